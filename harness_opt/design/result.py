"""What a redesign gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.design.explanations import Price, Relaxation
from harness_opt.design.robustness import Robustness
from harness_opt.design.sqp import Step
from harness_opt.design.trade_off import TradeOff
from harness_opt.errors import Status
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem
from harness_opt.model.results import LimitResult, Motion, notebook_html


@dataclass(frozen=True)
class VariableResult:
    """One design variable before and after, with its bounds, in the unit of its key."""

    before: float
    after: float
    lower: float
    upper: float


@dataclass(frozen=True)
class AtBound:
    """A design variable that stands at one of its bounds; ``side`` is "lower" or "upper"."""

    variable: str
    side: str

    def __str__(self) -> str:
        """Return it in words: ``lead.length at its upper bound``."""
        return f"{self.variable} at its {self.side} bound"


@dataclass(frozen=True)
class Redesign:
    """What a redesign found.

    Args:
        problem: the redesigned problem; ``harness_opt.write_problem`` writes it.
        original: the problem it came from.
        motion: of the redesigned problem, on twice the frames and twice the elements.
        clearances: of that motion.
        limits: rows of that motion; all margins are >= 0 where ``ok``.
        limits_before: rows of the original design; None where no shape joins its clamps.
        motion_before: of the original design.
        variables: before and after, by name.
        iterations: quadratic programs solved.
        looked_at: designs simulated.
        history: of the iterations.
        active: what holds the design where it is: limits, and variables at a bound.
        short: by how much cables were drawn too short for their clamps, m, by name.
        optimal: whether all limits hold and no small change promises a better design: the conditions of first order.
        moved: what did not stand where the design may begin, by name: where it stood, and where it was moved to first.
        relaxations: where no design holds all limits, what giving way in one of them or in one bound would do.
        relaxations_together: what giving way in two would do, where none alone does.
        prices: where all hold, what those cost that hold the design where it is.
        feasible: whether all limits hold.
        status: OK, or why a design could not be simulated.
        message: for the user; empty where all is well.
        timing: seconds by phase.
        trade_off: of the two quantities that were asked for; None where none were.
        without: optional clips that it does without, "CABLE.CLIP".
        robust: how it fares within the tolerances of the problem; None where that states none.
    """

    problem: Problem
    original: Problem
    motion: Motion
    clearances: ClearanceResult
    limits: tuple[LimitResult, ...]
    limits_before: tuple[LimitResult, ...] | None
    motion_before: Motion
    variables: Mapping[str, VariableResult]
    iterations: int
    history: tuple[Step, ...]
    active: tuple[LimitId | AtBound, ...]
    moved: Mapping[str, tuple[float, float]]
    relaxations: tuple[Relaxation, ...]
    prices: tuple[Price, ...]
    feasible: bool
    looked_at: int = 0
    short: Mapping[str, float] = field(default_factory=dict)
    optimal: bool = False
    relaxations_together: tuple[tuple[Relaxation, Relaxation], ...] = ()
    status: Status = Status.OK
    message: str = ""
    timing: Mapping[str, float] = field(default_factory=dict)
    trade_off: TradeOff | None = None
    robust: Robustness | None = None
    without: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return one line."""
        told = "all limits hold" if self.feasible and self.ok else self.message or "not all limits hold"
        moved = [f"{n} {v.before:.6g} -> {v.after:.6g}" for n, v in self.variables.items() if v.after != v.before]
        return f"<Redesign: {told}; {', '.join(moved) or 'nothing changed'}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the verdict, the limits, a small picture."""
        return notebook_html(self)

    @property
    def violation(self) -> float:
        """The largest shortfall of a limit over its scale; 0 where all hold."""
        cables = self.problem.cables
        shares = (-row.margin / row.scale(cables[row.cable].cable.radius) for row in self.limits)
        return max([0.0, *shares])

    @property
    def ok(self) -> bool:
        """True where every shape was found and every limit holds."""
        return self.status.ok and self.feasible


@dataclass(frozen=True)
class Earlier:
    """A redesign that was interrupted, to go on from.

    Args:
        values: of its best design, by name.
        history: its iterations.
    """

    values: Mapping[str, float]
    history: tuple[Step, ...] = ()

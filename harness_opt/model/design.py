"""What must hold, what a redesign may change, and what is sought."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from harness_opt.model.tolerances import Tolerance

Minimise = Literal["change", "length"]


@dataclass(frozen=True)
class Limits:
    """What must hold at every moment; None leaves a limit out.

    Args:
        clearance: between the cable's surface and parts, other cables, itself, m.
        bend_radius: smallest radius of the centreline, m.
        twist: largest twist per length, rad/m.
        clamp_force: of the clamps at both ends of a cable, N.
        clamp_moment: N m.
        clip_force: of every clip between them, N.
        clip_moment: N m.
    """

    clearance: float | None = None
    bend_radius: float | None = None
    twist: float | None = None
    clamp_force: float | None = None
    clamp_moment: float | None = None
    clip_force: float | None = None
    clip_moment: float | None = None


@dataclass(frozen=True)
class Variable:
    """A design variable with its bounds, absolute, in the unit of its key (m, or degrees for ``rotate_*_deg``).

    ``name`` is ``CABLE.length``, ``CABLE.start.position.x`` or ``CABLE.end.rotate_z_deg`` and the like.
    """

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class Coupling:
    """A quantity that follows a design variable: ``factor`` times its value plus ``offset``.

    ``name`` and ``leader`` are names as those of variables; values are absolute, in the units of their keys.
    """

    name: str
    leader: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def words(self) -> str:
        """As a problem file has it, behind an equals sign."""
        factor = "" if self.factor == 1.0 else f"{float(self.factor)!r} * "
        offset = f" {'-' if self.offset < 0 else '+'} {abs(float(self.offset))!r}" if self.offset else ""
        return f"{factor}{self.leader}{offset}"


@dataclass(frozen=True)
class Design:
    """What a redesign may change and what it prefers.

    Args:
        minimise: "change" (least change from the given design) or "length" (of all cables together).
        variables: the design variables.
        couplings: quantities that follow them.
        weights: of the change of a variable, by name, 1 where left out; 0 changes it for nothing.
        maximise: "margin" asks for the largest worst margin instead, each as a share of its limit; None does not.
        snaps: whether the cables may snap on the way.
        round_length, round_deg: to multiples of which a redesign rounds the variables that it moves and nothing else
            follows, m and degrees; 0 rounds nothing.
        seed: of the designs that it looks at.
    """

    minimise: Minimise = "change"
    variables: tuple[Variable, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    weights: Mapping[str, float] = field(default_factory=dict)
    maximise: Literal["margin"] | None = None
    snaps: bool = False
    round_length: float = 1e-4
    round_deg: float = 0.1
    seed: int = 0


@dataclass(frozen=True)
class Robust:
    """What a redesign holds its limits against, beside the nominal design.

    Args:
        tolerances: by key of the problem file.
        hold: "quantile": all limits hold for ``share`` of what is built; "corners": at every corner of the tolerances.
        share: between 0 and 1.
        samples: of the Monte Carlo study that verifies it; 0 leaves it out.
        seed: of these samples.
    """

    tolerances: Mapping[str, Tolerance] = field(default_factory=dict)
    hold: Literal["quantile", "corners"] = "quantile"
    share: float = 0.99
    samples: int = 500
    seed: int = 0

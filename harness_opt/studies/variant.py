"""One variant of a study, from its values to a row of plain numbers: what a worker does.

What a variant leaves to the next is what costs time to make and has no say in the result: the problem's tables, its
meshes, the CasADi functions. Same values, same row, whatever ran before.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from harness_opt.clearance.limits import all_limits
from harness_opt.clearance.measure import clearances
from harness_opt.design.redesign import redesign
from harness_opt.errors import CompilerError, ProblemError
from harness_opt.motion.simulate import simulate
from harness_opt.numerics.machine_code import compiled, wanted
from harness_opt.numerics.threads import one_at_a_time
from harness_opt.report.summary import verdict
from harness_opt.studies.shared_problem import Shared, local_problem, version

REFUSED = "refused"  # the values make no problem: a cable too short for its clamps, say
FAILED = "failed"  # something broke that should not have
LOST = "lost"  # its worker died with it, again and again
STATUSES = ("ok", "violated", "uncertain", "infeasible", "unsolved", REFUSED, FAILED, LOST)


@dataclass(frozen=True)
class VariantResult:
    """What came of one variant; plain numbers, in SI units but for twist, deg/m as in the file.

    Args:
        number: in the study, from 0.
        key: sha256 of all that the result depends on.
        values: of the varied quantities, by key.
        status: "ok", "violated", "uncertain", "infeasible" or "unsolved" as in a summary; "refused" where the values
            make no problem; "failed" or "lost" where the run itself broke.
        reason: for the user; empty where all is well.
        frames: solved.
        snaps: how often a cable jumped to another shape.
        stable: whether every frame is.
        worst_limit: the limit with the smallest margin in its own scale; None where there is none.
        worst_margin: that margin, as a share of the limit (of a clearance: and the cable's radius); < 0 is violated.
        margins, worst: by limit, such as "clearance.lead.bracket".
        after: of a redesign: what became of the design variables, by name.
        seconds: that it took; no part of the table.
    """

    number: int
    key: str
    values: Mapping[str, Any]
    status: str
    reason: str = ""
    frames: int = 0
    snaps: int = 0
    stable: bool = False
    worst_limit: str | None = None
    worst_margin: float | None = None
    margins: Mapping[str, float] = field(default_factory=dict)
    worst: Mapping[str, float] = field(default_factory=dict)
    after: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def ok(self) -> bool:
        """True where every limit holds."""
        return self.status == "ok"


# --- one variant ---------------------------------------------------------------------------------------


@one_at_a_time
def run_variant(shared: Shared, number: int, values: Mapping[str, Any]) -> VariantResult:
    """Return what comes of one variant, whatever that is: no exception leaves but what ends the process.

    Args:
        shared: what all variants share.
        number: of the variant.
        values: of the varied quantities, by key.
    """
    key = shared.key(values)
    begin = time.perf_counter()
    try:
        if shared.version != version():
            found = f"found harness-opt {version()} on this worker, expected {shared.version}, as in the study"
            raise ProblemError(found)
        result = _run(shared, number, key, values)
    except ProblemError as error:
        # the problem's file is every variant's, and names no reason
        result = VariantResult(number, key, values, REFUSED, str(error).replace(f"{shared.file}: ", ""))
    except Exception as error:  # whatever breaks one variant is its row, and no reason to lose the others
        result = VariantResult(number, key, values, FAILED, f"{type(error).__name__}: {error}")
    return dataclasses.replace(result, seconds=time.perf_counter() - begin)


def run_compiled_variant(shared: Shared, number: int, values: Mapping[str, Any]) -> VariantResult:
    """Return what :func:`run_variant` does, by machine code where this worker can have it."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(CompilerError):  # as fast as it gets here; the results are the same
            stack.enter_context(compiled())
        return run_variant(shared, number, values)


def variant_runner() -> Callable[[Shared, int, Mapping[str, Any]], VariantResult]:
    """Return what runs a variant on a worker, by machine code where that is wanted here."""
    return run_compiled_variant if wanted() else run_variant


def _run(shared: Shared, number: int, key: str, values: Mapping[str, Any]) -> VariantResult:
    """Simulate or redesign one variant.

    Raises:
        ProblemError: the values make no problem.
    """
    local = local_problem(shared)
    problem = local.problem(values)
    if shared.command == "redesign":
        result: Any = redesign(problem, throw=False)
        motion, rows = result.motion, result.limits
        after = {name: variable.after for name, variable in result.variables.items()}
    else:
        result = motion = simulate(problem, throw=False)
        rows, after = all_limits(motion.problem, motion, clearances(motion, local.scene(problem))), {}
    known = [row for row in rows if math.isfinite(row.worst)]  # a cable that never comes near itself has no margin
    shares = {row.id: row.margin / row.scale(problem.cables[row.cable].cable.radius) for row in known}
    worst = min(shares, key=shares.__getitem__, default=None)
    return VariantResult(
        number=number,
        key=key,
        values=values,
        status=verdict(result, rows),
        reason=result.message,
        frames=len(motion.motion),
        snaps=len(motion.snaps),
        stable=bool(motion.cables) and all(bool(cable.stable.all()) for cable in motion.cables.values()),
        worst_limit=None if worst is None else str(worst),
        worst_margin=None if worst is None else shares[worst],
        margins={str(row.id): row.id.kind.from_si * row.margin for row in known},
        worst={str(row.id): row.id.kind.from_si * row.worst for row in known},
        after=after,
    )

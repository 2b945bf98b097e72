"""What a redesign found, for other programs: its part of the summary."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from harness_opt.files.summary import (
    ClampEntry,
    PriceEntry,
    RedesignEntry,
    RelaxationEntry,
    RobustEntry,
    StepEntry,
    VariableEntry,
    WithinEntry,
    YieldEntry,
    key_in_file_units,
    limit_entry,
)
from harness_opt.model import design_variables
from harness_opt.model.cable import End
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.numerics import rotations

if TYPE_CHECKING:
    from harness_opt.design.explanations import Price, Relaxation
    from harness_opt.design.result import Redesign
    from harness_opt.design.robustness import Robustness, Within, Yield
    from harness_opt.design.sqp import Step


def redesign_summary(result: Motion | Redesign) -> RedesignEntry:
    """Return the part of a summary that is about the redesign.

    Args:
        result: a redesign, or the motion of the design given where that could not be simulated.
    """
    from harness_opt.report.trade_off_files import trade_off_summary  # a simulation needs none of the rooms behind it

    if isinstance(result, Motion):  # no other design was looked for
        problem = result.problem
        given = zip(problem.design.variables, design_variables.values(problem), strict=True)
        return RedesignEntry(
            variables={
                v.name: VariableEntry(before=float(at), after=None, lower=v.lower, upper=v.upper) for v, at in given
            },
            iterations=0,
            looked_at=0,
            violation=None,
            limits_before=None,
            active=[],
        )
    design = result.original.design
    entry = RedesignEntry(
        variables={
            name: VariableEntry(before=v.before, after=v.after, lower=v.lower, upper=v.upper)
            for name, v in result.variables.items()
        },
        goal=design.maximise or design.minimise,
        coupled={coupling.name: coupling.words for coupling in design.couplings},
        moved_inside={name: {"from": a, "to": b} for name, (a, b) in result.moved.items()},
        iterations=result.iterations,
        looked_at=result.looked_at,
        too_short=dict(result.short),
        optimal=result.optimal,
        violation=result.violation,
        limits_before=None if result.limits_before is None else [limit_entry(row) for row in result.limits_before],
        active=[str(held) for held in result.active],
        bows={
            name: list(run.bow)
            for name, run in result.problem.cables.items()
            if run.bow is not None and run.bow != result.original.cables[name].bow
        },
        clamps=list(_clamps(result.original, result.problem)),
        in_the_way=[_relaxation(found) for found in result.relaxations],
        in_the_way_together=[(_relaxation(a), _relaxation(b)) for a, b in result.relaxations_together],
        costs=[_price(found) for found in result.prices],
        history=[_step(step) for step in result.history],
    )
    if result.robust is not None:
        entry["robust"] = _robust(result.robust)
    if result.trade_off is not None:
        entry["pareto"] = trade_off_summary(result.trade_off)
    return entry


def _clamps(drawn: Problem, problem: Problem) -> Iterator[ClampEntry]:
    """Yield the clamps of ``problem`` that do not stand as ``drawn``."""
    for name, run in problem.cables.items():
        for side, old in (("start", drawn.cables[name].start), ("end", drawn.cables[name].end)):
            end: End = getattr(run, side)
            if end != old:
                yield ClampEntry(
                    name=f"{name}.{side}",
                    body=end.body,
                    position=None if end.position is None else list(end.position),
                    direction=None if end.frame is None else rotations.tangent(np.asarray(end.frame)).tolist(),
                    quaternion=None if end.quaternion is None else list(end.quaternion),
                )


def _step(step: Step) -> StepEntry:
    return StepEntry(
        aim=step.aim,
        objective=step.objective,
        margin=step.margin,
        limit=None if step.limit is None else str(step.limit),
        amount=step.amount,
        trust=step.trust,
        step=step.step,
        accepted=step.accepted,
    )


def _robust(found: Robustness) -> RobustEntry:
    return RobustEntry(
        hold=found.hold,
        asked=found.asked,
        holds=found.holds,
        rounds=found.rounds,
        before=None if found.before is None else _within(found.before),
        after=None if found.after is None else _within(found.after),
        yield_before=None if found.yield_before is None else _yield(found.yield_before),
        yield_after=None if found.yield_after is None else _yield(found.yield_after),
    )


def _within(found: Within) -> WithinEntry:
    by_limit, nominal, allowances = (
        {str(limit): value for limit, value in values.items()}
        for values in (found.by_limit, found.nominal, found.allowances)
    )
    return WithinEntry(
        share=found.share, corner=found.corner, by_limit=by_limit, nominal=nominal, allowances=allowances
    )


def _yield(found: Yield) -> YieldEntry:
    return YieldEntry(
        share=found.share, samples=found.samples, error=found.error, failures=found.failures, linear=found.linear
    )


def _relaxation(found: Relaxation) -> RelaxationEntry:
    kind, unit = key_in_file_units(found.kind)
    return RelaxationEntry(
        key=found.key,
        kind=kind,
        part=found.part,
        cable=found.cable,
        value=unit * found.value,
        share=found.share,
        estimate=unit * found.estimate,
        enough=None if found.enough is None else unit * found.enough,
        variables=dict(found.variables),
    )


def _price(found: Price) -> PriceEntry:
    kind, unit = key_in_file_units(found.kind)
    return PriceEntry(
        key=found.key,
        kind=kind,
        part=found.part,
        cable=found.cable,
        value=unit * found.value,
        saves=found.saves / unit,
        of=found.of,
        buys={variable: unit * float(rate) for variable, rate in found.buys.items()},
    )

"""What to say about a redesign: what changed, stands in the way and costs, in words; its part of a summary."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from harness_opt.files.summary import (
    ClampEntry,
    PriceEntry,
    RedesignEntry,
    RelaxationEntry,
    RobustEntry,
    StepEntry,
    Summary,
    VariableEntry,
    WithinEntry,
    YieldEntry,
    key_in_file_units,
    limit_entry,
)
from harness_opt.model import design_variables
from harness_opt.model.ends import End
from harness_opt.model.limits import DEGREES, KIND_OF_KEY, MILLIMETRES, Unit, spoken
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.numerics import rotations

if TYPE_CHECKING:
    from harness_opt.design.explanations import Price, Relaxation
    from harness_opt.design.result import Redesign
    from harness_opt.design.robustness import Robustness, Within, Yield
    from harness_opt.design.sqp import Step

LEAST_BOUGHT = 0.05  # of what the best variable buys, in its unit: less is not worth saying
TRADES = 2  # variables named for each limit
SAVED = {"change": ("{:.2g} % of the change", 100.0), "length": ("{:.2g} mm of length", 1e3)}


def changes(summary: Summary) -> str:
    """Return the variables before and after, a line each, and where the clamps that moved stand, as CAD wants it."""
    found = summary.get("redesign")
    if found is None:
        return ""
    lines = []
    for name, variable in found["variables"].items():
        after = "-" if variable["after"] is None else f"{variable['after']:.6g}"
        unit = "deg" if name.endswith("_deg") else "m"
        bounds = f"[{variable['lower']:g}, {variable['upper']:g}]"
        lines.append(f"{name}: {variable['before']:.6g} -> {after} {unit}, within {bounds}")
    for name, bow in found.get("bows", {}).items():
        lines.append(
            f"{name}.bow: to ({', '.join(f'{x:.3g}' for x in bow)}), the side to which it is laid at the start"
        )
    return "\n".join([*lines, *(clamp_words(clamp) for clamp in found.get("clamps", []))])


def clamp_words(clamp: ClampEntry) -> str:
    """Return where a clamp stands: ``lead.end in arm: at (30, 0, 18) mm, direction (1, 0, 0)``."""
    parts = []
    if clamp["position"] is not None:
        parts.append(f"at ({', '.join(f'{1e3 * x:.6g}' for x in clamp['position'])}) mm")
    if clamp["direction"] is not None:
        parts.append(f"direction ({', '.join(f'{x:.5g}' for x in clamp['direction'])})")
    return f"{clamp['name']} in {clamp['body']}: {', '.join(parts)}"


def redesign_words(summary: Summary) -> Iterator[str]:
    """Give what there is to say about a redesign beside its limits, a sentence each; nothing about a simulation."""
    found = summary.get("redesign")
    if found is None:
        return
    if found.get("without"):
        yield f"Optional clips that it does without: {', '.join(found['without'])}."
    for name, moved in found.get("moved_inside", {}).items():
        unit = _unit(name)
        a, b = (f"{unit.factor * moved[key]:.6g} {unit.name}" for key in ("from", "to"))
        why = "where what it follows puts it" if name in found["coupled"] else "inside its bounds"
        yield f"{name} stood at {a}; the redesign began at {b}, {why}."
    for name, by in found.get("too_short", {}).items():
        words = f"was drawn {1e3 * by:.1f} mm too short to reach its clamps; the redesign began where it does"
        yield f"Cable {spoken(name)} {words}."
    if summary["status"] == "ok" and not found.get("optimal", True):
        yield "A small further step might change less: the search ended before the conditions of an optimum held."
    yield from _ways_out(found.get("in_the_way", []), found.get("in_the_way_together", []))
    for cost in found.get("costs", []):
        yield from _cost(cost)
    yield from _robust(found.get("robust"))
    curve = found.get("pareto")
    if curve is not None:
        held = sum(point["verified"] for point in curve["points"])
        yield f"{held} verified designs trade {curve['first']} for {curve['second']}: see pareto.csv."


def _unit(key: str, kind: str = "") -> Unit:
    """Return the unit shown of a limit of ``kind``, or of the bound or variable ``key``."""
    if kind in KIND_OF_KEY:
        return KIND_OF_KEY[kind].unit
    return DEGREES if key.endswith("_deg") else MILLIMETRES


def _what(entry: RelaxationEntry | PriceEntry) -> str:
    """Return what a relaxation or a cost is about: ``bend radius``, ``clearance to housing``, ``lead.length``."""
    if entry["kind"] not in KIND_OF_KEY:
        return entry["key"].removeprefix("design.variables.")
    words = KIND_OF_KEY[entry["kind"]].words
    if entry["cable"] is not None:
        return f"{words} of {spoken(entry['cable'])}"
    return words if entry["part"] is None else f"{words} to {entry['part']}"


def _ways_out(
    entries: Sequence[RelaxationEntry], together: Sequence[tuple[RelaxationEntry, RelaxationEntry]]
) -> Iterator[str]:
    """Say what stands in each other's way, and what giving way in one limit or bound would do, or in two."""
    if len(entries) > 1:
        yield f"In each other's way: {', '.join(dict.fromkeys(_what(one) for one in entries))}."
    ways = [_way_out(entry) for entry in entries if entry["enough"] is not None]
    if ways:
        yield f"{'Either of these' if len(ways) > 1 else 'This'} alone would do: {'; '.join(ways)}."
    rest = [_what(entry) for entry in entries if entry["enough"] is None]
    if rest:
        yield f"Giving way in one of these alone would not do: {'; '.join(dict.fromkeys(rest))}."
    if together:
        pairs = (" and ".join(_way_out(entry) for entry in pair) for pair in together)
        yield f"Two together would do: {'; or '.join(pairs)}."


def _way_out(entry: RelaxationEntry) -> str:
    """Say what value of one limit or bound would do; one must have been found."""
    unit, enough = _unit(entry["key"], entry["kind"]), entry["enough"] or 0.0
    change = enough - entry["value"]
    more = f"{abs(unit.factor * change):.3g} {unit.name} {'more' if change > 0 else 'less'}"
    if entry["kind"] in KIND_OF_KEY:
        return f"{more} {_what(entry)} ({entry['key']} = {enough:.6g})"
    side = "up" if entry["kind"] == "upper" else "down"
    return f"{more} {_what(entry)} (bound {side} to {enough:.6g})"


def _cost(entry: PriceEntry) -> Iterator[str]:
    """Say what a limit or bound costs, and what buys it."""
    unit, kind = _unit(entry["key"], entry["kind"]), KIND_OF_KEY.get(entry["kind"])
    words, share = SAVED.get(entry["of"], ("{:.2g} % of the worst margin's limit", 100.0))
    saved = words.format(share * entry["saves"] * unit.step / unit.factor)
    gains = "add" if entry["of"] == "margin" else "save"
    # loads and twist hold below their limits, bounds give way to their own side
    more = entry["kind"] == "upper" if kind is None else not kind.is_least
    yield f"{unit.step:g} {unit.name} {'more' if more else 'less'} {_what(entry)} would {gains} {saved}."
    yield from _bought(entry)


def _bought(entry: PriceEntry) -> Iterator[str]:
    unit = _unit(entry["key"], entry["kind"])
    steps = {name: rate / _unit(name).factor * unit.factor for name, rate in entry["buys"].items()}
    best = sorted(steps, key=lambda name: -abs(steps[name]))[:TRADES]
    told = [
        f"1 {_unit(name).name} {'more' if steps[name] > 0 else 'less'} {name} buys {abs(steps[name]):.2g} {unit.name}"
        for name in best
        if abs(steps[name]) > LEAST_BOUGHT * abs(steps[best[0]])
    ]
    if told:
        yield f"Of {_what(entry)}, {', '.join(told)}."


def _robust(found: RobustEntry | None) -> Iterator[str]:
    """Say how a design fares within tolerances."""
    if found is None or found["after"] is None:
        return
    held = "hold" if found["holds"] else "do not hold"
    where = "at every corner" if found["hold"] == "corners" else f"for {_share(found['asked'])} of what is built"
    yield f"Within the tolerances all limits {held} {where}, by linearised margins."
    shares = ["?" if within is None else _share(within["share"]) for within in (found["before"], found["after"])]
    yield f"Yield by linearised margins: {' -> '.join(shares)}."
    for words, entry in (("Yield before", found["yield_before"]), ("Yield after", found["yield_after"])):
        if entry is not None:
            share = f"{_share(entry['share'])} +- {100.0 * entry['error']:.1f} %"
            linear = _share(entry["linear"])
            yield f"{words}, {entry['samples']} samples simulated: {share}; by linearised margins: {linear}."


def _share(share: float) -> str:
    return f"{100.0 * share:.1f} %"


# --- the part of the summary -----------------------------------------------------------------------------------------


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
    if result.without:
        entry["without"] = list(result.without)
    if result.robust is not None:
        entry["robust"] = _robust_entry(result.robust)
    if result.trade_off is not None:
        entry["pareto"] = trade_off_summary(result.trade_off)
    return entry


def _clamps(drawn: Problem, problem: Problem) -> Iterator[ClampEntry]:
    """Yield the clamps of ``problem`` that do not stand as ``drawn``."""
    for name, run in problem.cables.items():
        for side, old in drawn.cables[name].clamps.items():
            end: End = run.clamps[side]
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


def _robust_entry(found: Robustness) -> RobustEntry:
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

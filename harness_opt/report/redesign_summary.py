"""What a redesign found, as dicts and lists for its summary: variables, history, what is in the way, what limits cost.

Limits are in the words and the units of the problem file.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from harness_opt.model import design_variables
from harness_opt.model.results import LimitResult, Motion

if TYPE_CHECKING:
    from harness_opt.design.nominal import Redesign
    from harness_opt.design.prices import Price
    from harness_opt.design.relaxations import Relaxation

Json = dict[str, Any]
LimitWords = Callable[[LimitResult], Json]

FILE_WORDS = {"twist": ("twist_deg_per_m", math.degrees(1.0))}  # name and unit in the file of what is in rad here


def redesign_summary(result: Motion | Redesign, limit_words: LimitWords) -> Json:
    """Return the part of a summary that is about the redesign.

    Args:
        result: a redesign, or the motion of the design given where that could not be simulated.
        limit_words: a limit's row as the summary has it.
    """
    from harness_opt.report.trade_off_files import trade_off_summary  # a simulation needs none of the rooms behind it

    if isinstance(result, Motion):  # no other design was looked for
        problem = result.problem
        given = zip(problem.design.variables, design_variables.values(problem), strict=True)
        bounds = {v.name: (float(at), None, v.lower, v.upper) for v, at in given}
        return {
            "variables": {
                name: dict(zip(("before", "after", "lower", "upper"), values, strict=True))
                for name, values in bounds.items()
            },
            "iterations": 0,
            "limits_before": [],
            "active": [],
        }
    design = result.original.design
    return {
        "variables": {name: dataclasses.asdict(found) for name, found in result.variables.items()},
        "goal": design.maximise or design.minimise,
        "coupled": {coupling.name: coupling.words for coupling in design.couplings},
        "moved_inside": {name: {"from": a, "to": b} for name, (a, b) in result.moved.items()},
        "iterations": result.iterations,
        "limits_before": [limit_words(row) for row in result.limits_before],
        "active": list(result.active),
        "in_the_way": [_relaxation(found) for found in result.relaxations],
        "costs": [_price(found) for found in result.prices],
        "history": [dataclasses.asdict(step) for step in result.history],
        **({} if result.robust is None else {"robust": dataclasses.asdict(result.robust)}),
        **({} if result.trade_off is None else {"pareto": trade_off_summary(result.trade_off)}),
    }


def _relaxation(found: Relaxation) -> Json:
    name, unit = FILE_WORDS.get(found.kind, (found.kind, 1.0))
    entry = dataclasses.asdict(found) | {"kind": name, "key": found.key.replace(f".{found.kind}", f".{name}")}
    for value in ("value", "estimate", "enough"):
        entry[value] = None if entry[value] is None else unit * entry[value]
    return entry


def _price(found: Price) -> Json:
    name, unit = FILE_WORDS.get(found.kind, (found.kind, 1.0))
    entry = dataclasses.asdict(found) | {"kind": name, "key": found.key.replace(f".{found.kind}", f".{name}")}
    buys = {variable: unit * float(rate) for variable, rate in found.buys.items()}
    return entry | {"value": unit * found.value, "saves": found.saves / unit, "buys": buys}

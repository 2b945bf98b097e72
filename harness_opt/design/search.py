"""The search for the best design over the bounds, and its verification.

A descent from the drawn design comes first; then a look at many designs, and descents from the best of them. What a
verification shows to be short is asked for in addition, and the search goes on.

Where no design holds every limit, the search ends at the least violation: the largest shortfall of a limit over its
scale, as it is reported. First that of the worst limits is made as small as can be, then that of the others; then, with
every shortfall kept at what it came to, the design goes as near to the drawn one as that allows, so that what has
nothing to do with the violation stays as drawn.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from harness_opt.design.evaluation import GUARD, HELD, SEARCH_STRIDE, Evaluated, Evaluator
from harness_opt.design.objective import Objective
from harness_opt.design.sqp import Note, descend, stationary
from harness_opt.design.starts import coarse_stride, looks, promising
from harness_opt.design.verification import Verified, ask_for_more, rounded, strays, verify
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem
from harness_opt.model.spans import clamp_way
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

VERIFICATIONS = 4
ROUNDS = 3  # of looks, where none leads to a design that holds
DESCENTS = 3  # from the best designs of a look
HALVINGS = 4  # of the way back to the drawn design: to a sixteenth of it
UPRIGHT = 0.9  # of the way between the clamps is along z: there is no up across it
TRIED = 3  # designs met, the least violated ones, that are simulated on all frames
SAME = 0.01  # of a scale: designs whose limits fall short by as much in all are equals
NEAR = 2.0 * GUARD  # a margin that near to what it is asked for stands in the way
WORST = 0.95  # of the largest shortfall: limits with that much are the worst ones


def search(evaluate: Evaluator, objective: Objective, trial: Evaluated, note: Note, *, near: bool = False) -> Evaluated:
    """Return the best design found from ``trial``, on all frames.

    The search uses half of the frames, and all of them to end with. A design that is ``near`` the end already needs no
    more than all frames.
    """
    if near:
        best = descend(evaluate, objective, trial, 1, note)
        if objective.held(best):
            return best
    met = [trial]
    best = _first_descent(evaluate, objective, trial, note)
    best = _beside(evaluate, objective, best, note, met)
    if not objective.held(best):
        best = _redeemed(evaluate, objective, best, note, SEARCH_STRIDE)
    full = evaluate(best.values, best)
    if full is not None:
        best = _descent(evaluate, objective, full, note, stride=1)
    return best if objective.held(best) else least_violation(evaluate, objective, [*met, best], note)


def _first_descent(evaluate: Evaluator, objective: Objective, trial: Evaluated, note: Note) -> Evaluated:
    """Return where the descent from ``trial`` ends, led back to the side that a cable came in by, or aside.

    Where that does not end well, the nearest faces may: they lead out of thick parts.
    """
    best = descend(evaluate, objective, trial, SEARCH_STRIDE, note)
    if objective.held(best):
        return best
    by_faces = evaluate.by_nearest_faces()
    plain = by_faces(trial.values, trial)
    if plain is not None and not np.array_equal(plain.rows.margin, trial.rows.margin):
        other = descend(by_faces, objective, plain, SEARCH_STRIDE, note)
        best = other if objective.held(other) else best
    return best


def _descent(
    evaluate: Evaluator, objective: Objective, design: Evaluated, note: Note, *, stride: int = SEARCH_STRIDE
) -> Evaluated:
    """Return the best design met from ``design`` down, and where it is not stationary from nearer to the drawn one."""
    best = descend(evaluate, objective, design, stride, note)
    if not objective.held(best):
        best = _redeemed(evaluate, objective, best, note, stride)
    if objective.held(best) and not stationary(objective, best):
        nearer = _back(evaluate, objective, best, stride)
        best = best if nearer is best else descend(evaluate, objective, nearer, stride, note)
    return best


def _redeemed(evaluate: Evaluator, objective: Objective, design: Evaluated, note: Note, stride: int) -> Evaluated:
    """Return the design of least violation near ``design``, and where that holds all limits the best from there.

    A cable deep inside a part is pushed out through the nearest face, which may be one that no design reaches.
    """
    least = descend(evaluate, objective.least_violation(), design, stride, note)
    return descend(evaluate, objective, least, stride, note) if objective.held(least) else least


def _back(evaluate: Evaluator, objective: Objective, design: Evaluated, stride: int) -> Evaluated:
    """Return a design on the way from ``design`` back to the one that changes count from, as near to that as holds."""
    best, low, high = design, 0.0, 1.0
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        values = objective.centre + share * (design.values - objective.centre)
        trial = evaluate(values, best, stride=stride)
        if trial is not None and objective.better(trial, best):
            best, high = trial, share
        else:
            low = share
    return best


def _beside(evaluate: Evaluator, objective: Objective, best: Evaluated, note: Note, met: list[Evaluated]) -> Evaluated:
    """Return the best design that looks over the bounds lead to, or ``best``; what they lead to is added to ``met``."""
    for number in range(ROUNDS):
        before = best
        for look in promising(objective, looks(evaluate, objective, best, number, [*met, best]), best, DESCENTS):
            if objective.held(best) and not objective.could_beat(best, look.values):
                continue
            scout = evaluate(look.values, None, stride=SEARCH_STRIDE)  # as its file will be: a look may have strayed
            if scout is None:
                continue
            met.append(scout)
            end = _descent(evaluate, objective, scout, note)
            met.append(end)
            best = end if objective.better(end, best) else best
        if objective.held(best) and (best is before or objective.held(before)):
            break
    return best


def verified(evaluate: Evaluator, objective: Objective, design: Evaluated, note: Note) -> Verified:
    """Search from ``design``, round and verify the end, ask for what is short there, and search again."""
    for attempt in range(VERIFICATIONS):
        design = search(evaluate, objective, design, note, near=attempt > 0 and not evaluate.cold)
        design = _unconcerned(evaluate, objective, design)
        found = _verify_rounded(evaluate, objective, design)
        if found.holds(snaps=objective.snaps) or not objective.held(design) or attempt == VERIFICATIONS - 1:
            break
        if found.strayed:
            # of two shapes of one pose the search followed another one than a start from nothing finds
            evaluate.cold = True
        else:
            ask_for_more(evaluate, found)
        again = evaluate(design.values, design)
        if again is None:
            break
        design = again
    return found


def _unconcerned(evaluate: Evaluator, objective: Objective, design: Evaluated) -> Evaluated:
    """Return ``design`` with each variable back as drawn that no limit in its way knows of, where as much holds then.

    A descent ends once it promises little of the whole objective, and such a variable may have little part in that.
    """
    in_the_way = design.rows.rate[design.rows.margin < NEAR]
    alone = ~np.any(in_the_way, axis=0) & (objective.weights > 0.0)
    values = np.where(alone, objective.centre, design.values)
    trial = evaluate(values, design) if np.any(values != design.values) else None
    if trial is None or objective.violation(trial) > max(HELD, objective.violation(design) + HELD):
        return design
    return trial


def _verify_rounded(evaluate: Evaluator, objective: Objective, design: Evaluated) -> Verified:
    """Return ``design`` rounded and verified; as it is where that does not hold and it may."""
    values = rounded(evaluate.problem, objective, design)
    near = evaluate(values, design, quick=True) if (values != design.values).any() else None
    found = verify(evaluate, design) if near is None else verify(evaluate, near, design)
    if near is None or found.holds(snaps=objective.snaps) or not objective.held(design):
        return found
    exact = verify(evaluate, design)
    return exact if exact.holds(snaps=objective.snaps) else found


def otherwise_bowed(
    evaluate: Evaluator, objective: Objective, found: Verified, note: Note
) -> tuple[Evaluator, Verified]:
    """Return a design that holds with one cable bowed to another side than drawn, or ``found`` where there is none.

    Args:
        evaluate: of the problem as drawn.
        objective: what is sought.
        found: where its search ended.
        note: told of every iteration.
    """
    seen: list[tuple[Evaluated, Evaluator]] = []
    drawn = _coarse(evaluate, objective.centre)
    for bowed in _bowed(evaluate.problem):
        other = evaluate.of(bowed)
        look = _coarse(other, objective.centre)
        known = [one for one in (drawn, *(one for one, _ in seen)) if one is not None]
        if look is not None and all(strays(one.motion, look.motion) for one in known):
            seen.append((look, other))
    for look, other in sorted(seen, key=lambda one: objective.merit(one[0]))[:DESCENTS]:
        scout = other(look.values, look, stride=SEARCH_STRIDE)
        end = None if scout is None else _descent(other, objective, scout, note)
        full = None if end is None or not objective.held(end) else other(end.values, end)
        if full is not None:
            answer = verified(other, objective, full, note)
            if answer.holds(snaps=objective.snaps):
                return other, answer
    return evaluate, found


def _coarse(evaluate: Evaluator, values: Array) -> Evaluated | None:
    return evaluate(values, None, stride=coarse_stride(evaluate), quick=True)


def _bowed(problem: Problem) -> Iterator[Problem]:
    """Yield ``problem`` with one cable bowed across the way between its clamps: up, down, and to both sides."""
    for name, run in problem.cables.items():
        way = clamp_way(problem, name, np.zeros(1))
        if way is None:
            continue
        along = way[0] / max(float(np.linalg.norm(way)), 1e-12)
        up = np.eye(3)[2 if abs(along[2]) < UPRIGHT else 0]
        up = rotations.normalise(up - (up @ along) * along)
        for bow in (up, -up, np.cross(along, up), -np.cross(along, up)):
            yield dataclasses.replace(
                problem, cables={**problem.cables, name: dataclasses.replace(run, bow=tuple(bow.tolist()))}
            )


def least_violation(evaluate: Evaluator, objective: Objective, met: Sequence[Evaluated], note: Note) -> Evaluated:
    """Return the design of least violation.

    Args:
        evaluate: simulates designs.
        objective: what was sought.
        met: designs: where the search began, and others, to go on from the best of them.
        note: told of every iteration.
    """
    reporting = evaluate.reporting({})
    few = [met[0], *sorted(met[1:], key=lambda one: one.violation)[:TRIED]]
    known = [full for one in few if (full := reporting(one.values, one)) is not None]
    if not known:
        return met[0]
    best = _least(objective, known)
    best = _least(objective, [descend(reporting, objective.least_violation(), best, 1, note), *known])
    most = min(best.violation, *(one.violation for one in known))
    short = {limit: shortfall for limit, shortfall in best.shortfalls.items() if shortfall > HELD}
    worst = {limit: most for limit, shortfall in short.items() if shortfall >= WORST * most}
    if len(worst) < len(short):
        best = _kept(evaluate, objective.relaxing(frozenset(short) - frozenset(worst)), best, worst, note)
    best = _kept(evaluate, objective, best, {**best.shortfalls, **worst}, note)
    return evaluate(best.values, best) or best  # with what is asked for, and not what is allowed, in its margins


def _kept(
    evaluate: Evaluator, objective: Objective, best: Evaluated, shortfalls: Mapping[LimitId, float], note: Note
) -> Evaluated:
    """Return the best design for ``objective`` that is no more violated than ``best``, with ``shortfalls`` allowed."""
    keeping = evaluate.reporting(shortfalls)
    begin = keeping(best.values, best)
    if begin is None:
        return best
    end = descend(keeping, objective, begin, 1, note)
    return _least(objective, [end, best])


def _least(objective: Objective, designs: Sequence[Evaluated]) -> Evaluated:
    """Return the least violated of ``designs``; of those as violated the one whose limits fall short least in all.

    Among equals in that, too, the one with the least objective.
    """
    least = min(one.violation for one in designs)
    equals = [one for one in designs if one.violation <= least + HELD]

    def order(one: Evaluated) -> tuple[int, float]:
        in_all = sum(shortfall for shortfall in one.shortfalls.values() if shortfall > HELD)
        return round(in_all / SAME), objective.preference(one.values)

    return min(equals, key=order)

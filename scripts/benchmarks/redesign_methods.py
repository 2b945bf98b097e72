"""Is another method better than ours at finding the design of least change, by simulations spent and objective reached?

On 30 random scenes of ``redesign_family.py`` with one to four variables. All methods ask the same function: a design
simulated on half of the frames, with the worst margin of each limit and its derivatives. The reference is the best that
descents find from the best ten of 2,000 random designs. What a method ends at is judged on all frames, from nothing,
before any rounding: it has to hold what the redesign asks for.

    python scripts/benchmarks/redesign_methods.py [--quick] [--first 0] [--scenes 30] [--random 2000]
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import warnings
from collections.abc import Callable

import casadi
import numpy as np
import redesign_family as family
from scipy.optimize import Bounds, NonlinearConstraint, minimize

import harness_opt as ho
from harness_opt.design.evaluation import SEARCH_STRIDE, Evaluated, Evaluator
from harness_opt.design.objective import Objective, objective_of
from harness_opt.design.search import search
from harness_opt.design.sqp import SMALL, descend
from harness_opt.design.starts import beginning, coarse_stride, nearest
from harness_opt.numerics.quadratic_program import solve
from harness_opt.numerics.threads import one_thread
from harness_opt.parts.scene import load_scene

BEST = 10  # random designs that the reference descends from
KNOWN = 60  # of them, whose shapes the others start from: begun from nothing each would take five times as long
MOST = 60  # simulations that a peer may spend: five times what ours does on most scenes
FAR = 1e-3  # of the bounds' ranges: steps end there
CLOSE = 1.02  # times the reference's objective

Array = np.ndarray


def scene(number: int) -> family.Scene:
    """Return one of the family's scenes in turn; every sixth has four variables."""
    if number % 3 == 0:
        return family.thin_or_short(number // 3)
    if number % 3 == 1:
        return family.slotted(number // 3)
    found = family.feasible(number // 3)
    return found if number % 2 else _with_more(found)


def _with_more(found: family.Scene) -> family.Scene:
    """Return a scene with components of its clamps' places as further variables, four in all."""
    problem = found.problem
    run, variables = problem.cables["lead"], list(problem.design.variables)
    for name in ("lead.end.position.x", "lead.start.position.y", "lead.start.position.z", "lead.end.position.z"):
        if len(variables) < 4 and name not in {variable.name for variable in variables}:
            place = getattr(run, name.split(".")[1]).position["xyz".index(name[-1])]
            reach = 0.08 * run.cable.length
            variables.append(ho.Variable(name, place - reach, place + reach))
    design = dataclasses.replace(problem.design, variables=tuple(variables))
    return dataclasses.replace(found, problem=dataclasses.replace(problem, design=design))


class Spent(Exception):
    """A method has spent the simulations that it may."""


class Posed:
    """The common function: least change over the unit cube, with the worst margin of each limit, counted."""

    def __init__(self, problem: ho.Problem):
        self.evaluate = Evaluator(problem, load_scene(problem), "gauss-newton", None)
        self.objective = objective_of(problem)
        self.first = beginning(self.evaluate, self.objective, self.objective.centre).first
        self.limits = [*self.first.shortfalls, None]  # and that no cable is too short
        self.begin = self.unit(self.first.values)
        self.met = [self.first]

    def unit(self, values: Array) -> Array:
        """Return ``values`` (k,) in the unit cube."""
        return (values - self.objective.lower) / self.objective.range

    def values(self, unit: Array) -> Array:
        """Return the values (k,) of a point of the unit cube, which a method may overstep a little."""
        return self.objective.lower + np.clip(unit, 0.0, 1.0) * self.objective.range

    def change(self, unit: Array) -> float:
        """Return the objective."""
        return self.objective.preference(self.values(unit))

    def slope(self, unit: Array) -> Array:
        """Return its derivatives (k,)."""
        return self.objective.weights * (self.values(unit) - self.objective.centre) / self.objective.range

    def seen(self, unit: Array) -> tuple[Array, Array]:
        """Return the worst margin of each limit (m,) and its derivatives (m, k); far from held where none is known."""
        values = self.values(unit)
        design = next((one for one in self.met if np.array_equal(one.values, values)), None)
        if design is None:
            if self.evaluate.count >= MOST:
                raise Spent
            near = nearest(self.objective, values, self.met)
            design = self.evaluate(values, near, stride=SEARCH_STRIDE)
            if design is None:
                return np.full(len(self.limits), -10.0), np.zeros((len(self.limits), len(values)))
            self.met.append(design)
        margin, rate = np.ones(len(self.limits)), np.zeros((len(self.limits), len(values)))
        for row in np.argsort(-design.rows.margin):  # the worst one comes last
            at = self.limits.index(design.rows.limit[row])
            margin[at], rate[at] = design.rows.margin[row], design.rows.rate[row] * self.objective.range
        # as the redesign does: of a design with snaps every margin is worse
        return margin - self.objective.violation(design) * (len(design.motion.snaps) > 0), rate


# --- methods: each returns the values (k,) that it ends at -----------------------------------------------


def ours(posed: Posed) -> Array:
    """What a redesign does before it rounds and verifies."""
    return search(posed.evaluate, posed.objective, posed.first, lambda *_: None).values


def slsqp(posed: Posed) -> Array:
    """SciPy's sequential least squares programming, from the drawn design."""
    limits = {"type": "ineq", "fun": lambda x: posed.seen(x)[0], "jac": lambda x: posed.seen(x)[1]}
    answer = minimize(
        posed.change, posed.begin, jac=posed.slope, bounds=Bounds(0.0, 1.0), constraints=limits, method="SLSQP",
        options={"ftol": 1e-8},
    )  # fmt: skip
    return posed.values(answer.x)


def cobyqa(posed: Posed) -> Array:
    """SciPy's COBYQA, which uses no derivatives, from the drawn design."""
    limits = NonlinearConstraint(lambda x: posed.seen(x)[0], 0.0, np.inf)
    answer = minimize(
        posed.change, posed.begin, bounds=Bounds(0.0, 1.0), constraints=limits, method="COBYQA",
        options={"maxfev": 10 * MOST, "initial_tr_radius": 0.25, "final_tr_radius": FAR},
    )  # fmt: skip
    return posed.values(answer.x)


def ipopt(posed: Posed) -> Array:
    """IPOPT on the linearised problem, again and again within a trust region that is halved where no step helps."""
    size, at, trust = len(posed.begin), posed.begin, 0.25
    centre = posed.unit(posed.objective.centre)
    margin, rate = posed.seen(at)

    def merit(unit: Array, margin: Array) -> float:
        return posed.change(unit) + 10.0 * max(0.0, -float(margin.min()))

    while trust > FAR:
        step, short = casadi.MX.sym("step", size), casadi.MX.sym("short")
        change = 0.5 * casadi.dot(posed.objective.weights, (at + step - centre) ** 2)
        held = margin + casadi.mtimes(casadi.DM(rate), step) + short
        problem = {"x": casadi.vertcat(step, short), "f": change + 10.0 * short, "g": held}
        solver = casadi.nlpsol("linearised", "ipopt", problem, {"ipopt.print_level": 0, "print_time": False})
        low, high = np.maximum(-at, -trust), np.minimum(1.0 - at, trust)
        answer = solver(lbx=[*low, 0.0], ubx=[*high, np.inf], lbg=0.0)
        moved = np.clip(at + np.asarray(answer["x"]).ravel()[:size], 0.0, 1.0)
        if np.max(np.abs(moved - at)) < FAR:
            break
        new_margin, new_rate = posed.seen(moved)
        if merit(moved, new_margin) < merit(at, margin):
            at, margin, rate = moved, new_margin, new_rate
        else:
            trust *= 0.5
    return posed.values(at)


def at_random(posed: Posed) -> Array:
    """The best of as many designs at random as a method may spend simulations."""
    random = np.random.default_rng(1)
    while True:
        posed.seen(random.random(len(posed.begin)))


METHODS: dict[str, Callable[[Posed], Array]] = {
    "ours": ours, "SLSQP": slsqp, "COBYQA": cobyqa, "IPOPT": ipopt, "at random": at_random,
}  # fmt: skip


# --- what they reach ------------------------------------------------------------------------------------


def reached(posed: Posed, values: Array) -> float:
    """Return the objective at ``values`` (k,), on all frames from nothing; infinite where a limit is missed.

    What is let pass of a limit is charged at its price, which may be a few per cent of a small change.
    """
    end = posed.evaluate(values, None)
    if end is None or not posed.objective.held(end):
        return np.inf
    program = posed.objective.program(end, SMALL)[0]
    price = float(solve(program).multipliers[~program.soft].sum())
    return posed.objective.value(end) + price * posed.objective.violation(end)


def reference(problem: ho.Problem, count: int) -> float:
    """Return the best objective of descents from the best ten of ``count`` random designs."""
    posed = Posed(problem)
    evaluate, objective = posed.evaluate, posed.objective
    random = np.random.default_rng(2).uniform(objective.lower, objective.upper, (count, len(posed.begin)))
    known: list[Evaluated] = [posed.first]
    looks: list[Evaluated] = []
    for place in random:
        near = nearest(objective, place, known)
        look = evaluate(place, near, stride=coarse_stride(evaluate), quick=True)
        if look is not None:
            known += [look] if len(known) < KNOWN else []
            looks.append(look if len(known) < KNOWN else look.without_shapes())
    best = np.inf
    for look in sorted(looks, key=objective.merit)[:BEST]:
        best = min(best, _descended(posed, objective, look))
    return best


def _descended(posed: Posed, objective: Objective, look: Evaluated) -> float:
    scout = posed.evaluate(look.values, None, stride=SEARCH_STRIDE)
    if scout is None:
        return np.inf
    low = descend(posed.evaluate, objective, scout, SEARCH_STRIDE, lambda *_: None)
    full = posed.evaluate(low.values, low)
    if full is None:
        return np.inf
    return reached(posed, descend(posed.evaluate, objective, full, 1, lambda *_: None).values)


@one_thread
def main() -> None:
    """Print a row a scene, with simulations and objective over the reference's, and what each method comes to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--scenes", type=int, default=30)
    parser.add_argument("--random", type=int, default=2000, help="designs of the reference")
    parser.add_argument("--quick", action="store_true", help="four scenes, 100 designs")
    wanted = parser.parse_args()
    if wanted.quick:
        wanted.scenes, wanted.random = 4, 100
    warnings.simplefilter("ignore")  # of the peers, about steps outside their bounds
    ratios: dict[str, list[float]] = {name: [] for name in METHODS}
    spent: dict[str, list[int]] = {name: [] for name in METHODS}
    print(f"{'scene':14}{'variables':>10}{'reference':>11}" + "".join(f"{name:>16}" for name in METHODS))
    for number in range(wanted.first, wanted.first + wanted.scenes):
        given = scene(number)
        least = reference(given.problem, wanted.random)
        row = f"{given.name:14}{len(given.problem.design.variables):10}{least:11.5f}"
        for name, method in METHODS.items():
            posed = Posed(given.problem)
            try:
                values = method(posed)
            except Spent:  # the best that it met counts
                values = min(posed.met, key=posed.objective.merit).values
            spent[name].append(posed.evaluate.count)
            ratios[name].append(reached(posed, values) / least if np.isfinite(least) else np.nan)
            row += f"{spent[name][-1]:6}{ratios[name][-1]:10.3f}"
        print(row, flush=True)
    for name, found in ratios.items():
        held, close = np.isfinite(found).sum(), np.sum(np.array(found) <= CLOSE)
        print(
            f"{name}: {held} of {len(found)} hold all limits, {close} within {100 * (CLOSE - 1):.0f} % of the "
            f"reference, worst {max(found):.3f}; {statistics.median(spent[name]):.0f} simulations in the median"
        )


if __name__ == "__main__":
    main()

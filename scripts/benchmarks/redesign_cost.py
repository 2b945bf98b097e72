"""What does a redesign cost, in simulations, and how does that grow with the number of design variables?

The cable of ``lift_arm`` is redesigned with its length alone, then with more and more components of its clamps' poses
as well, each time from the design as drawn. A simulation is what ``harness-opt simulate`` solves and certifies of it:
shapes, clearances, limits. All times are of the processor.

    python scripts/benchmarks/redesign_cost.py
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import harness_opt as ho

PROBLEM = Path(__file__).resolve().parents[2] / "problems" / "lift_arm" / "lift_arm.toml"
REPEATS = 3
SHIFT = 0.02  # m, by which positions may change
TURN = 20.0  # degrees, by which clamps may turn
MORE = (
    "end.position.x", "end.position.z", "start.rotate_x_deg", "end.rotate_x_deg", "start.position.x",
    "start.rotate_y_deg", "end.rotate_y_deg", "start.position.z", "end.position.y",
)  # fmt: skip
Answer = TypeVar("Answer")


def timed(run: Callable[[], Answer]) -> tuple[float, Answer]:
    """Return the least time of some runs, s, and what the last one gave."""
    seconds = []
    for _ in range(REPEATS):
        begin = time.process_time()
        answer = run()
        seconds.append(time.process_time() - begin)
    return min(seconds), answer


def with_variables(problem: ho.Problem, count: int) -> ho.Problem:
    """Return ``problem`` with its length and the first components of its clamps' poses as variables."""
    run = problem.cables["lead"]
    variables = list(problem.design.variables)
    for name in MORE[: count - 1]:
        side, _, component = name.partition(".")
        if component.startswith("rotate"):
            bounds = (-TURN, TURN)
        else:
            place = getattr(run, side).position["xyz".index(component[-1])]
            bounds = (place - SHIFT, place + SHIFT)
        variables.append(ho.Variable(f"lead.{name}", *bounds))
    return dataclasses.replace(problem, design=dataclasses.replace(problem.design, variables=tuple(variables)))


def main() -> None:
    """Print a table: variables, seconds, simulations' worth, iterations."""
    problem = ho.read_problem(PROBLEM)
    simulation, motion = timed(lambda: ho.simulate(problem))
    whole, _ = timed(lambda: ho.clearances(motion))
    print(f"simulate: {simulation:.2f} s for the shapes, {simulation + whole:.2f} s with certified clearances")
    print(
        f"{'variables':>9} {'s':>6} {'simulations':>12} {'with clearances':>16} {'iterations':>11} {'against one':>12}"
    )
    first = None
    for count in (1, 2, 5, 10):
        posed = with_variables(problem, count)
        seconds, design = timed(lambda posed=posed: ho.redesign(posed))
        first = first or seconds
        print(
            f"{count:9} {seconds:6.2f} {seconds / simulation:12.1f} {seconds / (simulation + whole):16.1f} "
            f"{design.iterations:11} {seconds / first:12.2f}{'' if design.ok else '  limits violated'}"
        )


if __name__ == "__main__":
    main()

"""Many threads, one answer: bit for bit that of one thread, whatever else runs and whatever ran before."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import harness_opt as ho
from oracles.flap import FLAP, put

THREADS = 4


def together(work: Callable[[int], Any], numbers: Sequence[int], threads: int = THREADS) -> list[Any]:
    """Return what ``work`` makes of each number, all threads begun at one moment."""
    gate = threading.Barrier(threads)

    def share(first: int) -> list[Any]:
        gate.wait()
        return [work(number) for number in numbers[first::threads]]

    with ThreadPoolExecutor(threads) as pool:
        shares = list(pool.map(share, range(threads)))
    return [shares[k % threads][k // threads] for k in range(len(numbers))]


def pose(number: int) -> ho.Shape:
    stiff, along = 1.0 + 1e-3 * number, 1e-4 * (number % 50)
    cable = ho.Cable(
        length=1.0 + 1e-4 * (number % 97), diameter=0.01, bending_stiffness=stiff, torsional_stiffness=0.7 * stiff,
        mass_per_length=0.1,
    )  # fmt: skip
    end = ho.End(position=(0.3 + along, 0.2, 0.3), quaternion=(0.8, 0.3, 0.5099019513592785, 0.1))
    start = ho.End(position=(0, 0, 0), quaternion=(1, 0, 0, 0))
    return ho.equilibrium(cable, start, end, gravity=(0, 0, -9.81), throw=False)


def same(one: Any, other: Any) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("position", "quaternion", "force"))


@pytest.mark.parametrize("count", [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_equilibria_of_several_threads_are_those_of_one(count):
    one = [pose(number) for number in range(count)]
    many = together(pose, range(count), THREADS if count < 1000 else 8)
    assert all(shape.ok for shape in one)
    assert [k for k in range(count) if not same(one[k], many[k])] == []


def test_an_answer_does_not_depend_on_what_was_solved_before():
    forth = [pose(number) for number in range(12)]
    back = [pose(number) for number in reversed(range(12))][::-1]
    assert all(same(a, b) for a, b in zip(forth, back, strict=True))


def test_motions_clearances_and_redesigns_of_several_threads_are_those_of_one(here):
    near = FLAP.replace("position = [0.08, 0, 0]", "position = [0.08, 0.01, 0.07]")
    files = [put(near.replace("length = 0.3\n", f"length = {0.3 + 0.002 * k}\n"), f"{k}.toml") for k in range(4)]

    def work(number: int) -> tuple[Any, ...]:
        problem = ho.read_problem(files[number % 4])
        if number >= 8:
            found = ho.redesign(problem, throw=False)
            return found.motion.cables["lead"].position, [row.margin for row in found.limits]
        motion = ho.simulate(problem)
        return motion.cables["lead"].position, [pair.worst for pair in ho.clearances(motion).pairs]

    one = [work(number) for number in range(12)]
    many = together(work, range(12))
    for (shapes, numbers), (others, found) in zip(one, many, strict=True):
        assert np.array_equal(shapes, others)
        assert numbers == found


def test_a_fork_in_the_middle_of_a_solve_leaves_the_child_able_to_solve():
    if not hasattr(os, "fork"):
        pytest.skip("no fork here")
    busy = threading.Thread(target=lambda: [pose(number) for number in range(20)])
    busy.start()
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python's own, of forks beside threads
        child = os.fork()
    if child == 0:
        os._exit(0 if pose(1).ok else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    busy.join()


def test_threads_write_the_same_file_and_folder_one_after_the_other(here):
    problem = ho.read_problem(put(FLAP))
    motion = ho.simulate(problem)

    def work(number: int) -> None:
        ho.write_problem(problem, "again.toml")
        ho.write_results(motion, "results")

    together(work, range(16))
    assert ho.read_problem("again.toml").cables == problem.cables
    assert sorted(entry.name for entry in here.iterdir()) == ["again.toml", "flap.toml", "results"]

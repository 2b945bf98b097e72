"""Bodies that carry bodies: their poses against closed forms, bounds on their speeds against differences, bad ones."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import harness_opt as ho
from harness_opt.model.bodies import Rates
from harness_opt.numerics import rotations
from oracles.chains import closed_form, random_motion, three_hinges
from oracles.problems import shipped


def problem_of(bodies: dict[str, ho.Body], **changes: object) -> ho.Problem:
    return shipped("lift_arm").changed(bodies=bodies, **changes)


def test_three_hinges_in_a_row_equal_their_closed_form(rng):
    motion = np.linspace(0, 1, 11)
    for _ in range(20):
        bodies, _ = three_hinges(rng)
        position, quaternion = problem_of(bodies).poses("c", motion)
        expected = np.array([closed_form(bodies, at) for at in motion])
        np.testing.assert_allclose(position, expected[:, :3, 3], atol=1e-12)
        np.testing.assert_allclose(rotations.matrix(quaternion), expected[:, :3, :3], atol=1e-12)


def test_what_is_fixed_to_a_body_moves_with_it(rng):
    bodies, _ = three_hinges(rng)
    problem = problem_of({**bodies, "lid": ho.Body(parent="c"), "base": ho.Body(), "foot": ho.Body(parent="base")})
    at = np.linspace(0, 1, 5)
    for own, carrying in zip(problem.poses("lid", at), problem.poses("c", at), strict=True):
        np.testing.assert_array_equal(own, carrying)
    assert [problem.is_moved(name) for name in ("a", "c", "lid", "base", "foot", "world")] == [True] * 3 + [False] * 3


def placed(rng) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return where a body stands in its parent at 0: at its origin, or anywhere."""
    if rng.integers(2):
        return (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    return tuple(rng.normal(size=3)), tuple(rotations.normalise(rng.normal(size=4)))


def test_a_placed_body_turns_about_a_line_of_its_parent():
    """A quarter turn about z through (1, 0, 0), of what stands at (2, 0, 0) turned by a quarter about x."""
    half = np.sqrt(0.5)
    hinge = ho.Hinge((1, 0, 0), (0, 0, 1), 0.0, np.pi / 2)
    bodies = {
        "a": ho.Body(hinge, position=(2, 0, 0), quaternion=(half, half, 0, 0)),
        "b": ho.Body(None, "a", (0, 1, 0)),
    }
    problem = problem_of(bodies)
    position, quaternion = problem.poses("a", [0.0, 1.0])
    np.testing.assert_allclose(position, [[2, 0, 0], [1, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(rotations.rotate(quaternion, [0.0, 1.0, 0.0]), [[0, 0, 1], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(problem.poses("b", [1.0])[0], [[1, 1, 1]], atol=1e-15)


Poses = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def speeds(poses: Poses, at: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return by central differences the speed and acceleration of ``point`` (k, 3) of a body, then its angular ones."""
    h = 1e-4
    (back, now, ahead), turns = zip(*[poses(at + k * h) for k in (-1, 0, 1)], strict=True)
    held = rotations.rotate(rotations.conjugate(turns[1]), point - now)
    back, now, ahead = (p + rotations.rotate(q, held) for p, q in zip((back, now, ahead), turns, strict=True))
    first, second, third = (Rotation.from_quat(q, scalar_first=True) for q in turns)
    before, after = (second * first.inv()).as_rotvec() / h, (third * second.inv()).as_rotvec() / h
    found = (ahead - back) / (2 * h), (ahead - 2 * now + back) / h**2, 0.5 * (before + after), (after - before) / h
    return tuple(np.linalg.norm(one, axis=1) for one in found)


def looseness(rates: Rates, poses: Poses, first: np.ndarray, last: np.ndarray) -> float:
    """Check rates against fine differences from ``first`` (k,) to ``last`` (k,), and return how far above they are."""
    middle, turn = poses(0.5 * (first + last))
    held = rotations.rotate(rotations.conjugate(turn), rates.centre - middle)
    bounds = np.stack([rates.speed, rates.acceleration, rates.turning, rates.turning_change])
    most = np.zeros_like(bounds)
    for share in np.linspace(0, 1, 41):
        at = np.clip(first + share * (last - first), first + 2e-4, last - 2e-4)
        position, quaternion = poses(at)
        most = np.maximum(most, speeds(poses, at, position + rotations.rotate(quaternion, held)))
    assert np.all(most <= bounds * (1 + 1e-5) + 1e-4), np.max(most - bounds)
    return float(np.median((bounds + 1e-6) / (most + 1e-6)))


# a carries b, which carries c; a carries d too, and e is fixed to that
TREE = {"a": "world", "b": "a", "c": "b", "d": "a", "e": "d"}


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize(
    ("body", "view", "most"),
    [("c", "world", 3.0), ("c", "a", 3.0), ("a", "c", 4.0), ("c", "d", 4.0), ("e", "c", 4.0), ("world", "b", 4.0)],
)
def test_rates_of_chains_bound_fine_differences(rng, back, body, view, most):
    """Of motions of any kind: never faster than the bounds, and these not far above; in the world, and from bodies."""
    found = []
    for _ in range(15):
        bodies = {
            name: ho.Body(None if name == "e" else random_motion(rng), parent, *placed(rng))
            for name, parent in TREE.items()
        }
        problem = problem_of(bodies, out_and_back=back)
        cuts = np.sort(np.concatenate([[0.001, 0.5, 0.999], rng.uniform(0.01, 0.99, 12)]))
        first, last = cuts[:-1], cuts[1:]
        keep = last - first > 1e-3
        first, last = first[keep], last[keep]
        poses = functools.partial(problem.poses_from, view, body)
        found.append(looseness(problem.rates(body, first, last, view=view), poses, first, last))
    assert np.median(found) < most


def test_what_moves_as_one_is_seen_to_stand_still(rng):
    bodies = {name: ho.Body(None if name == "e" else random_motion(rng), parent) for name, parent in TREE.items()}
    problem, at = problem_of(bodies), np.linspace(0, 1, 11)
    for body, view in (("e", "d"), ("d", "e"), ("c", "c")):
        rates = problem.rates(body, at[:-1], at[1:], view=view)
        assert not np.any([rates.speed, rates.acceleration, rates.turning, rates.turning_change])
        position, quaternion = problem.poses_from(view, body, at)
        np.testing.assert_allclose(position, 0.0, atol=1e-14)
        np.testing.assert_allclose(np.abs(quaternion), np.tile([1.0, 0, 0, 0], (11, 1)), atol=1e-14)
    between = [
        problem.joints_between(*pair) for pair in (("e", "d"), ("c", "a"), ("c", "e"), ("world", "c"), ("a", "a"))
    ]
    assert between == [0, 2, 3, 3, 0]


@pytest.mark.parametrize(
    ("parents", "mistakes"),
    [
        ({"a": "world", "b": "c"}, ["bodies.b.parent: found \"c\", expected one of 'world', 'a', 'b'"]),
        ({"a": "a"}, ['bodies.a.parent: found a circle, "a" on "a", expected one that leads to the world']),
        (
            {"a": "b", "b": "c", "c": "b", "d": "a"},
            ['bodies.b.parent: found a circle, "b" on "c" on "b", expected one that leads to the world'],
        ),
        ({"a": ["b"]}, ['bodies.a.parent: found ["b"], expected text in quotes']),
    ],
)
def test_parents_that_lead_nowhere(parents, mistakes):
    run = ho.CableRun(ho.Cable(0.3, 0.005, 1e-3, 1e-3), ho.End(position=(0, 0, 0)), ho.End(position=(0, 0, 0.2)))
    with pytest.raises(ho.ProblemError) as error:
        ho.Problem({"lead": run}, {name: ho.Body(parent=parent) for name, parent in parents.items()})
    assert list(error.value.mistakes) == mistakes


def test_a_long_chain_is_no_trouble():
    slide = ho.Slide((0, 0, 1), 0.0, 0.001)
    bodies = {f"b{k}": ho.Body(slide, f"b{k - 1}" if k else "world") for k in range(1000)}
    run = ho.CableRun(ho.Cable(0.3, 0.005, 1e-3, 1e-3), ho.End(position=(0, 0, 0)), ho.End(position=(0, 0, 0.2)))
    assert ho.Problem({"lead": run}, bodies).poses("b999", [1.0])[0][0, 2] == pytest.approx(1.0, rel=1e-12)

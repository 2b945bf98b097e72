"""What must not matter does not: where the cable is, its unit, its direction, left or right, step, solver, signs."""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations

SHAPE = 1e-9  # of the centreline, in lengths of the cable
LOADS = 1e-7  # of curvature, force and moment, relative to their largest
ALONG_X = tuple(rotations.from_tangent((1, 0, 0)).tolist())
SOLVERS = ("gauss-newton", "levenberg-marquardt", "ipopt")
QUANTITIES = ("position", "quaternion", "curvature", "force", "moment")


def unit(*numbers: float) -> tuple[float, ...]:
    return tuple(rotations.normalise(numbers).tolist())


class Setup(NamedTuple):
    """A cable between two ends."""

    cable: ho.Cable
    start: ho.End
    end: ho.End
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bow: tuple[float, float, float] | None = None

    def solve(self, **options: object) -> ho.Shape:
        shape = ho.equilibrium(
            self.cable, self.start, self.end, self.gravity, bow=self.bow, **({"tolerance": 1e-10} | options)
        )
        assert shape.ok
        return shape


CASES = {
    "clamped, heavy": Setup(
        ho.Cable(1, 0.01, 1, 0.7, 3.0),
        ho.End((0.1, 0.2, 0.3), ALONG_X),
        ho.End((0.6, 0.4, 0.2), unit(0.3, 0.5, -0.2, 0.7)),
        gravity=(0, 0, -9.81),
    ),
    "clamped, weightless, flat": Setup(
        ho.Cable(1, 0.01, (1.0, 2.0), 1.4),
        ho.End((0, 0, 0), ALONG_X),
        ho.End((0.5, 0.3, 0.1), unit(0.9, 0.1, -0.3, 0.2)),
        bow=(0.1, 0.2, 1.0),
    ),
    "clamped, two turns": Setup(
        ho.Cable(1, 0.01, 1, 0.3, 2.0),
        ho.End((0, 0, 0), ALONG_X),
        ho.End((0.8, 0.1, 0.2), unit(0.5, 0.6, 0.4, 0.5), turns=1),
        gravity=(0, 1.0, -9.81),
    ),
    "pinned": Setup(
        ho.Cable(1, 0.01, 1, 2.0, 3.0),
        ho.End((0, 0, 0), ALONG_X),
        ho.End((0.7, 0.2, -0.2), moment=(0.3, 1.0, -0.5)),
        gravity=(0, 0, -9.81),
    ),
    "free": Setup(
        ho.Cable(1, 0.01, (2.0, 1.0), 2.0, 0.5),
        ho.End((0, 0, 0), ALONG_X),
        ho.End(force=(-1.0, 2.0, 1.0), moment=(0.3, 0.5, -0.5)),
        gravity=(0, 0, -9.81),
    ),
    "guided": Setup(
        ho.Cable(1, 0.01, 1, 2.0, 0.5),
        ho.End((0, 0, 0), ALONG_X),
        ho.End(force=(1.0, 2.0, 3.0), quaternion=unit(0.5, 0.6, 0.4, 0.5)),
        gravity=(0, 0, -9.81),
    ),
}
BY_CASE = pytest.mark.parametrize("name", CASES)


@functools.cache
def as_given(name: str) -> ho.Shape:
    return CASES[name].solve()


def assert_same(found: dict, expected: dict, length: float = 1.0) -> None:
    """Assert that two shapes, given as dicts of (N, 3) and (N, 4), are the same."""
    assert np.max(np.linalg.norm(found["position"] - expected["position"], axis=1)) < SHAPE * length
    signs = np.sign(np.sum(found["quaternion"] * expected["quaternion"], axis=1))
    assert np.all(signs == signs[0])
    assert np.max(np.abs(signs[0] * found["quaternion"] - expected["quaternion"])) < 10 * SHAPE
    for name in ("curvature", "force", "moment"):
        size = np.max(np.linalg.norm(expected[name], axis=1))
        assert np.max(np.abs(found[name] - expected[name])) < LOADS * size, name


def arrays(shape: object) -> dict[str, np.ndarray]:
    return {name: getattr(shape, name) for name in QUANTITIES}


# --- rigid motion -------------------------------------------------------------------------------------------


def carried(end: ho.End, shift: np.ndarray, turn: np.ndarray) -> ho.End:
    """Return ``end`` with everything about it turned, then shifted."""
    changes = {}
    for name in ("position", "force", "moment"):
        if getattr(end, name) is not None:
            moved = rotations.rotate(turn, getattr(end, name)) + (shift if name == "position" else 0)
            changes[name] = tuple(moved)
    if end.quaternion is not None:
        changes["quaternion"] = tuple(rotations.multiply(turn, end.quaternion))
    return dataclasses.replace(end, **changes)


@BY_CASE
@pytest.mark.parametrize("turn", [(0.2, 0.7, -0.4, 0.5), (0.0, 1.0, 0.0, 0.0), (0.9, -0.1, -0.3, 0.8)])
def test_rigid_motion_of_everything(name, turn):
    case, shift, turn = CASES[name], np.array([3.0, -2.0, 5.0]), np.array(unit(*turn))
    bow = None if case.bow is None else tuple(rotations.rotate(turn, case.bow))
    moved = Setup(
        case.cable,
        carried(case.start, shift, turn),
        carried(case.end, shift, turn),
        tuple(rotations.rotate(turn, case.gravity)),
        bow,
    ).solve()
    here = as_given(name)
    expected = {
        "position": shift + rotations.rotate(turn, here.position),
        "quaternion": rotations.multiply(turn, here.quaternion),
        "curvature": here.curvature,
        "force": rotations.rotate(turn, here.force),
        "moment": rotations.rotate(turn, here.moment),
    }
    assert_same(arrays(moved), expected)
    assert moved.energy == pytest.approx(here.energy, rel=1e-9)
    assert moved.stable == here.stable


# --- units --------------------------------------------------------------------------------------------------


@BY_CASE
@pytest.mark.parametrize(("length", "stiffness"), [(1e-3, 1e-9), (1e-3, 1.0), (1e3, 1.0), (25.4, 1e6)])
def test_change_of_units(name, length, stiffness):
    case = CASES[name]
    force, moment = stiffness / length**2, stiffness / length
    scales = {"position": length, "force": force, "moment": moment}

    def scaled(end: ho.End) -> ho.End:
        given = {n: getattr(end, n) for n in scales if getattr(end, n) is not None}
        return dataclasses.replace(end, **{n: tuple(scales[n] * np.array(v)) for n, v in given.items()})

    cable = case.cable
    bending = stiffness * cable.stiffness[:2]
    other = ho.Cable(
        length * cable.length,
        length * cable.diameter,
        tuple(bending),
        stiffness * cable.torsional_stiffness,
        cable.mass_per_length * force / length,
    )
    found = Setup(other, scaled(case.start), scaled(case.end), case.gravity, case.bow).solve()
    here = as_given(name)
    expected = arrays(here)
    for quantity, scale in (scales | {"curvature": 1 / length}).items():
        expected[quantity] = scale * expected[quantity]
    assert_same(arrays(found), expected, length)
    np.testing.assert_allclose(found.s, length * here.s, rtol=1e-14)
    assert found.energy == pytest.approx(here.energy * moment, rel=1e-9)
    assert found.estimated_error == pytest.approx(here.estimated_error, rel=1e-2, abs=1e-13)


# --- the other way round ------------------------------------------------------------------------------------

HALF_TURN = np.array([0.0, 1.0, 0.0, 0.0])  # about d1: turns d2 and d3 round


def reversed_end(end: ho.End, *, turns: int = 0) -> ho.End:
    """Return ``end`` as the other end of the reversed cable: its tangent points the other way, loads stay."""
    if end.quaternion is None:
        return dataclasses.replace(end, turns=turns)
    return dataclasses.replace(end, quaternion=tuple(rotations.multiply(end.quaternion, HALF_TURN)), turns=turns)


@BY_CASE
def test_reversing_the_cable(name):
    # s -> L - s. With d2 and d3 turned round, twist and the curvature about d2 keep their sign, that about d1 changes
    # it; what was the s- side is the s+ side, so force and moment change sign.
    case = CASES[name]
    here = as_given(name)
    back = Setup(
        case.cable,
        reversed_end(case.end),
        reversed_end(case.start, turns=case.end.turns),
        case.gravity,
        case.bow,
    ).solve()
    expected = {
        "position": here.position[::-1],
        "quaternion": rotations.multiply(here.quaternion, HALF_TURN)[::-1],
        "curvature": (here.curvature * (-1, 1, 1))[::-1],
        "force": -here.force[::-1],
        "moment": -here.moment[::-1],
    }
    assert_same(arrays(back), expected)
    # energies count from the level of the start
    rise = here.position[-1] - here.position[0]
    work = case.cable.mass_per_length * np.dot(case.gravity, rise)
    assert back.energy == pytest.approx(here.energy + work, rel=1e-9)
    assert back.stability_margin == pytest.approx(here.stability_margin, rel=1e-4, abs=1e-6)


# --- left and right -----------------------------------------------------------------------------------------

ACROSS = np.array([1.0, -1.0, 1.0])  # mirror in the plane y = 0, d2 kept on the mirrored side
PSEUDO = -ACROSS  # moments are pseudovectors
QUATERNION = np.array([1.0, -1.0, 1.0, -1.0])


def mirrored(end: ho.End, *, turns: int = 0) -> ho.End:
    changes = {"turns": turns}
    for name, signs in (("position", ACROSS), ("force", ACROSS), ("moment", PSEUDO), ("quaternion", QUATERNION)):
        if getattr(end, name) is not None:
            changes[name] = tuple(signs * np.array(getattr(end, name)))
    return dataclasses.replace(end, **changes)


@BY_CASE
def test_mirror(name):
    case = CASES[name]
    here = as_given(name)
    bow = None if case.bow is None else tuple(ACROSS * case.bow)
    gravity = tuple(ACROSS * case.gravity)
    found = Setup(case.cable, mirrored(case.start), mirrored(case.end, turns=-case.end.turns), gravity, bow).solve()
    expected = {
        "position": ACROSS * here.position,
        "quaternion": QUATERNION * here.quaternion,
        "curvature": PSEUDO * here.curvature,
        "force": ACROSS * here.force,
        "moment": PSEUDO * here.moment,
    }
    assert_same(arrays(found), expected)
    assert found.energy == pytest.approx(here.energy, rel=1e-9)


# --- signs of quaternions, solvers, guesses -----------------------------------------------------------------


def negated(end: ho.End) -> ho.End:
    return end if end.quaternion is None else dataclasses.replace(end, quaternion=tuple(-np.array(end.quaternion)))


@BY_CASE
@pytest.mark.parametrize("side", ["start", "end"])
def test_sign_of_a_quaternion_means_nothing(name, side):
    case = CASES[name]
    other = case._replace(**{side: negated(getattr(case, side))}).solve()
    assert_same(arrays(other), arrays(as_given(name)))


@pytest.mark.parametrize("side", ["start", "end"])
def test_sign_of_a_quaternion_means_nothing_to_a_warm_start(side):
    case = CASES["clamped, heavy"]
    guess = case.solve()
    heavier = case._replace(cable=dataclasses.replace(case.cable, mass_per_length=20.0))
    expected = heavier.solve(guess=guess)
    other = heavier._replace(**{side: negated(getattr(case, side))}).solve(guess=guess)
    assert_same(arrays(other), arrays(expected))


@BY_CASE
@pytest.mark.parametrize("solver", SOLVERS[1:])
def test_solver_does_not_change_the_shape(name, solver):
    assert_same(arrays(CASES[name].solve(solver=solver, tolerance=5e-10)), arrays(as_given(name)))


@BY_CASE
def test_stations_do_not_change_the_shape(name):
    coarse, fine = CASES[name].solve(stations=6), CASES[name].solve(stations=501)
    at = fine.at(coarse.s)
    for quantity in QUANTITIES:
        np.testing.assert_allclose(getattr(coarse, quantity), getattr(at, quantity), rtol=0, atol=1e-12)


# --- motions ------------------------------------------------------------------------------------------------


def swing() -> ho.Problem:
    """Return a heavy cable between the world and a hinged body that swings by 80 degrees."""
    run = ho.CableRun(
        ho.Cable(0.5, 0.006, 0.01, 0.008, 0.06),
        ho.End((0, 0, 0), unit(1, 0, 0, 0)),
        ho.End((0.25, 0.05, 0), unit(0.0, 0.9, 0.3, 0.1), body="arm"),
    )
    hinge = ho.Hinge((0.3, 0, 0.1), (0.2, 1, 0), 0.0, np.deg2rad(80))
    return ho.Problem({"lead": run}, {"arm": ho.Body(hinge)}, gravity=(0, 0, -9.81))


def last_frame(**options: object) -> dict[str, np.ndarray]:
    motion = ho.simulate(swing(), tolerance=1e-9, **options)
    assert motion.ok and not motion.snaps
    return {name: getattr(motion.cables["lead"], name)[-1] for name in QUANTITIES}


@pytest.fixture(scope="module")
def reference_frame() -> dict[str, np.ndarray]:
    return last_frame()


@pytest.mark.parametrize(
    "options",
    [{"spatial_step": 0.05}, {"spatial_step": 0.0013}, {"elements": 32}]
    + [{"solver": solver, "spatial_step": 0.02} for solver in SOLVERS[1:]],
    ids=str,
)
def test_last_frame_does_not_depend_on_the_way(options, reference_frame):
    found = last_frame(**options)
    error = np.linalg.norm(found["position"] - reference_frame["position"], axis=1)
    assert np.max(error) < 1e-8 * 0.5
    for name in ("curvature", "force", "moment"):
        size = np.max(np.linalg.norm(reference_frame[name], axis=1))
        assert np.max(np.abs(found[name] - reference_frame[name])) < 1e-6 * size, name


def test_a_taut_cable_carried_round_a_hinge_stays_straight():
    # both clamps ride on one body: rounding takes their distance past the length here and there
    body = {"arm": ho.Body(ho.Hinge((0.3, 0.2, 0.1), (0.3, 1.0, 0.2), 0.0, 2.0))}
    along = rotations.from_tangent([1.0, 0.0, 0.0])
    run = ho.CableRun(
        ho.Cable(1.0, 0.01, 1.0, 0.7),
        ho.End((0, 0, 0), tuple(along), body="arm"),
        ho.End((1, 0, 0), tuple(along), body="arm"),
    )
    motion = ho.simulate(ho.Problem({"lead": run}, body), spatial_step=0.1)
    lead = motion.cables["lead"]
    chord = lead.position[:, -1] - lead.position[:, 0]
    np.testing.assert_allclose(lead.position, lead.position[:, :1] + lead.s[:, None] * chord[:, None], atol=1e-9)

"""Shapes against closed forms (elliptic integrals, arcs, helices, straight cables) and another solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, optimize, special

import harness_opt as ho
from harness_opt.numerics import rotations
from oracles.elastica import ALONG_X, Elastica, elastica_error, unit_cable

SHAPE = 1e-8  # largest error of the centreline, in lengths of the cable
SOLVERS = ("gauss-newton", "levenberg-marquardt", "ipopt")
OFF_STATION = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 200))  # in lengths; none is a station or a node


# --- clamped elastica ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("bow", [(0, 0, 1), (0, -0.6, 0.8)])
@pytest.mark.parametrize("distance", [0.9, 0.6, 0.3, 0.1])
def test_clamped_elastica(distance, bow):
    bow = np.array(bow, dtype=float)
    shape = ho.equilibrium(unit_cable(), ho.End((0, 0, 0), ALONG_X), ho.End((distance, 0, 0), ALONG_X), bow=bow)
    exact = Elastica.between(distance)
    assert shape.ok and shape.stable
    assert elastica_error(shape.position, shape.s, distance, bow) < SHAPE
    assert elastica_error(shape.at(OFF_STATION).position, OFF_STATION, distance, bow) < SHAPE
    across = np.cross([1.0, 0, 0], bow)
    thrust = exact.lam**2
    np.testing.assert_allclose(shape.force, np.tile([-thrust, 0, 0], (101, 1)), rtol=0, atol=1e-7 * thrust)
    moment = 2 * exact.k * exact.lam
    np.testing.assert_allclose(shape.moment[[0, -1]], moment * np.stack([across] * 2), rtol=0, atol=1e-7 * moment)


@pytest.mark.parametrize("distance", [0.6, 0.3, 0.1])
def test_clamped_elastica_reached_by_sliding(distance):
    run = ho.CableRun(
        unit_cable(), ho.End((0, 0, 0), ALONG_X), ho.End((0.9, 0, 0), ALONG_X, body="slide"), bow=(0, 0, 1)
    )
    problem = ho.Problem({"lead": run}, {"slide": ho.Body(ho.Slide((-1, 0, 0), 0.0, 0.9 - distance))})
    motion = ho.simulate(problem, tolerance=1e-9, spatial_step=0.04)
    lead = motion.cables["lead"]
    assert motion.ok and not motion.snaps and np.all(lead.stable)
    # the cable may turn freely about its chord: the shape is exact, its plane is kept but for rounding
    across = lead.position[-1, 50] * (0, 1, 1)
    bow = across / np.linalg.norm(across)
    assert np.linalg.norm(bow - (0, 0, 1)) < 1e-6
    assert elastica_error(lead.position[-1], lead.s, distance, bow) < SHAPE


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_finds_the_elastica(solver):
    shape = ho.equilibrium(
        unit_cable(), ho.End((0, 0, 0), ALONG_X), ho.End((0.6, 0, 0), ALONG_X), bow=(0, 0, 1), solver=solver
    )
    # the cable may turn freely about its chord: the shape is exact, its plane is kept but for what a solver lets slip
    across = shape.position[50] * (0, 1, 1)
    bow = across / np.linalg.norm(across)
    assert np.linalg.norm(bow - (0, 0, 1)) < 1e-5
    assert elastica_error(shape.position, shape.s, 0.6, bow) < SHAPE


# --- cantilever under a dead force across it ----------------------------------------------------------------


def cantilever(load: float, s: np.ndarray) -> np.ndarray:
    """Return x and deflection (N, 2) of a cantilever, L = B = 1, under a dead tip force ``load`` across it.

    With beta = theta + pi / 2 the equation is the pendulum's, beta'' = -P sin(beta): sin(beta / 2) = k sn(u),
    u from u0 at the clamp, beta = pi / 2, to K(k) at the tip, beta' = 0.
    """

    def first(k: float) -> float:
        return float(special.ellipkinc(np.arcsin(1 / (k * np.sqrt(2))), k * k))

    def excess(k: float) -> float:
        return special.ellipk(k * k) - first(k) - np.sqrt(load)

    k = optimize.brentq(excess, np.sqrt(0.5) * (1 + 1e-12), 1 - 1e-12, xtol=1e-16, rtol=1e-15)

    def parts(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _, cn, _, amplitude = special.ellipj(u, k * k)
        return cn, 2 * special.ellipeinc(amplitude, k * k) - u

    (cn0, rise0), (cn, rise) = parts(np.array(first(k))), parts(first(k) + np.sqrt(load) * np.asarray(s))
    return np.stack([2 * k * (cn0 - cn), rise0 - rise], axis=-1) / np.sqrt(load)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("load", [1.0, 5.0, 10.0])
def test_cantilever_under_a_tip_force(load, solver):
    shape = ho.equilibrium(unit_cable(), ho.End((0, 0, 0), ALONG_X), ho.End(force=(0, 0, -load)), solver=solver)
    assert shape.ok and shape.stable
    for s, position in ((shape.s, shape.position), (OFF_STATION, shape.at(OFF_STATION).position)):
        exact = cantilever(load, s)
        expected = np.stack([exact[:, 0], np.zeros(len(s)), -exact[:, 1]], axis=1)
        assert np.max(np.linalg.norm(position - expected, axis=1)) < SHAPE


@pytest.mark.parametrize(("axis", "stiffness", "load"), [("d1", (1.5, 4.0), 3.0), ("d2", (4.0, 1.5), 3.0)])
@pytest.mark.parametrize("stiff", [False, True])
def test_flat_section_bends_about_the_axis_of_its_load(axis, stiffness, load, stiff):
    # a force along d2 bends about d1, one along d1 about d2; the stiffer axis too, below lateral buckling
    stiffness = stiffness[::-1] if stiff else stiffness
    about = stiffness[0] if axis == "d1" else stiffness[1]
    d1, d2 = (rotations.rotate(ALONG_X, e) for e in np.eye(3)[:2])
    direction = d2 if axis == "d1" else d1
    shape = ho.equilibrium(
        unit_cable(bending_stiffness=stiffness),
        ho.End((0, 0, 0), ALONG_X),
        ho.End(force=tuple(load * direction)),
    )
    plane = cantilever(load / about, shape.s)
    exact = plane[:, :1] * np.array([1.0, 0, 0]) + plane[:, 1:] * direction
    assert np.max(np.linalg.norm(shape.position - exact, axis=1)) < SHAPE


# --- arcs and helices ---------------------------------------------------------------------------------------


def helix(omega: np.ndarray, first: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centreline (N, 3) and frames (N, 4) of a rod of constant Darboux vector (section frame).

    R(s) = R0 exp([omega] s); the centreline is its third column, integrated by Rodrigues' formula.
    """
    rate = np.linalg.norm(omega)
    axis, e3, s = omega / rate, np.array([0, 0, 1.0]), np.asarray(s)[:, None]
    along = axis * (axis @ e3)
    local = along * s + (e3 - along) * np.sin(rate * s) / rate
    local = local + np.cross(axis, e3) * (1 - np.cos(rate * s)) / rate
    return rotations.rotate(first, local), rotations.multiply(first, rotations.from_rotation_vector(s * omega))


def wrench(omega: np.ndarray, stiffness: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the constant force and moment in the section frame that hold the helix ``omega``.

    M = K (omega - rest), and omega x M + e3 x F = 0 with F along omega, so that omega x F = 0; one of the
    first two entries of ``omega`` is zero.
    """
    moment = stiffness * (omega - rest)
    turning = np.cross(omega, moment)
    bent = 0 if omega[0] else 1
    size = (-turning[1] if bent == 0 else turning[0]) / omega[bent]
    force = size * omega
    np.testing.assert_allclose(turning + np.cross([0, 0, 1.0], force), 0, atol=1e-12)
    return force, moment


TILTED = rotations.normalise([0.3, -0.5, 0.7, 0.4])


def held_by_wrench(omega, stiffness, rest=(0.0, 0.0, 0.0), solver="gauss-newton"):
    """Return (shape, exact centreline, exact frames) of a cantilever loaded by the wrench of a helix."""
    omega, stiffness, rest = (np.asarray(v, dtype=float) for v in (omega, stiffness, rest))
    origin = np.array([1.0, -2, 0.5])
    force, moment = wrench(omega, stiffness, rest)
    cable = unit_cable(stiffness[2], bending_stiffness=tuple(stiffness[:2]), rest_curvature=tuple(rest))
    s = np.linspace(0, 1, 101)
    r, q = helix(omega, TILTED, s)
    shape = ho.equilibrium(
        cable,
        ho.End(tuple(origin), tuple(TILTED)),
        ho.End(force=tuple(rotations.rotate(q[-1], force)), moment=tuple(rotations.rotate(q[-1], moment))),
        solver=solver,
    )
    return shape, origin + r, q


def assert_same(shape, r, q, omega):
    assert shape.ok
    assert np.max(np.linalg.norm(shape.position - r, axis=1)) < SHAPE
    assert np.max(1 - np.abs(np.sum(shape.quaternion * q, axis=1))) < 1e-14  # 1 - cos of half the angle
    np.testing.assert_allclose(shape.curvature, np.tile(omega, (101, 1)), rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("angle", "stiffness", "axis"),
    [
        *((turns * np.pi, (1, 1, 0.7), 1) for turns in (0.5, 1, 1.5, 2)),
        (np.pi, (1, 2.5, 1.2), 0),
        (0.5 * np.pi, (1, 2.5, 1.2), 1),
    ],
)
def test_end_moment_makes_a_circular_arc(angle, stiffness, axis):
    omega = angle * np.eye(3)[axis]
    shape, r, q = held_by_wrench(omega, stiffness)
    assert_same(shape, r, q, omega)
    assert np.linalg.norm(r[-1] - r[0]) == pytest.approx(2 / angle * np.sin(angle / 2), abs=1e-12)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("omega", "stiffness"), [((2, 0, 1), (1, 1, 0.7)), ((0, 2, -1), (2, 1, 3))])
def test_end_wrench_makes_a_helix(omega, stiffness, solver):
    shape, r, q = held_by_wrench(omega, stiffness, solver=solver)
    assert_same(shape, r, q, omega)


def test_end_wrench_makes_a_long_helix():
    shape, r, q = held_by_wrench((4, 0, -3), (1, 1, 1.5))
    assert_same(shape, r, q, (4, 0, -3))


def test_end_wrench_makes_a_helix_of_a_precurved_cable():
    shape, r, q = held_by_wrench((3, 0, 2), (1, 1, 0.7), rest=(2.0, 0.0, 1.0))
    assert_same(shape, r, q, (3, 0, 2))


@pytest.mark.parametrize("stiffness", [(1, 1, 0.7), (1, 2.5, 1.2)])
@pytest.mark.parametrize("rest", [(0, 1.5 * np.pi, 0), (0, 9 * np.pi, 0), (3, 0, 2), (12, 3, 5)])
def test_unloaded_precurved_cable_keeps_its_rest_shape(rest, stiffness):
    cable = unit_cable(stiffness[2], bending_stiffness=stiffness[:2], rest_curvature=rest)
    shape = ho.equilibrium(cable, ho.End((0, 0, 0), tuple(TILTED)), ho.End())
    assert_same(shape, *helix(np.asarray(rest, dtype=float), TILTED, shape.s), rest)
    assert shape.stable
    assert np.max(np.abs(shape.moment)) < 1e-8 and np.max(np.abs(shape.force)) < 1e-8
    assert shape.energy == pytest.approx(0, abs=1e-12)


# --- weight -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("weight", [1.0, 100.0, 1e4])
def test_hanging_cable_is_straight(weight):
    down = tuple(rotations.from_tangent((0, 0, -1)).tolist())
    cable = unit_cable(mass_per_length=weight / 9.81)
    shape = ho.equilibrium(cable, ho.End((0, 0, 2), down), ho.End(), (0, 0, -9.81))
    assert shape.ok and shape.stable
    straight = np.stack([0 * shape.s, 0 * shape.s, 2 - shape.s], axis=1)
    assert np.max(np.abs(shape.position - straight)) < SHAPE
    pull = np.stack([0 * shape.s, 0 * shape.s, -weight * (1 - shape.s)], axis=1)
    np.testing.assert_allclose(shape.force, pull, rtol=0, atol=1e-9 * weight)
    assert np.max(np.abs(shape.moment)) < 1e-8 * weight
    assert shape.energy == pytest.approx(-weight / 2, rel=1e-10)  # the work of gravity below the start


def heavy_cantilever(weight: float, s: np.ndarray) -> np.ndarray:
    """Return x, height and angle (N, 3) of a horizontal heavy cantilever, L = B = 1, by ``solve_bvp``.

    theta'' = w (1 - s) cos(theta), theta(0) = theta'(1) = 0.
    """

    def rates(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([np.cos(y[2]), np.sin(y[2]), y[3], weight * (1 - s) * np.cos(y[2])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], a[1], a[2], b[3]])

    mesh = np.linspace(0, 1, 201)
    guess = np.stack([mesh, -0.5 * mesh, -np.sin(mesh), -np.cos(mesh)])
    found = integrate.solve_bvp(rates, ends, mesh, guess, tol=1e-10, max_nodes=100_000)
    assert found.success
    return found.sol(s)[:3].T


@pytest.mark.parametrize(("weight", "solver"), [(5.0, SOLVERS[0]), *((60.0, s) for s in SOLVERS), (1000.0, SOLVERS[0])])
def test_heavy_cantilever(weight, solver):
    cable = unit_cable(mass_per_length=weight / 9.81)
    shape = ho.equilibrium(cable, ho.End((0, 0, 0), ALONG_X), ho.End(), (0, 0, -9.81), solver=solver)
    assert shape.ok and shape.stable
    for s, at in ((shape.s, shape), (OFF_STATION, shape.at(OFF_STATION))):
        x, z, theta = heavy_cantilever(weight, s).T
        exact = np.stack([x, 0 * x, z], axis=1)
        assert np.max(np.linalg.norm(at.position - exact, axis=1)) < SHAPE
        tangent = np.stack([np.cos(theta), 0 * x, np.sin(theta)], axis=1)
        assert np.max(np.abs(rotations.tangent(at.quaternion) - tangent)) < 1e-7


# --- units --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("length", "bending"), [(0.3, 0.02), (1e-2, 3e-7), (40.0, 5e3)])
def test_results_are_in_si_units(length, bending):
    weight = 20.0  # w L^3 / B
    cable = ho.Cable(length, 0.01 * length, bending, 3 * bending, weight * bending / (9.81 * length**3))
    end = ho.End((0.6 * length, 0.1 * length, 0), tuple(rotations.from_tangent((0.6, 0, -0.8))))
    like = ho.End((0.6, 0.1, 0), end.quaternion)
    start = ho.End((0, 0, 0), ALONG_X)
    shape = ho.equilibrium(cable, start, end, (0, 0, -9.81))
    unit = ho.equilibrium(unit_cable(mass_per_length=weight / 9.81), start, like, (0, 0, -9.81))
    for name, scale in {
        "s": length,
        "position": length,
        "curvature": 1 / length,
        "force": bending / length**2,
        "moment": bending / length,
    }.items():
        expected = getattr(unit, name) * scale
        np.testing.assert_allclose(
            getattr(shape, name), expected, rtol=0, atol=1e-9 * np.max(np.abs(expected)), err_msg=name
        )
    assert shape.energy == pytest.approx(unit.energy * bending / length, rel=1e-9)
    # a check that does not lean on the product: the whole weight hangs between the two clamps
    carried = shape.force[0] - shape.force[-1]
    np.testing.assert_allclose(carried, [0, 0, -weight * bending / length**2], rtol=1e-9, atol=1e-9 * weight)

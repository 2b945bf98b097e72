"""Stability against exact buckling loads, from both sides within 1 %, and the number of unstable directions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, special

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.rod import stability as stability_module
from harness_opt.rod.boundary import Kind, case
from harness_opt.rod.collocation import pack, stations
from harness_opt.rod.equations import Section
from harness_opt.rod.stability import lowest_mode, stability, surely_stable
from harness_opt.rod.states import Rod
from harness_opt.statics.solve import STAGES, solve_on

MESH = np.linspace(0, 1, 17)
CANTILEVER = Kind(True, True, False, False)
GUIDED = Kind(True, True, False, True)  # the end's orientation is held, its place is not
PROPPED = Kind(True, True, True, False)
PINNED = Kind(True, False, True, False)
CLAMPED = Kind(True, True, True, True)
PROP = 4.493409457909064  # tan x = x
UP = np.array([0.0, 0.0, 1.0])
BELOW, ABOVE = 0.99, 1.01


@pytest.fixture(autouse=True, params=["dense", "sparse"])
def matrices(request, monkeypatch):
    """Every threshold is met by either way to the eigenvalues."""
    monkeypatch.setattr(stability_module, "SPARSE_FROM", 10**6 if request.param == "dense" else 0)


def straight(
    force: np.ndarray, *, stiffness=(1.0, 1.0, 0.7), load=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0), twist=0.0
) -> Rod:
    """Return a straight upright rod under a force at its start, twisted evenly."""
    s = MESH[:, None]
    q = rotations.from_rotation_vector(twist * s * UP)
    forces = np.asarray(force) - s * np.asarray(load)
    moments = np.broadcast_to(np.asarray(moment, dtype=float), forces.shape)
    return Rod(
        Section(np.array(stiffness), np.zeros(3)), np.asarray(load, dtype=float), MESH, q, s * UP, forces, moments
    )


def is_stable(rod: Rod, kind: Kind) -> bool:
    """Return whether ``rod`` is stable; the quick test must not say so where the thorough one does not."""
    answer = bool(stability(rod, kind).stable)
    assert answer or not surely_stable(rod, kind)
    return answer


COLUMNS = {
    "cantilever": (CANTILEVER, np.pi**2 / 4),
    "guided": (GUIDED, np.pi**2),
    "pinned": (PINNED, np.pi**2),
    "propped": (PROPPED, PROP**2),
    "clamped": (CLAMPED, 4 * np.pi**2),
}


@pytest.mark.parametrize("stiffness", [(1, 1, 0.7), (1, 1, 20), (1, 3, 1), (3, 1, 1)], ids=str)
@pytest.mark.parametrize("name", COLUMNS)
def test_column(name, stiffness):
    kind, critical = COLUMNS[name]
    assert is_stable(straight(-BELOW * critical * UP, stiffness=stiffness), kind)
    assert not is_stable(straight(-ABOVE * critical * UP, stiffness=stiffness), kind)


@pytest.mark.parametrize("name", ["cantilever", "guided", "propped", "clamped"])
def test_column_sharply(name):
    # the elements are of the third degree: the threshold itself is met far better than to 1 %
    kind, critical = COLUMNS[name]

    def margin(load: float) -> float:
        values = stability(straight(-load * UP, stiffness=(1.0, 50.0, 50.0)), kind).margin
        return float(values)

    found = optimize.brentq(margin, 0.9 * critical, 1.1 * critical, xtol=1e-10)
    assert found == pytest.approx(critical, rel=1e-6)


def test_pinned_column_may_turn_about_its_axis():
    rod = straight(-0.9 * np.pi**2 * UP, stiffness=(1.0, 50.0, 50.0))
    answer = stability(rod, PINNED)
    assert answer.index == 0
    assert abs(answer.margin) < 1e-9  # neutral: nothing holds the rotation
    field = lowest_mode(rod, PINNED)
    np.testing.assert_allclose(np.abs(field), np.tile(UP, (len(MESH), 1)), atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "criticals"),
    [
        (CANTILEVER, [(n - 0.5) ** 2 * np.pi**2 for n in (1, 2, 3, 4)]),
        (GUIDED, [n**2 * np.pi**2 for n in (1, 2, 3, 4)]),
        (CLAMPED, [4 * np.pi**2, 4 * PROP**2, 16 * np.pi**2]),
    ],
)
@pytest.mark.parametrize("stiffness", [(1, 1, 1), (1, 1000, 1)], ids=["round", "flat"])
def test_index_counts_the_critical_loads_passed(kind, criticals, stiffness):
    planes = 2 if stiffness[1] == 1 else 1  # a round column buckles in two planes at once
    for passed, (low, high) in enumerate(zip([0.0, *criticals[:-1]], criticals, strict=True)):
        rod = straight(-0.5 * (low + high) * UP, stiffness=stiffness)
        assert int(stability(rod, kind).index) == planes * passed


@pytest.mark.parametrize("stiffness", [(1, 1, 0.7), (1, 5, 0.7)], ids=str)
def test_heavy_upright_column(stiffness):
    critical = 2.25 * optimize.brentq(lambda x: special.jv(-1 / 3, x), 1.5, 2.2) ** 2
    assert critical == pytest.approx(7.837, abs=1e-3)
    for factor in (BELOW, ABOVE):
        weight = factor * critical
        rod = straight(-weight * UP, load=-weight * UP, stiffness=stiffness)
        assert is_stable(rod, CANTILEVER) == (factor < 1)


@pytest.mark.parametrize("torsion", [0.7, 3.0])
def test_twisted_rod_between_clamps_without_thrust(torsion):
    # z = y1 + i y2: z'''' = i m z''' with z = z' = 0 at both ends has a solution first where tan(m/2) = m/2
    for factor in (BELOW, ABOVE):
        moment = factor * 2 * PROP
        rod = straight(np.zeros(3), stiffness=(1, 1, torsion), twist=moment / torsion, moment=moment * UP)
        assert is_stable(rod, CLAMPED) == (factor < 1)


@pytest.mark.parametrize("torsion", [0.7, 1.0, 1.5])
def test_twisted_ring(torsion):
    # Michell and Zajac: the ring leaves its plane at a twist of 2 pi sqrt(3) B / C
    curvature, s = 2 * np.pi, MESH
    for factor in (BELOW, ABOVE):
        twist = factor * curvature * np.sqrt(3) / torsion
        turning = rotations.from_rotation_vector(s[:, None] * curvature * np.array([0, 1.0, 0]))
        q = rotations.multiply(turning, rotations.from_rotation_vector(s[:, None] * twist * UP))
        r = np.stack([1 - np.cos(curvature * s), 0 * s, np.sin(curvature * s)], axis=1) / curvature
        axis = np.array([0, 1.0, 0])
        moment = curvature * axis + torsion * twist * rotations.tangent(q)
        force = np.tile(torsion * twist * curvature * axis, (len(s), 1))
        rod = Rod(Section(np.array([1, 1, torsion]), np.zeros(3)), np.zeros(3), MESH, q, r, force, moment)
        assert max(np.max(np.abs(defect)) for defect in rod.defects()[:3]) < 1e-6  # it is an equilibrium
        assert is_stable(rod, CLAMPED) == (factor < 1)


def test_strip_buckles_sideways():
    # Prandtl and Michell: a deep cantilever under a tip force, P L^2 = 4.0126 sqrt(kz times the weak bending stiffness)
    stiffness = np.array([1e6, 1.0, 0.5])
    for factor in (BELOW, ABOVE):
        load = factor * 4.012599 * np.sqrt(stiffness[1] * stiffness[2])
        force, s = np.array([0, load, 0]), MESH[:, None]
        rod = straight(force, stiffness=stiffness, moment=np.array([-load, 0, 0]) * (1 - s))
        assert is_stable(rod, CANTILEVER) == (factor < 1)


# --- elastica -----------------------------------------------------------------------------------------------


def elastica(distance: float, torsion: float, waves: int = 1) -> Rod:
    """Return the planar clamped elastica with ``waves`` arches, solved by the collocation from the exact one.

    sin(theta/2) = k sn(lam s), lam = 4 K(k) waves; the end distance is 2 E / K - 1 whatever the number of waves.
    """
    k = optimize.brentq(
        lambda k: 2 * special.ellipe(k * k) / special.ellipk(k * k) - 1 - distance, 1e-6, 1 - 1e-9, xtol=1e-15
    )
    rate = 4 * special.ellipk(k * k) * waves
    mesh = np.linspace(0, 1, 24 * waves + 1)
    sn, cn, _, _ = special.ellipj(rate * stations(mesh, STAGES), k * k)
    angle = 2 * np.arcsin(k * sn)
    across = np.array([0, -1.0, 0])  # turns x to z
    q = rotations.multiply(rotations.from_rotation_vector(angle[:, None] * across), rotations.from_tangent((1, 0, 0)))
    moment = (2 * k * rate * cn)[:, None] * across
    clamp = rotations.from_tangent((1, 0, 0))
    posed = case(
        ho.Cable(1, 0.01, 1, torsion),
        ho.End((0, 0, 0), tuple(clamp)),
        ho.End((distance, 0, 0), tuple(clamp)),
        np.zeros(3),
    )
    solved = solve_on(posed, mesh, pack(q, moment, np.array([-(rate**2), 0, 0]), STAGES), "gauss-newton")
    assert solved.ok and np.max(np.abs(solved.rod.r[:, 1])) < 1e-9
    assert solved.rod.force[0, 0] == pytest.approx(-(rate**2), rel=1e-9)
    return solved.rod


@pytest.mark.parametrize(("torsion", "threshold"), [(0.7, 0.446), (1.0, 1 / 3)])
def test_elastica_tips_out_of_its_plane(torsion, threshold):
    assert is_stable(elastica(ABOVE * threshold, torsion), CLAMPED)
    assert not is_stable(elastica(BELOW * threshold, torsion), CLAMPED)
    # what lowers the energy there leads out of the plane: the section turns about the tangent, or the tangent
    # turns about a section axis that lies in the plane of the bow
    rod = elastica(BELOW * threshold, torsion)
    field = rotations.rotate(rod.q, lowest_mode(rod, CLAMPED))
    assert np.max(np.abs(field[:, 1])) < 1e-3


@pytest.mark.parametrize("distance", [0.9, 0.5, 0.3, 0.1])
def test_elastica_of_a_cable_stiff_in_twist_stays_in_its_plane(distance):
    assert is_stable(elastica(distance, 3.0), CLAMPED)


@pytest.mark.parametrize("torsion", [0.7, 3.0, 100.0])
@pytest.mark.parametrize("distance", [0.95, 0.6, 0.3])
def test_two_arches_are_unstable(distance, torsion):
    assert not is_stable(elastica(distance, torsion, waves=2), CLAMPED)


@pytest.mark.parametrize("torsion", [0.7, 100.0])
def test_second_planar_mode_is_unstable(torsion):
    # the column's own second mode: y'''' + P y'' = 0 with sqrt(P) = 2 * 4.4934, antisymmetric about the middle
    distance = 0.95
    mesh = np.linspace(0, 1, 25)
    root = 2 * PROP
    u = stations(mesh, STAGES) - 0.5
    slope = np.cos(root * u) - np.cos(0.5 * root)
    curvature = -root * np.sin(root * u)
    size = np.sqrt(2 * (1 - distance) / np.mean(slope**2))  # what shortens the chord to the distance
    across = np.array([0, -1.0, 0])
    clamp = rotations.from_tangent((1, 0, 0))
    q = rotations.multiply(rotations.from_rotation_vector((size * slope)[:, None] * across), clamp)
    posed = case(
        ho.Cable(1, 0.01, 1, torsion),
        ho.End((0, 0, 0), tuple(clamp)),
        ho.End((distance, 0, 0), tuple(clamp)),
        np.zeros(3),
    )
    x = pack(q, (size * curvature)[:, None] * across, np.array([-(root**2), 0, 0]), STAGES)
    solved = solve_on(posed, mesh, x, "gauss-newton")
    assert solved.ok
    rod = solved.rod
    assert np.max(np.abs(rod.r[:, 1])) < 1e-9
    np.testing.assert_allclose(rod.r[:, 2], -rod.r[::-1, 2], atol=1e-9)  # antisymmetric: the second mode
    assert np.max(np.abs(rod.r[:, 2])) > 0.03
    assert not is_stable(rod, CLAMPED)


@pytest.mark.parametrize("factor", [BELOW, ABOVE])
def test_user_sees_a_column_buckle(factor):
    # a cantilever column under a dead load: straight below Euler's load, bent and stable above it
    clamp = ho.End((0, 0, 0), (1, 0, 0, 0))
    load = factor * np.pi**2 / 4
    shape = ho.equilibrium(ho.Cable(1, 0.01, 1, 0.7), clamp, ho.End(force=(0, 0, -load)))
    assert shape.ok and shape.stable
    bent = np.max(np.linalg.norm(shape.position[:, :2], axis=1))
    assert bent < 1e-8 if factor < 1 else bent > 0.05


def test_shaft_under_a_dead_end_torque():
    # straight, clamped at one end, a torque T fixed in space at the other: B theta'' + i T theta' = -lambda theta for
    # the complex tilt, theta(0) = 0 and B theta' + i T theta = 0 at the end: k cot k = -i T / 2, lambda = k^2 - T^2 / 4
    def least(torque: float) -> float:
        k = 0.5 * np.pi + 0j
        for step in np.linspace(0.0, torque, 200)[1:]:
            for _ in range(20):
                k -= (k / np.tan(k) + 0.5j * step) / (1.0 / np.tan(k) - k / np.sin(k) ** 2)
        return float((k * k - 0.25 * torque**2).real)

    cable = ho.Cable(1.0, 0.01, 1.0, 0.7)
    clamp = ho.End((0, 0, 0), (1, 0, 0, 0))
    for torque in (3.0, 3.9, 4.1, 5.0):  # below 2 the least eigenvalue is that of pure twist
        shape = ho.equilibrium(cable, clamp, ho.End(force=(0, 0, 0), moment=(0, 0, torque)))
        assert shape.stability_margin == pytest.approx(least(torque), abs=1e-3)
        assert shape.stable == (least(torque) > 0)
    assert least(4.0) > 0 > least(4.1)


def test_many_shapes_looked_at_a_few_at_a_time_are_the_same(monkeypatch):
    forces = (0.5, 2.0, 3.0, 30.0)  # on either side of pi^2 / 4, where a cantilever gives way
    rods = [straight(-force * UP) for force in forces]
    stacked = (np.stack([getattr(one, name) for one in rods]) for name in ("q", "r", "force", "moment"))
    many = Rod(rods[0].section, rods[0].load, MESH, *stacked)
    alone = [stability(rod, CANTILEVER) for rod in rods]
    for entries in (1, 10_000_000):
        monkeypatch.setattr("harness_opt.rod.stability.MOST_ENTRIES", entries)
        found = stability(many, CANTILEVER)
        assert found.index.tolist() == [int(one.index) for one in alone] == [0, 0, 2, 4]
        assert found.margin == pytest.approx([float(one.margin) for one in alone], rel=1e-6)
        assert not surely_stable(many, CANTILEVER)

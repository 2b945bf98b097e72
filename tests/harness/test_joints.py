"""Clips that let the cable turn or slide, and free bodies, against closed forms and against cables without them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipkinc

import harness_opt as ho
from harness_opt.harness.span_loads import LENGTH, POSITION, ROTATION, SIZE, SpanLoads
from harness_opt.model.results import at_clip, split
from harness_opt.numerics import rotations
from harness_opt.rod.boundary import case
from harness_opt.rod.equations import scale
from harness_opt.statics.cold_start import cold_start
from harness_opt.statics.mesh import refine
from harness_opt.statics.solve import solve_on

GRAVITY = (0.5, 0.0, -9.81)
CABLE = ho.Cable(0.6, 0.006, (2e-3, 3e-3), 1.6e-3, 0.05, rest_curvature=(1.0, -0.5, 0.8))
START = ho.End((0, 0, 0), tangent=(0, 0, 1), roll_deg=20)
END = ho.End((0.25, 0.05, 0.1), tangent=(1, 0, 0), roll_deg=-10)


def clip(kind: str, at: float, position, **more: object) -> ho.Clip:
    return ho.Clip(name="here", kind=kind, at=at, position=tuple(np.asarray(position, dtype=float).tolist()), **more)


def at_rest(cable: ho.Cable, start: ho.End, end: ho.End, *clips: ho.Clip, gravity=GRAVITY) -> ho.Motion:
    return ho.simulate(ho.Problem({"lead": ho.CableRun(cable, start, end, clips=clips)}, gravity=gravity))


def applied(motion: ho.Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return the force and the moment of the one clip in the first frame."""
    before, behind = split(motion).cables.values()
    loads = at_clip(before, behind)
    return loads.force[0, 0], loads.moment[0, 0]


# --- what spans pull with ---------------------------------------------------------------------------------


def loads(ends: np.ndarray, length: float, near: SpanLoads | None = None) -> SpanLoads:
    """Return the span whose ends are moved and turned by ``ends`` (12,) from START and END."""
    cable = ho.Cable(length, 0.006, (2e-3, 3e-3), 1.6e-3, 0.05, rest_curvature=(1.0, -0.5, 0.8))
    placed = []
    for end, by in ((START, ends[:6]), (END, ends[6:])):
        turn = rotations.from_rotation_vector(by[3:])
        place = tuple((np.asarray(end.position) + by[:3]).tolist())
        placed.append(ho.End(place, quaternion=tuple(rotations.multiply(turn, end.frame).tolist())))
    posed = case(cable, *placed, np.asarray(GRAVITY))
    if near is None:
        solved = refine(cold_start(posed, 0, None, "gauss-newton"), 1e-11, "gauss-newton")[0]
    else:
        like = near.solved.case.boundary
        posed = posed.signed_like(like.start_quaternion, like.end_quaternion)
        solved = solve_on(posed, near.solved.bound.mesh, near.solved.solution.x, "gauss-newton", residual=1e-13)
    assert solved.ok
    return SpanLoads(solved, scale(cable)[1], np.asarray(placed[0].position))


def test_loads_are_the_rates_of_the_energy_and_stiffness_those_of_the_loads():
    here, step = loads(np.zeros(12), 0.6), 1e-5
    here = loads(np.zeros(12), 0.6, here)
    moved = np.zeros((SIZE, 13))
    moved[POSITION[0], :3], moved[ROTATION[0], 3:6] = np.eye(3), np.eye(3)
    moved[POSITION[1], 6:9], moved[ROTATION[1], 9:12], moved[LENGTH, 12] = np.eye(3), np.eye(3), 1.0
    rates, stiffness = np.zeros(SIZE), np.zeros((SIZE, SIZE))
    for k in range(SIZE):
        by = step * np.eye(SIZE)[k]
        ahead, behind = (loads(sign * by[:12], 0.6 + sign * by[12], here) for sign in (1, -1))
        rates[k] = (ahead.energy - behind.energy) / (2 * step)
        stiffness[:, k] = (ahead.gradient - behind.gradient) / (2 * step)
    assert np.max(np.abs(rates - here.gradient)) < 1e-7 * np.max(np.abs(rates))
    assert np.max(np.abs(stiffness - here.stiffness)) < 1e-6 * np.max(np.abs(stiffness))


def tip_angle(load: float) -> float:
    """Return the angle, rad, of the tip of a cantilever of length and bending stiffness 1 under a dead ``load`` across.

    From load^(1/2) = K(k) - F(k, asin(1 / (k sqrt 2))), sin(theta / 2 + pi / 4) = k (Frisch-Fay, Flexible Bars, 2.2).
    """

    def missing(k: float) -> float:
        m = k * k
        return float(ellipkinc(np.pi / 2, m) - ellipkinc(np.arcsin(1 / (k * np.sqrt(2))), m)) - np.sqrt(load)

    k = brentq(missing, np.sqrt(0.5) + 1e-12, 1 - 1e-12, xtol=1e-15)
    return 2 * np.arcsin(k) - np.pi / 2


@pytest.mark.parametrize(("load", "published"), [(1.0, 0.445159), (5.0, 4.687488), (10.0, 9.901446)])
def test_a_sleeve_pushes_a_bent_cantilever_out(load, published):
    """Bigoni et al., J. Mech. Phys. Solids 61 (2013): with M^2 / 2 B, which is P sin(theta) of the tip."""
    cable, length = ho.Cable(0.3, 0.006, 0.02, 0.015), 0.3
    force = load * 0.02 / length**2
    posed = case(cable, ho.End((0, 0, 0), tangent=(1, 0, 0)).held(), ho.End(force=(0, 0, -force)), np.zeros(3))
    solved = refine(cold_start(posed, 0, None, "gauss-newton"), 1e-12, "gauss-newton")[0]
    pushed = -SpanLoads(solved, scale(cable)[1], np.zeros(3)).gradient[LENGTH] * length**2 / 0.02
    assert pushed == pytest.approx(load * np.sin(tip_angle(load)), rel=1e-9)
    assert pushed == pytest.approx(published, abs=1e-6)


# --- clips ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["pivot", "ring"])
def test_a_pivot_or_a_ring_where_the_cable_is_anyway_changes_nothing(kind):
    free = ho.equilibrium(CABLE, START, END, GRAVITY)
    place = free.at(0.23)
    motion = at_rest(CABLE, START, END, clip(kind, 0.23, place.position))
    shapes = motion.cables["lead"]
    s = shapes.s
    if kind == "ring":
        assert motion.problem.found["lead, here"].places[0] == pytest.approx(0.23, abs=1e-7)
        s = np.concatenate([s[s <= 0.23], s[s > 0.23]])
    assert np.max(np.abs(shapes.position[0] - free.at(np.clip(s, 0, 0.6)).position)) < (
        6e-10 if kind == "pivot" else 1e-7
    )
    force, moment = applied(motion)
    assert np.linalg.norm(force) < 1e-6
    assert np.linalg.norm(moment) < 1e-9


def test_a_pivot_takes_force_and_no_moment():
    force, moment = applied(at_rest(CABLE, START, END, clip("pivot", 0.3, (0.1, 0.06, 0.2))))
    assert np.linalg.norm(force) > 0.01
    assert np.linalg.norm(moment) < 1e-10


def test_a_swivel_takes_no_moment_about_its_tangent():
    tangent = rotations.unit([1.0, 0.4, 0.2])
    force, moment = applied(at_rest(CABLE, START, END, clip("swivel", 0.3, (0.1, 0.06, 0.2), tangent=tuple(tangent))))
    assert np.linalg.norm(force) > 0.01
    assert np.linalg.norm(moment) > 1e-3
    assert abs(moment @ tangent) < 1e-10


@pytest.mark.parametrize("kind", ["sleeve", "ring"])
def test_what_slides_without_friction_has_the_same_configurational_force_on_both_sides(kind):
    given = {"tangent": (1.0, 0.4, 0.2)} if kind == "sleeve" else {}
    motion = at_rest(CABLE, START, END, clip(kind, 0.3, (0.1, 0.06, 0.2), **given))
    station = motion.cables["lead"].clip_stations[0]
    shapes, sides = motion.cables["lead"], []
    for k in (station, station + 1):
        q, force, moment = shapes.quaternion[0, k], shapes.force[0, k], shapes.moment[0, k]
        omega, own = shapes.curvature[0, k], rotations.rotate(rotations.conjugate(shapes.quaternion[0, k]), moment)
        strain = omega - np.asarray(CABLE.rest_curvature)
        sides.append(force @ rotations.tangent(q) + own @ omega - 0.5 * strain @ (CABLE.stiffness * strain))
    assert sides[0] == pytest.approx(sides[1], abs=1e-9)
    assert abs(motion.problem.found["lead, here"].places[0] - 0.3) > 1e-3


def test_a_ring_on_a_symmetric_cable_finds_the_middle():
    cable = ho.Cable(0.48, 0.006, 2e-3, 1.6e-3, 0.02)
    start, end = (ho.End((x, 0, 0), tangent=(x and -1, 0, 1) if x else (1, 0, 1), roll_deg=0) for x in (0.0, 0.4))
    end = ho.End((0.4, 0, 0), tangent=(1, 0, -1), roll_deg=0)
    motion = at_rest(cable, start, end, clip("ring", 0.22, (0.2, 0, 0.12)), gravity=(0, 0, -9.81))
    assert motion.problem.found["lead, here"].places[0] == pytest.approx(0.24, abs=1e-9)


def test_a_flat_sleeve_with_a_roll_guides_it_and_one_without_lets_it_turn():
    turns = at_rest(CABLE, START, END, clip("sleeve", 0.3, (0.1, 0.06, 0.2), tangent=(1.0, 0.4, 0.2)))
    guided = at_rest(CABLE, START, END, clip("sleeve", 0.3, (0.1, 0.06, 0.2), tangent=(1.0, 0.4, 0.2), roll_deg=70))
    along = rotations.unit([1.0, 0.4, 0.2])
    assert abs(applied(turns)[1] @ along) < 1e-10 < abs(applied(guided)[1] @ along)


def test_a_beam_over_four_supports_has_the_reactions_of_the_books():
    """Three equal spans and an overhang under their weight, on hinges: Clapeyron's three moments.

    M0 = 0 and M3 = -w a^2 / 2 at the outer supports, M_(i-1) + 4 M_i + M_(i+1) = -w L^2 / 2 at the inner ones.
    """
    span, overhang, bending = 0.2, 0.02, 0.05
    weight = 0.1 * bending / span**3  # N/m, so light that it hardly bends
    length = 3 * span + overhang
    cable = ho.Cable(length, 0.006, bending, bending, weight / 9.81)
    rings = [
        ho.Clip(name=name, kind="ring", at=at, position=(at, 0.0, 0.0))
        for name, at in (("b", span), ("c", 2 * span), ("d", 3 * span))
    ]
    shapes = at_rest(cable, ho.End((0, 0, 0)), ho.End(), *rings, gravity=(0, 0, -9.81)).cables["lead"]
    last = -weight * overhang**2 / 2
    inner = np.linalg.solve([[4.0, 1.0], [1.0, 4.0]], [-weight * span**2 / 2, -weight * span**2 / 2 - last])
    moments = np.array([0.0, *inner, last])
    slopes = np.diff(moments) / span
    expected = [weight * span / 2 + slopes[0]]
    expected += [weight * span + slopes[k] - slopes[k - 1] for k in (1, 2)]
    expected.append(weight * (span / 2 + overhang) - slopes[2])
    force = shapes.force[0, :, 2]
    up = [-force[0], *(force[k] - force[k + 1] for k in shapes.clip_stations)]
    assert np.array(up) == pytest.approx(expected, rel=1e-4)


def test_a_clip_that_is_drawn_in_the_wrong_place_along_the_cable_is_slid_to_where_it_reaches():
    motion = at_rest(CABLE, START, END, clip("ring", 0.05, (0.1, 0.06, 0.2)))
    other = at_rest(CABLE, START, END, clip("ring", 0.3, (0.1, 0.06, 0.2)))
    places = [one.problem.found["lead, here"].places[0] for one in (motion, other)]
    assert places[0] == pytest.approx(places[1], abs=1e-9)


def test_a_cable_that_slides_out_of_its_sleeve_has_no_rest():
    """One end free, hanging: nothing keeps it in."""
    cable = ho.Cable(0.4, 0.006, 2e-3, 1.6e-3, 0.5)
    run = ho.CableRun(cable, ho.End(), ho.End(), clips=(clip("sleeve", 0.2, (0, 0, 0), tangent=(0, 0, -1)),))
    motion = ho.simulate(ho.Problem({"lead": run}, gravity=(0, 0, -9.81)), throw=False)
    assert not motion.ok
    assert "slide out of their clips" in motion.message


# --- free bodies ------------------------------------------------------------------------------------------


def test_a_cable_cut_in_two_by_a_free_body_without_mass_hangs_as_if_it_were_whole():
    free = ho.equilibrium(CABLE, START, END, GRAVITY)
    parts = [ho.Cable(length, 0.006, (2e-3, 3e-3), 1.6e-3, 0.05, CABLE.rest_curvature) for length in (0.25, 0.35)]
    here = ho.End((0, 0, 0), quaternion=(1, 0, 0, 0), body="splice")
    cables = {"one": ho.CableRun(parts[0], START, here), "other": ho.CableRun(parts[1], here, END)}
    place = free.at(0.25)
    near = [tuple(np.round(values, 2).tolist()) for values in (place.position, place.quaternion)]
    splice = ho.Body(position=near[0], quaternion=tuple(rotations.normalise(near[1]).tolist()), free=True)
    motion = ho.simulate(ho.Problem(cables, {"splice": splice}, gravity=GRAVITY))
    for name, first in (("one", 0.0), ("other", 0.25)):
        shapes = motion.cables[name]
        assert np.max(np.abs(shapes.position[0] - free.at(first + shapes.s).position)) < 6e-10


def test_a_weight_on_two_cables_hangs_from_both():
    mass = 0.2
    cable = ho.Cable(0.3, 0.004, 1e-4, 1e-4, 0.01)
    ends = [ho.End((x, 0, 0), tangent=(0, 0, z), roll_deg=0) for x, z in ((-0.1, -1), (0.1, 1))]
    cables = {
        "left": ho.CableRun(cable, ends[0], ho.End((-0.01, 0, 0.01), tangent=(0, 0, -1), roll_deg=0, body="weight")),
        "right": ho.CableRun(cable, ho.End((0.01, 0, 0.01), tangent=(0, 0, 1), roll_deg=0, body="weight"), ends[1]),
    }
    bodies = {"weight": ho.Body(free=True, mass=mass)}
    motion = ho.simulate(ho.Problem(cables, bodies, gravity=(0, 0, -9.81)))
    pulled = motion.cables["right"].force[0, 0] - motion.cables["left"].force[0, -1]
    assert pulled == pytest.approx([0, 0, 9.81 * mass], abs=1e-9)
    assert motion.problem.found["weight"].positions[0, :2] == pytest.approx([0, 0], abs=1e-8)

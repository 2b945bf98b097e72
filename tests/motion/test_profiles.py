"""Paths, profiles and what is shown between them: closed forms, independent integration, and solved shapes."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

import harness_opt as ho
from harness_opt.model.results import Snap
from harness_opt.motion.playback import between

CABLE = ho.Cable(length=1.0, diameter=0.01, bending_stiffness=1.0, torsional_stiffness=0.7, mass_per_length=0.2)
UP = (1.0, 0.0, 0.0, 0.0)
ALONG_X = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
CLAMP = ho.End(
    (0.3, 0.1, 0.4), tuple(Rotation.from_euler("x", 30, degrees=True).as_quat(scalar_first=True)), body="arm"
)
HINGE = ho.Hinge((0.6, 0.0, 0.3), (0.0, -1.0, 0.4), 0.2, 1.2)
STEP = 0.05


def problem_of(start: ho.End, end: ho.End, **changes: object) -> ho.Problem:
    return dataclasses.replace(
        ho.Problem(
            {"lead": ho.CableRun(CABLE, start, end)}, {"arm": ho.Body(HINGE)}, gravity=(0, 0, -9.81), duration=2.0
        ),
        spatial_step=STEP,
        **changes,
    )


PROBLEM = problem_of(ho.End((0, 0, 0), UP), CLAMP)


@pytest.fixture(scope="module")
def motion() -> ho.Motion:
    found = ho.simulate(PROBLEM)
    assert not found.snaps
    return found


def hinged(angle: np.ndarray, end: ho.End) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and rotation matrices of a clamp that turns about HINGE, by SciPy's rotations."""
    axis = np.array(HINGE.axis) / np.linalg.norm(HINGE.axis)
    turn = Rotation.from_rotvec(np.outer(angle, axis))
    held = Rotation.from_quat(end.quaternion, scalar_first=True)
    return HINGE.point + turn.apply(np.subtract(end.position, HINGE.point)), (turn * held).as_matrix()


def polygon(position: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(position, axis=-2), axis=-1).sum(axis=-1)


def turns(rotation: np.ndarray) -> np.ndarray:
    """Return the rotation vectors (T, 100, 3) from each of 101 nodes to the next, by SciPy."""
    frames = rotation.reshape(-1, 101, 3, 3)
    steps = np.swapaxes(frames[:, :-1], -1, -2) @ frames[:, 1:]
    return Rotation.from_matrix(steps.reshape(-1, 3, 3)).as_rotvec().reshape(-1, 100, 3)


def integrated(s: np.ndarray, profile: ho.Profile) -> np.ndarray:
    """Return the centreline (17) of the directors alone, by a spline of order 8."""
    return profile.position[0] + make_interp_spline(s, profile.rotation[:, :, 2], k=7).antiderivative()(s)


# --- paths --------------------------------------------------------------------------------------------------


def test_the_path_of_a_hinged_clamp_is_a_circle():
    path = ho.disperse(PROBLEM, "lead")
    position, rotation = hinged(np.linspace(0.2, 1.2, len(path)), CLAMP)
    np.testing.assert_allclose(path.position, position, atol=1e-14)
    np.testing.assert_allclose(path.rotation, rotation, atol=1e-14)
    steps = np.linalg.norm(np.diff(path.position, axis=0), axis=1)
    assert np.all(steps <= STEP) and np.all(steps > 0.7 * STEP)


def test_the_path_is_where_the_motion_is_solved(motion):
    path, last = ho.disperse(PROBLEM, "lead"), [profile.position[-1] for profile in ho.profiles(motion, "lead")]
    np.testing.assert_allclose(path.position, last, atol=1e-10)


def test_a_spatial_step_disperses_the_path():
    assert len(ho.disperse(PROBLEM, "lead", STEP / 4)) == pytest.approx(4 * len(ho.disperse(PROBLEM, "lead")), abs=4)


def test_the_path_of_the_fixed_point_stands_still():
    path = ho.disperse(PROBLEM, "lead", clamp="start")
    assert np.all(path.position == 0.0) and np.all(path.rotation == np.eye(3))


def test_a_path_drives_a_motion(motion):
    """The paper's list of positions and rotation matrices is all that a simulation needs to know of the clamp."""
    path = ho.disperse(PROBLEM, "lead")
    driven = problem_of(PROBLEM.cables["lead"].start, ho.End((0, 0, 0), UP, body="arm"))
    driven = dataclasses.replace(driven, bodies={"arm": ho.Body(path.poses(duration=2.0))})
    again = ho.simulate(driven, frames=np.linspace(0, 1, len(path)))
    assert driven.bodies["arm"].motion.times[-1] == 2.0
    difference = again.cables["lead"].position - motion.cables["lead"].position
    assert np.max(np.abs(difference)) < 1e-6


def test_a_path_that_turns_on_the_spot_and_past_half_a_turn():
    angle = np.linspace(0.0, 2.0 * math.pi, 9)
    path = ho.Path(np.zeros((9, 3)), Rotation.from_rotvec(np.outer(angle, [0, 0, 1])).as_matrix())
    poses = path.poses(duration=4.0)
    np.testing.assert_allclose(poses.times, np.linspace(0, 4, 9))
    assert np.all(np.sum(np.multiply(poses.quaternions[1:], poses.quaternions[:-1]), axis=1) > 0.9)  # no sign jumps
    _, between_points = poses.poses([1 / 16])
    np.testing.assert_allclose(
        np.abs(between_points[0]), [math.cos(math.pi / 16), 0, 0, math.sin(math.pi / 16)], atol=1e-12
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ho.disperse(PROBLEM, "power"), r"cable: found 'power', expected one of 'lead'"),
        (lambda: ho.disperse(PROBLEM, "lead", clamp="middle"), r"clamp: found 'middle', expected 'start' or 'end'"),
        (lambda: ho.disperse(PROBLEM, "lead", 0.0), "spatial_step: found 0.0, expected"),
        (lambda: ho.disperse(PROBLEM, "lead", math.nan), "spatial_step: found nan, expected"),
        (lambda: ho.disperse(PROBLEM, "lead", 5.0), "spatial_step: found 5 m, expected at most .* the whole trail"),
        (lambda: ho.disperse(dataclasses.replace(PROBLEM, bodies={"arm": ho.Body()}), "lead"), "bodies: .*no path"),
        (lambda: ho.disperse(PROBLEM, "lead").poses(0.0), "duration: found 0.0, expected"),
    ],
)
def test_paths_that_cannot_be_dispersed(call, words):
    with pytest.raises(ho.ProblemError, match=words):
        call()


@pytest.mark.parametrize("free", [("position",), ("quaternion",), ("position", "quaternion")])
def test_a_free_end_has_no_path(free):
    loose = problem_of(PROBLEM.cables["lead"].start, dataclasses.replace(CLAMP, **dict.fromkeys(free)))
    words = rf"cables\.lead\.end: found an end without {' and '.join(free)}, expected both"
    with pytest.raises(ho.ProblemError, match=words):
        ho.disperse(loose, "lead")


# --- what a list of poses has to be ---------------------------------------------------------------------------

POINTS = np.arange(12.0).reshape(4, 3)
TURNS = Rotation.from_rotvec(POINTS).as_matrix()
KINDS = pytest.mark.parametrize(("kind", "point"), [(ho.Path, "path point"), (ho.Profile, "node")])


def spoiled(array: np.ndarray, at: object, value: object) -> np.ndarray:
    changed = array.copy()
    changed[at] = value
    return changed


@KINDS
@pytest.mark.parametrize(
    ("position", "rotation", "words"),
    [
        (POINTS, spoiled(TURNS, (2, slice(None), 0), -TURNS[2, :, 0]), "rotation: found .* determinant -1 at POINT 2"),
        (
            POINTS,
            spoiled(TURNS, (1, 0, 0), TURNS[1, 0, 0] + 1e-8),
            "rotation: .* at POINT 1 .*differs from the identity by",
        ),
        (
            POINTS,
            spoiled(TURNS, 3, np.sqrt(1.3) * TURNS[3]),
            "at POINT 3 whose A.T A differs from the identity by 0.3,",
        ),
        (POINTS, spoiled(TURNS, 0, 1e300), "at POINT 0 whose A.T A differs from the identity by inf,"),
        (POINTS, spoiled(TURNS, (1, 1, 1), math.nan), "rotation: found .*nan.* at POINT 1, expected finite"),
        (spoiled(POINTS, (3, 0), math.inf), TURNS, r"position: found \[inf, 10.0, 11.0\] at POINT 3, expected finite"),
        (POINTS[:, :2], TURNS, r"position: found an array of shape \(4, 2\), expected \(M, 3\)"),
        (POINTS, TURNS[0], r"rotation: found an array of shape \(3, 3\), expected \(M, 3, 3\)"),
        (POINTS[:3], TURNS, "rotation: found 4 matrices, expected one a POINT, 3"),
        (POINTS[:1], TURNS[:1], r"position: found an array of shape \(1, 3\), expected .* at least two POINTs"),
        (1.0, TURNS, r"position: found an array of shape \(\)"),
        ([[0, 0, 0], [1]], TURNS, "position: found rows of different lengths"),
        (POINTS.astype(complex), TURNS, "position: found an array of complex128, expected real"),
        (POINTS, None, "rotation: found an array of object, expected real"),
    ],
)
def test_poses_that_cannot_be(kind, point, position, rotation, words):
    with pytest.raises(ho.ProblemError, match=words.replace("POINT", point)):
        kind(position, rotation)


def test_every_mistake_is_told_at_once():
    with pytest.raises(ho.ProblemError) as caught:
        ho.Path(spoiled(POINTS, 0, math.nan), -TURNS)
    assert [line.split(":")[0] for line in caught.value.mistakes] == ["position", "rotation"]


@KINDS
def test_poses_do_not_change_behind_the_back(kind, point):
    mine = POINTS.copy()
    made = kind(mine, TURNS)
    mine[0] = 7.0
    np.testing.assert_array_equal(made.position, POINTS)
    with pytest.raises(ValueError, match="read-only"):
        made.rotation[0] = 0.0


# --- files --------------------------------------------------------------------------------------------------


def test_files_come_back_to_the_same_bits(tmp_path, motion):
    path, listed = ho.disperse(PROBLEM, "lead"), ho.profiles(motion, "lead")
    path.save(tmp_path / "path")  # the name as given, whatever its ending
    ho.save_profiles(tmp_path / "all.npz", listed)
    listed[3].save(tmp_path / "one.npz")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["all.npz", "one.npz", "path"]
    pairs = [(ho.Path.load(tmp_path / "path"), path), (ho.Profile.load(str(tmp_path / "one.npz")), listed[3])]
    for again, saved in (*pairs, *zip(ho.load_profiles(tmp_path / "all.npz"), listed, strict=True)):
        assert type(again) is type(saved)
        np.testing.assert_array_equal(again.position, saved.position)
        np.testing.assert_array_equal(again.rotation, saved.rotation)


def npz(**arrays: object):
    return lambda file: np.savez(file, **{name.replace("_", "/"): array for name, array in arrays.items()})


def cut_short(file: Path) -> None:
    npz(path_position=POINTS, path_rotation=TURNS)(file)
    file.write_bytes(file.read_bytes()[:-200])


def damaged(file: Path) -> None:
    npz(path_position=POINTS, path_rotation=TURNS)(file)
    content = bytearray(file.read_bytes())
    content[content.index(POINTS.tobytes()) + 9] ^= 0xFF
    file.write_bytes(content)


def single(file: Path) -> None:
    with file.open("wb") as handle:
        np.save(handle, POINTS)


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda file: None, "no way to read it .*No such file"),
        (lambda file: file.mkdir(), "no way to read it .*directory"),
        (lambda file: file.write_bytes(b""), "found a file that is none, or damaged"),
        (lambda file: file.write_bytes(b"t,x,y,z\n0,1,2,3\n"), "found a file that is none, or damaged"),
        (cut_short, "found a file that is none, or damaged"),
        (damaged, "found a file that is none, or damaged .*CRC"),
        (single, "found a single array"),
        (npz(), "found nothing, expected an npz archive of path/position and path/rotation"),
        (npz(lead_position=POINTS), "found lead/position, expected an npz archive of path/position"),
        (npz(profile_position=POINTS[None], profile_rotation=TURNS[None]), "found profile/position, profile/rotation"),
        (npz(path_position=np.array([None, 1]), path_rotation=TURNS), "found a file that is none, .*pickle"),
        (npz(path_position=POINTS, path_rotation=-TURNS), "rotation: found a matrix of determinant -1 at path point 0"),
    ],
    ids=[
        "missing", "folder", "empty", "text", "cut short", "damaged", "npy", "nothing in it", "another's", "profiles",
        "pickled", "no rotations",
    ],
)  # fmt: skip
def test_files_that_are_no_path(tmp_path, write, words):
    file = tmp_path / "path.npz"
    write(file)
    with pytest.raises(ho.ProblemError, match=rf"path\.npz: .*{words}"):
        ho.Path.load(file)


def test_files_that_are_no_profiles(tmp_path):
    file = tmp_path / "profiles.npz"
    two = [ho.Profile(POINTS, TURNS), ho.Profile(POINTS + 1.0, TURNS)]
    ho.save_profiles(file, two)
    with pytest.raises(ho.ProblemError, match="found 2 profiles, expected one"):
        ho.Profile.load(file)
    np.savez(file, **{"profile/position": np.stack([POINTS] * 2), "profile/rotation": np.stack([TURNS, -TURNS])})
    with pytest.raises(ho.ProblemError, match=r"profiles\.npz: profile 1: rotation: found .* at node 0"):
        ho.load_profiles(file)
    np.savez(file, **{"profile/position": POINTS, "profile/rotation": TURNS})
    with pytest.raises(ho.ProblemError, match=r"of shape \(4, 3\) .*expected \(P, N, 3\)"):
        ho.load_profiles(file)
    with pytest.raises(ho.ProblemError, match="profiles: found profiles of 3 and 4 nodes"):
        ho.save_profiles(file, [two[0], ho.Profile(POINTS[:3], TURNS[:3])])
    with pytest.raises(ho.ProblemError, match="profiles: found none"):
        ho.save_profiles(file, [])


def test_places_that_cannot_be_written(tmp_path):
    path = ho.Path(POINTS, TURNS)
    for place in (tmp_path / "nowhere" / "path.npz", tmp_path):
        with pytest.raises(ho.ProblemError, match="found no way to write it"):
            path.save(place)
    assert not any(tmp_path.iterdir()) and not list(tmp_path.parent.glob(f".{tmp_path.name}*.part"))


# --- what is shown ----------------------------------------------------------------------------------------------

BOTH = pytest.mark.parametrize("how", ["linear", "exact"])


def halves(motion: ho.Motion) -> np.ndarray:
    return 0.5 * (motion.motion[1:] + motion.motion[:-1])


@BOTH
@pytest.mark.parametrize(("step", "count"), [(0.02, 101), (0.3, 8), (2.0, 2), (1.999999999, 3)])
def test_moments_run_from_the_first_to_the_last(motion, how, step, count):
    times, shown = ho.display(motion, "lead", step, how)
    assert times[0] == 0.0 and times[-1] == 2.0 and len(times) == len(shown) == count
    np.testing.assert_allclose(np.diff(times)[:-1], step, rtol=1e-12)
    assert 0 < times[-1] - times[-2] <= step * (1 + 1e-12)


@BOTH
def test_at_a_frame_its_own_profile_is_shown(motion, how):
    step = 2.0 / (len(motion.motion) - 1) / 3  # two moments between every two frames
    _, shown = ho.display(motion, "lead", step, how)
    for profile, solved in zip(shown[::3], ho.profiles(motion, "lead"), strict=True):
        np.testing.assert_array_equal(profile.position, solved.position)
        np.testing.assert_array_equal(profile.rotation, solved.rotation)


@BOTH
def test_beside_a_frame_the_shape_is_the_frame_to_rounding(motion, how):
    beside = 1e-11
    for offset, frames in ((beside, motion.motion[:-1]), (-beside, motion.motion[1:])):
        position, _ = between(motion, "lead", frames + offset, how)
        kept = slice(0, -1) if offset > 0 else slice(1, None)
        assert np.max(np.abs(position - motion.cables["lead"].position[kept])) < 100 * beside


def test_exact_keeps_the_length(motion):
    s = motion.cables["lead"].s
    for profile in ho.display(motion, "lead", 0.017)[1]:
        # the solved frames themselves are so good, see the stations' distance and the motion's tolerance
        assert np.max(np.abs(integrated(s, profile) - profile.position)) < 2e-8
    shortened = [abs(polygon(profile.position) - 1.0) for profile in ho.display(motion, "lead", 0.017, "linear")[1]]
    assert max(shortened) > 1e-4


def test_exact_meets_the_clamps_at_any_moment(motion):
    times, shown = ho.display(motion, "lead", 0.013)
    position, rotation = hinged(0.2 + times / 2.0, CLAMP)
    for k, profile in enumerate(shown):
        np.testing.assert_allclose(profile.position[[0, -1]], [(0, 0, 0), position[k]], atol=2e-12)
        np.testing.assert_allclose(profile.rotation[[0, -1]], [np.eye(3), rotation[k]], atol=2e-12)


def test_a_cable_carried_along_turns_as_one():
    """Both clamps on one body: exact turns the cable, linear cuts the circle, which shortens it by its chord."""
    carried = problem_of(ho.End((0, 0, 0), UP, body="arm"), CLAMP, gravity=(0, 0, 0))
    moved = ho.simulate(carried, spatial_step=0.2)
    half = 0.5 / (len(moved.motion) - 1)  # angle between neighbours: 1 rad in all
    position, rotation = between(moved, "lead", halves(moved), "exact")
    first = ho.profiles(moved, "lead")[0]
    axis = np.array(HINGE.axis) / np.linalg.norm(HINGE.axis)
    for k, at in enumerate(halves(moved)):
        turn = Rotation.from_rotvec(at * axis)
        np.testing.assert_allclose(position[k], HINGE.point + turn.apply(first.position - HINGE.point), atol=2e-7)
        np.testing.assert_allclose(rotation[k], turn.as_matrix() @ first.rotation, atol=2e-6)
    cut, turned = between(moved, "lead", halves(moved), "linear")
    along = (position - HINGE.point) @ axis
    foot = HINGE.point + along[..., None] * axis
    np.testing.assert_allclose(cut, foot + math.cos(half) * (position - foot), atol=2e-7)
    np.testing.assert_allclose(turned, rotation, atol=2e-6)
    assert np.all(polygon(cut) < polygon(position))


def test_a_free_end_hangs_as_it_is_carried():
    hanging = problem_of(ho.End((0, 0, 0), ALONG_X, body="arm"), ho.End())
    hanging = dataclasses.replace(hanging, bodies={"arm": ho.Body(ho.Slide((1, 2, 3), 0.0, 0.5))})
    moved = ho.simulate(hanging, spatial_step=0.25)
    still = moved.cables["lead"].position[0]
    for how, at in itertools.product(["exact", "linear"], [0.1, 0.6]):
        position, _ = between(moved, "lead", np.array([at]), how)
        np.testing.assert_allclose(position[0], still + at * 0.5 * np.array([1, 2, 3]) / math.sqrt(14), atol=2e-7)


GIVEN = [(), ("position",), ("quaternion",), ("position", "quaternion")]


@pytest.mark.parametrize(
    ("start", "end"), [(a, b) for a, b in itertools.product(GIVEN, GIVEN) if "position" in (*a, *b)], ids=str
)
def test_what_the_ends_are_given_is_met_and_no_more_is_bent(motion, start, end):
    """Shapes between clamps are as good as any to interpolate between; so the ends may be loosened afterwards."""
    run = PROBLEM.cables["lead"]
    loose = [
        dataclasses.replace(clamp, **{name: None for name in ("position", "quaternion") if name not in given})
        for clamp, given in ((run.start, start), (run.end, end))
    ]
    problem = problem_of(*loose)
    values = halves(motion)
    position, rotation = between(dataclasses.replace(motion, problem=problem), "lead", values, "exact")
    target, target_frame = hinged(0.2 + values, CLAMP)
    goals = {("start", "position"): (position[:, 0], 0.0), ("start", "quaternion"): (rotation[:, 0], np.eye(3))}
    goals |= {("end", "position"): (position[:, -1], target), ("end", "quaternion"): (rotation[:, -1], target_frame)}
    for (name, quantity), (found, goal) in goals.items():
        if quantity in {"start": start, "end": end}[name]:
            np.testing.assert_allclose(found, np.broadcast_to(goal, found.shape), atol=2e-12)
    s = motion.cables["lead"].s
    for k in range(len(values)):
        profile = ho.Profile(position[k], rotation[k])
        assert np.max(np.abs(integrated(s, profile) - profile.position)) < 2e-8
    solved = turns(Rotation.from_quat(motion.cables["lead"].quaternion.reshape(-1, 4), scalar_first=True).as_matrix())
    change = turns(rotation) - 0.5 * (solved[1:] + solved[:-1])
    size = np.linalg.norm(change, axis=-1).max(axis=0)
    if set(start).isdisjoint(end):
        assert size.max() < 1e-12  # placing the whole is enough, and the curvature is the plain mean
    else:
        assert size.max() > 1e-8
        # an end free to turn bears no moment: at half a piece from it, the change is next to nothing
        assert size[0] < 0.03 * size.max() or "quaternion" in start
        assert size[-1] < 0.03 * size.max() or "quaternion" in end


def test_far_from_the_origin_nothing_is_lost():
    away = np.array([3e4, -2e4, 1e4])
    moved = dataclasses.replace(HINGE, point=tuple(away + HINGE.point))
    end = dataclasses.replace(CLAMP, position=tuple(away + CLAMP.position))
    far = dataclasses.replace(problem_of(ho.End(tuple(away), UP), end), bodies={"arm": ho.Body(moved)})
    found = ho.simulate(far, frames=[0.0, 0.1])
    near = ho.simulate(PROBLEM, frames=[0.0, 0.1])
    shown, expected = (between(m, "lead", np.array([0.05]), "exact")[0] for m in (found, near))
    np.testing.assert_allclose(shown - away, expected, atol=1e-7)


def test_second_order_in_the_spatial_step():
    steps = [STEP, 2 * STEP, 4 * STEP]
    motions = [ho.simulate(PROBLEM, spatial_step=step) for step in steps]
    errors = [ho.display_error(found, "lead") for found in motions]
    widths = np.log([1.0 / (len(found.motion) - 1) for found in motions])
    for how, quantities in {"linear": ("node", "length", "clamp"), "exact": ("node",)}.items():
        for quantity in quantities:
            order = np.polyfit(widths, np.log([getattr(error[how], quantity) for error in errors]), 1)[0]
            assert order == pytest.approx(2.0, abs=0.2), (how, quantity)
    for error in errors:
        assert error["exact"].node < error["linear"].node
        assert error["exact"].length < 1e-4 * error["linear"].length
        assert error["exact"].clamp < 1e-10 and error["exact"].clamp_turn < 1e-10


def test_the_errors_are_those_of_the_profiles_shown(motion):
    errors = ho.display_error(motion, "lead", 0.9)
    solved = ho.simulate(PROBLEM, frames=np.union1d(motion.motion, [0.45, 0.9]))
    for how, error in errors.items():
        times, shown = ho.display(motion, "lead", 0.9, how)
        np.testing.assert_allclose(times, [0.0, 0.9, 1.8, 2.0])
        truth = [solved.cables["lead"].position[np.searchsorted(solved.motion, at)] for at in (0.45, 0.9)]
        distance = np.linalg.norm(np.array([p.position for p in shown[1:3]]) - truth, axis=-1)
        assert error.node == pytest.approx(distance.max(), rel=1e-6)
        assert error.time == pytest.approx([0.9, 1.8][distance.max(axis=1).argmax()])
        lengths = [polygon(p.position) / polygon(r) - 1.0 for p, r in zip(shown[1:3], truth, strict=True)]
        assert error.length == pytest.approx(np.abs(lengths).max(), rel=1e-6)


def test_no_error_where_all_moments_are_frames(motion):
    errors = ho.display_error(motion, "lead", 2.0)
    assert all(dataclasses.astuple(error) == (0.0,) * 5 for error in errors.values())


# --- snaps, partial motions, bad input --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def snapping() -> ho.Motion:
    """Return the motion of a flat strip, bowed up, whose end is turned until it has to bow down."""
    strip = ho.Cable(length=1.0, diameter=0.01, bending_stiffness=(30.0, 1.0), torsional_stiffness=0.7)
    end = ho.End((0.8, 0, 0), ALONG_X, body="arm")
    arm = ho.Body(ho.Hinge((0.8, 0, 0), (0, 1, 0), -math.pi / 3, math.pi / 3))
    run = ho.CableRun(strip, ho.End((0, 0, 0), ALONG_X), end, bow=(0, 0, 1))
    found = ho.simulate(ho.Problem({"lead": run}, {"arm": arm}), spatial_step=0.04)
    assert len(found.snaps) == 1
    return found


def test_until_a_snap_the_older_shape_is_shown(snapping):
    k = snapping.snaps[0].frame
    solved = snapping.cables["lead"].position
    jump = np.linalg.norm(solved[k] - solved[k - 1], axis=1).max()
    values = snapping.motion[k - 1] + np.array([0.1, 0.5, 0.999]) * (snapping.motion[k] - snapping.motion[k - 1])
    held, _ = between(snapping, "lead", values, "linear")
    np.testing.assert_array_equal(held, np.stack([solved[k - 1]] * 3))
    position, rotation = between(snapping, "lead", values, "exact")
    assert np.linalg.norm(position - solved[k - 1], axis=-1).max() < 0.1 * jump
    angle = math.pi / 3 * (2 * values - 1) + math.pi / 2
    np.testing.assert_allclose(
        rotation[:, -1, :, 2], np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1), atol=2e-12
    )
    np.testing.assert_allclose(position[:, -1], [(0.8, 0, 0)] * 3, atol=2e-12)
    after, _ = between(snapping, "lead", snapping.motion[k : k + 1], "exact")
    np.testing.assert_array_equal(after[0], solved[k])


def test_another_cable_s_snap_is_its_own(snapping):
    others = dataclasses.replace(snapping, snaps=(Snap("power", 1, 0.1),))
    values = halves(snapping)[:1]
    for how in ("linear", "exact"):
        found, expected = (between(motion, "lead", values, how)[0] for motion in (others, snapping))
        np.testing.assert_array_equal(found, expected)


def test_a_motion_solved_in_part_is_shown_in_part(motion):
    lead = motion.cables["lead"]
    cut = {field.name: getattr(lead, field.name)[2:5] for field in dataclasses.fields(lead) if field.name != "s"}
    part = dataclasses.replace(motion, motion=motion.motion[2:5], cables={"lead": dataclasses.replace(lead, **cut)})
    times, shown = ho.display(part, "lead", 0.05)
    np.testing.assert_allclose(times[[0, -1]], 2.0 * part.motion[[0, -1]])
    np.testing.assert_allclose(times[1:-1] / 0.05, np.round(times[1:-1] / 0.05), atol=1e-9)
    np.testing.assert_array_equal(shown[-1].position, lead.position[4])


def test_a_scene_that_stands_still_has_one_moment():
    still = ho.simulate(dataclasses.replace(PROBLEM, bodies={"arm": ho.Body()}))
    times, shown = ho.display(still, "lead", 0.1)
    np.testing.assert_array_equal(times, [0.0])
    np.testing.assert_array_equal(shown[0].position, still.cables["lead"].position[0])
    assert ho.display_error(still, "lead")["exact"].node == 0.0


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan, math.inf, 2.1, "fast", 1e-6])
def test_temporal_steps_that_cannot_be(motion, step):
    for call in (ho.display, ho.display_error):
        with pytest.raises(ho.ProblemError, match=r"temporal_step: found .*, expected"):
            call(motion, "lead", step)


def test_names_that_are_unknown(motion):
    for call in (ho.profiles, ho.display_error, lambda *given: ho.display(*given, 0.1)):
        with pytest.raises(ho.ProblemError, match="cable: found 'power', expected one of 'lead'"):
            call(motion, "power")
    with pytest.raises(ho.ProblemError, match="interpolation: found 'cubic', expected 'exact' or 'linear'"):
        ho.display(motion, "lead", 0.1, "cubic")
    with pytest.raises(ho.ProblemError, match="no cable was solved"):
        ho.profiles(dataclasses.replace(motion, cables={}), "lead")


def test_clamps_out_of_reach_between_two_frames(motion):
    """Solved at poses within reach, played with the clamp further away than the cable is long."""
    far = dataclasses.replace(CLAMP, position=(0.9, 0.1, 0.9))
    played = dataclasses.replace(motion, problem=problem_of(PROBLEM.cables["lead"].start, far))
    with pytest.raises(
        ho.SolveError, match=r"cable lead, motion 0\.\d+: no curve between frames 0 and 1 .*spatial_step"
    ):
        ho.display(played, "lead", 0.01)

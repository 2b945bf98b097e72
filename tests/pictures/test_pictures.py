"""Pictures: what they show is counted, in the scene and in the pixels; what is missing has one line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness_opt.clearance.limits import all_limits
from harness_opt.clearance.measure import measure
from harness_opt.design.nominal import redesign
from harness_opt.errors import HarnessError
from harness_opt.files.arrays import KEPT
from harness_opt.files.read import write_problem
from harness_opt.files.stored_results import read_motion
from harness_opt.model.bodies import Body, Hinge
from harness_opt.model.cable import Cable, CableRun, End
from harness_opt.model.design import Design, Limits, Variable
from harness_opt.model.parts import Box, Capsule, Cylinder, Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.motion.simulate import simulate
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from harness_opt.pictures import drawing, opengl
from harness_opt.pictures import film as animation
from harness_opt.pictures import stills as pictures
from harness_opt.pictures.camera import TITLE_ROOM, Camera
from harness_opt.pictures.drawing import CABLES, SIZE, TOUCHES, Moment
from harness_opt.pictures.stills import AFTER
from harness_opt.pictures.window import Window
from harness_opt.report.result_files import write_results

UP, ALONG = (tuple(rotations.from_tangent(way)) for way in ((0, 0, 1), (1, 0, 0)))
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="windows come without X11 elsewhere")


@pytest.fixture(scope="module")
def pyvista():
    return pytest.importorskip("pyvista", reason="pyvista (the extra 'pictures') is not installed")


@pytest.fixture(scope="module")
def two_cables() -> Motion:
    """A head that turns on a mast, with two cables, of which one runs through the mast."""

    def run(length: float, side: float) -> CableRun:
        start = End((0.05, side, 0.0), UP)
        return CableRun(Cable(length, 0.006, 2e-3, 1.5e-3), start, End((0.12, side, 0.2), ALONG, body="head"))

    parts = {
        "base": Part(Box((0.3, 0.3, 0.02)), position=(0, 0, -0.015)),
        "mast": Part(Cylinder(0.02, 0.2), position=(0, 0, 0.1)),
        "head": Part(Box((0.2, 0.1, 0.05)), body="head", position=(0.02, 0, 0.26)),
        "knob": Part(Capsule(0.01, 0.04), body="head", position=(0, 0.06, 0.2)),
        "ball": Part(Sphere(0.03), position=(-0.1, 0, 0.02)),
    }
    problem = Problem(
        cables={"power": run(0.36, 0.03), "video": run(0.34, -0.03)},
        bodies={"head": Body(Hinge((0, 0, 0), (0, 0, 1), -0.8, 0.8))},
        parts=parts,
        limits=Limits(clearance=0.006, bend_radius=0.03),
        spatial_step=0.03,
        title="Head on a mast",
    )
    return simulate(problem)


@pytest.fixture(scope="module")
def design():
    """A cable over a post that is too high for it as drawn, and the longer one that clears it."""
    cable = Cable(0.2, 0.006, 2e-3, 1.5e-3)
    problem = Problem(
        cables={"lead": CableRun(cable, End((0, 0, 0), UP), End((0.15, 0, 0.02), ALONG, body="arm"))},
        bodies={"arm": Body(Hinge((0.05, 0, 0), (0, -1, 0), 0.0, 0.3))},
        parts={"post": Part(Box((0.01, 0.03, 0.06)), position=(0.06, 0, 0.03))},
        limits=Limits(clearance=0.003),
        design=Design("change", (Variable("lead.length", 0.18, 0.3),)),
        spatial_step=0.02,
    )
    found = redesign(problem)
    assert min(row.margin for row in found.limits_before) < 0 <= min(row.margin for row in found.limits)
    return found


def pixels(pyvista, file: Path) -> np.ndarray:
    """Return the picture (h, w, 3), 0 to 255."""
    image = pyvista.read(file)
    width, height, _ = image.dimensions
    return np.asarray(image.active_scalars).reshape(height, width, -1)[::-1, :, :3].astype(int)


def like(image: np.ndarray, colour: str) -> int:
    """Return how many pixels have the hue of ``colour`` and are not pale."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    wanted = np.array([red, green, blue]) - np.mean([red, green, blue])
    grey = image.mean(axis=-1, keepdims=True)
    strength = np.linalg.norm(image - grey, axis=-1)
    alike = (image - grey) @ wanted / (np.maximum(strength, 1e-9) * np.linalg.norm(wanted))
    return int(np.sum((strength > 0.6 * np.linalg.norm(wanted)) & (alike > 0.98)))


def view_of(motion: Motion):
    scene = load_scene(motion.problem)
    found = measure(motion.problem, scene, motion.motion, motion.cables)
    return pictures.worst_view(motion, scene, all_limits(motion.problem, motion, found), "Worst")


def names(actors, kind: str) -> set[str]:
    return {name.removeprefix(f"{kind}:") for name in actors if name.startswith(f"{kind}:")}


# --- import ---------------------------------------------------------------------------------------------


def test_importing_the_room_imports_no_pyvista():
    code = "import sys, harness_opt.pictures.stills; print({'pyvista', 'vtk', 'vtkmodules'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


# --- stills ---------------------------------------------------------------------------------------------


def test_worst_shows_every_part_and_cable(pyvista, two_cables, tmp_path):
    view = view_of(two_cables)
    plotter = pictures.still([view])
    actors = set(plotter.actors)
    plotter.close()
    assert names(actors, "part") == set(two_cables.problem.parts)
    assert names(actors, "cable") == set(two_cables.problem.cables)
    assert len(names(actors, "clamp")) == 4
    assert {"marker", "witness", "leader"} <= actors
    ghosts = names(actors, "ghost part")
    assert {ghost.partition(":")[0] for ghost in ghosts} == {"head", "knob"}, "only what moves leaves ghosts"
    assert len(names(actors, "ghost cable")) == len(ghosts)


def test_worst_picture_has_the_size_and_the_colours(pyvista, two_cables, tmp_path):
    before = dict(os.environ)
    assert pictures.write_pictures(two_cables, tmp_path / "new") == ["worst.png"]
    assert dict(os.environ) == before
    image = pixels(pyvista, tmp_path / "new" / "worst.png")
    assert image.shape == (SIZE[1], SIZE[0], 3)
    assert 0.3 < np.mean(np.all(image == 255, axis=-1)) < 0.95, "white around, and something on it"
    for colour in (*CABLES[:2], TOUCHES):
        assert like(image, colour) > 300, colour


def test_what_is_run_into_is_glass_and_the_cable_red_in_it(pyvista, two_cables):
    view = view_of(two_cables)
    assert (view.row.name, view.row.part, view.violated) == ("clearance", "mast", True)
    assert view.moment.touched == {"mast"}
    plotter = pictures.still([view])
    opacity = {name: plotter.actors[f"part:{name}"].prop.opacity for name in two_cables.problem.parts}
    plotter.close()
    assert {name for name, value in opacity.items() if value < 1} == {"mast"}
    points, colours = drawing.cable_colours(view.moment, view.row.cable)
    red = np.all(colours == drawing.rgb(TOUCHES), axis=1)
    radius = two_cables.problem.cables[view.row.cable].cable.radius
    inside = np.hypot(points[:, 0], points[:, 1]) < 0.02 + radius
    assert np.array_equal(red, inside & (points[:, 2] < 0.2 + radius))


def test_witness_is_as_long_as_the_clearance(two_cables):
    view = view_of(two_cables)
    on_cable, on_mast = view.witness
    assert np.linalg.norm(on_cable - on_mast) == pytest.approx(abs(view.row.worst), rel=1e-3)
    assert np.hypot(*on_mast[:2]) == pytest.approx(0.02, abs=1e-9)


def test_before_and_after_stand_side_by_side(pyvista, design, tmp_path):
    assert pictures.write_pictures(design, tmp_path) == ["worst.png", "before_after.png"]
    image = pixels(pyvista, tmp_path / "before_after.png")
    assert image.shape == (SIZE[1], SIZE[0], 3)
    left, right = np.split(image, 2, axis=1)
    assert like(left, TOUCHES) > 500 and like(left, CABLES[0]) > 300
    assert like(right, TOUCHES) == 0 and like(right, AFTER[0]) > 300


def test_both_views_have_one_camera(pyvista, design):
    scene = load_scene(design.problem)
    views = [
        pictures.worst_view(design.motion_before, scene, design.limits_before, "Before"),
        pictures.worst_view(design.motion, scene, design.limits, "After"),
    ]
    plotter = pictures.still(views)
    cameras = [renderer.camera for renderer in plotter.renderers]
    shown = [names(renderer.actors, "part") | names(renderer.actors, "cable") for renderer in plotter.renderers]
    plotter.close()
    assert cameras[0].position == cameras[1].position and cameras[0].focal_point == cameras[1].focal_point
    assert shown == [{"post", "lead"}] * 2


def test_without_limits_the_smallest_clearance_is_shown(pyvista, two_cables):
    free = replace(two_cables, problem=replace(two_cables.problem, limits=Limits()))
    view = pictures.worst_view(free, load_scene(free.problem), (), "Free")
    assert (view.row.name, view.row.part) == ("clearance", "mast")
    bare = replace(free, problem=replace(free.problem, parts={}))
    assert pictures.worst_view(bare, load_scene(bare.problem), (), "Bare").row.name == "bend_radius"


def test_nothing_solved_draws_nothing(two_cables, tmp_path):
    none = {
        name: replace(c, **{key: value[:0] for key, value in vars(c).items() if key != "s"})
        for name, c in two_cables.cables.items()
    }
    assert pictures.write_pictures(replace(two_cables, motion=two_cables.motion[:0], cables=none), tmp_path) == []
    assert not any(tmp_path.iterdir())


# --- camera and words -----------------------------------------------------------------------------------


def test_camera_sees_the_cables_at_all_moments(pyvista, two_cables):
    moment = view_of(two_cables).moment
    meshes = {name: drawing.solid(part) for name, part in moment.scene.parts.items()}
    for aspect in (16 / 9, 8 / 9):
        camera = Camera.of([moment], meshes, aspect)
        assert camera.up[2] > 0.3 and camera.back[2] > 0, "z up, from above"
        for cable in two_cables.cables.values():
            at = camera.project(cable.position.reshape(-1, 3))
            assert at.min() > 0.05 and at[:, 0].max() < 0.95 and at[:, 1].max() < 1 - TITLE_ROOM
        point = np.array([0.03, -0.02, 0.1])
        assert camera.unproject(camera.project(point[None])[0], point) == pytest.approx(point, abs=1e-12)


def test_camera_looks_across_the_plane_of_the_motion(pyvista, design):
    moment = Moment.of(design.motion, load_scene(design.problem), 0)
    camera = Camera.of([moment], {name: drawing.solid(part) for name, part in moment.scene.parts.items()}, 1.0)
    assert abs(camera.back[1]) > 0.85, "the hinge's axis is y"


def test_words_go_where_the_picture_is_empty():
    occupied = np.ones((900, 1600), dtype=bool)
    occupied[:, 1000:] = False
    corner, box = pictures._free_place(np.array([0.55, 0.5]), "4.0 mm to part", occupied)
    assert corner[0] * 1600 >= 1000 and np.all(corner + box < 1)
    low, _ = pictures._free_place(np.array([0.55, 0.05]), "4.0 mm to part", np.zeros((900, 1600), dtype=bool))
    assert low[1] >= pictures.KEY_ROOM, "the keys stand below"


# --- window ---------------------------------------------------------------------------------------------


@pytest.fixture
def folder(two_cables, tmp_path) -> Path:
    """A result folder with no more in it than the contract promises."""
    file = write_problem(two_cables.problem, tmp_path / "problem.toml")
    limits = [{"name": "clearance", "limit": 0.006, "margin": -0.01, "motion": 0.5}]
    summary = {
        "command": "simulate", "versions": {"harness-opt": "0"}, "problem": {"file": str(file)}, "limits": limits
    }  # fmt: skip
    place = tmp_path / "result"
    place.mkdir()
    (place / "summary.json").write_text(json.dumps(summary))
    arrays = {f"{n}/{key}": getattr(c, key) for n, c in two_cables.cables.items() for key in ("s", *KEPT)}
    np.savez(place / "motion.npz", motion=two_cables.motion, **arrays)
    return place


def test_window_follows_the_motion(pyvista, folder, two_cables):
    motion, before, worst = read_motion(folder)
    assert worst == 0.5 and before is None
    window = Window(motion, worst, off_screen=True)
    actors = window.plotter.actors
    assert names(actors, "part") == set(two_cables.problem.parts)
    assert names(actors, "cable") == {"power", "video"}
    tip = []
    for at in (0.0, 1.0):
        window.go(at)
        assert np.allclose(actors["part:mast"].user_matrix, np.eye(4))
        end = actors["clamp:power:end"].user_matrix[:3, 3]
        assert end == pytest.approx(two_cables.cables["power"].position[int(at) * -1, -1])
        tip.append(np.array(actors["part:head"].user_matrix)[:2, :2] @ [1.0, 0.0])
    assert np.arctan2(*tip[0][::-1]) == pytest.approx(-0.8) and np.arctan2(*tip[1][::-1]) == pytest.approx(0.8)
    window.plotter.close()


def test_window_steps_and_plays(pyvista, folder):
    window = Window(*read_motion(folder)[::2], off_screen=True)
    window.go(0.0)
    window.step(1)
    assert window.at == window.motion.motion[1]
    window.step(-5)
    assert window.at == 0.0
    window.tick(0.25)
    assert window.at == 0.0, "it does not play yet"
    window.toggle()
    window.tick(0.25)
    assert window.at == pytest.approx(0.25 / window.motion.problem.duration)
    window.go(1.0)
    window.tick(0.25)
    assert window.at == 0.0, "it starts again after the end"
    window.plotter.close()


def shades(window: Window, cable: str) -> np.ndarray:
    """Return the distinct colours (n, 3) of a cable in the last view of a window."""
    return np.unique(window.acts[-1].renderer.actors[f"cable:{cable}"].mapper.dataset.point_data["colour"], axis=0)


def test_window_colours_by_what_is_asked(pyvista, folder, two_cables):
    motion, _, worst = read_motion(folder)
    window = Window(motion, worst, off_screen=True)
    allowed = {tuple(drawing.rgb(hex_)) for hex_ in (*CABLES[:2], TOUCHES, drawing.SHORT)}
    assert {tuple(colour) for colour in shades(window, "power")} <= allowed
    for mode, title in (("bend", "Bend radius"), ("twist", "Twist"), ("clearance", "Clearance")):
        window.colour_by(mode)
        titles = window.plotter.scalar_bars.keys()
        assert [words.strip() for words in titles] == [title]
        assert (len(shades(window, "power")) > 20) == (mode != "twist"), "without weight the twist is even"
    window.colour_by("bend")
    shapes = two_cables.cables["power"]
    bends = np.linalg.norm(shapes.curvature[..., :2], axis=-1)
    window.go(float(motion.motion[np.argmax(bends.max(axis=1))]))
    reddest = shades(window, "power")[:, 0].max()
    window.go(float(motion.motion[np.argmin(bends.max(axis=1))]))
    assert shades(window, "power")[:, 0].max() <= reddest
    window.colour_by("limits")
    assert not window.plotter.scalar_bars.keys()
    window.plotter.close()


def test_window_points_at_what_is_nearest(pyvista, folder):
    motion, _, worst = read_motion(folder)
    window = Window(motion, worst, off_screen=True)
    act = window.acts[0]
    tight = min(act.moment(window.frame).still.pairs, key=lambda pair: pair.worst - pair.limit)
    ends = act.renderer.actors["witness"].mapper.dataset.points
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(abs(tight.worst), rel=1e-4)
    window.plotter.close()


def test_window_hides_and_shows(pyvista, folder):
    motion, _, worst = read_motion(folder)
    window = Window(motion, worst, off_screen=True)
    for name, kind in (("ghosts", "ghost"), ("frames", "clamp:")):
        for wanted in (True, False):
            setattr(window, name, wanted)
            window.go(0.5)
            actors = window.acts[0].renderer.actors
            found = [bool(actor.visibility) for key, actor in actors.items() if key.startswith(kind)]
            assert found and set(found) == {wanted}
    window.plotter.close()


def test_window_shows_before_and_after_side_by_side(pyvista, design, tmp_path):
    problem = replace(design.original, file=write_problem(design.original, tmp_path / "post.toml"))
    write_results(replace(design, original=problem), tmp_path / "result")
    motion, before, worst = read_motion(tmp_path / "result")
    assert motion.problem.cables["lead"].cable.length == design.problem.cables["lead"].cable.length
    assert before.problem.cables["lead"].cable.length == 0.2
    window = Window(motion, worst, before=before, off_screen=True)
    shown = [names(act.renderer.actors, "part") | names(act.renderer.actors, "cable") for act in window.acts]
    assert shown == [{"post", "lead"}] * 2
    cameras = [renderer.camera for renderer in window.plotter.renderers]
    assert cameras[0].position == cameras[1].position
    window.go(0.0)
    image = window.picture().astype(int)
    left, right = np.split(image, 2, axis=1)
    assert like(left, CABLES[0]) > 300 and like(right, AFTER[0]) > 300
    window.plotter.close()


# --- film -----------------------------------------------------------------------------------------------


def test_film_shows_the_motion(pyvista, two_cables, tmp_path):
    av = pytest.importorskip("av", reason="av (the extra 'pictures') is not installed")
    found = animation.write_pictures_and_film(two_cables, tmp_path)
    assert found == ["worst.png", "motion.mp4"]
    with av.open(str(tmp_path / "motion.mp4")) as film:
        stream = film.streams.video[0]
        assert (stream.codec_context.name, stream.width, stream.height) == ("h264", *animation.SIZE)
        shots = [shot.to_ndarray(format="rgb24").astype(int) for shot in film.decode(video=0)]
    seconds = len(shots) / animation.RATE
    assert 2.0 <= seconds <= 6.0, "a motion of a second is shown in two, and held still at its ends"
    for shot in (shots[0], shots[len(shots) // 2], shots[-1]):
        assert 0.3 < np.mean(np.all(shot > 250, axis=-1)) < 0.98, "white around, and something on it"
    assert np.mean(np.abs(shots[0] - shots[-1]) > 40) > 0.01, "it moves"
    assert np.mean(np.abs(shots[0] - shots[5]) > 40) < 0.001, "it is held still at the start"


@pytest.mark.parametrize("worst", [0.0, 0.37, 1.0])
def test_moments_of_a_film_go_on_and_stop_at_the_worst(two_cables, worst):
    shown = animation.moments(two_cables, worst)
    assert shown[0] == 0.0 and shown[-1] == 1.0 and np.all(np.diff(shown) >= 0)
    assert np.sum(shown == worst) >= animation.HOLD * animation.RATE
    assert np.diff(shown).max() < 0.05


def test_what_stands_still_has_no_film(pyvista, two_cables, tmp_path):
    one = replace(
        two_cables, motion=two_cables.motion[:1], cables={n: c.first(1) for n, c in two_cables.cables.items()}
    )
    assert animation.write_pictures_and_film(one, tmp_path) == ["worst.png"]


def test_without_a_way_to_film_one_line_names_the_remedy(pyvista, two_cables, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(HarnessError, match=r'found no PyAV, expected the extra "harness-opt\[pictures\]"'):
        animation.write_film(two_cables, load_scene(two_cables.problem), (), tmp_path)


# --- what is missing ------------------------------------------------------------------------------------


@linux
@pytest.mark.parametrize("display", [None, ":9999"])
def test_without_a_screen_one_line_says_so(pyvista, folder, monkeypatch, capfd, display):
    monkeypatch.delenv("DISPLAY", raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(HarnessError, match="found no display to open a window on") as caught:
        pictures.show(folder)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@linux
def test_without_opengl_one_line_names_the_remedy(pyvista, two_cables, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv(opengl.WINDOW_VARIABLE, raising=False)
    monkeypatch.setattr(opengl, "_loads", lambda library: False)
    with pytest.raises(HarnessError, match=r"found no OpenGL .* apt-get install libegl1") as caught:
        pictures.write_pictures(two_cables, tmp_path)
    assert "\n" not in str(caught.value)
    assert not any(tmp_path.iterdir())


def test_without_pyvista_one_line_names_the_remedy(two_cables, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(HarnessError, match=r'found no pyvista, expected the extra "harness-opt\[pictures\]"'):
        pictures.write_pictures(two_cables, tmp_path)


def test_a_folder_without_a_result_is_named(folder, tmp_path):
    with pytest.raises(HarnessError, match="nowhere: found no result of harness-opt"):
        pictures.show(tmp_path / "nowhere")
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps({key: summary[key] for key in ("command", "versions")}))
    with pytest.raises(HarnessError, match="result: found a damaged result"):
        pictures.show(folder)
    (folder / "summary.json").write_text("{}")
    with pytest.raises(HarnessError, match="result: found no result of harness-opt"):
        pictures.show(folder)
    (folder / "summary.json").write_text(json.dumps(summary | {"problem": {"file": None}, "limits": []}))
    with pytest.raises(HarnessError, match="found no name of a problem file"):
        pictures.show(folder)

"""The window: it follows the motion, colours, points and hides as it is asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness_opt.files.read import write_problem
from harness_opt.files.stored_results import read_motion
from harness_opt.pictures.window import Window
from harness_opt.report.colours import CABLES, SHORT, TOUCHES, rgb
from harness_opt.report.result_files import write_results
from oracles.pictures import like, names


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
    return np.unique(window.views[-1].renderer.actors[f"cable:{cable}"].mapper.dataset.point_data["colour"], axis=0)


def test_window_colours_by_what_is_asked(pyvista, folder, two_cables):
    motion, _, worst = read_motion(folder)
    window = Window(motion, worst, off_screen=True)
    allowed = {tuple(rgb(hex_)) for hex_ in (*CABLES[:2], TOUCHES, SHORT)}
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
    act = window.views[0]
    tight = min(act.drawn(window.frame).still.pairs, key=lambda pair: pair.worst - pair.limit)
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
            actors = window.views[0].renderer.actors
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
    shown = [names(act.renderer.actors, "part") | names(act.renderer.actors, "cable") for act in window.views]
    assert shown == [{"post", "lead"}] * 2
    cameras = [renderer.camera for renderer in window.plotter.renderers]
    assert cameras[0].position == cameras[1].position
    window.go(0.0)
    image = window.picture().astype(int)
    left, right = np.split(image, 2, axis=1)
    assert like(left, CABLES[0]) > 300 and like(right, CABLES[0]) > 300
    window.plotter.close()

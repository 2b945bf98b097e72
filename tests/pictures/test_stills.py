"""Stills: what they show is counted, in the scene and in the pixels."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from harness_opt.model.design import Limits
from harness_opt.parts.scene import load_scene
from harness_opt.pictures import drawing
from harness_opt.pictures import stills as pictures
from harness_opt.pictures.camera import TITLE_ROOM, Camera
from harness_opt.pictures.drawing import SIZE, DrawnFrame
from harness_opt.report.colours import CABLES, TOUCHES, rgb
from oracles.pictures import like, names, pixels, view_of

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
    assert view.shown.touched == {"mast"}
    plotter = pictures.still([view])
    opacity = {name: plotter.actors[f"part:{name}"].prop.opacity for name in two_cables.problem.parts}
    plotter.close()
    assert {name for name, value in opacity.items() if value < 1} == {"mast"}
    points, colours = drawing.cable_colours(view.shown, view.row.cable)
    red = np.all(colours == rgb(TOUCHES), axis=1)
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
    assert like(right, TOUCHES) == 0 and like(right, CABLES[0]) > 300


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
    moment = view_of(two_cables).shown
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
    moment = DrawnFrame.of(design.motion, load_scene(design.problem), 0)
    camera = Camera.of([moment], {name: drawing.solid(part) for name, part in moment.scene.parts.items()}, 1.0)
    assert abs(camera.back[1]) > 0.85, "the hinge's axis is y"


def test_words_go_where_the_picture_is_empty():
    occupied = np.ones((900, 1600), dtype=bool)
    occupied[:, 1000:] = False
    corner, box = pictures._free_place(np.array([0.55, 0.5]), "4.0 mm to part", occupied)
    assert corner[0] * 1600 >= 1000 and np.all(corner + box < 1)
    low, _ = pictures._free_place(np.array([0.55, 0.05]), "4.0 mm to part", np.zeros((900, 1600), dtype=bool))
    assert low[1] >= pictures.KEY_ROOM, "the keys stand below"

"""Meshes scaled and mirrored: sizes, places, and what is inside."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.parts.scene import load_scene
from oracles.problem_files import CONTRACT, changed, same, written
from oracles.scenes import problem_with


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (2.0, 0.5, 3.0), (-1.0, 1.0, 1.0), (-1.0, -2.0, -0.5)])
def test_a_scaled_wedge_is_the_wedge_of_scaled_corners(tmp_path, rng, scale):
    """Against the hull of the scaled corners: the same distances, the same side."""
    corners = 10 * rng.normal(size=(12, 3)) + 20
    trimesh.convex.convex_hull(corners).export(tmp_path / "wedge.stl")
    pose = {"position": (0.01, 0.0, -0.02), "quaternion": (0.5, 0.5, -0.5, 0.5)}
    found = load_scene(problem_with(ho.Part(ho.MeshFile(tmp_path / "wedge.stl", "mm", scale=scale), **pose)))
    trimesh.convex.convex_hull(corners * scale).export(tmp_path / "scaled.stl")
    expected = load_scene(problem_with(ho.Part(ho.MeshFile(tmp_path / "scaled.stl", "mm"), **pose)))
    points = rng.normal(size=(300, 3)) * 0.05
    one, other = (scene.parts["part"].signed_distance(points)[0] for scene in (found, expected))
    np.testing.assert_allclose(one, other, atol=2e-8)  # STL keeps seven digits
    assert np.any(one < 0) or np.all(one > 0)


def test_a_scale_of_nothing_in_python():
    with pytest.raises(
        ho.ProblemError, match=r"parts\.part\.mesh_scale: found \[1, 1, 0\], expected a number that is not 0"
    ):
        problem_with(ho.Part(ho.MeshFile("wedge.stl", "mm", scale=(1, 1, 0))))


def test_a_scale_is_written_and_read_back(folder):

    problem = ho.read_problem(
        written(folder, changed(('mesh_unit = "mm"', 'mesh_unit = "mm"\nmesh_scale = [1, -1, 2]')))
    )
    assert problem.parts["housing"].shape.scale == (1, -1, 2)
    again = ho.write_problem(problem, folder / "b.toml")
    assert "mesh_scale = [1.0, -1.0, 2.0]" in again.read_text() and "mesh_scale" not in CONTRACT
    assert same(ho.read_problem(again), problem)


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        ("0", "parts.housing.mesh_scale: found 0, expected a number that is not 0, or [x, y, z], three such numbers"),
        ("[1, 2]", "parts.housing.mesh_scale: found [1, 2], expected a number that is not 0, or [x, y, z], three such"),
    ],
)
def test_scales_that_are_none(folder, scale, words):
    file = written(folder, changed(('mesh_unit = "mm"', f'mesh_unit = "mm"\nmesh_scale = {scale}')))
    with pytest.raises(ho.ProblemError) as error:
        ho.read_problem(file)
    assert words in str(error.value)


def test_one_number_scales_all(folder):
    file = written(folder, changed(('mesh_unit = "mm"', 'mesh_unit = "mm"\nmesh_scale = 0.5')))
    assert ho.read_problem(file).parts["housing"].shape.scale == (0.5, 0.5, 0.5)

"""Which axis of a mesh points up: y in glTF, as its specification says, z elsewhere, unless the file says otherwise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.errors import ProblemError
from harness_opt.files.read import read_problem, write_problem
from harness_opt.files.schema import schema
from harness_opt.model.parts import MeshFile, Part
from harness_opt.parts.scene import load_scene
from harness_opt.report.description import description, facts
from oracles.scenes import problem_with

SCENE = """
schema = 1
[cables.c]
length = 0.3
diameter = 4e-3
bending_stiffness = 2e-3
torsional_stiffness = 1.5e-3
start = { body = "world", position = [0, 0, 0], tangent = [1, 0, 0] }
end = { body = "world", force = [0, 0, 0] }
[bodies.car.motion]
kind = "slide"
direction = [0, 0, 1]
from = 0.0
to = -0.03
[parts.p]
body = "car"
MESH
[limits]
clearance = 0.004
"""
AS_WRITTEN = np.array([[0.14, 0.04, -0.01], [0.16, 0.06, 0.01]])  # m, y from 40 to 60 mm
TURNED = np.array([[0.14, -0.01, 0.04], [0.16, 0.01, 0.06]])  # then z is


@pytest.fixture
def scene(tmp_path: Path):
    """Write the block in every format, and a problem with one of them."""
    block = trimesh.creation.box(bounds=AS_WRITTEN)
    for suffix in ("glb", "gltf", "stl", "obj", "ply"):
        if suffix == "gltf":
            for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(block)).items():
                (tmp_path / name.replace("model", "block")).write_bytes(content)
        else:
            block.export(tmp_path / f"block.{suffix}")

    def write(mesh: str) -> Path:
        (tmp_path / "p.toml").write_text(SCENE.replace("MESH", mesh))
        return tmp_path / "p.toml"

    return write


@pytest.mark.parametrize("up", [None, "y", "z"])
@pytest.mark.parametrize("suffix", ["glb", "gltf", "stl", "obj", "ply"])
def test_every_format_and_axis(scene, suffix, up):
    unit = "" if suffix in ("glb", "gltf") else 'mesh_unit = "m"\n'
    problem = read_problem(scene(f'mesh = "block.{suffix}"\n{unit}' + (f'up = "{up}"' if up else "")))
    loaded = load_scene(problem)
    axis = up or ("y" if suffix in ("glb", "gltf") else "z")
    wanted = TURNED if axis == "y" else AS_WRITTEN
    np.testing.assert_allclose([loaded.parts["p"].lower, loaded.parts["p"].upper], wanted, atol=1e-7)
    assert loaded.parts["p"].signed_distance([wanted.mean(axis=0)])[0] == pytest.approx(-0.01)
    content = facts(problem, loaded)
    assert content["parts"]["p"]["up"] == axis
    words = {"y": "12 triangles, closed, y up (turned to z up);", "z": "12 triangles, closed, z up;"}
    assert f"mesh block.{suffix}, {words[axis]}" in " ".join(description(problem, content).split())
    again = write_problem(problem, problem.file.parent / "deeper" / "again.toml")
    assert ("up = " in again.read_text()) == (up is not None)
    assert read_problem(again).parts["p"].shape.up_axis == axis


def test_clearance_to_a_block_whose_y_points_up(scene):
    result = ho.clearances(ho.simulate(read_problem(scene('mesh = "block.glb"'))))
    assert min(row.worst for row in result.limits if row.id.words.endswith("to p")) == pytest.approx(0.008, abs=1e-7)


def test_nodes_are_placed_before_the_axes_are_turned(tmp_path):
    """A node's transform is in the file's own axes (glTF 2.0, 3.5.3)."""
    turn = trimesh.transformations.rotation_matrix(0.5 * np.pi, (0, 0, 1))  # x to y
    turn[:3, 3] = 1.0, 2.0, 3.0
    placed = trimesh.Scene()
    placed.add_geometry(trimesh.creation.box(bounds=[[0, 0, 0], [0.3, 0.2, 0.1]]), transform=turn)
    placed.export(tmp_path / "b.glb")
    part = load_scene(problem_with(Part(MeshFile(tmp_path / "b.glb")))).parts["part"]
    np.testing.assert_allclose([part.lower, part.upper], [[0.8, -3.1, 2.0], [1.0, -3.0, 2.3]], atol=1e-6)


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ('mesh = "block.glb"\nup = "x"', "parts.p.up: found \"x\", expected one of 'y', 'z'"),
        ('mesh = "block.glb"\nup = 2', "parts.p.up: found 2, expected one of 'y', 'z'"),
        ('box = { size = [1, 1, 1] }\nup = "z"', "parts.p.up: found an axis without a mesh"),
    ],
)
def test_bad_axes(scene, mesh, words):
    with pytest.raises(ProblemError) as error:
        read_problem(scene(mesh))
    assert words in str(error.value)
    assert len(error.value.mistakes) == 1


def test_a_bad_axis_in_python(tmp_path):
    trimesh.creation.box().export(tmp_path / "b.stl")
    with pytest.raises(ProblemError, match=r"parts\.part\.up: found \"x\", expected one of 'y', 'z'"):
        load_scene(problem_with(Part(MeshFile(tmp_path / "b.stl", "m", up="x"))))


def test_the_schema_says_what_is_up():
    words = schema()["$defs"]["PartTable"]["properties"]["up"]
    assert words["enum"] == ["y", "z"]
    assert "STL" in words["description"]

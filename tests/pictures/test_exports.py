"""Exports: read back by other means, and compared with what was solved and with closed forms."""

from __future__ import annotations

import json
import math
import struct
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.clearance.limits import bending
from harness_opt.errors import HarnessError
from harness_opt.model.results import CableMotion, Motion
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from harness_opt.pictures import export as exports
from harness_opt.pictures.gltf import gltf
from harness_opt.pictures.swept_volume import for_stl, swept_volume

DOWN = (0.0, 0.0, 1.0, 0.0)
UP_AXIS = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # from z up to y up


@pytest.fixture(scope="module")
def motion() -> Motion:
    ends = ho.End((0, 0, 0), (1, 0, 0, 0)), ho.End((0.15, 0.02, 0), DOWN, body="flap")
    problem = ho.Problem(
        cables={"the lead": ho.CableRun(ho.Cable(0.3, 0.005, 2e-3, 1.5e-3, 0.05), *ends)},
        bodies={"flap": ho.Body(ho.Hinge((0.2, 0, 0), (0, 1, 0), 0.0, np.deg2rad(20)))},
        parts={
            "ball": ho.Part(ho.Sphere(0.02), position=(0.08, 0, 0)),
            "plate": ho.Part(ho.Box((0.05, 0.05, 0.002)), position=(0.2, 0, -0.01), body="flap"),
        },
        gravity=(0.0, 0.0, -9.81),
        limits=ho.Limits(clearance=0.004),
        duration=3.0,
        spatial_step=0.01,
    )
    return ho.simulate(problem)


@pytest.fixture
def folder(motion, tmp_path) -> Path:
    """A result folder, with its problem beside it."""
    file = ho.write_problem(motion.problem, tmp_path / "flap.toml")
    ho.write_results(ho.simulate(ho.read_problem(file)), tmp_path / "result")
    return tmp_path / "result"


def test_an_unknown_export_is_refused(folder, tmp_path):
    with pytest.raises(
        HarnessError, match="found an export to 'vrml', expected one of paraview, csv, gltf, stl, dxf, step"
    ):
        exports.export(folder, "vrml", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_csv_holds_what_was_solved(folder, motion, tmp_path):
    (told,) = exports.export(folder, "csv", tmp_path / "out")
    file = tmp_path / "out" / "the_lead.csv"
    assert told.startswith(f"{file}: {len(motion.motion)} frames")
    table = np.genfromtxt(file, delimiter=",", names=True)
    shapes = motion.cables["the lead"]
    assert len(table) == len(motion.motion) * len(shapes.s)
    last = table[table["frame"] == len(motion.motion) - 1]
    assert set(last["time_s"]) == {3.0}
    for key, values in {
        "x_m": shapes.position[-1, :, 0],
        "z_m": shapes.position[-1, :, 2],
        "arc_length_m": shapes.s,
        "quaternion_y": shapes.quaternion[-1, :, 2],
        "twist_rad_per_m": shapes.curvature[-1, :, 2],
        "bend_radius_m": 1 / bending(shapes)[-1],
        "force_z_N": shapes.force[-1, :, 2],
        "moment_y_Nm": shapes.moment[-1, :, 1],
    }.items():
        assert last[key] == pytest.approx(values, rel=1e-8, abs=1e-9), key
    to_ball = np.linalg.norm(shapes.position[-1] - [0.08, 0, 0], axis=1) - 0.02 - 0.0025
    assert np.all(last["clearance_m"] <= to_ball + 1e-9)


def test_an_export_that_fails_leaves_the_earlier_one(folder, tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    exports.export(folder, "csv", tmp_path / "out")
    before = (tmp_path / "out" / "the_lead.csv").read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device", "the_lead.csv")

    monkeypatch.setattr(np, "savetxt", full)
    with pytest.raises(OSError, match="No space left"):
        exports.export(folder, "csv", tmp_path / "out")
    assert (tmp_path / "out" / "the_lead.csv").read_bytes() == before
    assert sorted(entry.name for entry in (tmp_path / "out").iterdir()) == ["mine.txt", "the_lead.csv"]
    assert not [entry for entry in tmp_path.iterdir() if entry.name.startswith(".")]


@pytest.fixture
def alike(tmp_path) -> Path:
    """A result with names that are the same as those of files."""
    ends = ho.End((0, 0, 0), (1, 0, 0, 0)), ho.End((0.1, 0.1, 0.1), (1, 0, 0, 0), body="arm")
    runs = [ho.CableRun(ho.Cable(length, 0.005, 2e-3, 1.5e-3), *ends) for length in (0.3, 0.32, 0.34)]
    problem = ho.Problem(
        dict(zip(("a b", "a_b", "A B"), runs, strict=True)),
        bodies={"arm": ho.Body(ho.Slide((1, 0, 0), 0.0, 0.01))},
        parts={
            "p": ho.Part(ho.Sphere(0.01), position=(1, 0, 0), body="arm"),
            "p_00001": ho.Part(ho.Sphere(0.02), position=(2, 0, 0)),
            "p 00001": ho.Part(ho.Sphere(0.03), position=(3, 0, 0)),
        },
    )
    file = ho.write_problem(problem, tmp_path / "alike.toml")
    ho.write_results(ho.simulate(ho.read_problem(file), frames=[0.0, 1.0]), tmp_path / "result")
    return tmp_path


def test_names_that_are_alike_get_files_of_their_own(alike):
    told = exports.export(alike / "result", "csv", alike / "out")
    assert [line.partition(":")[0] for line in told] == [
        str(alike / "out" / f"{name}.csv") for name in ("a_b", "a_b-2", "A_B-3")
    ]
    for name, length in (("a_b", 0.3), ("a_b-2", 0.32), ("A_B-3", 0.34)):
        table = np.genfromtxt(alike / "out" / f"{name}.csv", delimiter=",", names=True)
        assert np.max(table["arc_length_m"]) == pytest.approx(length)


def test_parts_that_are_called_like_frames_of_others_get_files_of_their_own(alike):
    pyvista = pytest.importorskip("pyvista", reason="pyvista (the extra 'pictures') is not installed")
    exports.export(alike / "result", "paraview", alike / "out")
    entries = ElementTree.parse(alike / "out" / "motion.pvd").getroot().findall(".//DataSet")
    last = [entry.get("file") for entry in entries][-3:]
    radii = [0.5 * np.ptp(np.asarray(pyvista.read(alike / "out" / file).points)[:, 2]) for file in last]
    assert radii == pytest.approx([0.01, 0.02, 0.03], rel=0.02)


def test_what_is_no_number_is_an_empty_cell(tmp_path):
    """A straight cable without parts: no radius is infinite, and no clearance is told."""
    ends = ho.End((0, 0, 0), (1, 0, 0, 0)), ho.End((0, 0, 0.3), (1, 0, 0, 0))
    problem = ho.Problem({"lead": ho.CableRun(ho.Cable(0.3, 0.005, 2e-3, 1.5e-3), *ends)})
    file = ho.write_problem(problem, tmp_path / "straight.toml")
    ho.write_results(ho.simulate(ho.read_problem(file)), tmp_path / "result")
    exports.export(tmp_path / "result", "csv", tmp_path / "out")
    text = (tmp_path / "out" / "lead.csv").read_text()
    assert "nan" not in text and "inf" not in text
    table = np.genfromtxt(tmp_path / "out" / "lead.csv", delimiter=",", names=True)
    assert np.all(table["bend_radius_m"] > 1e6) and np.all(np.isnan(table["clearance_m"]))


def test_paraview_opens_a_frame_for_each_time(folder, motion, tmp_path):
    pyvista = pytest.importorskip("pyvista", reason="pyvista (the extra 'pictures') is not installed")
    exports.export(folder, "paraview", tmp_path / "out")
    reader = pyvista.get_reader(tmp_path / "out" / "motion.pvd")
    assert reader.time_values == pytest.approx(3.0 * motion.motion)
    entries = ElementTree.parse(tmp_path / "out" / "motion.pvd").getroot().findall(".//DataSet")
    files = [entry.get("file") for entry in entries]
    assert len(files) == 3 * len(motion.motion) and all((tmp_path / "out" / file).is_file() for file in files)
    assert files.count("frames/part_ball.vtp") == len(motion.motion), "what stands still is stored once"
    reader.set_active_time_value(3.0)
    shown = {mesh.n_points: mesh for mesh in reader.read()}
    shapes = motion.cables["the lead"]
    cable = next(mesh for mesh in shown.values() if "bend_radius" in mesh.point_data)
    assert cable.points == pytest.approx(shapes.position[-1], abs=1e-7)
    assert cable["moment"] == pytest.approx(shapes.moment[-1])
    assert {"arc_length", "curvature", "twist_deg_per_m", "force", "clearance"} <= set(cable.point_data)
    plate = pyvista.read(tmp_path / "out" / files[-1])
    position, quaternion = motion.problem.poses("flap", [1.0])
    assert np.mean(plate.points, axis=0) == pytest.approx(
        position[0] + rotations.rotate(quaternion[0], [0.2, 0, -0.01]), abs=1e-6
    )


# --- glTF ----------------------------------------------------------------------------------------------


class Gltf:
    """A binary glTF file, read by the specification."""

    def __init__(self, content: bytes) -> None:
        magic, version, length = struct.unpack_from("<4sII", content)
        assert (magic, version, length) == (b"glTF", 2, len(content))
        size, kind = struct.unpack_from("<I4s", content, 12)
        assert kind == b"JSON"
        self.tree = json.loads(content[20 : 20 + size])
        self.binary = content[28 + size :]

    def numbers(self, number: int) -> np.ndarray:
        entry = self.tree["accessors"][number]
        view = self.tree["bufferViews"][entry["bufferView"]]
        kind = {5126: np.float32, 5123: np.uint16, 5125: np.uint32}[entry["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[entry["type"]]
        flat = np.frombuffer(self.binary, kind, entry["count"] * width, view["byteOffset"])
        found = flat.reshape(entry["count"], width).astype(float)
        assert found.min(axis=0) == pytest.approx(entry["min"]) and found.max(axis=0) == pytest.approx(entry["max"])
        return found

    def local(self, node: int, frame: int) -> np.ndarray:
        """Return the matrix (4, 4) of a node at a key of the animation."""
        pose = {**self.tree["nodes"][node]}
        for channel in self.tree["animations"][0]["channels"]:
            if channel["target"]["node"] == node:
                sampler = self.tree["animations"][0]["samplers"][channel["sampler"]]
                pose[channel["target"]["path"]] = self.numbers(sampler["output"])[frame]
        x, y, z, w = pose.get("rotation", (0, 0, 0, 1))
        matrix = np.eye(4)
        matrix[:3, :3] = rotations.matrix([w, x, y, z])
        matrix[:3, 3] = pose.get("translation", (0, 0, 0))
        return matrix

    def world(self, node: int, frame: int) -> np.ndarray:
        parents = {child: k for k, entry in enumerate(self.tree["nodes"]) for child in entry.get("children", ())}
        matrix = self.local(node, frame)
        while node in parents:
            node = parents[node]
            matrix = self.local(node, frame) @ matrix
        return matrix


def test_gltf_plays_the_tube_around_the_shapes_that_were_solved(motion):
    file = Gltf(gltf(motion, load_scene(motion.problem)))
    node = next(entry for entry in file.tree["nodes"] if "skin" in entry)
    skin = file.tree["skins"][node["skin"]]
    primitive = file.tree["meshes"][node["mesh"]]["primitives"][0]
    vertices, owner = (
        file.numbers(primitive["attributes"]["POSITION"]),
        file.numbers(primitive["attributes"]["JOINTS_0"])[:, 0],
    )
    inverse = file.numbers(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
    shapes = motion.cables["the lead"]
    times = file.numbers(file.tree["animations"][0]["samplers"][0]["input"])[:, 0]
    assert times == pytest.approx(3.0 * motion.motion)
    for frame in (0, len(motion.motion) // 2, len(motion.motion) - 1):
        joints = np.array([file.world(joint, frame) for joint in skin["joints"]]) @ inverse
        placed = np.einsum(
            "kij,kj->ki", joints[owner.astype(int)], np.column_stack([vertices, np.ones(len(vertices))])
        )[:, :3]
        centre = shapes.position[frame][owner.astype(int)] @ UP_AXIS.T
        assert np.sort(np.linalg.norm(placed - centre, axis=1))[2:] == pytest.approx(0.0025, rel=1e-3), (
            "two are centres"
        )
        tangent = rotations.tangent(shapes.quaternion[frame])[owner.astype(int)] @ UP_AXIS.T
        assert np.einsum("ki,ki->k", placed - centre, tangent) == pytest.approx(0.0, abs=1e-6), "rings stand across"


def test_gltf_moves_the_bodies_and_stands_upright(motion):
    file = Gltf(gltf(motion, load_scene(motion.problem)))
    node = next(k for k, entry in enumerate(file.tree["nodes"]) if entry["name"] == "flap")
    for frame in (0, len(motion.motion) - 1):
        position, quaternion = motion.problem.poses("flap", motion.motion[frame])
        expected = UP_AXIS @ (position[0] + rotations.rotate(quaternion[0], [0.2, 0, -0.01]))
        assert (file.world(node, frame) @ [0.2, 0, -0.01, 1])[:3] == pytest.approx(expected, abs=1e-6)
    assert {"ball", "plate"} <= {mesh["name"] for mesh in file.tree["meshes"]}


def test_gltf_tube_is_closed_and_its_normals_point_outward(motion):
    file = Gltf(gltf(motion, load_scene(motion.problem)))
    mesh = next(mesh for mesh in file.tree["meshes"] if mesh["name"] == "the lead")
    primitive = mesh["primitives"][0]
    vertices, faces = (
        file.numbers(primitive["attributes"]["POSITION"]),
        file.numbers(primitive["indices"]).reshape(-1, 3),
    )
    tube = trimesh.Trimesh(vertices, faces.astype(int))
    tube.merge_vertices(merge_norm=True)
    assert tube.is_watertight and tube.volume == pytest.approx(np.pi * 0.0025**2 * 0.3, rel=0.04)


# --- swept volume --------------------------------------------------------------------------------------


def moved_straight(length: float, way: float, diameter: float, frames: int) -> Motion:
    """Return a straight cable along x that is moved along y."""
    ends = ho.End((0, 0, 0), (1, 0, 0, 0)), ho.End((length, 0, 0), (1, 0, 0, 0))
    problem = ho.Problem(cables={"lead": ho.CableRun(ho.Cable(length, diameter, 1e-3, 1e-3), *ends)})
    s = np.linspace(0, length, 11)
    position = np.zeros((frames, len(s), 3))
    position[..., 0], position[..., 1] = s, np.linspace(0, way, frames)[:, None]
    zero = np.zeros_like(position)
    quaternion = np.broadcast_to([1.0, 0, 0, 0], (*zero.shape[:2], 4))
    one = np.ones(frames)
    return Motion(
        problem,
        np.linspace(0, 1, frames),
        {"lead": CableMotion(s, position, quaternion, zero, zero, zero, one > 0, one, one, one)},
    )


@pytest.mark.parametrize(("way", "frames"), [(0.0, 1), (0.1, 2), (0.1, 7)])
def test_a_straight_sweep_has_the_volume_of_steiner(way, frames):
    pytest.importorskip("manifold3d", reason="manifold3d (the extra 'meshes') is not installed")
    length, radius = 0.2, 0.004
    swept = swept_volume(moved_straight(length, way, 2 * radius, frames), "lead")

    def around(r: float) -> float:
        """Return the volume of all points within ``r`` of a rectangle: Steiner's formula."""
        return 2 * r * length * way + math.pi * r**2 / 2 * 2 * (length + way) + 4 / 3 * math.pi * r**3

    assert around(radius) <= swept.volume <= around(radius + swept.excess)
    assert swept.excess < 0.05 * radius
    mesh = trimesh.Trimesh(swept.vertices, swept.faces)
    assert mesh.is_watertight and mesh.volume == pytest.approx(swept.volume, rel=1e-6)


def test_a_swept_volume_holds_every_shape(motion, folder, tmp_path):
    pytest.importorskip("manifold3d", reason="manifold3d (the extra 'meshes') is not installed")
    swept = swept_volume(motion, "the lead")
    shapes = motion.cables["the lead"]
    mesh = load_scene(
        motion.problem.changed(parts={"swept": ho.Part(ho.MeshFile(_saved(swept, tmp_path), "m"))})
    ).parts["swept"]
    inside = mesh.signed_distance(shapes.position.reshape(-1, 3))[0]
    assert np.all(inside <= -0.0025 + 1e-7), "the radius of the cable lies around every station"
    # what lies outside of all shapes by more than the surface may is not in it
    corners = mesh.vertices[:: max(1, len(mesh.vertices) // 500)]
    nearest = np.min(np.linalg.norm(corners[:, None] - shapes.position.reshape(-1, 3), axis=-1), axis=1)
    between = np.max(np.linalg.norm(np.diff(shapes.position, axis=0), axis=-1)) / 2 + shapes.s[1] / 2
    assert np.all(nearest <= 0.0025 + swept.excess / 0.98 + between + 2e-4)
    (told,) = exports.export(folder, "stl", tmp_path / "out")
    assert "cm3" in told and trimesh.load(tmp_path / "out" / "swept_the_lead_m.stl").is_watertight


def test_an_stl_in_millimetres_is_closed_for_other_readers(motion, folder, tmp_path):
    pytest.importorskip("manifold3d", reason="manifold3d (the extra 'meshes') is not installed")
    (told,) = exports.export(folder, "stl", tmp_path / "out", "mm")
    assert "in millimetres" in told
    raw = np.fromfile(
        tmp_path / "out" / "swept_the_lead_mm.stl",
        np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")]),
        offset=84,
    )["corners"]
    # as a reader sees it that merges equal corners and nothing else
    _, index = np.unique(raw.reshape(-1, 3), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    assert np.all(faces[:, [0, 1, 2]] != faces[:, [1, 2, 0]]), "no triangle without an area"
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there, back = ({tuple(e): n for e, n in zip(*np.unique(x, axis=0, return_counts=True), strict=True)} for x in (
        edges, edges[:, ::-1]
    ))  # fmt: skip
    assert {tuple(map(int, k)): v for k, v in there.items()} == {tuple(map(int, k)): v for k, v in back.items()}
    swept = swept_volume(motion, "the lead")
    volume = np.sum(np.linalg.det(raw.astype(float))) / 6
    assert volume == pytest.approx(1e9 * swept.volume, rel=1e-5)


def test_corners_that_numbers_of_32_bits_make_one_leave_a_closed_surface():
    box = trimesh.creation.box((1.0, 1.0, 1.0)).subdivide().subdivide()
    near = np.asarray(box.vertices).copy()
    near[1] = near[np.argsort(np.linalg.norm(near - near[1], axis=1))[1]] + 1e-12
    vertices, faces = for_stl(near, np.asarray(box.faces))
    assert len(vertices) == len(near) - 1 and len(faces) < len(box.faces)
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight


def test_centrelines_in_dxf_are_those_of_the_frames(motion, folder, tmp_path):
    (told, *_) = exports.export(folder, "dxf", tmp_path / "out", "mm")
    assert "in mm" in told and "a layer each" in told
    lines = (tmp_path / "out" / "the_lead_mm.dxf").read_text().splitlines()
    pairs = list(zip(map(int, lines[::2]), lines[1::2], strict=True))
    assert pairs[-1] == (0, "EOF") and (70, "4") in pairs, "millimetres"
    starts = [k for k, pair in enumerate(pairs) if pair == (0, "POLYLINE")]
    position = motion.cables["the lead"].position
    assert len(starts) == len(position)
    for frame in (0, len(position) - 1):
        end = pairs.index((0, "SEQEND"), starts[frame])
        body = pairs[starts[frame] + 7 : end]
        found = np.array([float(value) for code, value in body if code in (10, 20, 30)]).reshape(-1, 3)
        assert found == pytest.approx(1e3 * position[frame], abs=1e-9)
    layers = {value for code, value in pairs if code == 8}
    assert len(layers) == len(position) and all(layer.startswith("frame_") for layer in layers)
    with pytest.raises(HarnessError, match="found the unit 'inch', expected one of m, mm"):
        exports.export(folder, "stl", tmp_path / "out", "inch")


def _saved(swept, folder: Path) -> Path:
    trimesh.Trimesh(swept.vertices, swept.faces).export(folder / "swept.stl")
    return folder / "swept.stl"

"""Distances and clearances against brute force: every triangle, every pair of points, closed forms."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness_opt import rotations
from harness_opt.clearance import Options, _sag, closest_on_segments, measure
from harness_opt.errors import ProblemError
from harness_opt.problem import (
    Body,
    Box,
    Cable,
    CableRun,
    Capsule,
    Cylinder,
    End,
    Hinge,
    Limits,
    MeshFile,
    Part,
    Problem,
    Sphere,
)
from harness_opt.results import CableMotion
from harness_opt.scene import Mesh, load_scene

trimesh = pytest.importorskip("trimesh")

POSE = {"position": (0.02, -0.01, 0.03), "quaternion": tuple(rotations.normalise([0.9, 0.2, -0.3, 0.1]))}


# --- meshes, in mm, and what is known about them ---


def _meshes():
    box = trimesh.creation.box((60, 40, 20))
    inverted = box.copy()
    inverted.invert()
    some = box.copy()
    some.faces[::3] = some.faces[::3, ::-1]
    open_box = trimesh.Trimesh(box.vertices, box.faces[2:], process=False)
    slivers = np.vstack([box.faces, [[0, 0, 1], [2, 3, 3]]])
    degenerate = trimesh.Trimesh(np.vstack([box.vertices, box.vertices[:2].mean(0)]), slivers, process=False)
    degenerate.faces = np.vstack([degenerate.faces, [[0, 8, 1], [1, 8, 0]]])
    shell = trimesh.util.concatenate([trimesh.creation.box((60, 60, 60)), trimesh.creation.box((40, 40, 40))])
    shell.faces[12:] = shell.faces[12:, ::-1]
    muddled = shell.copy()
    wrong = [1, 4, 12, 13]  # the first face of the cavity among them
    muddled.faces[wrong] = muddled.faces[wrong][:, ::-1]
    twins = trimesh.util.concatenate(
        [box, box.copy().apply_translation((60, 40, 0))]
    )  # they share an edge, which four faces use
    return {
        "box": box,
        "icosphere": trimesh.creation.icosphere(subdivisions=3, radius=40),
        "annulus": trimesh.creation.annulus(15, 40, 25, sections=48),
        "inverted": inverted,
        "partly inverted": some,
        "degenerate": degenerate,
        "cavity": shell,
        "partly inverted cavity": muddled,
        "twins": twins,
        "open": open_box,
    }


MESHES = _meshes()


def _problem(part: Part, **more) -> Problem:
    run = CableRun(Cable(0.3, 0.005, 1e-3, 1e-3), End(position=(0, 0, 0)), End(position=(0, 0, 0.3)))
    return Problem({"lead": run}, parts={"part": part}, **more)


def _load(mesh, folder: Path, suffix: str = "stl", **pose):
    path = folder / f"mesh.{suffix}"
    mesh.export(path)
    unit = None if suffix == "glb" else "mm"
    return load_scene(_problem(Part(MeshFile(path, unit), **pose))).parts["part"]


def _brute(geometry: Mesh, points):
    """Distances to every triangle, one point at a time: to its plane where the foot is inside, else edges."""
    a, b, c = geometry.vertices[geometry.faces].swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    result = []
    for p in points:
        height = np.einsum("mi,mi->m", p - a, normal)
        foot = p - height[:, None] * normal
        sides = [
            np.einsum("mi,mi->m", np.cross(e - s, foot - s), normal) for s, e in ((a, b), (b, c), (c, a))
        ]
        distance = [np.where(np.min(sides, axis=0) >= 0, np.abs(height), np.inf)]
        for s, e in ((a, b), (b, c), (c, a)):
            t = np.einsum("mi,mi->m", p - s, e - s) / np.einsum("mi,mi->m", e - s, e - s)
            distance.append(np.linalg.norm(s + np.clip(t, 0, 1)[:, None] * (e - s) - p, axis=1))
        result.append(np.min(distance))
    return np.array(result)


def _inside(name: str, local):
    """Whether points (n, 3), in mm and in the mesh's own coordinates, are inside, (n,)."""
    x, y, z = np.abs(local).T
    if name == "icosphere":
        planes = MESHES[name].face_normals, MESHES[name].triangles[:, 0]
        return np.all(np.einsum("nmi,mi->nm", local[:, None] - planes[1], planes[0]) < 0, axis=1)
    if name == "annulus":
        sections, around = 48, np.arctan2(local[:, 1], local[:, 0])
        # distance to the chords of the polygon, whose corners stand where its first vertex does
        first = np.arctan2(MESHES[name].vertices[0, 1], MESHES[name].vertices[0, 0])
        step = 2 * np.pi / sections
        along = np.hypot(x, y) * np.cos((around - first) % step - step / 2) / np.cos(step / 2)
        return (along > 15) & (along < 40) & (z < 12.5)
    if name.endswith("cavity"):
        return (np.maximum(np.maximum(x, y), z) < 30) & (np.maximum(np.maximum(x, y), z) > 20)
    if name == "twins":
        moved = np.abs(local - [60, 40, 0])
        return ((x < 30) & (y < 20) & (z < 10)) | np.all(moved < [30, 20, 10], axis=1)
    return (x < 30) & (y < 20) & (z < 10)


def _points(mesh, rng):
    """Random points around and inside, on triangles' planes, on the surface, at corners and edges; mm."""
    lower, upper = mesh.bounds
    size = upper - lower
    around = rng.uniform(lower - 0.5 * size, upper + 0.5 * size, (250, 3))
    a, b, c = mesh.triangles[rng.integers(0, len(mesh.faces), 100)].swapaxes(0, 1)
    u, v = rng.uniform(-2, 2, (2, 100, 1))
    planes = a + u * (b - a) + v * (c - a)
    u, v = np.sort(rng.uniform(0, 1, (2, 100, 1)), axis=0)
    surface = a + u * (b - a) + (v - u) * (c - a)
    return around, planes, np.vstack([surface, a[:20], 0.5 * (a + b)[:20]])


@pytest.mark.parametrize("name", list(MESHES))
def test_mesh_against_every_triangle(name, tmp_path, rng):
    mesh = MESHES[name]
    geometry = _load(mesh, tmp_path, **POSE)
    assert geometry.closed == (name != "open")
    around, planes, surface = _points(mesh, rng)
    for local in (around, planes, surface):
        points = POSE["position"] + rotations.rotate(POSE["quaternion"], 1e-3 * local)
        distance, gradient, nearest = geometry.signed_distance(points)
        exact = _brute(geometry, points)
        np.testing.assert_allclose(np.abs(distance), exact, atol=1e-14)
        np.testing.assert_allclose(np.linalg.norm(points - nearest, axis=1), exact, atol=1e-14)
        np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=1e-9)
        assert np.all(geometry.lower_bound(points) <= distance + 1e-14)
        clear = exact > 1e-7  # the file holds float32: nearer, the mesh is not the one described above
        if geometry.closed:
            assert np.array_equal(distance[clear] < 0, _inside(name, local)[clear])
        else:
            assert np.all(distance >= 0)
    # the gradient on the surface points outward: a step along it leaves the part
    on, normal, _ = geometry.signed_distance(points[:100])
    on = geometry.signed_distance(points[:100] + 1e-5 * normal)[0]
    assert np.all(on > 0)


@pytest.mark.parametrize("name", ["box", "annulus", "icosphere", "inverted", "cavity"])
def test_gradient_against_differences(name, tmp_path, rng):
    geometry = _load(MESHES[name], tmp_path, **POSE)
    local = _points(MESHES[name], rng)[0][:120]
    points = POSE["position"] + rotations.rotate(POSE["quaternion"], 1e-3 * local)
    _check_gradient(geometry, points)


def _check_gradient(geometry, points):
    _, gradient, _ = geometry.signed_distance(points)
    h = 1e-7
    steps = h * np.eye(3)
    up = np.array([geometry.signed_distance(points + step)[0] for step in steps]).T
    down = np.array([geometry.signed_distance(points - step)[0] for step in steps]).T
    difference = (up - down) / (2 * h)
    smooth = np.abs(np.linalg.norm(difference, axis=1) - 1) < 1e-5  # not on the medial axis
    assert np.mean(smooth) > 0.9
    np.testing.assert_allclose(gradient[smooth], difference[smooth], atol=1e-4)


def test_large_mesh_in_clusters(tmp_path, rng):
    """Above a few thousand triangles the inside is found by clusters: the same as by every triangle."""
    shell = trimesh.util.concatenate(
        [trimesh.creation.torus(40, 15, 120, 60), trimesh.creation.torus(40, 8, 60, 30)]
    )
    shell.faces[14400:] = shell.faces[14400:, ::-1]  # hollow
    geometry = _load(shell, tmp_path)
    assert geometry.clusters is not None
    assert np.array_equal(np.sort(np.concatenate(geometry.clusters.members)), np.arange(len(geometry.faces)))
    points = rng.uniform(geometry.lower, geometry.upper, (400, 3))
    distance = geometry.signed_distance(points)[0]
    tube = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.04, points[:, 2])
    clear = np.abs(distance) > 2e-4
    assert np.array_equal((distance < 0)[clear], ((tube > 0.008) & (tube < 0.015))[clear])
    assert np.array_equal(distance < 0, np.abs(geometry.winding_number(points)) > 0.5)


def test_formats_give_the_same_part(tmp_path, rng):
    points = rng.uniform(-0.05, 0.05, (50, 3))
    wanted = _load(MESHES["annulus"], tmp_path).signed_distance(points)[0]
    for suffix in ("obj", "ply", "glb"):
        mesh = MESHES["annulus"].copy()
        if suffix == "glb":
            mesh.apply_scale(1e-3)  # glTF is in metres
        geometry = _load(mesh, tmp_path, suffix)
        np.testing.assert_allclose(geometry.signed_distance(points)[0], wanted, atol=1e-7)
        np.testing.assert_allclose(geometry.upper - geometry.lower, [0.08, 0.08, 0.025], atol=1e-7)


def test_absurd_answers_are_asked_again(tmp_path, rng, monkeypatch):
    geometry = _load(MESHES["annulus"], tmp_path)
    points = rng.uniform(-0.05, 0.05, (20, 3))
    wanted = geometry.signed_distance(points)
    honest = type(geometry.query).__call__

    def lying(self, points):
        claimed, face = honest(self, points)
        claimed[::3], claimed[1::3] = np.nan, -1.8e308
        return claimed, np.zeros_like(face)

    monkeypatch.setattr(type(geometry.query), "__call__", lying)
    for got, want in zip(geometry.signed_distance(points), wanted, strict=True):
        np.testing.assert_allclose(got, want, atol=1e-12)


SHAPES = {
    "box": Box((0.06, 0.04, 0.02)),
    "sphere": Sphere(0.03),
    "cylinder": Cylinder(0.02, 0.05),
    "capsule": Capsule(0.02, 0.05),
}


@pytest.mark.parametrize("name", list(SHAPES))
def test_primitives_against_fine_meshes_and_coal(name, rng):
    coal = pytest.importorskip("coal")
    shape = SHAPES[name]
    geometry = load_scene(_problem(Part(shape, **POSE))).parts["part"]
    local = rng.uniform(-0.06, 0.06, (400, 3))
    points = POSE["position"] + rotations.rotate(POSE["quaternion"], local)
    distance, gradient, nearest = geometry.signed_distance(points)
    twin = {
        "box": lambda: coal.Box(0.06, 0.04, 0.02),
        "sphere": lambda: coal.Sphere(0.03),
        "cylinder": lambda: coal.Cylinder(0.02, 0.05),
        "capsule": lambda: coal.Capsule(0.02, 0.05),
    }[name]()
    still, request = coal.Transform3s.Identity(), coal.DistanceRequest()
    for p, d in zip(local, distance, strict=True):
        if name == "cylinder" and d < 0:
            # coal leaves the caps out; the depth is the smaller of the depths under mantle and caps
            wanted = max(np.hypot(*p[:2]) - 0.02, abs(p[2]) - 0.025)
        else:
            at = coal.Transform3s(np.eye(3), p)
            wanted = coal.distance(coal.Sphere(0.0), at, twin, still, request, coal.DistanceResult())
        assert d == pytest.approx(wanted, abs=1e-12)
    np.testing.assert_allclose(points - distance[:, None] * gradient, nearest, atol=1e-14)
    np.testing.assert_allclose(geometry.signed_distance(nearest)[0], 0.0, atol=1e-14)
    np.testing.assert_allclose(geometry.lower_bound(points), distance, atol=1e-15)
    _check_gradient(geometry, points)
    # the box that holds the part: touched on all sides, never left
    surface = nearest[np.abs(distance) > 0]
    assert np.all(surface >= geometry.lower - 1e-12)
    assert np.all(surface <= geometry.upper + 1e-12)
    # the middle and the axis have no gradient of their own, but must give one
    middle = geometry.signed_distance(np.array([POSE["position"]]))
    assert np.linalg.norm(middle[1]) == pytest.approx(1.0)
    assert middle[0][0] < 0


@pytest.mark.parametrize("name", ["annulus mesh", "box mesh", *SHAPES])
def test_chord_bounds_hold_and_are_tight(name, tmp_path, rng):
    if name.endswith("mesh"):
        geometry = _load(MESHES[name.split()[0]], tmp_path)
    else:
        geometry = load_scene(_problem(Part(SHAPES[name]))).parts["part"]
    start = rng.uniform(-0.06, 0.06, (200, 3))
    end = start + rng.normal(size=(200, 3)) * 0.01
    end[:50, 1:] = start[:50, 1:]  # along triangles' planes too
    share = np.linspace(0, 1, 101)[:, None, None]
    line = (1 - share) * start + share * end
    least = np.min([geometry.signed_distance(points)[0] for points in line], axis=0)
    at = geometry.signed_distance(start)[0], geometry.signed_distance(end)[0]
    middle = 0.5 * (start + end)
    between = geometry.signed_distance(middle)[0]
    bound = geometry.chord_bound(start, end, *at)
    length = np.linalg.norm(end - start, axis=1)
    assert np.all(bound <= least + 1e-12)
    if name.endswith("mesh"):
        # as good as the sampling, which is coarser than the chord, where balls about the ends cover the chord
        known = (least > 0) & (at[0] + at[1] > length)
        slack = np.minimum(length / 200, length**2 / 1e4 / np.maximum(least, 1e-3))
        assert np.all((least - bound)[known] <= slack[known] + 1e-12)
    else:
        # tangents: the error falls with the length
        halves = (
            geometry.chord_bound(start, middle, at[0], between),
            geometry.chord_bound(middle, end, between, at[1]),
        )
        assert np.all(np.minimum(*halves) >= bound - 1e-12)
        assert np.mean(least - np.minimum(*halves)) < 0.6 * np.mean(least - bound)


def test_refusals_name_the_part_and_the_key(tmp_path):
    (tmp_path / "garbage.stl").write_text("this is no mesh\n")
    (tmp_path / "broken.glb").write_bytes(b"glTF....")
    nan = MESHES["box"].copy()
    nan.vertices[3] = np.nan
    (tmp_path / "nan.obj").write_text("v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n")
    (tmp_path / "line.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    (tmp_path / "points.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "end_header\n0 0 0\n"
    )
    parts = {
        stem: Part(MeshFile(tmp_path / name, "mm"))
        for stem, name in {
            "garbage": "garbage.stl",
            "broken": "broken.glb",
            "nan": "nan.obj",
            "line": "line.obj",
            "points": "points.ply",
            "missing": "missing.stl",
            "other": "drawing.dxf",
        }.items()
    }
    parts["flat"] = Part(Box((0.1, 0.0, 0.1)))
    parts["ball"] = Part(Sphere(-1.0))
    with pytest.raises(ProblemError) as caught:
        load_scene(Problem(_problem(parts["flat"]).cables, parts=parts))
    assert len(caught.value.mistakes) == len(parts)
    for name, line in zip(parts, caught.value.mistakes, strict=True):
        assert line.startswith(f"parts.{name}.")
        assert "found" in line
        assert "expected" in line


def test_too_many_triangles_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("harness_opt.scene.MOST_FACES", 11)
    with pytest.raises(ProblemError, match=r"parts\.part\.mesh: found 12 triangles, expected at most 11"):
        _load(MESHES["box"], tmp_path)


def test_open_mesh_is_told(tmp_path):
    MESHES["open"].export(tmp_path / "open.stl")
    problem = _problem(Part(MeshFile(tmp_path / "open.stl", "mm")))
    scene = load_scene(problem)
    assert "parts.part.mesh" in scene.warnings[0]
    result = measure(problem, scene, [0.0], {"lead": _shapes([_helix(0.03, 0.1)], 0.3)})
    assert not result.pairs[0].closed


def test_scene_is_light_without_meshes():
    code = (
        "import sys, harness_opt.scene as s, harness_opt.clearance, harness_opt.problem as p;"
        "c = p.CableRun(p.Cable(1, .01, 1, 1), p.End(position=(0,0,0)), p.End());"
        "s.load_scene(p.Problem({'c': c}, parts={'b': p.Part(p.Sphere(1.0))}));"
        "assert not {'coal', 'trimesh', 'casadi'} & set(sys.modules), sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# --- clearances ---


@pytest.fixture
def rng():
    return np.random.default_rng(20240611)


def _shapes(curves, length: float, count: int = 101) -> CableMotion:
    """A motion (P frames) of curves: functions s (n,) -> position, tangent, curvature vector (n, 3)."""
    s = np.linspace(0, length, count)
    position, tangent, bend = (np.array(x) for x in zip(*(curve(s) for curve in curves), strict=True))
    frames = rotations.shortest_arc([0.0, 0.0, 1.0], tangent)
    local = rotations.rotate(rotations.conjugate(frames), bend)
    # r'' = R (omega x e3)
    curvature = np.stack([-local[..., 1], local[..., 0], 0 * s + 0 * local[..., 0]], axis=-1)
    blank, per_frame = np.zeros_like(position), np.zeros(len(position))
    return CableMotion(
        s, position, frames, curvature, blank, blank, per_frame == 0, per_frame, per_frame, per_frame
    )


def _helix(radius: float, pitch: float, turn=(1.0, 0.0, 0.0, 0.0), centre=(0.0, 0.0, 0.0), phase=0.0):
    """A helix by arc length, turned and moved."""

    def curve(s):
        scale = np.hypot(radius, pitch / (2 * np.pi))
        a = s / scale + phase
        rise = pitch / (2 * np.pi) / scale
        zero = np.zeros_like(a)
        r = np.stack([radius * np.cos(a), radius * np.sin(a), rise * s], -1)
        t = np.stack([-radius / scale * np.sin(a), radius / scale * np.cos(a), zero + rise], -1)
        k = np.stack([-np.cos(a), -np.sin(a), zero], -1) * radius / scale**2
        return centre + rotations.rotate(turn, r), rotations.rotate(turn, t), rotations.rotate(turn, k)

    return curve


def _line(start, direction):
    def curve(s):
        d = rotations.normalise(direction)
        return start + s[:, None] * d, np.tile(d, (len(s), 1)), np.zeros((len(s), 3))

    return curve


def _random_helices(rng, count):
    return [
        _helix(
            rng.uniform(0.02, 0.06),
            rng.uniform(0.05, 0.2),
            rotations.normalise(rng.normal(size=4)),
            rng.uniform(-0.05, 0.05, 3),
            rng.uniform(0, 6),
        )
        for _ in range(count)
    ]


LENGTH = 0.3
DIAMETER = 0.005


def _cables(*names, bodies=("world", "world")):
    run = CableRun(
        Cable(LENGTH, DIAMETER, 1e-3, 1e-3),
        End(position=(0, 0, 0), body=bodies[0]),
        End(position=(0, 0, 0.3), body=bodies[1]),
    )
    return dict.fromkeys(names or ("lead",), run)


@pytest.mark.parametrize("kind", ["annulus", "icosphere", "inverted", *SHAPES])
def test_worst_against_dense_sampling(kind, tmp_path, rng):
    """A part that moves: the worst, its place and the bounds, against ten times the points."""
    if kind in MESHES:
        MESHES[kind].export(tmp_path / "part.stl")
        shape = MeshFile(tmp_path / "part.stl", "mm")
    else:
        shape = SHAPES[kind]
    arm = Body(Hinge((0.01, 0.02, 0.0), (1, 1, 0), 0.0, 1.5))
    problem = Problem(
        _cables(), {"arm": arm}, {"part": Part(shape, "arm", **POSE)}, limits=Limits(clearance=0.004)
    )
    curves, motion = _random_helices(rng, 12), np.linspace(0, 1, 12)
    cables = {"lead": _shapes(curves, LENGTH)}
    scene = load_scene(problem)
    pair = measure(problem, scene, motion, cables).pairs[0]
    dense = np.linspace(0, LENGTH, 1001)
    position, quaternion = arm.poses(motion)
    brute = []
    for frame, curve in enumerate(curves):
        back = rotations.conjugate(quaternion[frame])
        local = rotations.rotate(back, curve(dense)[0] - position[frame])
        brute.append(scene.parts["part"].signed_distance(local)[0] - DIAMETER / 2)
    brute = np.array(brute)
    assert pair.certified_along_arc
    assert not pair.certified  # nothing is known between frames
    assert pair.tolerance <= 0.0101 * DIAMETER + 1e-6
    assert pair.lower_bound <= brute.min() <= pair.worst + 1e-4
    # each frame is good to the stations' spacing at once, and to far less where the clearance is smooth
    assert np.all(pair.clearance <= brute.min(axis=1) + 0.5 * LENGTH / 100)
    assert np.median(np.abs(pair.clearance - brute.min(axis=1))) < 2e-6
    # each witness is a point of its curve, at the distance it says, along the normal it says
    for found in (pair.nearest, pair.witnesses):
        for i, frame in enumerate(found.frame):
            at = curves[frame](found.arc_length[i : i + 1])[0][0]
            along = at - found.point[i]
            expected = (found.clearance[i] + DIAMETER / 2) * found.normal[i]
            np.testing.assert_allclose(along, expected, atol=1e-6)
    assert np.all(pair.witnesses.clearance < 0.004 + DIAMETER)
    assert np.all(np.isnan(pair.nearest.other_arc_length))
    # every local minimum of the dense curve that lies below the horizon has a witness beside it
    for frame, row in enumerate(brute):
        low = np.flatnonzero((row[1:-1] < row[:-2]) & (row[1:-1] <= row[2:]) & (row[1:-1] < 0.0085)) + 1
        mine = pair.witnesses.arc_length[pair.witnesses.frame == frame]
        for k in low:
            depth = min(row[max(k - 30, 0) : k].max(), row[k : k + 31].max()) - row[k]
            assert depth < 1e-3 or np.min(np.abs(mine - dense[k])) < 2 * LENGTH / 100
    row = measure(problem, scene, motion, cables).limits[0]
    assert (row.name, row.part, row.worst, row.frame) == ("clearance", "part", pair.worst, pair.frame)
    assert row.margin == pytest.approx(pair.worst - 0.004)


def test_needle_between_two_stations_is_found(tmp_path):
    """A needle of 0.1 mm stands where no station sees it: it is met between them."""
    needle = trimesh.creation.box((0.1, 0.1, 20))
    wall = trimesh.creation.box((200, 1, 200)).apply_translation((0, 14.5, 0))
    needle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    needle.apply_translation((0.5 * 1e3 * LENGTH / 100, 14, 0))  # half way between stations, tip at y = 4 mm
    trimesh.util.concatenate([wall, needle]).export(tmp_path / "needle.stl")
    problem = Problem(
        _cables(),
        parts={"needle": Part(MeshFile(tmp_path / "needle.stl", "mm"))},
        limits=Limits(clearance=0.004),
    )
    cables = {"lead": _shapes([_line([-0.15, 0, 0], [1, 0, 0])], LENGTH)}
    pair = measure(problem, load_scene(problem), [0.0], cables).pairs[0]
    assert pair.worst == pytest.approx(0.004 - DIAMETER / 2, abs=1e-5)
    assert pair.nearest.arc_length[0] == pytest.approx(0.1515, abs=1e-4)
    assert pair.certified
    assert pair.tolerance < 6e-5


def test_cable_inside_a_part_is_negative_with_a_way_out(tmp_path):
    MESHES["box"].export(tmp_path / "box.stl")
    for shape in (MeshFile(tmp_path / "box.stl", "mm"), Box((0.06, 0.04, 0.02))):
        problem = _problem(Part(shape, clearance=0.002))
        cables = {"lead": _shapes([_line([-0.15, 0, 0.004], [1, 0, 0])], LENGTH)}
        pair = measure(problem, load_scene(problem), [0.0], cables).pairs[0]
        assert pair.worst == pytest.approx(-0.006 - DIAMETER / 2, abs=1e-4)
        np.testing.assert_allclose(pair.nearest.normal[0], [0, 0, 1], atol=1e-6)
        assert pair.limit == 0.002
        # the middle has no single way out, and still a normal
        cables = {"lead": _shapes([_line([-0.15, 0, 0], [1, 0, 0])], LENGTH)}
        pair = measure(problem, load_scene(problem), [0.0], cables).pairs[0]
        assert np.all(np.isfinite(pair.nearest.normal))


def test_cable_along_a_surface_is_certain(tmp_path):
    """Parallel to a plate every point is as near as any other, which Lipschitz bounds alone cannot settle."""
    plate = trimesh.creation.box((400, 400, 2)).subdivide().subdivide().subdivide()
    plate.export(tmp_path / "plate.stl")
    problem = _problem(Part(MeshFile(tmp_path / "plate.stl", "mm")), limits=Limits(clearance=0.001))
    lines = [_line([-0.15, 0.01 * i, 0.01], [1, 0, 1e-3 * i]) for i in range(5)]
    pair = measure(
        problem, load_scene(problem), np.linspace(0, 1, 5), {"lead": _shapes(lines, LENGTH)}
    ).pairs[0]
    assert pair.certified_along_arc
    assert pair.worst == pytest.approx(0.009 - DIAMETER / 2, abs=1e-7)


def test_budget_is_admitted(tmp_path, rng):
    MESHES["annulus"].export(tmp_path / "part.stl")
    problem = _problem(Part(MeshFile(tmp_path / "part.stl", "mm")))
    cables = {"lead": _shapes([_helix(0.05, 0.03, centre=(0, 0, -0.015))], LENGTH)}
    poor = measure(problem, load_scene(problem), [0.0], cables, Options(most_queries=3)).pairs[0]
    rich = measure(problem, load_scene(problem), [0.0], cables).pairs[0]
    assert not poor.certified_along_arc
    assert poor.lower_bound <= rich.lower_bound
    assert poor.tolerance > rich.tolerance
    assert rich.limit is None
    assert measure(problem, load_scene(problem), [0.0], cables).limits == ()


def test_part_on_the_clamps_own_body_does_not_count_near_it():
    """Both ends in blocks: each counts, but for the stretch near the clamp on its own body."""
    limit = 0.003
    reach = 2 * (limit + DIAMETER / 2)
    block, still = Part(Box((0.02, 0.02, 0.02)), position=(0, 0, -0.01)), np.array([0.0, 1.0])
    far = Part(Box((0.02, 0.02, 0.02)), "arm", position=(0, 0, LENGTH + 0.01))
    arm = Body(Hinge((0, 0, 0), (0, 0, 1), 0.0, 0.3))
    cables = {"lead": _shapes([_line([0, 0, 0], [0, 0, 1])] * 2, LENGTH)}
    worst = {}
    for ends in (("world", "arm"), ("arm", "world"), ("world", "world")):
        problem = Problem(
            _cables(bodies=ends), {"arm": arm}, {"block": block, "far": far}, limits=Limits(clearance=limit)
        )
        for pair in measure(problem, load_scene(problem), still, cables).pairs[:2]:
            worst[ends, pair.obstacle] = pair.worst, pair.excluded
    away, touching = pytest.approx(reach - DIAMETER / 2), pytest.approx(-DIAMETER / 2)
    assert worst[("world", "arm"), "block"] == (away, (reach, 0.0))
    assert worst[("world", "arm"), "far"] == (away, (0.0, reach))
    assert worst[("arm", "world"), "block"] == (touching, (0.0, reach))
    assert worst[("arm", "world"), "far"] == (touching, (reach, 0.0))
    assert worst[("world", "world"), "block"] == (away, (reach, reach))
    assert worst[("world", "world"), "far"] == (touching, (0.0, 0.0))


def test_cable_to_cable_against_every_pair(rng):
    problem = Problem(_cables("one", "two"), limits=Limits(clearance=0.002))
    ones, twos = _random_helices(rng, 10), _random_helices(rng, 10)
    cables = {"one": _shapes(ones, LENGTH), "two": _shapes(twos, LENGTH)}
    result = measure(problem, load_scene(problem), np.linspace(0, 1, 10), cables)
    assert [(pair.cable, pair.obstacle) for pair in result.pairs] == [
        ("one", "cable:one"),
        ("one", "cable:two"),
        ("two", "cable:two"),
    ]
    pair = result.pairs[1]
    dense = np.linspace(0, LENGTH, 1001)
    brute = np.array(
        [
            np.linalg.norm(one(dense)[0][:, None] - two(dense)[0], axis=-1).min()
            for one, two in zip(ones, twos, strict=True)
        ]
    )
    assert pair.certified_along_arc
    assert np.all(np.abs(pair.clearance + DIAMETER - brute) < 2e-4)
    # dense points overestimate: by less than half their spacing squared over the distance
    assert np.all(pair.clearance + DIAMETER <= brute + 1e-7)
    assert pair.lower_bound <= pair.worst <= pair.lower_bound + 6e-5
    for i, frame in enumerate(pair.nearest.frame):
        at = ones[frame](pair.nearest.arc_length[i : i + 1])[0][0]
        other = twos[frame](pair.nearest.other_arc_length[i : i + 1])[0][0]
        normal = pair.nearest.normal[i]
        np.testing.assert_allclose(at - other, (pair.clearance[i] + DIAMETER) * normal, atol=1e-6)
        np.testing.assert_allclose(pair.nearest.point[i], other + DIAMETER / 2 * normal, atol=1e-6)


@pytest.mark.parametrize(("radius", "pitch"), [(0.012, 0.008), (0.02, 0.009), (0.03, 0.2), (10.0, 1.0)])
def test_self_clearance_against_every_pair(radius, pitch):
    limit = 0.002
    problem = Problem(_cables(), limits=Limits(clearance=limit))
    curves = [_helix(radius, pitch * (1 + 0.1 * i)) for i in range(3)]
    pair = measure(
        problem, load_scene(problem), np.linspace(0, 1, 3), {"lead": _shapes(curves, LENGTH, 201)}
    ).pairs[0]
    gap = np.pi / 2 * (DIAMETER + limit)
    dense = np.linspace(0, LENGTH, 2001)
    allowed = dense[None] - dense[:, None] >= gap
    for frame, curve in enumerate(curves):
        r = curve(dense)[0]
        brute = np.where(allowed, np.linalg.norm(r[:, None] - r, axis=-1), np.inf).min()
        # points at the least arc apart may lie up to one step of the dense sampling nearer than it says
        assert pair.clearance[frame] + DIAMETER <= brute + 1e-7
        assert pair.clearance[frame] + DIAMETER >= brute - LENGTH / 2000
    assert pair.certified_along_arc
    assert np.all(pair.nearest.other_arc_length - pair.nearest.arc_length >= gap * (1 - 1e-12))
    if radius > 1:
        # a straight cable has nothing to push apart
        assert len(pair.witnesses.frame) == 0


def test_hairpin_at_the_limit_just_passes():
    """Limbs the limit apart: the rule that leaves neighbours out sees them at exactly the limit."""
    limit = 0.004
    half = 0.5 * (DIAMETER + limit)
    problem = Problem(_cables(), limits=Limits(clearance=limit))
    arc = np.pi * half
    leg = 0.5 * (LENGTH - arc)

    def hairpin(s):
        a = np.clip((s - leg) / half, 0, np.pi)
        before, after = np.minimum(s, leg), np.maximum(s - leg - arc, 0.0)
        zero = np.zeros_like(s)
        r = np.stack([-half * np.cos(a), zero, before + half * np.sin(a) - after], -1)
        t = np.stack([np.sin(a), zero, np.cos(a)], -1)
        bend = ((s > leg) & (s < leg + arc)) / half
        return r, t, np.stack([np.cos(a) * bend, zero, -np.sin(a) * bend], -1)

    pair = measure(problem, load_scene(problem), [0.0], {"lead": _shapes([hairpin], LENGTH, 401)}).pairs[0]
    assert pair.worst == pytest.approx(limit, abs=1e-5)


def test_crossing_cables_have_a_normal():
    problem = Problem(_cables("one", "two"), limits=Limits(clearance=0.002))
    cables = {
        "one": _shapes([_line([-0.15, 0, 0], [1, 0, 0])], LENGTH),
        "two": _shapes([_line([0, -0.15, 0], [0, 1, 0])], LENGTH),
    }
    pair = measure(problem, load_scene(problem), [0.0], cables).pairs[1]
    assert pair.worst == pytest.approx(-DIAMETER)
    np.testing.assert_allclose(np.abs(pair.nearest.normal[0]), [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize("radius", [0.003, 0.01, 1.0])
def test_sag_bounds_the_way_from_chord_to_arc(radius):
    curve = _helix(radius, 0.01)
    for length in np.geomspace(1e-4, 0.02, 12):
        s = np.linspace(0.02, 0.02 + length, 201)
        r = curve(s)[0]
        way = np.linalg.norm(r - r[0] - np.linspace(0, 1, 201)[:, None] * (r[-1] - r[0]), axis=1).max()
        sag = _sag(length, np.linalg.norm(r[-1] - r[0]))
        assert way <= sag + 1e-9
        if length < 0.5 * radius and sag > 1e-9:
            assert sag < 1.25 * way  # sqrt(4/3) for short arcs


def test_segments_against_sampling(rng):
    p, u, q, v = rng.normal(size=(4, 300, 3))
    v[:60] = u[:60] * rng.normal(size=(60, 1))  # parallel
    u[60:70], v[70:80] = 0.0, 0.0
    x, y = closest_on_segments(p, u, q, v)
    found = np.linalg.norm(p + x[:, None] * u - q - y[:, None] * v, axis=1)
    share = np.linspace(0, 1, 201)
    # for a point of the one segment the nearest of the other is a projection
    points = p + share[:, None, None] * u - q
    square = np.maximum(np.einsum("ki,ki->k", v, v), 1e-300)
    along = np.clip(np.einsum("nki,ki->nk", points, v) / square, 0, 1)
    sampled = np.linalg.norm(points - along[..., None] * v, axis=-1).min(axis=0)
    assert np.all(found <= sampled + 1e-12)
    assert np.all(found >= sampled - 0.005 * np.linalg.norm(u, axis=1) - 1e-12)


def test_same_question_same_answer(tmp_path, rng):
    MESHES["annulus"].export(tmp_path / "part.stl")
    problem = _problem(Part(MeshFile(tmp_path / "part.stl", "mm")), limits=Limits(clearance=0.01))
    cables = {"lead": _shapes(_random_helices(rng, 4), LENGTH)}
    answers = [measure(problem, load_scene(problem), np.linspace(0, 1, 4), cables) for _ in range(2)]
    for one, two in zip(*(answer.pairs for answer in answers), strict=True):
        assert one.lower_bound == two.lower_bound
        for name, values in vars(one.witnesses).items():
            assert np.array_equal(values, getattr(two.witnesses, name), equal_nan=True)


def test_short_cables_say_what_was_left_out():
    short = CableRun(Cable(0.01, 0.005, 1e-3, 1e-3), End(position=(0, 0, 0)), End(position=(0, 0, 0.01)))
    problem = Problem({"stub": short}, parts={"ball": Part(Sphere(0.1))}, limits=Limits(clearance=0.01))
    cables = {"stub": _shapes([_line([0, 0, 0], [0, 0, 1])], 0.01, 11)}
    result = measure(problem, load_scene(problem), [0.0], cables)
    assert result.pairs == ()
    assert len(result.left_out) == 2

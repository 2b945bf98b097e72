"""Distances of points and chords to parts against brute force: every triangle, closed forms, coal."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import trimesh

from harness_opt.errors import ProblemError
from harness_opt.model.parts import Box, MeshFile, Part, Sphere
from harness_opt.numerics import rotations
from harness_opt.numerics.vectors import lengths
from harness_opt.parts import mesh_headers
from harness_opt.parts.nearest import Shell
from harness_opt.parts.scene import load_scene
from oracles.scenes import MESHES, POSE, SHAPES, load_mesh, problem_with
from oracles.scripts import script


def _brute(geometry: Shell, points):
    """Distances to every triangle, one point at a time: to its plane where the foot is inside, else edges."""
    a, b, c = geometry.vertices[geometry.faces].swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    result = []
    for p in points:
        height = np.einsum("mi,mi->m", p - a, normal)
        foot = p - height[:, None] * normal
        sides = [np.einsum("mi,mi->m", np.cross(e - s, foot - s), normal) for s, e in ((a, b), (b, c), (c, a))]
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
    if name == "crossed":
        return (y < 20) & (z < 10) & (local[:, 0] > -30) & (local[:, 0] < 70)
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
    geometry = load_mesh(mesh, tmp_path, **POSE)
    assert geometry.closed == (name != "open")
    around, planes, surface = _points(mesh, rng)
    for local in (around, planes, surface):
        points = POSE["position"] + rotations.rotate(POSE["quaternion"], 1e-3 * local)
        distance, gradient, nearest = geometry.signed_distance(points)
        exact = _brute(geometry.outer, points)
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
    if name == "crossed":  # some of its surface lies inside it
        return
    on, normal, _ = geometry.signed_distance(points[:100])
    on = geometry.signed_distance(points[:100] + 1e-5 * normal)[0]
    assert np.all(on > 0)


@pytest.mark.parametrize("name", ["box", "annulus", "icosphere", "inverted", "cavity"])
def test_gradient_against_differences(name, tmp_path, rng):
    geometry = load_mesh(MESHES[name], tmp_path, **POSE)
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
    shell = trimesh.util.concatenate([trimesh.creation.torus(40, 15, 120, 60), trimesh.creation.torus(40, 8, 60, 30)])
    shell.faces[14400:] = shell.faces[14400:, ::-1]  # hollow
    geometry = load_mesh(shell, tmp_path)
    assert geometry.winding.clusters is not None
    assert np.array_equal(np.sort(np.concatenate(geometry.winding.clusters.members)), np.arange(len(geometry.faces)))
    points = rng.uniform(geometry.lower, geometry.upper, (400, 3))
    distance = geometry.signed_distance(points)[0]
    tube = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.04, points[:, 2])
    clear = np.abs(distance) > 2e-4
    assert np.array_equal((distance < 0)[clear], ((tube > 0.008) & (tube < 0.015))[clear])
    assert np.array_equal(distance < 0, np.abs(geometry.winding_number(points)) > 0.5)


def _ball(tmp_path, monkeypatch, most: int):
    """A ball of 5,120 triangles, of which one of coal's trees holds at most so many."""
    monkeypatch.setattr("harness_opt.parts.nearest.ONE_TREE", most)
    geometry = load_mesh(trimesh.creation.icosphere(subdivisions=4, radius=40), tmp_path)
    assert (len(geometry.shell.query._trees) > 1) == (most < len(geometry.faces))
    return geometry


def test_a_large_mesh_in_many_trees(tmp_path, rng, monkeypatch):
    """Distances of points, chords and boxes are those of one tree, and those of every triangle."""
    geometry, whole = _ball(tmp_path, monkeypatch, 1000), _ball(tmp_path, monkeypatch, 10**6)
    line = [0.041, 0.0, 0.0] + np.linspace(0, 0.03, 200)[:, None] * [0.0, 1.0, 0.5]
    points = np.concatenate([rng.uniform(-0.1, 0.1, (200, 3)), line, rng.normal(size=(20, 3)) * 1e-6])
    distance, nearest, _ = geometry.shell.nearest(points)
    np.testing.assert_allclose(distance, _brute(geometry.shell, points), atol=1e-14)
    np.testing.assert_allclose(lengths(points - nearest), distance, atol=1e-14)
    start = rng.uniform(-0.1, 0.1, (200, 3))
    end = start + 0.01 * rng.normal(size=(200, 3))
    clear = geometry.shell.query.chords(start, end)
    np.testing.assert_allclose(clear, whole.shell.query.chords(start, end), atol=1e-14)
    corners = np.stack([start, end, start + np.array([0.0, 0.01, 0.0])], axis=1)
    boxes = (made.shell.query.boxes(corners, corners.mean(axis=1)) for made in (geometry, whole))
    np.testing.assert_allclose(*(np.maximum(found, 0.0) for found in boxes), atol=1e-10)
    assert len(geometry.shell.bundles) == 64
    assert np.array_equal(np.sort(np.concatenate(geometry.shell.bundles)), np.arange(len(geometry.faces)))


def test_trees_are_made_of_what_is_near(tmp_path, monkeypatch):
    geometry = _ball(tmp_path, monkeypatch, 1000)
    query, made = geometry.shell.query, []
    make = type(query)._tree
    monkeypatch.setattr(type(query), "_tree", lambda self, k: (made.append(k), make(self, k))[1])
    geometry.shell.nearest([0.041, 0.0, 0.0] + np.linspace(0, 0.001, 50)[:, None] * [0.0, 1.0, 0.5])
    assert 0 < len(set(made)) < 10


def test_what_one_of_many_trees_does_not_know_is_asked_again(tmp_path, rng, monkeypatch):
    geometry = _ball(tmp_path, monkeypatch, 1000)
    points = rng.uniform(-0.1, 0.1, (20, 3))
    query = geometry.shell.query

    class Astray:
        """coal, whose every second answer is no number."""

        def __init__(self):
            self.asked = 0

        def __getattr__(self, name):
            return getattr(coal, name)

        def distance(self, *given):
            self.asked += 1
            return np.nan if self.asked % 2 else coal.distance(*given)

    coal = query._coal
    query._coal = Astray()
    distance, _, _ = geometry.shell.nearest(points)
    np.testing.assert_allclose(distance, _brute(geometry.shell, points), atol=1e-14)


def test_five_states_of_one_mesh(tmp_path, rng):
    """Closed, inside out, with flat faces, in millimetres: the same solid. Open: a shell, and only on request."""
    pytest.importorskip("manifold3d")
    bracket = script("make_meshes")
    parts = {}
    for name, mesh in bracket.variants().items():
        mesh.export(tmp_path / f"{name}.ply")
        file = MeshFile(tmp_path / f"{name}.ply", "mm" if name == "millimetres" else "m", shell=name == "open")
        parts[name] = load_scene(problem_with(Part(file))).parts["part"]
    closed = parts["closed"]
    points = rng.uniform(closed.lower - 0.01, closed.upper + 0.01, (400, 3))
    wanted = closed.signed_distance(points)
    assert 20 < np.sum(wanted[0] < 0) < 380
    for name in ("inverted", "degenerate", "millimetres"):
        assert parts[name].closed
        found = parts[name].signed_distance(points)
        np.testing.assert_allclose(found[0], wanted[0], atol=1e-8)
        np.testing.assert_allclose(found[2], wanted[2], atol=1e-6)
    shell = parts["open"]
    assert not shell.closed
    assert np.all(shell.signed_distance(points)[0] >= 0)


def test_formats_give_the_same_part(tmp_path, rng):
    points = rng.uniform(-0.05, 0.05, (50, 3))
    wanted = load_mesh(MESHES["annulus"], tmp_path).signed_distance(points)[0]
    for suffix in ("obj", "ply", "glb"):
        mesh = MESHES["annulus"].copy()
        if suffix == "glb":
            mesh.apply_scale(1e-3)  # glTF is in metres
        geometry = load_mesh(mesh, tmp_path, suffix)
        np.testing.assert_allclose(geometry.signed_distance(points)[0], wanted, atol=1e-7)
        np.testing.assert_allclose(geometry.upper - geometry.lower, [0.08, 0.08, 0.025], atol=1e-7)


def test_absurd_answers_are_asked_again(tmp_path, rng, monkeypatch):
    geometry = load_mesh(MESHES["annulus"], tmp_path)
    points = rng.uniform(-0.05, 0.05, (20, 3))
    wanted = geometry.signed_distance(points)
    honest = type(geometry.shell.query).__call__

    def lying(self, points):
        claimed, face = honest(self, points)
        claimed[::3], claimed[1::3] = np.nan, -1.8e308
        return claimed, np.zeros_like(face)

    monkeypatch.setattr(type(geometry.shell.query), "__call__", lying)
    for got, want in zip(geometry.signed_distance(points), wanted, strict=True):
        np.testing.assert_allclose(got, want, atol=1e-12)


@pytest.mark.parametrize("name", list(SHAPES))
def test_primitives_against_fine_meshes_and_coal(name, rng):
    coal = pytest.importorskip("coal")
    shape = SHAPES[name]
    geometry = load_scene(problem_with(Part(shape, **POSE))).parts["part"]
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
    assert np.array_equal(geometry.lower_bound(points), distance)
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
        geometry = load_mesh(MESHES[name.split()[0]], tmp_path)
    else:
        geometry = load_scene(problem_with(Part(SHAPES[name]))).parts["part"]
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
        load_scene(problem_with(Part(Sphere(1.0))).changed(parts=parts))
    assert len(caught.value.mistakes) == len(parts)
    for name, line in zip(parts, caught.value.mistakes, strict=True):
        assert line.startswith(f"parts.{name}.")
        assert "found" in line
        assert "expected" in line


def test_too_many_triangles_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("harness_opt.parts.mesh_headers.MOST_FACES", 11)
    with pytest.raises(ProblemError, match=r"parts\.part\.mesh: found 12 triangles, expected at most 11"):
        load_mesh(MESHES["box"], tmp_path)


def test_too_many_triangles_are_refused_before_they_are_read(tmp_path):
    """A binary STL file says how many it has: as many as are too many need not be held first."""
    path, count = tmp_path / "huge.stl", mesh_headers.MOST_FACES + 1
    with path.open("wb") as file:
        file.write(bytes(80) + count.to_bytes(4, "little"))
        file.truncate(84 + 50 * count)  # nothing is written: the disk keeps a hole
    with pytest.raises(ProblemError, match=r"found 7,500,001 triangles, expected at most 7,500,000"):
        load_scene(problem_with(Part(MeshFile(path, "mm"))))


def test_open_mesh_is_told(tmp_path):
    MESHES["open"].export(tmp_path / "open.stl")
    problem = problem_with(Part(MeshFile(tmp_path / "open.stl", "mm", shell=True)))
    assert "parts.part.mesh" in load_scene(problem).warnings[0]
    with pytest.raises(ProblemError, match=r"parts\.part\.mesh: found a surface that is not closed .* shell = true"):
        load_scene(problem_with(Part(MeshFile(tmp_path / "open.stl", "mm"))))


def test_scene_is_light_without_meshes():
    code = (
        "import sys, harness_opt.clearance.measure; from harness_opt.model.cable import Cable, CableRun, End;"
        "from harness_opt.model.parts import Part, Sphere; from harness_opt.model.problem import Problem;"
        "from harness_opt.parts.scene import load_scene;"
        "c = CableRun(Cable(1, .01, 1, 1), End(position=(0,0,0)), End());"
        "load_scene(Problem({'c': c}, parts={'b': Part(Sphere(1.0))}));"
        "assert not {'coal', 'trimesh', 'casadi'} & set(sys.modules), sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_random_pairs_of_cables_and_meshes(rng):
    """As many of the 10,000 pairs of ``scripts/benchmarks/clearance_oracle.py`` as a test has time for."""
    oracle = script("clearance_oracle")
    for kind, row in oracle.compare(288, rng).items():
        assert row["pairs"] == 48
        assert row["wrong sides"] == row["not finite"] == 0, kind
        assert row["distance"] < 1e-12, kind
        assert row["bound"] < 1e-12 and row["worst"] < 1e-12, kind
        assert row["gradient"] < 2e-3, kind  # differences of norm 1 +- 1e-6 may be turned by 1.4e-3

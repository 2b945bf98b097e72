"""Depths in assemblies are those below the outer surface of all bodies: unions in closed form and by others."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.parts.mesh import Mesh
from oracles.scenes import MESHES, load_mesh

TURN = rotations.matrix(rotations.normalise([0.8, 0.3, -0.4, 0.2]))


def box(lower, upper, finer=0):
    """A box between two corners, mm, its triangles halved a few times."""
    mesh = trimesh.creation.box(np.subtract(upper, lower))
    mesh.apply_translation(np.add(lower, upper) / 2)
    for _ in range(finer):
        mesh = mesh.subdivide()
    return mesh


def ball(centre, radius):
    return trimesh.creation.icosphere(subdivisions=3, radius=radius).apply_translation(centre)


def inward(mesh):
    mesh = mesh.copy()
    mesh.invert()
    return mesh


BLOCKS = {
    "touching": [box((0, 0, 0), (20, 20, 20)), box((20, 0, 0), (40, 20, 20))],
    "touching, shifted": [box((0, 0, 0), (20, 20, 20)), box((20, 5, 3), (40, 25, 17))],
    "touching, other triangles": [
        box((0, 0, 0), (20, 20, 20), 2),
        box((20, 0, 0), (40, 20, 20), 1),
        box((0, 0, 20), (40, 20, 33)),
    ],
    "small on large": [box((0, 0, 0), (60, 60, 10)), box((20, 20, 10), (30, 30, 40))],
    "nested": [box((0, 0, 0), (60, 60, 60)), box((20, 20, 20), (30, 30, 40))],
    "nested, flush": [box((0, 0, 0), (60, 60, 60)), box((0, 0, 0), (30, 30, 40), 1)],
    "overlapping": [box((0, 0, 0), (30, 30, 30)), box((15, 10, 5), (50, 25, 50))],
    "three": [
        box((0, 0, 0), (30, 30, 30)),
        box((15, 10, 5), (50, 25, 50)),
        box((10, -10, 10), (25, 40, 20)),
    ],
    "three times": [box((0, 0, 0), (30, 20, 10))] * 3,
    "twice, other triangles": [box((0, 0, 0), (30, 20, 10)), box((0, 0, 0), (30, 20, 10), 2)],
    "a gap that rounding leaves": [box((0, 0, 0), (20, 20, 20)), box((20 + 4e-6, 0, 0), (40, 20, 20))],
    "grid": [
        box((i, j, k), (i + 10, j + 10, k + 10)) for i, j, k in itertools.product((0, 10, 20), (0, 10), (0, 10, 20))
    ],
}


def _depth_of_union(boxes, points):
    """How deep points (n, 3) lie in a union of upright boxes, mm, (n,); 0 outside.

    Their sides cut space into cells, each of which is in or out: the nearest of those that are out tells.
    """
    boxes = [np.round(mesh.bounds, 3) for mesh in boxes]
    sides = [np.unique([bounds[:, axis] for bounds in boxes]) for axis in range(3)]
    walls = [np.concatenate([[-1e3], along, [1e3]]) for along in sides]
    away = np.full(len(points), np.inf)
    for cell in itertools.product(*(range(len(along) - 1) for along in walls)):
        lower = np.array([along[k] for along, k in zip(walls, cell, strict=True)])
        upper = np.array([along[k + 1] for along, k in zip(walls, cell, strict=True)])
        middle = 0.5 * (lower + upper)
        if not any(np.all((middle > bounds[0]) & (middle < bounds[1])) for bounds in boxes):
            away = np.minimum(away, np.linalg.norm(np.clip(points, lower, upper) - points, axis=1))
    return away


@pytest.mark.parametrize("turned", [False, True], ids=["upright", "turned"])
@pytest.mark.parametrize("name", list(BLOCKS))
def test_unions_of_boxes_in_closed_form(name, turned, tmp_path, rng):
    """Turned, the file's rounded corners leave gaps and overlaps where faces touch: these are closed."""
    bodies = BLOCKS[name]
    turn = TURN if turned else np.eye(3)
    whole = trimesh.util.concatenate(bodies)
    local = rng.uniform(whole.bounds[0], whole.bounds[1], (1500, 3))
    on = whole.triangles[rng.integers(len(whole.faces), size=500)]
    hidden = np.einsum("nc,nci->ni", rng.dirichlet(np.ones(3), 500), on)
    local = np.vstack([local, hidden + rng.choice([0, 1e-6, 1e-3], (500, 1)) * rng.normal(size=(500, 3))])
    whole.vertices = whole.vertices @ turn.T
    part = load_mesh(whole, tmp_path)
    points = 1e-3 * local @ turn.T
    distance, gradient, nearest = part.signed_distance(points)
    depth = 1e-3 * _depth_of_union(bodies, local)
    rounding = part.gap
    np.testing.assert_allclose(np.maximum(-distance, 0), depth, atol=rounding)
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(points - distance[:, None] * gradient, nearest, atol=1e-12)
    assert np.all(part.lower_bound(points) <= distance + rounding)


CURVED = {
    "balls": [ball((0, 0, 0), 20), ball((15, 3, 2), 18), ball((5, 15, 0), 12)],
    "ball and box": [ball((0, 0, 0), 20), box((-5, -5, -5), (40, 5, 5))],
    "balls in a box": [box((-40, -40, -40), (40, 40, 40)), ball((0, 0, 0), 20), ball((30, 3, 2), 18)],
    "pegs": [
        trimesh.creation.cylinder(20, 40, sections=48),
        trimesh.creation.cylinder(10, 40, sections=32).apply_translation((0, 0, 40)),
        trimesh.creation.cylinder(8, 70, sections=31),
    ],
    "cavity, half filled": [
        box((0, 0, 0), (60, 60, 60)),
        inward(box((10, 10, 10), (50, 50, 50))),
        box((5, 5, 5), (55, 55, 30)),
    ],
    "crossing at all angles": [
        trimesh.creation.box(size).apply_transform(
            trimesh.transformations.random_rotation_matrix(np.random.default_rng(k).random(3))
        )
        for k, size in enumerate(np.random.default_rng(5).uniform(10, 40, (8, 3)))
    ],
}


def _union(bodies):
    """The boolean union of bodies, cavities cut out of the first, by manifold3d."""
    manifold = pytest.importorskip("manifold3d")

    def solid(mesh):
        return manifold.Manifold(manifold.Mesh64(mesh.vertices, mesh.faces.astype(np.uint64)))

    first, *rest = bodies
    total = solid(first)
    for mesh in rest:
        total = total + solid(mesh) if mesh.volume > 0 else total - solid(inward(mesh))
    found = total.to_mesh64()
    return np.asarray(found.vert_properties)[:, :3], np.asarray(found.tri_verts, dtype=np.int64)


@pytest.mark.parametrize("turned", [False, True], ids=["upright", "turned"])
@pytest.mark.parametrize("name", list(CURVED))
def test_unions_against_a_boolean_kernel(name, turned, tmp_path, rng):
    bodies, turn = CURVED[name], TURN if turned else np.eye(3)
    vertices, faces = _union(bodies)
    wanted = Mesh.of("union", "world", 1e-3 * vertices @ turn.T, faces, True)
    whole = trimesh.util.concatenate(bodies)
    whole.vertices = whole.vertices @ turn.T
    part = load_mesh(whole, tmp_path)
    assert part.outer is not part.shell
    points = rng.uniform(part.lower, part.upper, (1500, 3))
    np.testing.assert_allclose(part.signed_distance(points)[0], wanted.signed_distance(points)[0], atol=part.gap)


@pytest.mark.parametrize("name", ["touching, shifted", "three", "nested, flush", "grid"])
def test_bounds_hold_in_assemblies(name, tmp_path, rng):
    """What certificates rest on: distances change no faster than places do, no hull dips below its bound."""
    whole = trimesh.util.concatenate(BLOCKS[name])
    whole.vertices = whole.vertices @ TURN.T
    part = load_mesh(whole, tmp_path)
    middle = rng.uniform(part.lower, part.upper, (400, 3))
    size = rng.choice([1e-5, 1e-4, 1e-3, 5e-3], (400, 1, 1))
    corners = middle[:, None] + size * rng.normal(size=(400, 4, 3))
    middle = corners.mean(axis=1)
    at = part.signed_distance(middle)[0]
    bound = part.hull_bound(corners, middle, at)
    chord = part.chord_bound(corners[:, 0], middle, part.signed_distance(corners[:, 0])[0], at)
    for share in rng.dirichlet(np.ones(4), 60):
        inside = part.signed_distance(np.einsum("c,kci->ki", share, corners))[0]
        assert np.all(bound <= inside + part.gap)
        between = part.signed_distance(middle + share[0] * (corners[:, 0] - middle))[0]
        assert np.all(chord <= between + part.gap)
    step = 1e-4 * rng.normal(size=middle.shape)
    change = part.signed_distance(middle + step)[0] - at
    assert np.all(np.abs(change) <= np.linalg.norm(step, axis=1) + part.gap)


def test_a_gap_that_is_one_stays(tmp_path):
    apart = trimesh.util.concatenate([box((0, 0, 0), (20, 20, 20)), box((20.01, 0, 0), (40, 20, 20))])
    part = load_mesh(apart, tmp_path)
    distance = part.signed_distance([[0.018, 0.01, 0.01], [0.020005, 0.01, 0.01]])[0]
    np.testing.assert_allclose(distance, [-0.002, 5e-6], atol=1e-8)


@pytest.mark.parametrize("name", ["box", "annulus", "icosphere", "cavity", "degenerate", "twins"])
def test_single_bodies_keep_their_surface(name, tmp_path):
    part = load_mesh(MESHES[name], tmp_path)
    assert part.outer is part.shell


def test_depth_of_a_cable_in_two_blocks_that_touch(tmp_path):
    """As deep as in one block, and certified: 10 mm below the nearest outer face, and the radius."""
    scene = """
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
from = -0.059
to = -0.061
[parts.p]
body = "car"
mesh = "p.stl"
mesh_unit = "mm"
[limits]
clearance = 0.004
"""
    (tmp_path / "p.toml").write_text(scene)
    halves = [box((140, -10, 40), (160, 10, 60)), box((140, -10, 60), (160, 10, 80))]
    trimesh.util.concatenate(halves).export(tmp_path / "p.stl")
    result = ho.clearances(ho.simulate(ho.read_problem(tmp_path / "p.toml")))
    row = next(row for row in result.limits if row.id.words.endswith("to p"))
    assert row.certified
    assert row.worst == pytest.approx(-0.012, abs=1e-8)

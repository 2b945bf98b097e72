"""Are the distances of cables to meshes right, and what do they cost? Brute force over random pairs, and times.

    python scripts/benchmarks/clearance_oracle.py            # 10,000 pairs and the table of times, some minutes
    python scripts/benchmarks/clearance_oracle.py 300        # fewer pairs

Each pair is a mesh and a stretch of a cable set to be hard for it: inside, outside, touching, along a face, in the
plane of a triangle, through a corner. Every point is compared with all triangles, exactly, and its side with the sum of
all solid angles; the smallest clearance of the stretch with samples at a tenth of the step; gradients with differences.
The times are per frame of the lift arm, against one mesh of 20,000 triangles and against 50 parts of 200,000, with the
certificate of the whole motion and without.
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import trimesh

import harness_opt as ho
from harness_opt.clearance.measure import measure
from harness_opt.model.cable import CableRun
from harness_opt.model.results import CableMotion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.mesh import Mesh
from harness_opt.parts.scene import load_scene

PAIRS = 10_000
STATIONS = 9  # of the stretch of cable of each pair
FINER = 10  # samples of the brute force between two stations
DIAMETER = 0.004  # m
KINDS = ("inside", "outside", "touching", "along a face", "in a plane", "through a corner")
NEAR = 1e-9  # of the scene: nearer to the surface a side has no meaning


def meshes() -> dict[str, trimesh.Trimesh]:
    """Return closed meshes by name, in m: convex, with a hole, hollow, inside out, with slivers."""
    box = trimesh.creation.box((0.06, 0.04, 0.02))
    inverted = box.subdivide()
    inverted.invert()
    shell = trimesh.util.concatenate([trimesh.creation.box((0.06,) * 3), trimesh.creation.box((0.04,) * 3)])
    shell.faces[12:] = shell.faces[12:, ::-1]
    cut = trimesh.creation.box((0.05, 0.03, 0.02)).subdivide()
    stretched = trimesh.creation.cylinder(0.02, 0.08, sections=64)
    stretched.apply_scale([1.0, 1.0, 0.01])  # needles of triangles
    return {
        "box": box,
        "ball": trimesh.creation.icosphere(2, 0.03),
        "ring": trimesh.creation.annulus(0.015, 0.04, 0.025, sections=32),
        "torus": trimesh.creation.torus(0.03, 0.01, 24, 12),
        "inverted": inverted,
        "hollow": shell,
        "plate": cut,
        "needles": stretched,
    }


def stretch(mesh: trimesh.Trimesh, kind: str, rng: np.random.Generator) -> Array:
    """Return the start, direction (2, 3) and length of a straight stretch of cable that is hard in this way."""
    lower, upper = mesh.bounds
    size = float(np.linalg.norm(upper - lower))
    length = size * rng.uniform(0.02, 0.3)
    towards = rotations.normalise(rng.normal(size=3))
    a, b, c = mesh.triangles[rng.integers(len(mesh.faces))]
    weights = rng.dirichlet(np.ones(3))
    on = weights @ np.array([a, b, c])
    normal = rotations.normalise(np.cross(b - a, c - a))
    if kind == "inside":
        middle = on + 0.02 * size * rng.uniform() * (mesh.center_mass - on)
    elif kind == "outside":
        middle = rng.uniform(lower - 0.4 * size, upper + 0.4 * size)
    elif kind == "touching":
        middle = on
    elif kind == "along a face":
        towards = rotations.normalise(b - a + rng.uniform() * (c - b))
        middle = on + rng.choice([0.0, 0.5 * DIAMETER, -0.5 * DIAMETER]) * normal
    elif kind == "in a plane":
        towards = rotations.normalise((b - a) * rng.normal() + (c - a) * rng.normal())
        middle = a + rng.uniform(-2, 2) * (b - a) + rng.uniform(-2, 2) * (c - a)
    else:
        middle = a
    return np.array([middle - 0.5 * length * towards, length * towards])


def brute(triangles: Array, points: Array) -> tuple[Array, Array]:
    """Return signed distances (n,) of points (n, 3) from every triangle, and whether the side is sure (n,).

    The side is that of the sum of all solid angles (Van Oosterom and Strackee); written anew, apart from harness-opt.
    """
    a, b, c = triangles.swapaxes(0, 1)
    solid = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-9 * np.linalg.norm(b - a, axis=1) ** 2
    a, b, c = a[solid], b[solid], c[solid]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    distance, turns = [], []
    for p in points:
        height = np.sum((p - a) * normal, axis=1)
        foot = p - height[:, None] * normal
        over = np.min([np.sum(np.cross(e - s, foot - s) * normal, axis=1) for s, e in ((a, b), (b, c), (c, a))], axis=0)
        least = np.min(np.abs(height)[over >= 0], initial=np.inf)
        for s, e in ((a, b), (b, c), (c, a)):
            share = np.clip(np.sum((p - s) * (e - s), axis=1) / np.sum((e - s) ** 2, axis=1), 0.0, 1.0)
            least = min(least, np.linalg.norm(s + share[:, None] * (e - s) - p, axis=1).min())
        u, v, w = (corner - p for corner in (a, b, c))
        x, y, z = (np.linalg.norm(vector, axis=1) for vector in (u, v, w))
        below = x * y * z + np.sum(u * v, axis=1) * z + np.sum(v * w, axis=1) * x + np.sum(w * u, axis=1) * y
        turns.append(np.arctan2(np.sum(u * np.cross(v, w), axis=1), below).sum() / (2 * np.pi))
        distance.append(least)
    inside = np.abs(turns) > 0.5
    return np.where(inside, -1.0, 1.0) * distance, np.abs(turns - np.round(turns)) < 0.25


def cable(start: Array, way: Array) -> CableMotion:
    """Return one straight cable in one frame."""
    length = float(np.linalg.norm(way))
    s = np.linspace(0.0, length, STATIONS)
    q = np.tile(rotations.shortest_arc([0.0, 0.0, 1.0], way / length), (1, STATIONS, 1))
    blank, one = np.zeros((1, STATIONS, 3)), np.zeros(1)
    position = (start + np.linspace(0, 1, STATIONS)[:, None] * way)[None]
    return CableMotion(s, position, q, blank, blank, blank, one == 0, one, one, one)


def compare(count: int, rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Return, by kind of pair, how often and how far the answers are off."""
    worst = {
        k: dict.fromkeys(("pairs", "wrong sides", "not finite", "distance", "bound", "worst", "gradient"), 0.0)
        for k in KINDS
    }
    folder = Path(tempfile.mkdtemp())
    scenes = {}
    for name, mesh in meshes().items():
        mesh.export(folder / f"{name}.ply")
        # its clamps are on another body, so that no stretch of it is left out
        ends = (ho.End(position=(0, 0, z), body="rig") for z in (0.0, 0.5))
        run = CableRun(ho.Cable(1.0, DIAMETER, 1e-3, 1e-3), *ends)
        part = ho.Part(ho.MeshFile(folder / f"{name}.ply", "m"), clearance=0.002)
        problem = ho.Problem({"lead": run}, {"rig": ho.Body()}, {name: part})
        # as the file has it, in single precision
        scenes[name] = problem, load_scene(problem), trimesh.load_mesh(folder / f"{name}.ply", process=False)
    for number in range(count):
        problem, scene, mesh = scenes[list(scenes)[number % len(scenes)]]
        kind = KINDS[number // len(scenes) % len(KINDS)]
        row = worst[kind]
        geometry = next(iter(scene.parts.values()))
        size = float(np.linalg.norm(geometry.upper - geometry.lower))
        start, way = stretch(mesh, kind, rng)
        # samples of the brute force, every FINER-th of them a station
        fine = start + np.linspace(0, 1, FINER * (STATIONS - 1) + 1)[:, None] * way
        exact, sure = brute(mesh.triangles, fine)
        distance, gradient, nearest = geometry.signed_distance(fine)
        row["pairs"] += 1
        row["not finite"] += not all(np.all(np.isfinite(x)) for x in (distance, gradient, nearest))
        row["distance"] = max(row["distance"], float(np.abs(np.abs(distance) - np.abs(exact)).max() / size))
        off = sure & (np.abs(exact) > NEAR * size)
        row["wrong sides"] += int(np.sum(np.sign(distance)[off] != np.sign(exact)[off]))
        pair = measure(problem, scene, [0.0], {"lead": cable(start, way)}).pairs[0]
        beyond = pair.lower_bound - (exact.min() - DIAMETER / 2)
        row["bound"] = max(row["bound"], float(beyond / size))
        short = pair.worst - pair.tolerance - (exact.min() - DIAMETER / 2)
        row["worst"] = max(row["worst"], float(short / size))
        row["gradient"] = max(
            row["gradient"], gradient_error(geometry, fine[:: 4 * FINER], gradient[:: 4 * FINER], size)
        )
    return worst


def gradient_error(geometry: Mesh, points: Array, gradient: Array, size: float) -> float:
    """Return the largest difference to central differences, where these say that there is one gradient."""
    h = 1e-6 * size
    steps = h * np.eye(3)
    ahead = np.array([geometry.signed_distance(points + step)[0] for step in steps]).T
    behind = np.array([geometry.signed_distance(points - step)[0] for step in steps]).T
    difference = (ahead - behind) / (2 * h)
    single = np.abs(np.linalg.norm(difference, axis=1) - 1.0) < 1e-6
    return float(np.abs(gradient - difference)[single].max(initial=0.0))


def times() -> None:
    """Print the table of times per frame."""
    folder = Path(tempfile.mkdtemp())
    for name, sections, size in (("big", 100, 60.0), ("small", 44, 30.0)):
        trimesh.creation.torus(size, size / 3, sections, sections).export(folder / f"{name}.stl")
    lift = ho.read_problem(Path(__file__).resolve().parents[2] / "problems" / "lift_arm" / "lift_arm.toml")
    motion = ho.simulate(lift)
    near = ho.Part(ho.MeshFile(folder / "big.stl", "mm"), position=(0.1, 0.09, 0.1), clearance=0.004)
    rng = np.random.default_rng(0)
    around = {}
    for number in range(49):
        at = rng.uniform(-1.0, 1.0, 3) * [1.5, 1.5, 0.5] + [0.0, 0.0, 0.1]
        at = at if np.linalg.norm(at) > 0.4 else 4 * at
        around[f"part {number}"] = ho.Part(ho.MeshFile(folder / "small.stl", "mm"), position=tuple(at), clearance=0.004)
    print("\n| scene | triangles | frames alone, ms a frame | certificate included | frames solved for it |")
    print("|---|---|---|---|---|")
    for words, parts in (("one part", {"near": near}), ("50 parts", {"near": near, **around})):
        problem = dataclasses.replace(lift, parts=parts)
        scene, given = load_scene(problem), dataclasses.replace(motion, problem=problem)
        alone, whole = [], []
        for _ in range(5):
            begin = time.perf_counter()
            measure(problem, scene, motion.motion, motion.cables)
            between = time.perf_counter()
            found = ho.clearances(given, scene)
            alone.append(between - begin)
            whole.append(time.perf_counter() - between)
        faces = sum(len(part.faces) for part in scene.parts.values())
        each = [1e3 * np.median(seconds) / len(motion.motion) for seconds in (alone, whole)]
        print(f"| {words} | {faces:,} | {each[0]:.1f} | {each[1]:.1f} | {sum(found.inserted.values())} |")


def main() -> None:
    """Compare, and print both tables."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else PAIRS
    worst = compare(count, np.random.default_rng(1))
    print("| pair | pairs | wrong sides | not finite | distance off | bound too high | worst too high | gradient off |")
    print("|---|---|---|---|---|---|---|---|")
    for kind, row in worst.items():
        counted = " | ".join(f"{row[name]:.0f}" for name in ("pairs", "wrong sides", "not finite"))
        print(
            f"| {kind} | {counted} | "
            + " | ".join(f"{row[x]:.0e}" for x in ("distance", "bound", "worst", "gradient"))
            + " |"
        )
    times()


if __name__ == "__main__":
    main()

"""Random scenes in which a verdict can go wrong: what they are made of, each the same for its seed.

A cable, or two spans that share a clip, is simulated on many frames first; the parts are then set close to places that
it comes through, so that limits nearly hold or nearly don't, and the other limits close to what the frames show. What
of it a verdict is made from are the frames of a coarse step.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import trimesh

import harness_opt as ho
from harness_opt.motion.path import place_frames
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

KINDS = ("light", "heavy", "plates", "fast bodies", "clamps", "clips")
FINER = 20  # frames of the brute force for each step of a scene
MOST_FRAMES = 60  # of a scene, so that the brute force takes seconds
G = 9.81  # m/s2


@dataclasses.dataclass(frozen=True, eq=False)
class Drawn:
    """A scene, and its motion on many frames.

    Args:
        problem: with parts and limits.
        frames: motion values of the coarse step.
        fine: the same motion, FINER frames for each of these; every frame is one of its own.
        boxes: of parts that are meshes, centres and full sizes (k, 3), m, of the boxes that they are made of.
    """

    problem: ho.Problem
    frames: Array
    fine: ho.Motion
    boxes: dict[str, tuple[Array, Array]]


def direction(rng: np.random.Generator) -> Array:
    """Return a random unit vector (3,)."""
    return rotations.normalise(rng.normal(size=3))


def turn_to(axis: int, along: Array, rng: np.random.Generator) -> Array:
    """Return a quaternion (4,) that turns a coordinate axis to ``along`` (3,), turned about that at random."""
    spin = rotations.from_rotation_vector(along * rng.uniform(0, 2 * math.pi))
    return rotations.multiply(spin, rotations.shortest_arc(np.eye(3)[axis], along))


def end(rng: np.random.Generator, position: Array, tangent: Array, body: str = "world") -> ho.End:
    """Return an end whose roll is found, or given."""
    given = {} if rng.random() < 0.6 else {"roll_deg": float(rng.uniform(-180, 180))}
    return ho.End(position=tuple(position), tangent=tuple(tangent), body=body, **given)


def moved_by(rng: np.random.Generator, at: Array, travel: float) -> ho.Body:
    """Return a body of which the point ``at`` (3,) moves by about ``travel``, m."""
    if rng.random() < 0.4:
        first = rng.uniform(-1, 0) * travel
        return ho.Body(ho.Slide(tuple(direction(rng)), first, first + travel))
    arm = rng.uniform(0.3, 1.5) * travel
    angle = min(travel / arm, 2.5)
    first = rng.uniform(-1, 0) * angle
    return ho.Body(ho.Hinge(tuple(at + arm * direction(rng)), tuple(direction(rng)), first, first + angle))


def cables(rng: np.random.Generator, kind: str) -> tuple[dict[str, ho.CableRun], dict[str, ho.Body]]:
    """Return the cables of a scene, one or two spans, and the bodies that hold them."""
    length = 10 ** rng.uniform(-0.8, 0.2)
    stiffness = 10 ** rng.uniform(-4, -1)
    weight = 10 ** rng.uniform(3, 5) if kind == "heavy" else rng.choice([0.0, 10 ** rng.uniform(-1, 2)])
    cable = ho.Cable(
        length, length * rng.uniform(0.006, 0.02), stiffness, stiffness * rng.uniform(0.4, 1.3),
        weight * stiffness / (G * length**3),
    )  # fmt: skip
    start, far = rng.normal(size=3) * length, direction(rng)
    out = rotations.normalise(far + 0.9 * direction(rng))
    into = rotations.normalise(far + 0.9 * direction(rng))
    last = start + far * length * rng.uniform(0.35, 0.8)
    bodies = {"arm": moved_by(rng, last, length * rng.uniform(0.1, 0.4))}
    runs = {"a": ho.CableRun(cable, end(rng, start, out), end(rng, last, into, "arm"))}
    if kind == "clips":
        other = dataclasses.replace(cable, length=length * rng.uniform(0.7, 1.3))
        on = rotations.normalise(into + 0.8 * direction(rng))
        beyond = last + on * other.length * rng.uniform(0.35, 0.8)
        leaves = rotations.normalise(into + rng.choice([0.0, 0.3]) * direction(rng))
        runs["b"] = ho.CableRun(
            other, end(rng, last, leaves, "arm"), end(rng, beyond, rotations.normalise(on + 0.9 * direction(rng)))
        )
    if kind == "fast bodies":
        bodies["rotor"] = moved_by(rng, start + 0.5 * (last - start), length * rng.uniform(1.0, 3.0))
    return runs, bodies


def in_reach(problem: ho.Problem) -> bool:
    """Whether no cable is nearly taut anywhere on its way: there the shapes are straight lines, and no test."""
    for name, run in problem.cables.items():
        ends = problem.ends(name, np.linspace(0, 1, 41))
        most = max(float(np.linalg.norm(np.subtract(b.position, a.position))) for a, b in ends)
        if most > 0.93 * run.cable.length:
            return False
    return True


def solid(rng: np.random.Generator, kind: str, scale: float) -> tuple[object, Array, float, list]:
    """Return a part's shape, its direction to the cable (3,), its half thickness that way, and its boxes if a mesh."""
    thin = kind == "plates" or rng.random() < 0.3
    which = rng.choice(["box", "mesh"]) if thin else rng.choice(["box", "mesh", "sphere", "cylinder", "capsule"])
    size = scale * 10 ** rng.uniform(-0.5, 1.0, 3)
    if thin:
        size[0] = scale * 10 ** rng.uniform(-1.3, -0.3)
    towards = np.array([1.0, 0.0, 0.0])
    if which == "box":
        return ho.Box(tuple(size)), towards, size[0] / 2, []
    if which == "mesh":
        return None, towards, size[0] / 2, [(np.zeros(3), size)]
    if which == "sphere":
        return ho.Sphere(size[0] / 2), towards, size[0] / 2, []
    solid_kind = ho.Cylinder if which == "cylinder" else ho.Capsule
    return solid_kind(size[0] / 2, size[1]), towards, size[0] / 2, []


def near_the_way(rng: np.random.Generator, problem: ho.Problem, fine: ho.Motion, kind: str, limit: float) -> tuple:
    """Return a part close to where a cable comes through at some moment, and the boxes of its mesh."""
    name = str(rng.choice(list(fine.cables)))
    shapes, radius = fine.cables[name], problem.cables[name].cable.radius
    frame = int(rng.integers(len(fine.motion)))
    station = int(rng.integers(len(shapes.s) // 8, 7 * len(shapes.s) // 8))
    point, tangent = shapes.position[frame, station], rotations.tangent(shapes.quaternion[frame, station])
    shape, _, half, boxes = solid(rng, kind, 2 * radius)
    across = rotations.normalise(np.cross(tangent, direction(rng)))
    spare = rng.choice([rng.normal() * 0.1, rng.normal() * 0.5, rng.uniform(-1, 4)]) * 2 * radius
    if kind == "plates" and rng.random() < 0.3:  # where the cable passes through between two frames
        after = shapes.position[min(frame + 1, len(fine.motion) - 1), station]
        across, spare = rotations.normalise(after - point + 1e-9 * across), -radius - limit - half
    place = point - across * (radius + limit + spare + half)
    body = str(rng.choice(["world", *problem.bodies])) if kind != "fast bodies" else "rotor"
    position, turn = (x[0] for x in problem.poses(body, [fine.motion[frame]]))
    back = rotations.conjugate(turn)
    pose = rotations.multiply(back, turn_to(0, across, rng))
    return ho.Part(shape, body, tuple(rotations.rotate(back, place - position)), tuple(pose)), boxes


def second_wall(rng: np.random.Generator, problem: ho.Problem, fine: ho.Motion) -> tuple:
    """Return the run with a holder named by hand and a long let-off, and that holder: a thin wall within it."""
    run, shapes = problem.cables["a"], fine.cables["a"]
    side = str(rng.choice(["start", "end"]))
    given, radius = getattr(run, side), run.cable.radius
    let_off = float(min(rng.uniform(8, 30) * radius, 0.4 * run.cable.length))
    run = dataclasses.replace(run, **{side: dataclasses.replace(given, holders=("part0",), let_off=let_off)})
    frame, arc = int(rng.integers(len(fine.motion))), let_off * rng.uniform(0.3, 0.9)
    station = int(np.argmin(np.abs(shapes.s - (arc if side == "start" else shapes.s[-1] - arc))))
    point, tangent = shapes.position[frame, station], rotations.tangent(shapes.quaternion[frame, station])
    after = shapes.position[frame - 10, station]
    across = rotations.normalise(
        np.cross(tangent, rng.choice([0, 1]) * direction(rng) + np.cross(after - point, tangent))
    )
    half = radius * rng.uniform(0.1, 1.0)
    spare = rng.choice([rng.normal() * 0.2, rng.uniform(-1, 1)]) * radius
    place = point - across * (radius + spare + half)
    position, turn = (x[0] for x in problem.poses(given.body, [fine.motion[frame]]))
    back = rotations.conjugate(turn)
    size = (2 * half, radius * rng.uniform(0.5, 10), radius * rng.uniform(0.5, 10))
    pose = rotations.multiply(back, turn_to(0, across, rng))
    part = ho.Part(ho.Box(size), given.body, tuple(rotations.rotate(back, place - position)), tuple(pose))
    return run, (part, [])


def at_the_clamp(rng: np.random.Generator, problem: ho.Problem) -> tuple:
    """Return a part that holds a clamp, stands just beside it, or holds it and has a second wall on the cable's way."""
    run = problem.cables["a"]
    given = run.start if rng.random() < 0.5 else run.end
    sign = 1.0 if given is run.start else -1.0  # into the cable
    into, radius, at = sign * np.asarray(given.tangent), run.cable.radius, np.asarray(given.position)
    size = 2 * radius * 10 ** rng.uniform(0.2, 1.0, 3)
    boxes = [(np.array([-size[0] / 2, 0.0, 0.0]), size)]  # its face stands at the origin, the cable comes out along x
    form = rng.choice(["holds", "beside", "second wall"])
    offset = np.zeros(3)
    if form == "holds":
        offset[0] = rng.uniform(-0.5, 2.0) * radius
    elif form == "beside":
        offset[1] = size[1] / 2 + rng.uniform(0.3, 2.0) * radius
    else:
        gap, thick = rng.uniform(1.0, 4.0) * radius, rng.uniform(0.3, 2.0) * radius
        high = rng.uniform(-1.5, 2.5) * radius  # of the wall's edge over the cable's axis
        wall = np.array([thick, 20 * radius, 20 * radius])
        boxes += [(np.array([gap + thick / 2, 0.0, high - wall[2] / 2]), wall)]
    turn = turn_to(0, into, rng)
    place = at + rotations.rotate(turn, offset)
    shape = None if form == "second wall" else ho.Box(tuple(size))
    if shape is not None:
        place, boxes = place + rotations.rotate(turn, boxes[0][0]), []
    return ho.Part(shape, given.body, tuple(place), tuple(turn)), boxes


def meshed(part: ho.Part, boxes: list, file: Path) -> ho.Part:
    """Return ``part`` as a mesh of boxes, written to ``file``."""
    solids = []
    for centre, size in boxes:
        box = trimesh.creation.box(size)
        box.apply_translation(centre)
        solids.append(box)
    trimesh.util.concatenate(solids).export(file)
    return dataclasses.replace(part, shape=ho.MeshFile(file, "m"))


def limits(rng: np.random.Generator, fine: ho.Motion, clearance: float) -> ho.Limits:
    """Return limits of which those beside the clearance stand within a few per cent of what the frames show."""
    shapes = list(fine.cables.values())

    def most(values: list[Array], least: float = 1e-9) -> float:
        return max(least, *(float(np.linalg.norm(value, axis=-1).max()) for value in values))

    def about(value: float) -> float:
        return float(value * (1 + rng.choice([0.003, 0.03, 0.2]) * rng.normal()))

    return ho.Limits(
        clearance=clearance,
        bend_radius=about(1 / most([x.curvature[..., :2] for x in shapes])),
        twist=about(most([x.curvature[..., 2:] for x in shapes], 1e-2)),
        clamp_force=about(most([x.force[:, [0, -1]] for x in shapes], 1e-3)),
        clamp_moment=about(most([x.moment[:, [0, -1]] for x in shapes], 1e-5)),
    )


def draw(seed: int, number: int, folder: Path, step: float | None = None, finer: int = FINER) -> Drawn | None:
    """Return scene ``number`` of ``seed``, its kind by turns; None where a cable of it has no shape somewhere.

    Args:
        seed, number: 0 or more.
        folder: for its meshes.
        step: most that a clamp moves between two frames, m; None takes a random one, and few frames.
        finer: fine frames for each coarse step.
    """
    rng, kind = np.random.default_rng([seed, number]), KINDS[number % len(KINDS)]
    for _ in range(100):
        runs, bodies = cables(rng, kind)
        problem = ho.Problem(runs, bodies, gravity=(0, 0, -G))
        if in_reach(problem):
            break
    longest = max(run.cable.length for run in runs.values())
    steps = 10 ** rng.uniform(-2, np.log10(0.25)) * longest
    try:
        frames = place_frames(problem, step or float(steps))
    except ho.ProblemError:  # longer than the whole trail
        frames = np.linspace(0, 1, 2)
    if len(frames) > MOST_FRAMES and step is None:
        frames = np.linspace(0, 1, MOST_FRAMES)
    fine_frames = np.interp(np.arange((len(frames) - 1) * finer + 1) / finer, np.arange(len(frames)), frames)
    clearance = float(rng.uniform(0.05, 1.0) * next(iter(runs.values())).cable.diameter)
    # with a limit, a cable that loses turns is no failure but a violation
    problem = dataclasses.replace(problem, limits=ho.Limits(clearance=clearance))
    try:
        fine = ho.simulate(problem, frames=fine_frames)
    except ho.SolveError:
        return None
    parts, boxes, made, runs = {}, {}, [], problem.cables
    if kind == "clamps" and rng.random() < 0.5:
        run, wall = second_wall(rng, problem, fine)
        runs = {**runs, "a": run}
        made.append(wall)
    made += [near_the_way(rng, problem, fine, kind, clearance) for _ in range(int(rng.integers(1, 4)))]
    if kind == "clamps":
        made.append(at_the_clamp(rng, problem))
    for k, (part, of) in enumerate(made):
        name = f"part{k}"
        parts[name] = meshed(part, of, folder / f"{seed}_{number}_{name}.stl") if of else part
        if of:
            boxes[name] = tuple(map(np.array, zip(*of, strict=True)))
    problem = dataclasses.replace(problem, cables=runs, parts=parts, limits=limits(rng, fine, clearance))
    return Drawn(problem, frames, dataclasses.replace(fine, problem=problem), boxes)

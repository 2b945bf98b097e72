"""Does the redesign find a design where one is known to exist, and say so where none can?

- feasible: a random motion with a cable that bends well, random parts placed around what it sweeps with room to spare,
  limits that this known design holds, and then another design within the bounds that violates some.
- slotted: a panel of 1 to 20 mm with a slot or a window that the known design passes with 6 to 20 mm to spare, the
  drawn one beside it.
- thin or short: a cable drawn so long that it hangs through a thin plate and comes back, or too short for its clamps.
- infeasible: scenes that no design can save, each with the reason why not: the clamps turn the cable more than its
  length can bend, a ball stands on the clamp's way, a wall parts the clamps, the cable weighs more than the clamps may
  hold, two cables' clamps stand too near to each other.

Each design that is called one is simulated again, on three times the frames.

    python scripts/benchmarks/redesign_family.py [--first 0] [--feasible 50] [--slotted 50] [--thin 50]
        [--infeasible 30]
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import time
from collections.abc import Iterator, Mapping

import numpy as np

import harness_opt as ho
from harness_opt.clearance.limits import all_limits, cable_limits
from harness_opt.clearance.measure import measure
from harness_opt.model import design_variables
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene

FRAMES = 40.0  # frames that a clamp's way is divided into, about
ROOM = 0.5e-3  # m, by which the known design holds each clearance at least
SLACK = 0.88  # of the known design's least bend radius, as the limit; loads and twist the other way round
PLACES = 40  # tried for a part, and designs for a start
GRAVITY = (0.0, 0.0, -9.81)


@dataclasses.dataclass(frozen=True)
class Scene:
    """A problem with what is known of it.

    Args:
        name: of the kind of scene and its seed.
        problem: as given.
        known: the values of a design that holds all limits; None where there is none.
        culprit: what any design violates, as a limit's name; None where one holds.
    """

    name: str
    problem: ho.Problem
    known: np.ndarray | None = None
    culprit: str | None = None


def direction(random: np.random.Generator) -> np.ndarray:
    """Return a random unit vector."""
    return rotations.normalise(random.normal(size=3))


# --- scenes with a known design --------------------------------------------------------------------------


def feasible(seed: int) -> Scene:
    """Return the scene of ``seed``, which a design is known to hold."""
    random = np.random.default_rng([7, seed])
    while True:
        try:
            bare = _bare(random)
        except ho.ProblemError:  # too short for its clamps
            continue
        shapes = _well_bent(bare)
        if shapes is None:
            continue
        parts = _parts(random, bare, shapes)
        known = dataclasses.replace(bare, parts=parts, limits=_limits(random, bare, shapes))
        if len(parts) < 2 or not holds(known):
            continue
        start = _start(random, known)
        if start is not None:
            return start if start.name == "" else dataclasses.replace(start, name=f"feasible {seed}")


def _bare(random: np.random.Generator) -> ho.Problem:
    """Return a random cable between the world and a body on a random motion, without parts."""
    length = random.uniform(0.25, 0.5)
    bending = 10.0 ** random.uniform(-3.0, -2.3)
    cable = ho.Cable(
        length, random.uniform(3e-3, 8e-3), bending, random.uniform(0.6, 1.0) * bending, random.uniform(0.03, 0.1)
    )
    axis = direction(random)
    if random.random() < 0.6:
        point = random.uniform(-0.1, 0.1, 3)
        motion = ho.Hinge(tuple(point), tuple(axis), 0.0, math.radians(random.uniform(20, 90)))
    else:
        motion = ho.Slide(tuple(axis), 0.0, random.uniform(0.03, 0.12))
    end = random.uniform(0.45, 0.75) * length * direction(random)
    along = rotations.normalise(end + 0.8 * length * direction(random))
    arriving = rotations.normalise(end + 0.8 * length * direction(random))
    run = ho.CableRun(
        cable,
        ho.End((0.0, 0.0, 0.0), tuple(rotations.from_tangent(tuple(along), 0.0))),
        ho.End(tuple(end), tuple(rotations.from_tangent(tuple(arriving), 0.0)), body="arm"),
    )
    way = np.linalg.norm(np.diff(_clamp_way(run, motion), axis=0), axis=1).sum()
    return ho.Problem({"lead": run}, {"arm": ho.Body(motion)}, gravity=GRAVITY, spatial_step=float(way) / FRAMES)


def _clamp_way(run: ho.CableRun, motion: object) -> np.ndarray:
    position, quaternion = ho.Body(motion).poses(np.linspace(0, 1, 21))
    return position + rotations.rotate(quaternion, np.broadcast_to(run.end.position, position.shape))


def _well_bent(problem: ho.Problem) -> ho.Motion | None:
    """Return the motion if it can be followed without snaps, gently bent; None else."""
    run = problem.cables["lead"]
    reach = np.linalg.norm(_clamp_way(run, problem.bodies["arm"].motion), axis=1)
    if np.max(reach) > 0.85 * run.cable.length:
        return None
    motion = ho.simulate(problem, throw=False)
    if not motion.ok or motion.snaps:
        return None
    curvature = np.linalg.norm(motion.cables["lead"].curvature[..., :2], axis=-1)
    return motion if np.max(curvature) * 4.0 * run.cable.diameter < 1.0 else None


def _parts(random: np.random.Generator, problem: ho.Problem, motion: ho.Motion) -> dict[str, ho.Part]:
    """Return random parts around what the cable sweeps, each clear of it."""
    cable, shapes = problem.cables["lead"].cable, motion.cables["lead"]
    limits = ho.Limits(clearance=0.003)
    parts: dict[str, ho.Part] = {}
    wanted = int(random.integers(2, 5))
    for _ in range(PLACES):
        frame = random.integers(len(motion.motion))
        station = random.integers(15, 86)
        tangent = rotations.tangent(shapes.quaternion[frame, station])
        away = rotations.normalise(np.cross(tangent, direction(random)))
        size = random.uniform(0.008, 0.03)
        kind = random.integers(3)
        shape = [ho.Sphere(size), ho.Box((2 * size, 2 * size, 2 * size)), ho.Capsule(0.6 * size, 2 * size)][kind]
        gap = cable.radius + 0.003 + size * random.uniform(1.0, 1.6) + random.uniform(ROOM, 0.004)
        part = ho.Part(shape, position=tuple(shapes.position[frame, station] + gap * away), quaternion=_turned(random))
        tried = dataclasses.replace(problem, parts={**parts, f"part{len(parts)}": part}, limits=limits)
        found = measure(tried, load_scene(tried), motion.motion, motion.cables)
        # the parts of the world do not count near the clamp that the world holds
        if all(row.margin > ROOM for row in found.limits):
            parts = dict(tried.parts)
        if len(parts) == wanted:
            break
    return parts


def _turned(random: np.random.Generator) -> tuple[float, ...]:
    return tuple(rotations.normalise(random.normal(size=4)).tolist())


def _limits(random: np.random.Generator, problem: ho.Problem, motion: ho.Motion) -> ho.Limits:
    """Return limits that the known design holds with some slack; some are left out."""
    tight = ho.Limits(0.003, 1e-6, 1e-6, 1e-6, 1e-6)
    rows = cable_limits(problem.changed(limits=tight), motion)
    worst = {row.name: row.worst for row in rows}
    given = {name: worst[name] / SLACK for name in ("twist", "clamp_force", "clamp_moment") if random.random() < 0.3}
    return ho.Limits(clearance=0.003, bend_radius=SLACK * worst["bend_radius"], **given)


def holds(problem: ho.Problem) -> bool:
    """Return whether a simulation of ``problem`` holds all limits."""
    motion = ho.simulate(problem, throw=False)
    return (
        motion.ok
        and not motion.snaps
        and all(row.margin > 0 for row in all_limits(problem, motion, ho.clearances(motion)))
    )


def _start(random: np.random.Generator, known: ho.Problem) -> Scene | None:
    """Return a problem whose design violates a limit, and whose bounds hold the known design; None in vain."""
    cable = known.cables["lead"].cable
    names = ["lead.length"]
    names.append(str(random.choice(["lead.start.position.x", "lead.end.position.y", "lead.end.position.z"])))
    names.append(str(random.choice(["lead.start.rotate_x_deg", "lead.end.rotate_y_deg"])))
    names = names[: int(random.integers(1, 4))]
    reach = {"length": 0.15 * cable.length, "position": 0.08 * cable.length, "rotate": 30.0}
    widths = np.array([reach[design_variables.target(name).quantity] for name in names])
    free = tuple(ho.Variable(name, -100.0, 100.0) for name in names)
    base = known.changed(design=ho.Design(variables=free))
    best = design_variables.values(base)
    for _ in range(PLACES):
        shift = random.uniform(0.3, 0.9, len(names)) * random.choice([-1.0, 1.0], len(names)) * widths
        try:
            moved = design_variables.apply(base, best + shift)
            motion = ho.simulate(moved, throw=False)
        except ho.ProblemError:  # too short for its clamps
            continue
        if not motion.ok or not any(
            row.margin < 0
            for row in all_limits(moved, motion, measure(moved, load_scene(moved), motion.motion, motion.cables))
        ):
            continue
        # turns count from the pose given, everything else is absolute
        good = np.where([name.endswith("_deg") for name in names], -shift, best)
        variables = tuple(
            ho.Variable(name, float(m - w), float(m + w)) for name, m, w in zip(names, good, widths, strict=True)
        )
        return Scene("feasible", moved.changed(design=ho.Design("change", variables)), good)
    return None


# --- panels with an opening ------------------------------------------------------------------------------


def slotted(seed: int) -> Scene:
    """Return a panel with a slot (even seeds) or a window that the cable was drawn beside."""
    random = np.random.default_rng([33, seed])
    while True:
        known = _level(random)
        motion = ho.simulate(known, throw=False)
        if not motion.ok or motion.snaps:
            continue
        panel = _panel(random, known, motion, window=seed % 2 == 1)
        limits = ho.Limits(clearance=random.uniform(0.001, 0.004))
        aside = random.choice([-1.0, 1.0]) * random.uniform(0.02, 0.045)
        scene = _beside(dataclasses.replace(known, parts=panel, limits=limits), aside, both=bool(random.integers(2)))
        if holds(dataclasses.replace(known, parts=panel, limits=limits)) and not holds(scene.problem):
            return dataclasses.replace(scene, name=f"{'window' if seed % 2 else 'slot'} {seed}")


def _level(random: np.random.Generator) -> ho.Problem:
    """Return a cable that hangs between two clamps along x, one of which is lifted."""
    length, bending = random.uniform(0.25, 0.4), 10.0 ** random.uniform(-3.0, -2.3)
    cable = ho.Cable(length, random.uniform(3e-3, 6e-3), bending, 0.75 * bending, random.uniform(0.03, 0.08))
    reach = random.uniform(0.7, 0.9) * length
    run = ho.CableRun(
        cable,
        ho.End((0.0, 0.0, 0.0), tangent=(1.0, 0.0, 0.0)),
        ho.End((reach, 0.0, 0.0), tangent=(1.0, 0.0, 0.0), body="m"),
    )
    slide = ho.Slide((0.0, 0.0, 1.0), 0.0, random.uniform(0.03, 0.12) * length)
    return ho.Problem({"c": run}, {"m": ho.Body(slide)}, gravity=GRAVITY, spatial_step=0.02 * length)


def _panel(random: np.random.Generator, problem: ho.Problem, motion: ho.Motion, *, window: bool) -> dict[str, ho.Part]:
    """Return the pieces of a panel across x whose opening leaves what the cable sweeps 6 to 20 mm on every side."""
    thick, room, wide = random.uniform(0.001, 0.02), random.uniform(0.006, 0.02), 0.4
    at = random.uniform(0.35, 0.65) * problem.cables["c"].end.position[0]
    swept = motion.cables["c"].position.reshape(-1, 3)
    near = swept[np.abs(swept[:, 0] - at) < 0.5 * thick + room]
    more = room + problem.cables["c"].cable.radius + 0.004
    low, high = near.min(axis=0) - more, near.max(axis=0) + more
    middle = 0.5 * (low + high)
    tall = high[2] - low[2] if window else 2.0 * wide
    pieces = {
        "left": ((wide, tall), (low[1] - 0.5 * wide, middle[2])),
        "right": ((wide, tall), (high[1] + 0.5 * wide, middle[2])),
    }
    if window:
        pieces["below"] = ((2.0 * wide, wide), (middle[1], low[2] - 0.5 * wide))
        pieces["above"] = ((2.0 * wide, wide), (middle[1], high[2] + 0.5 * wide))
    return {
        name: ho.Part(ho.Box((thick, *map(float, size))), position=(float(at), *map(float, place)))
        for name, (size, place) in pieces.items()
    }


def _beside(known: ho.Problem, aside: float, *, both: bool) -> Scene:
    """Return ``known`` drawn beside its opening; ``both`` clamps move each for themselves, or one with the other."""
    run, reach = known.cables["c"], 0.06
    start, end = (
        dataclasses.replace(side, position=(side.position[0], aside, side.position[2])) for side in (run.start, run.end)
    )
    cables = {"c": dataclasses.replace(run, start=start, end=end)}
    first = ho.Variable("c.start.position.y", -reach, reach)
    if both:
        design = ho.Design(variables=(first, ho.Variable("c.end.position.y", -reach, reach)))
    else:
        design = ho.Design(variables=(first,), couplings=(ho.Coupling("c.end.position.y", "c.start.position.y"),))
    return Scene("", dataclasses.replace(known, cables=cables, design=design), np.zeros(1 + both))


# --- too long for what is thin below, or too short -------------------------------------------------------


def thin_or_short(seed: int) -> Scene:
    """Return a cable drawn too long, so that it hangs through a plate, or (odd seeds) too short for its clamps."""
    random = np.random.default_rng([34, seed])
    while True:
        known = _level(random)
        scene = _short(random, known) if seed % 2 else _thin(random, known)
        if scene is not None:
            return dataclasses.replace(scene, name=f"{'short' if seed % 2 else 'thin'} {seed}")


def _thin(random: np.random.Generator, known: ho.Problem) -> Scene | None:
    """A plate, a ring or a tube below what the known design sweeps, and a cable so long that it goes through it."""
    motion = ho.simulate(known, throw=False)
    if not motion.ok or motion.snaps:
        return None
    run = known.cables["c"]
    cable, reach = run.cable, run.end.position[0]
    thick, limit = random.uniform(0.001, 0.02), random.uniform(0.0, 0.004)
    lowest = motion.cables["c"].position[..., 2].min() - cable.radius - limit - random.uniform(0.002, 0.01)
    size = (1.5 * reach, 0.3, thick)
    plate = ho.Part(ho.Box(size), position=(0.5 * reach, 0.0, float(lowest - 0.5 * thick)))
    good = dataclasses.replace(known, parts={"plate": plate}, limits=ho.Limits(clearance=limit))
    longer = random.uniform(1.1, 1.35) * cable.length
    drawn = dataclasses.replace(run, cable=dataclasses.replace(cable, length=longer))
    variables = (ho.Variable("c.length", 0.95 * cable.length, 1.5 * cable.length),)
    problem = dataclasses.replace(good, cables={"c": drawn}, design=ho.Design(variables=variables))
    if not holds(good) or holds(problem):
        return None
    return Scene("", problem, np.array([cable.length]))


def _short(random: np.random.Generator, known: ho.Problem) -> Scene | None:
    """A cable that its clamps pull straight before the motion is over; bend radius and twist hold for the known one."""
    run = known.cables["c"]
    rise = random.uniform(0.2, 0.5) * run.cable.length
    motion = ho.Slide(tuple(direction(random)), 0.0, rise)
    length = 1.25 * float(np.linalg.norm(_clamp_way(run, motion), axis=1).max())
    good = dataclasses.replace(run, cable=dataclasses.replace(run.cable, length=length))
    problem = dataclasses.replace(known, cables={"c": good}, bodies={"m": ho.Body(motion)})
    solved = ho.simulate(problem, throw=False)
    if not solved.ok or solved.snaps:
        return None
    tight = problem.changed(limits=ho.Limits(bend_radius=1e-6))
    worst = cable_limits(tight, solved)[0].worst
    held = dataclasses.replace(problem, limits=ho.Limits(bend_radius=0.8 * worst, clamp_force=100.0))
    if not holds(held):
        return None
    too_short = dataclasses.replace(good.cable, length=random.uniform(0.6, 0.95) * length / 1.25)
    variables = (ho.Variable("c.length", 0.5 * length, 1.4 * length),)
    drawn = {"c": dataclasses.replace(good, cable=too_short)}
    return Scene("", dataclasses.replace(held, cables=drawn, design=ho.Design(variables=variables)), np.array([length]))


# --- scenes without one ----------------------------------------------------------------------------------


def infeasible(seed: int) -> Scene:
    """Return the scene of ``seed``, which no design can hold."""
    kinds = (_too_sharp, _in_the_way, _walled, _too_heavy, _too_near)
    random = np.random.default_rng([20, seed])
    while True:
        try:
            bare = _bare(random)
        except ho.ProblemError:  # too short for its clamps
            continue
        run = bare.cables["lead"]
        length = run.cable.length
        free = (
            ho.Variable("lead.length", 0.95 * length, 1.1 * length),
            ho.Variable("lead.start.rotate_x_deg", -10.0, 10.0),
        )
        motion = _well_bent(bare)
        if motion is None:
            continue
        scene = kinds[seed % len(kinds)](random, bare.changed(design=ho.Design("change", free)), motion)
        if scene is not None:
            return dataclasses.replace(scene, name=f"infeasible {seed} ({scene.name})")


def _too_sharp(random: np.random.Generator, problem: ho.Problem, motion: ho.Motion) -> Scene | None:
    """A curve whose tangent turns by an angle has that angle over its length as mean curvature at least."""
    ends = problem.ends("lead", 0.0)[0]
    tangents = [rotations.tangent(np.asarray(end.frame)) for end in ends]
    turn = math.acos(float(np.clip(tangents[0] @ tangents[1], -1.0, 1.0))) - math.radians(10.0)
    if turn < 0.5:
        return None
    least = problem.design.variables[0].upper / turn  # the largest bend radius that could do
    limits = ho.Limits(bend_radius=random.uniform(1.02, 1.3) * least)
    return Scene("too sharp", dataclasses.replace(problem, limits=limits), culprit="bend_radius")


def _in_the_way(random: np.random.Generator, problem: ho.Problem, motion: ho.Motion) -> Scene:
    """The clamp that moves, which no variable moves, is in the ball at one moment."""
    place = motion.cables["lead"].position[random.integers(len(motion.motion)), -1]
    ball = ho.Part(ho.Sphere(random.uniform(0.004, 0.01)), position=tuple(place))
    problem = dataclasses.replace(problem, parts={"ball": ball}, limits=ho.Limits(clearance=0.003))
    return Scene("in the way", problem, culprit="clearance")


def _walled(random: np.random.Generator, problem: ho.Problem, motion: ho.Motion) -> Scene | None:
    """A wall wider than any cable is long parts the clamps at one moment."""
    frame = int(random.integers(len(motion.motion)))
    start, end = motion.cables["lead"].position[frame, [0, -1]]
    across = end - start
    distance = float(np.linalg.norm(across))
    wide = 2.5 * problem.design.variables[0].upper
    wall = ho.Part(
        ho.Box((wide, wide, 0.15 * distance)),
        position=tuple(start + random.uniform(0.4, 0.6) * across),
        quaternion=tuple(rotations.from_tangent(tuple(across / distance), 0.0)),
    )
    problem = dataclasses.replace(problem, parts={"wall": wall}, limits=ho.Limits(clearance=0.002))
    return Scene("walled", problem, culprit="clearance")


def _too_heavy(random: np.random.Generator, problem: ho.Problem, motion: ho.Motion) -> Scene:
    """The two clamps together carry the weight, so one of them half of it at least."""
    cable = problem.cables["lead"].cable
    weight = cable.mass_per_length * problem.design.variables[0].lower * 9.81
    limits = ho.Limits(clamp_force=random.uniform(0.7, 0.95) * 0.5 * weight)
    return Scene("too heavy", dataclasses.replace(problem, limits=limits), culprit="clamp_force")


def _too_near(random: np.random.Generator, problem: ho.Problem, motion: ho.Motion) -> Scene:
    """Two cables begin nearer to each other than they may."""
    run = problem.cables["lead"]
    apart = run.cable.diameter + 0.003
    aside = rotations.rotate(np.asarray(run.start.frame), np.array([1.0, 0.0, 0.0]))
    beside = tuple(random.uniform(0.6, 0.9) * apart * aside)
    end = rotations.rotate(np.asarray(run.end.frame), np.array([0.02, 0.0, 0.0]))
    other = ho.CableRun(
        run.cable,
        dataclasses.replace(run.start, position=beside),
        dataclasses.replace(run.end, position=tuple(np.asarray(run.end.position) + end)),
    )
    cables = {"lead": run, "loom": other}
    problem = dataclasses.replace(problem, cables=cables, limits=ho.Limits(clearance=0.003))
    return Scene("too near", problem, culprit="clearance")


# --- the study -------------------------------------------------------------------------------------------


def solved(scene: Scene, design: ho.Redesign) -> bool:
    """Return whether the redesign of ``scene`` ended as it should."""
    if scene.culprit is None:
        return design.ok
    return design.status.ok and not design.feasible and scene.culprit in {r.name for r in design.limits if r.margin < 0}


KINDS = {
    "feasible": (feasible, 50),
    "slotted": (slotted, 50),
    "thin": (thin_or_short, 50),
    "infeasible": (infeasible, 30),
}


def scenes(first: int, counts: Mapping[str, int]) -> Iterator[tuple[str, Scene]]:
    """Give the scenes of each kind."""
    for kind, (scene, _) in KINDS.items():
        for seed in range(first, first + counts[kind]):
            yield kind, scene(seed)


def verified(design: ho.Redesign) -> bool:
    """Return whether a design that is called one holds all limits on three times the frames."""
    step = design.problem.spatial_step
    return not design.ok or holds(dataclasses.replace(design.problem, spatial_step=None if step is None else step / 3))


def main() -> int:
    """Redesign all scenes and tell how many ended as they should."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    for kind, (_, usual) in KINDS.items():
        parser.add_argument(f"--{kind}", type=int, default=usual)
    wanted = parser.parse_args()
    counts = {kind: [0, 0, 0, 0.0] for kind in KINDS}
    for kind, scene in scenes(wanted.first, {kind: getattr(wanted, kind) for kind in KINDS}):
        begin = time.process_time()
        design = ho.redesign(scene.problem, throw=False)
        seconds = time.process_time() - begin
        good, sure = solved(scene, design), verified(design)
        count = counts[kind]
        count[0] += good
        count[1] += 1
        count[2] += sure
        count[3] += seconds
        worst = min(design.limits, key=lambda row: row.margin / row.limit if row.limit else row.margin, default=None)
        told = "" if worst is None else f"{worst.name} {worst.margin:+.3g}"
        outcome = f"{'as it should' if good else 'NOT as it should':16} {'' if sure else 'NOT VERIFIED '}"
        spent = f"{design.iterations:3} steps {design.looked_at:4} designs {seconds:6.1f} s"
        more = f"snaps {len(design.motion.snaps)} {'' if design.optimal else 'not stationary'} {design.message}"
        print(f"{scene.name:34} {outcome}{len(design.variables)} variables {spent}  {told}, {more}", flush=True)
    for kind, (good, all_of, sure, seconds) in counts.items():
        print(f"{kind}: {good} of {all_of} as it should, {sure} verified, {seconds:.0f} s of the processor")
    return 0 if all(good == all_of == sure for good, all_of, sure, _ in counts.values()) else 1


if __name__ == "__main__":
    sys.exit(main())

"""Random harnesses, and each as one discrete energy that IPOPT minimises: no spans, no substructures, no rods solved.

Every span is a chain of straight segments with frames of their own, bent where two of them meet; bodies, and frames in
clips, are unknowns like these, and what holds together are constraints. Its error falls with the square of the
segments' length.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import casadi as ca
import numpy as np

import harness_opt as ho
from harness_opt.harness.balance import Harness
from harness_opt.harness.first_pose import first_state
from harness_opt.harness.freedoms import harnesses
from harness_opt.model.spans import in_spans, spans_of
from harness_opt.numerics import rotations


def product(p, q):
    """Return the product of two quaternions (4,), of CasADi."""
    v = p[0] * q[1:] + q[0] * p[1:] + ca.cross(p[1:], q[1:])
    return ca.vertcat(p[0] * q[0] - ca.dot(p[1:], q[1:]), v)


def inverse(q):
    return ca.vertcat(q[0], -q[1:])


def turned(q, v):
    """Return ``v`` (3,) turned by ``q`` (4,), not of unit length before it is solved."""
    return v + 2.0 * ca.cross(q[1:], ca.cross(q[1:], v) + q[0] * v)


@dataclass
class Unknowns:
    """The unknowns of the whole, with where to begin, and its constraints."""

    symbols: list
    begin: list
    zero: list

    def quaternion(self, begin):
        q = self.free(begin)
        self.zero.append(ca.dot(q, q) - 1.0)
        return q

    def free(self, begin):
        values = np.atleast_1d(np.asarray(begin, dtype=float))
        symbol = ca.SX.sym(f"x{len(self.symbols)}", len(values))
        self.symbols.append(symbol)
        self.begin.append(values)
        return symbol


@dataclass
class Minimum:
    """What IPOPT ended at: whether it did, the energy, J, where bodies stand, and the arc lengths at clips."""

    ok: bool
    energy: float
    bodies: dict[str, np.ndarray]
    places: dict[str, float]


def minimum(problem: ho.Problem, segments: int, shapes: dict[str, np.ndarray], poses: dict, places: dict) -> Minimum:
    """Minimise the energy of ``problem`` at the begin of its motion, every span of so many ``segments``.

    Args:
        problem: of whole cables.
        segments: of each span.
        shapes: frames (segments, 4) to begin with, by span.
        poses: of free bodies to begin with, by name: position (3,) and quaternion (4,).
        places: arc lengths at clips that the cable slides through, by (cable, clip).
    """
    x = Unknowns([], [], [])
    gravity, energy = ca.DM(list(problem.gravity)), 0.0
    bodies = {}
    for name, body in problem.bodies.items():
        if body.free:
            bodies[name] = x.free(poses[name][0]), x.quaternion(poses[name][1])
            energy -= body.mass * ca.dot(gravity, bodies[name][0])
    clips, at = {}, {}

    def stands(body: str):
        if body in bodies:
            return bodies[body]
        position, quaternion = problem.poses(body, [0.0])
        return ca.DM(position[0]), ca.DM(quaternion[0])

    for span in spans_of(problem).values():
        run, cable = problem.cables[span.cable], problem.cables[span.cable].cable
        ends = []
        begun = shapes[span.name]
        for name, near in zip(span.clamps, (begun[0], begun[-1]), strict=True):
            clamp = run.clamps[name]
            position, quaternion = stands(clamp.body)
            place = position + turned(quaternion, ca.DM(list(clamp.position)))
            kind = getattr(clamp, "kind", "fixed")
            if kind == "fixed":
                frame = product(quaternion, ca.DM(list(clamp.frame)))
            else:
                if (span.cable, name) not in clips:
                    clips[span.cable, name] = frame = x.quaternion(near)
                    if kind in ("swivel", "sleeve"):
                        along = turned(frame, ca.DM([0, 0, 1]))
                        side = np.linalg.svd(rotations.tangent(clamp.frame)[None])[2][1:]
                        x.zero += [ca.dot(along, turned(quaternion, ca.DM(one))) for one in side]
                    if kind in ("sleeve", "ring"):
                        at[span.cable, name] = x.free(places[span.cable, name])
                frame = clips[span.cable, name]
            ends.append((place, frame))
        reach = [
            at.get((span.cable, name), edge) for name, edge in zip(span.clamps, (span.first, span.last), strict=True)
        ]
        h = (reach[1] - reach[0]) / segments
        frames = [ends[0][1], *(x.quaternion(q) for q in begun), ends[1][1]]
        stiffness, rest = ca.DM(cable.stiffness), ca.DM(list(cable.rest_curvature))
        for k, (a, b) in enumerate(itertools.pairwise(frames)):
            arc = h if 0 < k < segments else 0.5 * h
            relative = product(inverse(a), b)
            sign = ca.sign(relative[0]) if k in (0, segments) else 1.0
            bend = 2.0 * sign * relative[1:] / arc - rest
            energy += 0.5 * arc * ca.dot(stiffness * bend, bend)
        place = ends[0][0]
        for q in frames[1:-1]:
            step = h * turned(q, ca.DM([0, 0, 1]))
            energy -= cable.mass_per_length * h * ca.dot(gravity, place + 0.5 * step)
            place += step
        x.zero.append((place - ends[1][0]) / cable.length)
    scale = problem.cables[next(iter(problem.cables))].cable
    unit = float(scale.stiffness[0]) / scale.length
    solver = ca.nlpsol(
        "monolithic", "ipopt", {"x": ca.vertcat(*x.symbols), "f": energy / unit, "g": ca.vertcat(*x.zero)},
        {"ipopt": {"print_level": 0, "tol": 1e-10, "max_iter": 400, "sb": "yes"}, "print_time": False},
    )  # fmt: skip
    found = solver(x0=np.concatenate(x.begin), lbg=0.0, ubg=0.0)
    value = ca.Function("value", [ca.vertcat(*x.symbols)], [ca.vertcat(*(bodies[n][0] for n in bodies), *at.values())])
    told = np.asarray(value(found["x"])).ravel()
    return Minimum(
        solver.stats()["success"],
        float(found["f"]) * unit,
        {name: told[3 * k : 3 * k + 3] for k, name in enumerate(bodies)},
        dict(zip(at, told[3 * len(bodies) :].tolist(), strict=True)),
    )


# --- random harnesses -------------------------------------------------------------------------------------


def random_cable(rng: np.random.Generator, length: float) -> ho.Cable:
    """Return a round or a flat cable, some of them made bent, from weightless to heavy."""
    bending = 10.0 ** rng.uniform(-3, -1)
    flat = rng.random() < 0.3
    stiffness = (bending, bending * 10.0 ** rng.uniform(-1, 1)) if flat else bending
    heavy = 10.0 ** rng.uniform(-1, 1.5) if rng.random() < 0.8 else 0.0  # w L^3 / B
    rest = tuple(rng.normal(size=3) * 0.5 / length) if rng.random() < 0.2 else (0.0, 0.0, 0.0)
    mass = heavy * bending / length**3 / 9.81
    return ho.Cable(length, 0.01 * length, stiffness, bending * rng.uniform(0.5, 1.5), mass, rest)


def walk(rng: np.random.Generator, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (steps + 1, 3) and directions of a random walk that turns by less than a right angle."""
    direction = rotations.unit(rng.normal(size=3))
    places, directions = [rng.normal(size=3) * 0.1], [direction]
    for _ in range(steps):
        places.append(places[-1] + rng.uniform(0.15, 0.35) * direction)
        direction = rotations.unit(direction + 0.5 * rng.normal(size=3))
        directions.append(direction)
    return np.array(places), np.array(directions)


def end(place, direction, **more: object) -> ho.End:
    return ho.End(tuple(place.tolist()), tangent=tuple(direction.tolist()), roll_deg=0.0, **more)


def random_harness(seed: int) -> ho.Problem:
    """Return a harness of 2 to 6 spans: a cable through clips of all kinds, or a tree about one or two free bodies."""
    rng = np.random.default_rng(seed)
    gravity = (0.0, 0.0, -9.81)
    if rng.random() < 0.6:
        return _row(rng, gravity)
    return _tree(rng, gravity)


def _row(rng: np.random.Generator, gravity) -> ho.Problem:
    spans = int(rng.integers(2, 7))
    places, directions = walk(rng, spans)
    slack = rng.uniform(1.03, 1.4, spans)
    own = slack * np.linalg.norm(np.diff(places, axis=0), axis=1)
    at, clips = np.cumsum(own), []
    for k in range(1, spans):
        kind = str(rng.choice(["fixed", "swivel", "pivot", "sleeve", "ring"]))
        tangent = None if kind in ("pivot", "ring") else tuple(directions[k].tolist())
        roll = 0.0 if kind == "fixed" else None
        place = tuple(places[k].tolist())
        clips.append(
            ho.Clip(name=f"c{k}", at=float(at[k - 1]), kind=kind, position=place, tangent=tangent, roll_deg=roll)
        )
    run = ho.CableRun(
        random_cable(rng, float(at[-1])),
        end(places[0], directions[0]),
        end(places[-1], directions[-1]),
        clips=tuple(clips),
    )
    return ho.Problem({"lead": run}, gravity=gravity)


def _tree(rng: np.random.Generator, gravity) -> ho.Problem:
    """One or two bodies, each with two to three branches to the world, the two joined by a trunk."""
    count = int(rng.integers(1, 3))
    bodies = {f"splice{k}": ho.Body(free=True, mass=float(rng.uniform(0.0, 0.05))) for k in range(count)}
    centres = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])[:count] + 0.1 * rng.normal(size=(count, 3))
    cables = {}
    for k in range(count):
        for branch in range(int(rng.integers(2, 4)) if count > 1 else int(rng.integers(2, 5))):
            out = rotations.unit(rng.normal(size=3))
            far = centres[k] + rng.uniform(0.15, 0.35) * out
            length = float(rng.uniform(1.05, 1.5) * np.linalg.norm(far - centres[k]))
            there = end(far, rotations.unit(out + 0.4 * rng.normal(size=3)))
            here = end(0.01 * out, out, body=f"splice{k}")
            cables[f"branch{k}{branch}"] = ho.CableRun(random_cable(rng, length), here, there)
    if count > 1:
        way = rotations.unit(centres[1] - centres[0])
        length = float(rng.uniform(1.1, 1.5) * np.linalg.norm(centres[1] - centres[0]))
        ends = end(0.01 * way, way, body="splice0"), end(-0.01 * way, way, body="splice1")
        cables["trunk"] = ho.CableRun(random_cable(rng, length), *ends)
    return ho.Problem(cables, bodies=bodies, gravity=gravity)


@dataclass
class Compared:
    """A harness as it is found, and as one discrete energy of the whole begun there.

    Args:
        solved: whether IPOPT came to a minimum.
        energy, oracle: of both, J.
        unit: B / L of the first cable, J.
    """

    solved: bool
    energy: float
    oracle: float
    unit: float

    @property
    def off(self) -> float:
        """How far apart the two are, over their size and the unit."""
        return abs(self.energy - self.oracle) / (abs(self.energy) + self.unit)


def compared(problem: ho.Problem, segments: tuple[int, int, int] = (24, 48, 96)) -> Compared | None:
    """Return a harness against the oracle, extrapolated from three numbers of segments; None where none is found."""
    apart, states = in_spans(problem), []
    for freedoms in harnesses(apart, problem):
        states.append(first_state(Harness(freedoms, "gauss-newton"), 0.0))
    if any(state is None for state in states):
        return None
    rods, poses, places, energy = {}, {}, {}, 0.0
    for state in states:
        energy += state.energy
        freedoms = state.harness.freedoms
        rods |= {name: span.solved.rod for name, span in zip(freedoms.spans, state.spans, strict=True)}
        poses |= {name: (state.pose.positions[k], state.pose.quaternions[k]) for k, name in enumerate(freedoms.bodies)}
        for clip, place in zip(freedoms.clips, state.pose.places, strict=True):
            places[tuple(clip.key.split(", "))] = place
    for name, run in apart.cables.items():
        if name not in rods:  # between fixed clips
            start, end = apart.ends(name, [0.0])[0]
            shape = ho.equilibrium(run.cable, start, end, problem.gravity)
            rods[name] = shape.rod
            weight = run.cable.mass_per_length * run.cable.length
            energy += shape.energy - weight * float(np.dot(problem.gravity, start.position))
    minima = []
    for count in segments:
        middles = (np.arange(count) + 0.5) / count
        begin = {name: rod.sample(middles).q for name, rod in rods.items()}
        minima.append(minimum(problem, count, begin, poses, places))
    one, two, three = (found.energy for found in minima)
    second = (4 * two - one) / 3, (4 * three - two) / 3
    first = next(iter(problem.cables.values())).cable
    unit = float(first.stiffness[0]) / first.length
    return Compared(all(m.ok for m in minima), energy, (8 * second[1] - second[0]) / 7, unit)

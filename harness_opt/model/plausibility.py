"""What can be but hardly is meant: cables thinner than a hair, longer than a ship, stiffer than diamond.

Such a problem is solved all the same; its numbers are most often in another unit than the file's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from harness_opt.model.bodies import Hinge, Slide, seconds_of
from harness_opt.model.cable import Cable
from harness_opt.model.courses import ValueTable
from harness_opt.model.parts import Box, Capsule, Cylinder, MeshFile, Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.model.spans import spans_of
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

THINNEST = 5e-5  # m, a thin human hair
THICKEST = 0.3  # m, a submarine power cable
LONGEST_CABLE = 100.0  # m, a ship
STOUTEST = 5.0  # diameters of length; below, shear and what the clamps do to the section count
STIFFEST_MODULUS = 1.2e12  # Pa, Young's modulus of diamond
SOFTEST_MODULUS = 1e3  # Pa, of jelly
HEAVIEST = 2.26e4  # kg/m3, osmium
LIGHTEST = 1.2  # kg/m3, air
MOST_RATIO = 100.0  # of torsional to bending stiffness, either way; a round rod has 2/3 to 1
STRONGEST = 25.0  # m/s2, gravity on Jupiter
MOST_DEGREES = 3600.0  # of a hinge: ten turns
BEYOND = 0.01  # of a table's whole way, that a spline may go beyond its values
LARGEST_PART = 100.0  # lengths of the longest cable
MISTAKEN = 30.0  # between a length as meant, once or twice what it spans, and one in millimetres, a thousand times that
SMALLEST_PART = 0.1  # diameters of the thinnest cable


def doubts(problem: Problem) -> tuple[str, ...]:
    """Return what is hardly meant in ``problem``, a line each that begins with the key; nothing for most problems."""
    lines = [line for name, run in problem.cables.items() for line in _cable(f"cables.{name}", run.cable)]
    return (*lines, *_spans(problem), *_surroundings(problem), *_limits(problem), *_lengths(problem))


def part_doubts(problem: Problem, name: str, size: Array) -> Iterator[str]:
    """Yield what is hardly meant about a part whose box has the edges ``size`` (3,), m."""
    if not problem.cables:  # nothing to compare it with
        return
    longest = max(run.cable.length for run in problem.cables.values())
    thinnest = min(run.cable.diameter for run in problem.cables.values())
    across = float(np.linalg.norm(size))
    key = _key_of_size(name, problem.parts[name])
    if across > LARGEST_PART * longest:
        yield f"{key}: the part is {across:.3g} m across, more than {LARGEST_PART:g} times the longest cable"
    elif across < SMALLEST_PART * thinnest:
        yield f"{key}: the part is {across:.3g} m across, far less than the thinnest cable"


def _key_of_size(name: str, part: Part) -> str:
    """Return the key that decides how large ``part`` is."""
    if isinstance(part.shape, MeshFile):
        return f"parts.{name}.mesh_unit"
    kinds = {Box: "box", Sphere: "sphere", Cylinder: "cylinder", Capsule: "capsule"}
    return f"parts.{name}.{kinds[type(part.shape)]}"


def _cable(key: str, cable: Cable) -> Iterator[str]:
    """Yield what is odd about one cable."""
    length, diameter = cable.length, cable.diameter
    if length > LONGEST_CABLE:
        yield f"{key}.length: found {length:g} m, longer than a ship"
    if diameter < THINNEST:
        yield f"{key}.diameter: found {diameter:g} m, thinner than a hair"
    elif diameter > THICKEST:
        yield f"{key}.diameter: found {diameter:g} m, thicker than a submarine cable"
    if length < STOUTEST * diameter:
        yield f"{key}.length: found {length / diameter:.3g} diameters, too short for a rod without shear"
    kx, ky, kz = cable.stiffness
    solid = math.pi * diameter**4 / 64  # m4, second moment of area of a full circle
    modulus = kx / solid if solid > 0 else math.inf
    if modulus > STIFFEST_MODULUS:
        yield f"{key}.bending_stiffness: found {kx:g} N m2, stiffer than a rod of diamond of that diameter"
    elif modulus < SOFTEST_MODULUS:
        yield f"{key}.bending_stiffness: found {kx:g} N m2, softer than a rod of jelly of that diameter"
    ratio = kz / min(kx, ky)
    if not 1 / MOST_RATIO <= ratio <= MOST_RATIO:
        yield f"{key}.torsional_stiffness: found {ratio:.3g} times the bending stiffness, a round rod has 0.7 to 1"
    area = 0.25 * math.pi * diameter**2
    density = cable.mass_per_length / area if area > 0 else math.inf
    if density > HEAVIEST:
        yield f"{key}.mass_per_length: found {density:.3g} kg/m3 over the full circle, more than osmium"
    elif 0 < density < LIGHTEST:
        yield f"{key}.mass_per_length: found {density:.3g} kg/m3 over the full circle, less than air"
    sharpest = 0.5 * diameter * math.hypot(*cable.rest_curvature[:2])
    if sharpest > 1:
        yield f"{key}.rest_curvature: found a radius below half the diameter, so the cable is made bent through itself"


def _spans(problem: Problem) -> Iterator[str]:
    """Yield spans between clips that are too short."""
    for span in spans_of(problem).values():
        run = problem.cables[span.cable]
        thick = (span.last - span.first) / run.cable.diameter
        if run.clips and thick < STOUTEST:
            before, here = span.clamps
            key = f"cables.{span.cable}.clips.{before if here == 'end' else here}.at"
            yield f"{key}: found {thick:.3g} diameters from {before} to {here}, too short for a rod without shear"


def _surroundings(problem: Problem) -> Iterator[str]:
    """Yield what is odd about gravity and motions."""
    size = math.hypot(*problem.gravity)
    if size > STRONGEST:
        yield f"gravity: found {size:g} m/s2, more than on Jupiter"
    elif problem.gravity[2] > 0.5 * size > 0:
        yield f"gravity: found {problem.gravity[2]:g} m/s2 along z, which is up"
    of_robots = {name for robot in problem.robots.values() for name in robot.bodies}  # these have doubts of their own
    for name, robot in problem.robots.items():
        yield from (f"robots.{name}: {words}" for words in robot.doubts)
    for name, body in problem.bodies.items():
        key, motion = f"bodies.{name}.motion", None if name in of_robots else body.motion
        if not isinstance(motion, (Hinge, Slide)):
            continue
        low, high = sorted((motion.start, motion.stop)) if motion.follows is None else motion.follows.range
        if low == high:
            yield f"{key}: found the same value at its begin and its end, so the body stands still"
        elif isinstance(motion, Hinge) and math.degrees(high - low) > MOST_DEGREES:
            yield f"{key}: found {math.degrees(high - low):g} degrees, more than ten turns"
        if isinstance(motion.follows, ValueTable) and motion.follows.beyond > BEYOND * (high - low):
            beyond = motion.follows.beyond
            most = f"{math.degrees(beyond):.3g} deg" if isinstance(motion, Hinge) else f"{1e3 * beyond:.3g} mm"
            words = f"found rows so far apart that a smooth curve through them goes {most} beyond their values"
            yield f"{key}.file: {words}; give more rows, or moves"
    yield from _clocks(problem)


def _clocks(problem: Problem) -> Iterator[str]:
    """Yield what goes through its times faster or slower than another does: bodies, and programs of robots."""
    owners = {link: (name, f"robots.{name}.program") for name, one in problem.robots.items() for link in one.bodies}
    told: dict[tuple[str, str], float] = {}
    for name, body in problem.bodies.items():
        seconds = seconds_of(body.motion)
        if seconds is not None:
            told[owners.get(name, (name, f"bodies.{name}.motion"))] = seconds
    longest = max(told, key=lambda one: told[one], default=None)
    for one, seconds in told.items():
        if longest is not None and not math.isclose(seconds, told[longest], rel_tol=1e-6):
            words = f"found {seconds:.6g} s, where that of {longest[0]} takes {told[longest]:.6g} s"
            yield f"{one[1]}: {words}; each is gone through over the whole motion"


def _lengths(problem: Problem) -> Iterator[str]:
    """Yield cables far longer than anything about them: the distance of their ends, their bounds, the parts."""
    at = np.linspace(0.0, 1.0, 11)  # moments at which ends are looked at
    sizes = [_reach(part) for part in problem.parts.values() if not isinstance(part.shape, MeshFile)]
    for name, run in problem.cables.items():
        if run.start.position is None or run.end.position is None:
            continue
        first, last = (
            position + rotations.rotate(quaternion, np.asarray(end.position))
            for end in (run.start, run.end)
            for position, quaternion in (problem.poses(end.body, at),)
        )
        apart = float(np.max(np.linalg.norm(last - first, axis=1)))
        bounds = [variable.upper for variable in problem.design.variables if variable.name == f"{name}.length"]
        largest = max([apart, *sizes, *bounds])
        if 0 < MISTAKEN * largest < run.cable.length:
            words = f"found {run.cable.length:g} m, where its ends are at most {apart:.3g} m apart"
            yield f"cables.{name}.length: {words}; lengths are in metres"


def _reach(part: Part) -> float:
    """Return about how large a solid is, m."""
    shape = part.shape
    if isinstance(shape, Box):
        return math.hypot(*shape.size)
    assert not isinstance(shape, MeshFile)
    return 2.0 * shape.radius + float(getattr(shape, "length", 0.0))


def _limits(problem: Problem) -> Iterator[str]:
    """Yield limits that no cable of the problem can mean."""
    longest = max((run.cable.length for run in problem.cables.values()), default=math.inf)
    given = {"limits.clearance": problem.limits.clearance, "limits.bend_radius": problem.limits.bend_radius}
    given |= {f"cables.{name}.bend_radius": run.bend_radius for name, run in problem.cables.items()}
    given |= {f"parts.{name}.clearance": part.clearance for name, part in problem.parts.items()}
    for key, limit in given.items():
        if limit is not None and limit > longest:
            yield f"{key}: found {limit:g} m, more than the length of the longest cable"

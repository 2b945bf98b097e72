"""What would be solved, before anything is: facts that follow from a problem, and the same in words."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness_opt.clearance.what_counts import let_off_length
from harness_opt.model.bodies import WORLD, Body, Hinge, Slide
from harness_opt.model.cable import CableRun, End
from harness_opt.model.design import Variable
from harness_opt.model.design_variables import target, value
from harness_opt.model.limits import CABLE_KINDS, LimitKind
from harness_opt.model.parts import MeshFile, Part
from harness_opt.model.plausibility import doubts
from harness_opt.model.problem import Problem, left_out
from harness_opt.motion.path import clamp_twist, place_frames
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Geometry, Mesh, Scene

Json = dict[str, Any]

WIDTH = 80
# w L^3/B, below which it means this: it is eight times a cantilever's sag in lengths; at 100 the stretch next to a
# clamp over which stiffness is felt, L sqrt(B / (w L^3)), is a tenth of the length
WEIGHTS = (
    (1.0, "stiffness shapes it, weight hardly"),
    (100.0, "weight and stiffness shape it"),
    (math.inf, "weight shapes it, but near its ends"),
)


def facts(problem: Problem, scene: Scene) -> Json:
    """Return what ``check`` says, as nested dicts and lists for JSON; SI units.

    Args:
        problem: as read.
        scene: its parts as geometry.

    Raises:
        ProblemError: the motion asks for too many frames.
    """
    motion = place_frames(problem)
    parts = {name: _part(problem, name, part, scene.parts[name]) for name, part in problem.parts.items()}
    return {
        "frames": len(motion),
        "duration": problem.duration,
        "out_and_back": problem.out_and_back,
        "cables": {name: _cable(problem, name, motion) for name in problem.cables},
        "bodies": {name: _body(body) for name, body in problem.bodies.items()},
        "parts": parts,
        "limits": {name: limit for name, limit in vars(problem.limits).items() if limit is not None},
        "design": {v.name: _variable(problem, v) for v in problem.design.variables},
        "coupled": {c.name: c.words for c in problem.design.couplings},
        "minimise": None if problem.design.maximise else problem.design.minimise,
        "maximise": problem.design.maximise,
        "left_out": _reasons(problem),
        "warnings": [*doubts(problem), *scene.warnings, *(found.words for found in suspects(problem, scene))],
    }


# --- facts ---------------------------------------------------------------------------------------------


def _cable(problem: Problem, name: str, motion: Array) -> Json:
    run: CableRun = problem.cables[name]
    cable = run.cable
    kx, ky, kz = (float(stiffness) for stiffness in cable.stiffness)
    weight = cable.mass_per_length * float(np.linalg.norm(problem.gravity))
    ends = [_path(problem, end, motion) for end in (run.start, run.end)]
    slack = None
    if ends[0] is not None and ends[1] is not None:
        slack = cable.length - np.linalg.norm(ends[1] - ends[0], axis=1)
        tight = problem.moments.words(float(motion[np.argmin(slack)]))
    return {
        "length": cable.length,
        "diameter": cable.diameter,
        "mass": cable.mass_per_length * cable.length,
        "weight_number": weight * cable.length**3 / min(kx, ky),
        "kz_over_kx": kz / kx,
        "ky_over_kx": ky / kx,
        "slack": None if slack is None else [float(np.min(slack)), float(np.max(slack))],
        "least_slack_at": None if slack is None else tight,
        "start": _end(run.start),
        "end": _end(run.end),
        "turns": run.turned_in,
        "bend_radius": run.bend_radius,
        "clamp_twist": clamp_twist(problem, name),
        "fitted_at": None if run.untwisted is None else run.fitted_at,
        "fitted_where": None if run.untwisted is None else problem.moments.words(run.fitted_at),
    }


def _variable(problem: Problem, variable: Variable) -> Json:
    """Return what a design variable is now, its bounds, and what a rotation turns about, in its body's coordinates."""
    found = {"now": value(problem, variable.name), "lower": variable.lower, "upper": variable.upper}
    meant = target(variable.name)
    if meant.quantity != "rotate":
        return found
    end: End = getattr(problem.cables[meant.cable], str(meant.side))
    if end.frame is None:
        return found
    projected = end.frame if end.tangent is None else rotations.from_tangent(end.tangent)
    axis = rotations.matrix(projected)[:, meant.axis]
    return found | {"about": (np.round(axis, 6) + 0.0).tolist(), "body": end.body}


def _path(problem: Problem, end: End, motion: Array) -> Array | None:
    """Return the world positions (P, 3) of ``end``, or None where a force holds it."""
    if end.position is None:
        return None
    position, quaternion = problem.poses(end.body, motion)
    return position + rotations.rotate(quaternion, end.position)


def _end(end: End) -> Json:
    """Return how an end is held: the four kinds of the design notes, section 1."""
    kinds = {
        (True, True): "clamped",
        (True, False): "pinned",
        (False, True): "guided",
        (False, False): "free",
    }
    return {"held": kinds[end.position is not None, end.frame is not None], "body": end.body}


def _body(body: Body) -> Json:
    motion = body.motion
    if motion is None:
        return {"kind": "still"}
    if isinstance(motion, Hinge):
        angles = [math.degrees(motion.start), math.degrees(motion.stop)]
        return {"kind": "hinge", "point": list(motion.point), "axis": list(motion.axis), "angles_deg": angles}
    if isinstance(motion, Slide):
        return {
            "kind": "slide",
            "direction": list(motion.direction),
            "travel": [motion.start, motion.stop],
        }
    return {
        "kind": "poses",
        "count": len(motion.times),
        "file": None if motion.file is None else motion.file.name,
    }


def _part(problem: Problem, name: str, part: Part, geometry: Geometry) -> Json:
    entry = {
        "kind": "mesh" if isinstance(part.shape, MeshFile) else type(part.shape).__name__.lower(),
        "body": part.body,
        "lower": geometry.lower.tolist(),
        "upper": geometry.upper.tolist(),
        "closed": geometry.closed,
        "clearance": problem.clearance_limit(name),
    }
    if isinstance(part.shape, MeshFile) and isinstance(geometry, Mesh):
        entry |= {"file": part.shape.path.name, "up": part.shape.up_axis, "triangles": len(geometry.faces)}
    return entry


def _reasons(problem: Problem) -> list[Json]:
    """Return what the solve leaves out, and why."""
    heavy = any(run.cable.mass_per_length for run in problem.cables.values())
    why = {
        "weight": "gravity is zero or not given" if heavy else "no cable has a density or mass_per_length",
        "parts": "there are none to stay clear of",
        "clearance of cables to each other and to themselves": "limits.clearance is not given",
        "other cables": "there is only one",
        "motion": "no body moves, so that one frame is solved",
    }
    family = "its clamps stand on one line, and it is round and without weight"
    reasons = [{"what": what, "why": why.get(what, family)} for what in left_out(problem)]
    unlimited = [name for name in problem.parts if problem.clearance_limit(name) is None]
    if unlimited:
        what = f"a limit for {', '.join(unlimited)}"
        reasons.append({"what": what, "why": "neither has its own clearance nor is there a general one"})
    missing = [kind.value for kind in CABLE_KINDS if not any(problem.cable_limit(kind, one) for one in problem.cables)]
    if missing:
        names = ", ".join(name.replace("_", " ") for name in missing)
        reasons.append({"what": f"limits on {names}", "why": "they are not given"})
    return reasons


# --- what is suspicious ---


@dataclass(frozen=True)
class Suspect:
    """What can be but is hardly meant.

    Args:
        words: a line that begins with the key.
        part: the part that is to be looked at, or None.
        clamp: cable and side of the clamp that is to be looked at, or None.
    """

    words: str
    part: str | None = None
    clamp: tuple[str, str] | None = None


def suspects(problem: Problem, scene: Scene) -> list[Suspect]:
    """Return clamps that stand in a part that does not hold them, and those that point into a wall."""
    return [
        found
        for name, run in problem.cables.items()
        for side, end in (("start", run.start), ("end", run.end))
        for part in scene.parts.values()
        if (found := _suspect(problem, (name, side), end, part)) is not None
    ]


def _suspect(problem: Problem, clamp: tuple[str, str], end: End, part: Geometry) -> Suspect | None:
    """Return what is odd about a clamp and a part at both ends and in the middle of the motion."""
    name, side = clamp
    moments, radius = np.array([0.0, 0.5, 1.0]), problem.cables[name].cable.radius
    position = _path(problem, end, moments)
    if position is None or not part.closed:
        return None
    key, limit = f"cables.{name}.{side}", problem.clearance_limit(part.name)
    origin, turn = problem.poses(part.body, moments)
    home = rotations.conjugate(turn)
    depth = -part.signed_distance(rotations.rotate(home, position - origin))[0]
    holds = end.body == part.body if end.holders is None else part.name in end.holders
    if not holds:
        k = int(np.argmax(depth))
        at = problem.moments.words(float(moments[k]))
        words = f"{key}.position: found {1e3 * depth[k]:.3g} mm deep in {part.name}, which does not hold it, at {at}"
        return Suspect(words, part.name, clamp) if depth[k] > 0 else None
    if end.frame is None:
        return None
    quaternion = problem.poses(end.body, moments[:1])[1][0]
    out = rotations.rotate(quaternion, rotations.tangent(np.asarray(end.frame))) * (1.0 if side == "start" else -1.0)
    reach = let_off_length(end, radius, limit)
    ahead, behind = (position[0] + sign * reach * out - origin[0] for sign in (1.0, -1.0))
    inside = part.signed_distance(rotations.rotate(home[0], np.stack([ahead, behind])))[0] < 0
    if not inside[0]:
        return None
    turned = "; the other way it would come out, so it may be turned round" if not inside[1] else ""
    words = f"{key}.tangent: found the cable {1e3 * reach:.3g} mm on still inside {part.name}, which holds it{turned}"
    return Suspect(words, part.name, clamp)


# --- words ---------------------------------------------------------------------------------------------


def description(problem: Problem, content: Mapping[str, Any]) -> str:
    """Return ``content``, from :func:`facts`, as lines of at most 80 columns."""
    title = problem.title or str(problem.file or "A problem without title")
    frames = "1 frame" if content["frames"] == 1 else f"{content['frames']} frames"
    lines = [title, "", f"Would be solved: {_counted(content['cables'], 'cable')} over {frames}."]
    for words in (_cable_lines, _body_lines, _part_lines, _limit_lines):
        lines += words(content)
    lines += [f"Left out: {reason['what']}, for {reason['why']}." for reason in content["left_out"]]
    lines += [f"Beware: {warning}." for warning in content["warnings"]]
    return "\n".join(
        textwrap.fill(line, WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
        for line in lines
    )


def _counted(things: Mapping[str, Any], word: str) -> str:
    return f"{len(things)} {word}" + ("" if len(things) == 1 else "s")


def _cable_lines(content: Mapping[str, Any]) -> Iterator[str]:
    for name, cable in content["cables"].items():
        size = f"{_mm(cable['length'])} mm long, {_mm(cable['diameter'])} mm thick"
        held = " and ".join(_held(side, cable[side]) for side in ("start", "end"))
        turns = f", with {cable['turns']:+g} turns" if cable["turns"] else ""
        yield f"Cable {name}: {size}; {held}{turns}."
        flat = f", ky/kx = {cable['ky_over_kx']:.4g}" if cable["ky_over_kx"] != 1 else ""
        weight = f"weighs {1e3 * cable['mass']:.4g} g, w L^3/B = {cable['weight_number']:.4g}"
        number = cable["weight_number"]
        what = next(words for below, words in WEIGHTS if number < below)
        yield f"  {weight}, kz/kx = {cable['kz_over_kx']:.4g}{flat}: {what}"
        if cable["clamp_twist"] is not None:
            degrees = math.degrees(cable["clamp_twist"])
            where = "at the start" if cable["fitted_at"] is None else f"where fitted, at {cable['fitted_where']}"
            yield f"  its clamps build in {degrees:.4g} deg of twist, {degrees / cable['length']:.4g} deg/m, {where}"
        if cable["slack"] is not None:
            smallest, largest = (f"{1e3 * slack:.4g}" for slack in cable["slack"])
            least = f"least at {cable['least_slack_at']}"
            yield f"  slack over the distance of its ends: {smallest} to {largest} mm over the motion, {least}"


def _held(side: str, end: Mapping[str, Any]) -> str:
    if end["held"] == "free":
        return f"its {side} is free"
    return f"its {side} is {end['held']} {'in the' if end['body'] == WORLD else 'to'} {end['body']}"


def _body_lines(content: Mapping[str, Any]) -> Iterator[str]:
    for name, body in content["bodies"].items():
        if body["kind"] == "hinge":
            point = f"the point {_place(body['point'])} mm"
            axis = f"the axis {_direction(body['axis'])}"
            start, stop = body["angles_deg"]
            words = f"turns about {axis} through {point}, from {start:g} to {stop:g} deg"
        elif body["kind"] == "slide":
            start, stop = (_mm(travel) for travel in body["travel"])
            words = f"slides along {_direction(body['direction'])}, from {start} to {stop} mm"
        elif body["kind"] == "poses":
            words = f"follows the {body['count']} poses of {body['file'] or 'a table'}"
        else:
            words = "stands still"
        yield f"Body {name}: {words}."


def _part_lines(content: Mapping[str, Any]) -> Iterator[str]:
    for name, part in content["parts"].items():
        what = part["kind"]
        if what == "mesh":
            surface = "closed" if part["closed"] else "open, so a shell"
            up = "y up (turned to z up)" if part["up"] == "y" else "z up"
            what = f"mesh {part['file']}, {part['triangles']} triangles, {surface}, {up}"
        limit = "no limit" if part["clearance"] is None else f"at least {_mm(part['clearance'])} mm clear"
        yield f"Part {name}, of {part['body']}: {what}; {limit}"
        yield f"  box from {_place(part['lower'])} to {_place(part['upper'])} mm"


def _limit_lines(content: Mapping[str, Any]) -> Iterator[str]:
    kinds = [(LimitKind(name), limit) for name, limit in content["limits"].items()]
    limits = [f"{kind.words} {limit * kind.from_si * kind.unit.factor:.6g} {kind.unit.name}" for kind, limit in kinds]
    own = {name: cable["bend_radius"] for name, cable in content["cables"].items() if cable["bend_radius"] is not None}
    limits += [f"bend radius of {name} {_mm(radius)} mm" for name, radius in own.items()]
    if limits:
        yield f"Limits: {', '.join(limits)}."
    if content["design"]:
        aim = f"the least {content['minimise']}" if content["minimise"] else "the largest worst margin"
        follow = "".join(f"; {name} follows, = {words}" for name, words in content["coupled"].items())
        yield f"A redesign would change, for {aim}{follow}:"
        for name, variable in content["design"].items():
            unit = "deg" if name.endswith("_deg") else "m"
            now, lower, upper = variable["now"], variable["lower"], variable["upper"]
            outside = "" if lower <= now <= upper else ": outside, so it begins at the nearest"
            about = f", about {_direction(variable['about'])} of {variable['body']}" if "about" in variable else ""
            yield f"  {name}: {now:g} {unit} now, within [{lower:g}, {upper:g}]{outside}{about}"


def _mm(length: float) -> str:
    return f"{1e3 * length:.6g}"


def _place(point: list[float]) -> str:
    return f"({', '.join(f'{1e3 * x:.4g}' for x in point)})"


def _direction(vector: list[float]) -> str:
    return f"({', '.join(f'{x:g}' for x in vector)})"

"""What would be solved, before anything is: facts that follow from a problem, and the same in words."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from harness_opt.model.bodies import WORLD, Body, BodyMotion, Hinge, Slide
from harness_opt.model.cable import CableRun
from harness_opt.model.courses import Course, Moves, ValueTable
from harness_opt.model.design import Variable
from harness_opt.model.design_variables import target, value
from harness_opt.model.ends import Clip, End
from harness_opt.model.limits import CABLE_KINDS, LimitKind
from harness_opt.model.parts import MeshFile, Part
from harness_opt.model.plausibility import doubts
from harness_opt.model.problem import Problem, left_out
from harness_opt.model.spans import Span, in_spans, slack, spans_of
from harness_opt.motion.path import clamp_twist, place_frames
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Geometry, Mesh, Scene
from harness_opt.report.suspects import suspects

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
    apart = in_spans(problem)
    spans = [span for span in spans_of(problem).values() if span.cable == name]
    held = [_span(apart, span, motion) for span in spans]
    tightest = min(held, key=lambda span: span["slack"][0] if span["slack"] else math.inf)
    return {
        "length": cable.length,
        "diameter": cable.diameter,
        "mass": cable.mass_per_length * cable.length,
        "weight_number": weight * cable.length**3 / min(kx, ky),
        "kz_over_kx": kz / kx,
        "ky_over_kx": ky / kx,
        "slack": tightest["slack"],
        "least_slack_at": tightest["least_slack_at"],
        "spans": held,
        "start": _end(run.start),
        "end": _end(run.end),
        "clips": {clip.name: {"at": clip.at, "kind": clip.kind, **_end(clip)} for clip in run.clips},
        "turns": run.turned_in,
        "bend_radius": run.bend_radius,
        "clamp_twist": clamp_twist(problem, name),
        "fitted_at": None if run.untwisted is None else run.fitted_at,
        "fitted_where": None if run.untwisted is None else problem.moments.words(run.fitted_at),
    }


def _span(problem: Problem, span: Span, motion: Array) -> Json:
    """Return the clamps of a span of ``problem``, which is in spans, its least and most slack, and where that is."""
    found: Json = {"from": span.clamps[0], "to": span.clamps[1], "slack": None, "least_slack_at": None}
    run = problem.cables[span.name]
    slides = any(isinstance(end, Clip) and end.slides for end in (run.start, run.end))
    left = None if slides else slack(problem, span, motion)  # where it slides, its length is to be found
    if left is None:
        return found
    tight = problem.moments.words(float(motion[np.argmin(left)]))
    return found | {"slack": [float(np.min(left)), float(np.max(left))], "least_slack_at": tight}


def _variable(problem: Problem, variable: Variable) -> Json:
    """Return what a design variable is now, its bounds, and what a rotation turns about, in its body's coordinates."""
    found = {"now": value(problem, variable.name), "lower": variable.lower, "upper": variable.upper}
    meant = target(variable.name)
    if meant.quantity != "rotate":
        return found
    end: End = problem.cables[meant.cable].clamps[str(meant.clamp)]
    if end.frame is None:
        return found
    projected = end.frame if end.tangent is None else rotations.from_tangent(end.tangent)
    axis = rotations.matrix(projected)[:, meant.axis]
    return found | {"about": (np.round(axis, 6) + 0.0).tolist(), "body": end.body}


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
    stands = {"position": list(body.position), "quaternion": list(body.quaternion)} if body.is_placed else {}
    if body.free:
        return {"parent": body.parent, **stands, "kind": "free", "mass": body.mass}
    return {"parent": body.parent, **stands, **_body_motion(body.motion)}


def _body_motion(motion: BodyMotion | None) -> Json:
    if motion is None:
        return {"kind": "still"}
    if isinstance(motion, Hinge):
        angles = [math.degrees(motion.start), math.degrees(motion.stop)]
        line = {"kind": "hinge", "point": list(motion.point), "axis": list(motion.axis), "angles_deg": angles}
        return line | _course(motion.follows)
    if isinstance(motion, Slide):
        return {
            "kind": "slide",
            "direction": list(motion.direction),
            "travel": [motion.start, motion.stop],
            **_course(motion.follows),
        }
    return {
        "kind": "poses",
        "count": len(motion.times),
        "file": None if motion.file is None else motion.file.name,
    }


def _course(course: Course | None) -> Json:
    """Return what a hinge or a slide follows; nothing where it goes evenly."""
    if course is None:
        return {}
    told: Json = {"seconds": course.seconds, "range": list(course.range)}
    if isinstance(course, ValueTable):
        file = None if course.file is None else course.file.name
        return {"follows": told | {"count": len(course.times), "file": file}}
    return {"follows": told | {"moves": len(course.moves) if isinstance(course, Moves) else 0}}


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
        held = " and ".join(_held(f"its {side}", cable[side]) for side in ("start", "end"))
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
        for clip, held in cable["clips"].items():
            where = "in the world" if held["body"] == WORLD else f"on {held['body']}"
            free = f"{clip} is a {held['kind']} {where}"
            yield f"  at {_mm(held['at'])} mm {_held(clip, held) if held['kind'] == 'fixed' else free}"
        for span in cable["spans"]:
            if span["slack"] is not None:
                between = f" from {span['from']} to {span['to']}" if cable["clips"] else ""
                ends = "these" if between else "its ends"
                smallest, largest = (f"{1e3 * slack:.4g}" for slack in span["slack"])
                least = f"over the motion, least at {span['least_slack_at']}"
                yield f"  slack{between} over the distance of {ends}: {smallest} to {largest} mm {least}"


def _held(what: str, end: Mapping[str, Any]) -> str:
    if end["held"] == "free":
        return f"{what} is free"
    return f"{what} is {end['held']} {'in the' if end['body'] == WORLD else 'to'} {end['body']}"


def _body_lines(content: Mapping[str, Any]) -> Iterator[str]:
    for name, body in content["bodies"].items():
        if body["kind"] == "hinge":
            point = f"the point {_place(body['point'])} mm"
            axis = f"the axis {_direction(body['axis'])}"
            start, stop = body["angles_deg"]
            words = f"turns about {axis} through {point}, from {start:.6g} to {stop:.6g} deg"
            words += _follows_words(body, lambda angle: f"{math.degrees(angle):.6g}", "deg")
        elif body["kind"] == "slide":
            start, stop = (_mm(travel) for travel in body["travel"])
            words = f"slides along {_direction(body['direction'])}, from {start} to {stop} mm"
            words += _follows_words(body, _mm, "mm")
        elif body["kind"] == "poses":
            words = f"follows the {body['count']} poses of {body['file'] or 'a table'}"
        elif body["kind"] == "free":
            words = f"hangs on its cables, {1e3 * body['mass']:.4g} g"
        else:
            words = "stands still" if body["parent"] == WORLD else "is fixed"
        carried = "" if body["parent"] == WORLD else f", on {body['parent']}"
        carried += f", at {_place(body['position'])} mm" if "position" in body else ""
        yield f"Body {name}{carried}: {words}."


def _follows_words(body: Mapping[str, Any], number: Callable[[float], str], unit: str) -> str:
    """Return the words for a course that a hinge or a slide follows."""
    course = body.get("follows")
    if course is None:
        return ""
    low, high = (number(value) for value in course["range"])
    if "count" in course:
        by = f"the {course['count']} rows of {course['file'] or 'a table'}"
    else:
        by = "one move" if course["moves"] == 1 else f"{course['moves']} moves"
    return f", by {by} in {course['seconds']:.6g} s, within {low} and {high} {unit}"


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

"""Checks of a problem that need more than one key: references, choices, names, bounds.

They walk nested tables, as a problem file has them: those of a file that is being read, in which ``INVALID`` stands
where a value is already known to be wrong, and those of a Problem made in Python. So one run names every mistake, none
twice, and both in the same words.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.between_keys import mistakes_of_bodies, mistakes_of_owner, mistakes_of_variables
from harness_opt.model.bodies import WORLD, Body
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.checks import (
    INVALID,
    ORIENTATIONS,
    KeyPath,
    Mistake,
    Tree,
    clip_tables,
    dotted,
    one_of,
    shown,
    table,
    value,
)
from harness_opt.model.design import Minimise
from harness_opt.model.ends import CLIP_KINDS, ENDS, NO_CLIP, End
from harness_opt.model.parts import UP_AXES, Box, MeshFile, Part, mesh_mistakes
from harness_opt.model.spans import too_short

LONGEST_NAME = 100  # letters; names become file names and array names
NAME_MARKS = " _-"  # what names may hold beside letters and digits: they become file names and array names
LINK_MARK = "."  # in names of bodies and parts, as robots' links have them
KINDS = {"cables": CableRun, "bodies": Body, "parts": Part}
AT_LEAST_0 = ("clearance",)  # of the limits; the others are above 0


def mistakes_between(tree: Tree) -> Iterator[Mistake]:
    """Yield the mistakes that only several keys show.

    Args:
        tree: the tables, with ``INVALID`` for values that are known to be wrong.
    """
    yield from _names(tree)
    for name in table(tree, "cables"):
        yield from _cable(tree, name)
    for name in table(tree, "parts"):
        yield from mistakes_of_owner(tree, ("parts", name), table(tree, "parts", name))
    yield from mistakes_of_bodies(tree)
    yield from _bend_radius(tree)
    yield from mistakes_of_variables(tree)


def _names(tree: Tree) -> Iterator[Mistake]:
    for section in ("cables", "bodies", "parts", "robots"):
        for name in table(tree, section):
            if len(name) > LONGEST_NAME:
                yield (
                    (section, name[:LONGEST_NAME]),
                    f"found a longer name, expected {LONGEST_NAME} letters at most",
                )
            elif not is_name(name, LINK_MARK if section in ("bodies", "parts") else ""):
                words = "expected a name of letters, digits, spaces, _ and -"
                yield (section, name), f"found the name {shown(name)}, {words}"
    if WORLD in table(tree, "bodies"):
        yield (
            ("bodies", WORLD),
            'found "world", expected another name: the world always exists and stands still',
        )


def is_name(name: str, also: str = "") -> bool:
    """Return whether ``name`` holds what names may hold, or the marks ``also``."""
    plain = all(c.isalnum() or c in NAME_MARKS + also for c in name)
    return bool(name) and name == name.strip(" .") and plain


# --- cables --------------------------------------------------------------------------------------------


def _cable(tree: Tree, name: str) -> Iterator[Mistake]:
    path, cable = ("cables", name), table(tree, "cables", name)
    if "density" in cable and "mass_per_length" in cable:
        yield (*path, "density"), "found mass_per_length as well, expected one of the two"
    ends, clips = {side: table(cable, side) for side in ENDS}, clip_tables(cable)
    for where, end in (
        *(((*path, side), end) for side, end in ends.items()),
        *(((*path, "clips", clip), table(clips, clip)) for clip in clips),
    ):
        yield from mistakes_of_owner(tree, where, end)
        yield from _holders(tree, (*where, "holders"), end)
        yield from _choices(where, end)
    yield from _clips(path, cable)
    yield from _turns(path, ends, clipped=bool(clips))
    given = all(isinstance(cable.get(side), Mapping) for side in ENDS)
    if given and not clips and not any("position" in end for end in ends.values()):
        words = "found no position at either end, expected one: the cable would fly away"
        yield (*path, "end", "position"), words


def _clips(path: KeyPath, cable: Tree) -> Iterator[Mistake]:
    """Check that the clips of a cable have names of their own and follow each other along it."""
    clips, last, before = clip_tables(cable), 0.0, "the start"
    names = [value(table(clips, key), "name") for key in clips]
    for key in clips:
        clip, here = table(clips, key), (*path, "clips", key)
        name, at = value(clip, "name"), value(clip, "at")
        if name in NO_CLIP or names.count(name) > 1:
            words = "a name of its own" if name not in NO_CLIP else f"another name than {', '.join(NO_CLIP)}"
            yield (*here, "name"), f"found {shown(name)}, expected {words}"
        elif isinstance(name, str) and not is_name(name):
            words = "expected a name of letters, digits, spaces, _ and -"
            yield (*here, "name"), f"found the name {shown(name)}, {words}"
        yield from _held(here, clip)
        if isinstance(at, (int, float)):
            if not at > last:
                yield (*here, "at"), f"found {shown(at)}, expected more than {last:g}, where {before} is"
            last, before = max(last, at), f"clip {shown(name)}"
    length = value(cable, "length")
    if clips and isinstance(length, (int, float)) and not last < length:
        yield (*path, "length"), f"found {shown(length)}, expected more than {last:g}, where its last clip is"


def _held(path: KeyPath, clip: Tree) -> Iterator[Mistake]:
    """Check that a clip holds the cable: its place and its section."""
    for load in ("force", "moment"):
        if load in clip:
            yield (*path, load), f"found a {load} at a clip, expected a position and a tangent: it holds the cable"
    if "position" not in clip:
        yield (*path, "position"), "found nothing, expected [x, y, z], three numbers: where the clip stands"
    kind = value(clip, "kind") or "fixed"
    if kind not in ("pivot", "ring") and not any(given in clip for given in ORIENTATIONS):
        yield (*path, "tangent"), "found nothing, expected [x, y, z], three numbers: the cable's direction there"
    if kind not in CLIP_KINDS:
        yield (*path, "kind"), f"found {shown(kind)}, expected {one_of(CLIP_KINDS, kind)}"
    for key in ("roll", "turns", "roll_deg")[: {"fixed": 0, "sleeve": 2}.get(kind, 3)]:
        if key in clip:
            yield (*path, key), f"found it at a {kind}, expected none: how the cable turns in it is found"
    if kind != "fixed":
        return
    if value(clip, "roll") == "free":
        yield (*path, "roll"), 'found "free" at a clip, expected "untwisted", or a roll that is given'
    turns, untwisted = value(clip, "turns"), "tangent" in clip and "roll_deg" not in clip
    if isinstance(turns, (int, float)) and turns != int(turns) and not untwisted:
        yield (*path, "turns"), f"found {shown(turns)}, expected a whole number: the roll is given"


def _holders(tree: Tree, path: KeyPath, end: Tree) -> Iterator[Mistake]:
    """Check that what holds the cable at an end are parts of the body that carries it."""
    names, body, parts = value(end, "holders"), end.get("body", WORLD), table(tree, "parts")
    if not isinstance(names, (list, tuple)) or body is INVALID:
        return
    bodies = {name: table(parts, name).get("body", WORLD) for name in parts}
    own = [name for name in bodies if bodies[name] == body]
    wanted = f"a part of {shown(body)}"
    for name in names:
        if name not in bodies:
            yield path, f"found {shown(name)}, expected {wanted}: {one_of(own, name) if own else 'it has none'}"
        elif bodies[name] not in (body, INVALID):
            yield path, f"found {shown(name)}, a part of {shown(bodies[name])}, expected {wanted}"


def _choices(path: KeyPath, end: Tree) -> Iterator[Mistake]:
    """Check what excludes each other at one end."""
    for *others, key in (
        ("position", "force"),
        (*ORIENTATIONS, "moment"),
        ORIENTATIONS,
        ("quaternion", "roll"),
        ("roll", "roll_deg"),
    ):
        for other in others:
            if other in end and key in end:
                yield (*path, key), f"found {other} as well, expected {other} or {key}"
    for key in ("roll", "roll_deg"):
        if key in end and "tangent" not in end and not (key == "roll" and "quaternion" in end):
            yield (*path, "tangent"), f"found nothing, expected a tangent for {key} to turn about"


def _turns(path: KeyPath, ends: Mapping[str, Tree], *, clipped: bool) -> Iterator[Mistake]:
    """Check that turns stand where they count, between ends that hold the cable, and are whole unless untwisted."""
    for own, end in ends.items():
        turns, key = value(end, "turns"), (*path, own, "turns")
        if not turns:
            continue
        untwisted = "tangent" in end and "roll_deg" not in end and value(end, "roll") != "free"
        if own == "start" and not untwisted:
            yield key, f"found {shown(turns)}, expected turns at the cable's end only, or at an untwisted start"
        elif not untwisted and turns != int(turns):
            yield key, f"found {shown(turns)}, expected a whole number: the roll is given"
        for side, other in ends.items():
            if clipped and side != own:  # a clip holds the span there
                continue
            if not any(name in other for name in ORIENTATIONS):
                yield key, f"found {shown(turns)}, expected 0, as the {side} has neither quaternion nor tangent"
            elif value(other, "roll") == "free":
                yield key, f"found {shown(turns)}, expected 0, as {'it' if side == own else f'the {side}'} turns freely"


# --- limits ----------------------------------------------------------------------------------


def _bend_radius(tree: Tree) -> Iterator[Mistake]:
    limit, cables = value(table(tree, "limits"), "bend_radius"), table(tree, "cables")
    diameters = {name: value(table(cables, name), "diameter") for name in cables}
    own = {name: value(table(cables, name), "bend_radius") for name in cables}
    for name, radius in own.items():
        if radius is not None and diameters.pop(name) is not None and radius < 0.5 * cables[name]["diameter"]:
            words = f"expected at least {0.5 * cables[name]['diameter']:.6g}, half the diameter"
            yield ("cables", name, "bend_radius"), f"found {shown(radius)}, {words}"
    thick = max((name for name, d in diameters.items() if d is not None), key=lambda n: diameters[n], default=None)
    if limit is not None and thick is not None and limit < 0.5 * diameters[thick]:
        words = f"expected at least {0.5 * diameters[thick]:.6g}, half the diameter of cable {thick!r}"
        yield ("limits", "bend_radius"), f"found {shown(limit)}, {words}"


# --- a Problem made in Python ---------------------------------------------------------------------------


def mistakes_of(problem: Any) -> list[str]:
    """Return what is wrong about a Problem, a line each: ``cables.lead.end.body: found "amr", expected ...``.

    Args:
        problem: which calls this while it is made.
    """
    wrong = [*_kinds(problem)]
    if wrong:  # what is of another kind cannot be looked into
        return wrong
    found = checks.Gathered()
    found.told += [f"{dotted(path)}: {words}" for path, words in mistakes_between(_tree(problem))]
    if not problem.cables:
        found.told.append("cables: found an empty table, expected at least one cable")
    for one in problem.design.variables:
        if not (_is_number(one.lower) and _is_number(one.upper)):
            key = dotted(("design", "variables", one.name))
            found.told.append(f"{key}: found {shown([one.lower, one.upper])}, expected [lower, upper], two numbers")
    if not isinstance(problem.title, str):
        found.told.append(f"title: found {shown(problem.title)}, expected text in quotes")
    with found:
        checks.numbers("gravity", problem.gravity, 3)
    with found:
        checks.positive("motion.duration", problem.duration)
    if problem.spatial_step is not None:
        with found:
            checks.positive("motion.spatial_step", problem.spatial_step)
    for name, limit in vars(problem.limits).items():
        if limit is not None:
            with found:
                checks.positive(f"limits.{name}", limit, zero=name in AT_LEAST_0)
    for name, body in problem.bodies.items():
        with found:
            checks.numbers(f"{dotted(('bodies', name))}.position", body.position, 3)
        with found:
            checks.quaternion(f"{dotted(('bodies', name))}.quaternion", body.quaternion)
    for name, part in problem.parts.items():
        _part_values(found, ("parts", name), part)
    minimise = problem.design.minimise
    if minimise not in get_args(Minimise):
        found.told.append(f"design.minimise: found {shown(minimise)}, expected {one_of(get_args(Minimise))}")
    if not found.told:  # what a redesign may lengthen or move is for a simulation to refuse
        free = [one.name for one in (*problem.design.variables, *problem.design.couplings)]
        fixed = [name for name in problem.cables if not any(key.startswith(f"{name}.") for key in free)]
        found.told += [one.message for one in too_short(problem, fixed)]
    return found.told


def _kinds(problem: Any) -> Iterator[str]:
    """Yield what is of another kind than it has to be."""
    for section, kind in KINDS.items():
        named = getattr(problem, section)
        if not isinstance(named, Mapping):
            yield f"{section}: found {type(named).__name__}, expected {kind.__name__}s by name, such as {{'lead': ...}}"
            continue
        for name, one in named.items():
            if not isinstance(one, kind):
                more = ": a cable with its two ends" if isinstance(one, Cable) else ""
                yield f"{dotted((section, str(name)))}: found {type(one).__name__}, expected {kind.__name__}{more}"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _part_values(found: checks.Gathered, path: tuple[str, ...], part: Part) -> None:
    key, shape = dotted(path), part.shape
    if part.clearance is not None:
        with found:
            checks.positive(f"{key}.clearance", part.clearance, zero=True)
    with found:
        checks.numbers(f"{key}.position", part.position, 3)
    with found:
        checks.quaternion(f"{key}.quaternion", part.quaternion)
    if isinstance(shape, MeshFile):
        found.told += [f"{key}.{name}: {words}" for name, words in mesh_mistakes(str(shape.path), shape.unit)]
        if shape.up not in (None, *UP_AXES):
            found.told.append(f"{key}.up: found {shown(shape.up)}, expected {one_of(UP_AXES)}")
        with found:
            checks.numbers(f"{key}.mesh_scale", shape.scale, 3)
            if not all(shape.scale):
                words = "expected a number that is not 0, or [x, y, z], three such numbers"
                raise ProblemError(f"{key}.mesh_scale: found {shown(shape.scale)}, {words}")
        return
    kind = f"{key}.{type(shape).__name__.lower()}"
    if isinstance(shape, Box):
        with found:
            for side in checks.numbers(f"{kind}.size", shape.size, 3):
                checks.positive(f"{kind}.size", side)
        return
    for name, size in vars(shape).items():
        with found:
            checks.positive(f"{kind}.{name}", size)


def _tree(problem: Any) -> dict[str, Any]:
    """Return the tables that a problem file would have, as far as their keys and references go."""
    design = problem.design
    variables: dict[str, Any] = {
        one.name: [one.lower, one.upper] if _is_number(one.lower) and _is_number(one.upper) else INVALID
        for one in design.variables
    }
    variables |= {one.name: f"= {one.words}" for one in design.couplings}
    return {
        "cables": {name: _run_table(run) for name, run in problem.cables.items()},
        "bodies": {
            name: {"parent": body.parent, "free": body.free, "mass": body.mass} for name, body in problem.bodies.items()
        },
        "parts": {name: {"body": part.body} for name, part in problem.parts.items()},
        "limits": {"bend_radius": problem.limits.bend_radius or None},
        "design": {"variables": variables, "weights": dict(design.weights), "minimise": design.minimise},
    }


def _run_table(run: CableRun) -> dict[str, Any]:
    own = {"diameter": run.cable.diameter, "length": run.cable.length, "bend_radius": run.bend_radius}
    clips = [_end_table(clip) for clip in run.clips]
    ends = {"start": _end_table(run.start), "end": _end_table(run.end)}
    return {**own, **ends, **({"clips": clips} if clips else {})}


def _end_table(end: End) -> dict[str, Any]:
    given = {name: value for name, value in vars(end).items() if value is not None}
    return {name: value for name, value in given.items() if name not in ("swivel", "turns") or value}

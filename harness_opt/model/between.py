"""Checks of a problem that need more than one key: references, choices, names, bounds.

They walk nested tables, as a problem file has them: those of a file that is being read, in which ``INVALID`` stands
where a value is already known to be wrong, and those of a Problem made in Python. So one run names every mistake, none
twice, and both in the same words.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, get_args

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.bodies import WORLD, Body
from harness_opt.model.cable import Cable, CableRun, End
from harness_opt.model.checks import KeyPath, Mistake, coupling, dotted, one_of, shown
from harness_opt.model.design import Minimise
from harness_opt.model.parts import Box, MeshFile, Part
from harness_opt.model.reach import too_short

Tree = Mapping[str, Any]
INVALID = object()  # in the place of a value that is known to be wrong

SIDES = ("start", "end")
ORIENTATIONS = ("quaternion", "tangent")  # what gives an end its section frame
LONGEST_NAME = 100  # letters; names become file names and array names
NAME_MARKS = " _-"  # what names may hold beside letters and digits: they become file names and array names
LINK_MARK = "."  # in names of bodies and parts, as robots' links have them
KINDS = {"cables": CableRun, "bodies": Body, "parts": Part}
AT_LEAST_0 = ("clearance",)  # of the limits; the others are above 0


def table(tree: Any, *path: str) -> Tree:
    """Return the table at ``path``; an empty one where there is none."""
    for key in path:
        tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree if isinstance(tree, Mapping) else {}


def value(tree: Tree, key: str) -> Any:
    """Return the value of ``key``, or None where it is missing or already named as wrong."""
    found = tree.get(key)
    return None if found is INVALID else found


def mistakes_between(tree: Tree) -> Iterator[Mistake]:
    """Yield the mistakes that only several keys show.

    Args:
        tree: the tables, with ``INVALID`` for values that are known to be wrong.
    """
    yield from _names(tree)
    for name in table(tree, "cables"):
        yield from _cable(tree, name)
    for name in table(tree, "parts"):
        yield from _body(tree, ("parts", name), table(tree, "parts", name))
    for name in table(tree, "bodies"):
        yield from _body(tree, ("bodies", name), table(tree, "bodies", name), "parent")
    yield from _circles(table(tree, "bodies"))
    yield from _bend_radius(tree)
    yield from _variables(tree)


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


def _body(tree: Tree, path: KeyPath, owner: Tree, key: str = "body") -> Iterator[Mistake]:
    """Check that the body which ``owner`` names exists."""
    name, bodies = value(owner, key), tree.get("bodies", {})
    if name is None or not isinstance(bodies, Mapping):
        return
    known = [WORLD, *(body for body in bodies if body != WORLD)]
    if name not in known:
        yield (*path, key), f"found {shown(name)}, expected {one_of(known, name)}"


def _circles(bodies: Tree) -> Iterator[Mistake]:
    """Check that no body carries itself, however many are between; each circle is told once."""
    told: set[str] = set()
    for name in bodies:
        way = [name]
        while True:
            parent = value(table(bodies, way[-1]), "parent")
            if not isinstance(parent, str) or parent == WORLD or parent not in bodies or parent in told:
                break
            if parent in way:
                circle = [*way[way.index(parent) :], parent]
                around = " on ".join(shown(one) for one in circle)
                yield ("bodies", parent, "parent"), f"found a circle, {around}, expected one that leads to the world"
                break
            way.append(parent)
        told.update(way)


# --- cables --------------------------------------------------------------------------------------------


def _cable(tree: Tree, name: str) -> Iterator[Mistake]:
    path, cable = ("cables", name), table(tree, "cables", name)
    if "density" in cable and "mass_per_length" in cable:
        yield (*path, "density"), "found mass_per_length as well, expected one of the two"
    ends = {side: table(cable, side) for side in SIDES}
    for side, end in ends.items():
        yield from _body(tree, (*path, side), end)
        yield from _holders(tree, (*path, side, "holders"), end)
        yield from _choices((*path, side), end)
    yield from _turns(path, ends)
    given = all(isinstance(cable.get(side), Mapping) for side in SIDES)
    if given and not any("position" in end for end in ends.values()):
        words = "found no position at either end, expected one: the cable would fly away"
        yield (*path, "end", "position"), words


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


def _turns(path: KeyPath, ends: Mapping[str, Tree]) -> Iterator[Mistake]:
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
            if not any(name in other for name in ORIENTATIONS):
                yield key, f"found {shown(turns)}, expected 0, as the {side} has neither quaternion nor tangent"
            elif value(other, "roll") == "free":
                yield key, f"found {shown(turns)}, expected 0, as the {side} turns freely"


# --- limits ----------------------------------------------------------------------------------


def _bend_radius(tree: Tree) -> Iterator[Mistake]:
    limit = value(table(tree, "limits"), "bend_radius")
    diameters = {name: value(table(tree, "cables", name), "diameter") for name in table(tree, "cables")}
    thick = max((name for name, d in diameters.items() if d is not None), key=lambda n: diameters[n], default=None)
    if limit is not None and thick is not None and limit < 0.5 * diameters[thick]:
        words = f"expected at least {0.5 * diameters[thick]:.6g}, half the diameter of cable {thick!r}"
        yield ("limits", "bend_radius"), f"found {shown(limit)}, {words}"


# --- design --------------------------------------------------------------------------------------------


def variables_of(cable: str) -> dict[str, tuple[str, str] | None]:
    """Return the design variables of a cable by name: side and what it needs there; None for its length."""
    names: dict[str, tuple[str, str] | None] = {f"{cable}.length": None}
    for side in SIDES:
        for axis in "xyz":
            names[f"{cable}.{side}.position.{axis}"] = (side, "position")
            names[f"{cable}.{side}.rotate_{axis}_deg"] = (side, "orientation")
    return names


def _variables(tree: Tree) -> Iterator[Mistake]:
    if "cables" not in tree or tree["cables"] is INVALID:
        return
    known = {name: (cable, need) for cable in table(tree, "cables") for name, need in variables_of(cable).items()}
    given = table(tree, "design", "variables")
    for name, bounds in given.items():
        path = ("design", "variables", name)
        if isinstance(bounds, Mapping):
            continue
        if name not in known:
            yield path, f"found an unknown variable, expected {_nearest_variable(known, name)}"
            continue
        cable, need = known[name]
        if need is not None:
            yield from _given(path, tree, cable, need)
        if isinstance(bounds, str):
            yield from _coupling(path, bounds, given)
        elif bounds is not INVALID:
            yield from _bounds(path, bounds, is_length=need is None)
    yield from _preferences(tree, {name for name, bounds in given.items() if not isinstance(bounds, str)})


def _coupling(path: KeyPath, text: str, given: Tree) -> Iterator[Mistake]:
    """Check what follows another variable: one with bounds, in the same unit."""
    found, name = coupling(text), path[-1]
    free = [other for other, bounds in given.items() if not isinstance(bounds, str)]
    if found is None:
        words = (
            'expected text such as "= lead.start.position.x", "= -lead.end.rotate_x_deg" or "= 2 * lead.length + 0.01"'
        )
        yield path, f"found {shown(text)}, {words}"
    elif found[0] not in free:
        yield path, f"found {shown(text)}, expected a variable with bounds: {one_of(free, found[0])}"
    elif found[0].endswith("_deg") != name.endswith("_deg"):
        yield path, f"found {shown(text)}, expected a variable in the same unit"
    elif name.endswith(".length") and isinstance(given[found[0]], (list, tuple)):
        least = min(found[1] * bound + found[2] for bound in given[found[0]])
        if not least > 0:
            yield path, f"found {shown(text)}, which may be {least:.6g}, expected a length above 0"


def _preferences(tree: Tree, free: set[str]) -> Iterator[Mistake]:
    """Check what a redesign prefers."""
    design = table(tree, "design")
    for name in table(design, "weights"):
        if name not in free:
            found = "found a weight of no variable with bounds"
            yield ("design", "weights", name), f"{found}, expected {one_of(sorted(free), name) or 'variables first'}"
    if "maximise" in design and "minimise" in design:
        yield ("design", "maximise"), "found minimise as well, expected one of the two"


def _nearest_variable(known: Mapping[str, Any], name: str) -> str:
    """Return what to type in the place of ``name``; the whole list would fill the screen."""
    forms = "CABLE.length, CABLE.start.position.x or CABLE.end.rotate_x_deg and the like"
    nearest = one_of(known, name).partition("; ")[2]
    return f"{forms}; {nearest}" if nearest else forms


def _given(path: KeyPath, tree: Tree, cable: str, need: tuple[str, str]) -> Iterator[Mistake]:
    """Check that the end which a variable moves or turns has what it changes."""
    side, what = need
    end = tree["cables"][cable].get(side) if isinstance(tree["cables"][cable], Mapping) else None
    keys = ORIENTATIONS if what == "orientation" else ("position",)
    if isinstance(end, Mapping) and not any(key in end for key in keys):
        yield (
            path,
            f"found no {' or '.join(keys)} in cables.{cable}.{side}, expected one for the variable to change",
        )


def _bounds(path: KeyPath, bounds: Any, *, is_length: bool) -> Iterator[Mistake]:
    lower, upper = bounds
    if not lower < upper:
        yield path, f"found {shown(bounds)}, expected [lower, upper] with the lower bound below the upper"
    if is_length and not lower > 0:
        yield path, f"found {shown(bounds)}, expected a lower bound above 0 for a length"


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
        found.told += too_short(problem, fixed).values()
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
        with found:
            checks.numbers(f"{key}.mesh_scale", shape.scale, 3)
            if not all(shape.scale):
                raise ProblemError(f"{key}.mesh_scale: found {shown(shape.scale)}, expected numbers that are not 0")
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
    variables: dict[str, Any] = {one.name: [one.lower, one.upper] for one in design.variables}
    variables |= {one.name: f"= {one.words}" for one in design.couplings}
    return {
        "cables": {name: _run_table(run) for name, run in problem.cables.items()},
        "bodies": {name: {"parent": body.parent} for name, body in problem.bodies.items()},
        "parts": {name: {"body": part.body} for name, part in problem.parts.items()},
        "limits": {"bend_radius": problem.limits.bend_radius or None},
        "design": {"variables": variables, "weights": dict(design.weights)},
    }


def _run_table(run: CableRun) -> dict[str, Any]:
    return {"diameter": run.cable.diameter, "start": _end_table(run.start), "end": _end_table(run.end)}


def _end_table(end: End) -> dict[str, Any]:
    given = {name: value for name, value in vars(end).items() if value is not None}
    return {name: value for name, value in given.items() if name not in ("swivel", "turns") or value}

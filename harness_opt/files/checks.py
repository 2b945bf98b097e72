"""Checks of a problem file that need more than one key: references, choices, names, bounds.

They walk the tree that :func:`~harness_opt.files.schema.structured` leaves: plain tables, ``INVALID`` where a
value is already known to be wrong. So one run names every mistake, and none twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from harness_opt.files.places import MOST_MESH_BYTES, Places
from harness_opt.files.schema import INVALID, MESHES_IN_METRES, PART_SHAPES, UNITLESS_MESHES
from harness_opt.files.values import MESH_UNITS, KeyPath, Mistake, coupling, one_of, shown
from harness_opt.model.bodies import WORLD

Tree = Mapping[str, Any]

SIDES = ("start", "end")
ORIENTATIONS = ("quaternion", "tangent")  # what gives an end its section frame
LONGEST_NAME = 100  # letters; names become file names and array names
NAME_MARKS = " _-"  # what names may hold beside letters and digits: they become file names and array names


def table(tree: Any, *path: str) -> Tree:
    """Return the table at ``path``; an empty one where there is none."""
    for key in path:
        tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree if isinstance(tree, Mapping) else {}


def value(tree: Tree, key: str) -> Any:
    """Return the value of ``key``, or None where it is missing or already named as wrong."""
    found = tree.get(key)
    return None if found is INVALID else found


def mistakes_between(tree: Tree, places: Places) -> Iterator[Mistake]:
    """Yield the mistakes that only several keys, or a mesh file, show.

    Args:
        tree: the tables, with ``INVALID`` for values that are known to be wrong.
        places: where meshes may lie.
    """
    yield from _names(tree)
    for name in table(tree, "cables"):
        yield from _cable(tree, name)
    for name in table(tree, "parts"):
        yield from _part(tree, name, places)
    yield from _bend_radius(tree)
    yield from _variables(tree)


def _names(tree: Tree) -> Iterator[Mistake]:
    for section in ("cables", "bodies", "parts"):
        for name in table(tree, section):
            if len(name) > LONGEST_NAME:
                yield (
                    (section, name[:LONGEST_NAME]),
                    f"found a longer name, expected {LONGEST_NAME} letters at most",
                )
            elif not name or name != name.strip() or not all(c.isalnum() or c in NAME_MARKS for c in name):
                words = "expected a name of letters, digits, spaces, _ and -"
                yield (section, name), f"found the name {shown(name)}, {words}"
    if WORLD in table(tree, "bodies"):
        yield (
            ("bodies", WORLD),
            'found "world", expected another name: the world always exists and stands still',
        )


def _body(tree: Tree, path: KeyPath, owner: Tree) -> Iterator[Mistake]:
    """Check that the body which ``owner`` names exists."""
    name, bodies = value(owner, "body"), tree.get("bodies", {})
    if name is None or not isinstance(bodies, Mapping):
        return
    known = [WORLD, *(body for body in bodies if body != WORLD)]
    if name not in known:
        yield (*path, "body"), f"found {shown(name)}, expected {one_of(known, name)}"


# --- cables --------------------------------------------------------------------------------------------


def _cable(tree: Tree, name: str) -> Iterator[Mistake]:
    path, cable = ("cables", name), table(tree, "cables", name)
    if "density" in cable and "mass_per_length" in cable:
        yield (*path, "density"), "found mass_per_length as well, expected one of the two"
    ends = {side: table(cable, side) for side in SIDES}
    for side, end in ends.items():
        yield from _body(tree, (*path, side), end)
        yield from _choices((*path, side), end)
    yield from _turns(path, ends)
    given = all(isinstance(cable.get(side), Mapping) for side in SIDES)
    if given and not any("position" in end for end in ends.values()):
        words = "found no position at either end, expected one: the cable would fly away"
        yield (*path, "end", "position"), words


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


# --- parts and limits ----------------------------------------------------------------------------------


def _part(tree: Tree, name: str, places: Places) -> Iterator[Mistake]:
    path, part = ("parts", name), table(tree, "parts", name)
    if not isinstance(tree["parts"][name], Mapping):
        return
    yield from _body(tree, path, part)
    shapes = [shape for shape in PART_SHAPES if shape in part]
    if len(shapes) != 1:
        found = " and ".join(shapes) or "no shape"
        yield path, f"found {found}, expected exactly one of {', '.join(PART_SHAPES)}"
    for key, words in (("mesh_unit", "a unit"), ("mesh_sha256", "a SHA-256"), ("shell", "a shell"), ("up", "an axis")):
        if key in part and "mesh" not in part:
            yield (*path, key), f"found {words} without a mesh, expected it beside mesh only"
    if value(part, "mesh") is not None:
        yield from _mesh(path, part, places)


def _mesh(path: KeyPath, part: Tree, places: Places) -> Iterator[Mistake]:
    """Check the suffix, the unit, the place and the presence of a mesh file; what is in it is the scene's to read."""
    mesh = part["mesh"]
    suffix = Path(mesh).suffix.lower()
    known = (*UNITLESS_MESHES, *MESHES_IN_METRES)
    if suffix not in known:
        yield (*path, "mesh"), f"found {shown(mesh)}, expected a file ending in {one_of(known, suffix)}"
    elif suffix in UNITLESS_MESHES and "mesh_unit" not in part:
        words = f"expected {one_of(MESH_UNITS)}: {suffix} files carry no unit"
        yield (*path, "mesh_unit"), f"found nothing, {words}"
    why = places.fault(mesh, "a mesh", value(part, "mesh_sha256"), MOST_MESH_BYTES)
    if why:
        yield (*path, "mesh"), why


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

"""Checks between keys: of design variables and their bounds, of bodies and what carries and holds them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from harness_opt.model.bodies import WORLD
from harness_opt.model.checks import (
    INVALID,
    ORIENTATIONS,
    KeyPath,
    Mistake,
    Tree,
    clip_tables,
    coupling,
    one_of,
    shown,
    table,
    value,
)
from harness_opt.model.ends import ENDS


def variables_of(cable: str, clips: Sequence[str] = ()) -> dict[str, tuple[str, str] | None]:
    """Return the design variables of a cable by name: clamp and what it needs there; None for arc lengths."""
    names: dict[str, tuple[str, str] | None] = {f"{cable}.length": None}
    names |= {f"{cable}.{clip}.at": None for clip in clips}
    for side in (*ENDS, *clips):
        for axis in "xyz":
            names[f"{cable}.{side}.position.{axis}"] = (side, "position")
            names[f"{cable}.{side}.rotate_{axis}_deg"] = (side, "orientation")
    return names


def mistakes_of_variables(tree: Tree) -> Iterator[Mistake]:
    """Yield what is wrong about design variables, and about what a redesign prefers among them.

    Args:
        tree: the tables, with ``INVALID`` for values that are known to be wrong.
    """
    if "cables" not in tree or tree["cables"] is INVALID:
        return
    known = {
        name: (cable, need)
        for cable in table(tree, "cables")
        for name, need in variables_of(cable, list(clip_tables(table(tree, "cables", cable)))).items()
    }
    given = table(tree, "design", "variables")
    for name, bounds in given.items():
        path = ("design", "variables", name)
        if isinstance(bounds, Mapping):
            continue
        if name not in known:
            yield path, f"found an unknown variable, expected {_nearest_variable(known, name)}"
            continue
        cable, need = known[name]
        clip = _slides(table(tree, "cables", cable), name)
        if clip is not None:
            yield path, f"found the place of clip {shown(clip)}, through which the cable slides: it is found"
        if need is not None:
            yield from _given(path, tree, cable, need)
        if isinstance(bounds, str):
            yield from _coupling(path, bounds, given)
        elif bounds is not INVALID:
            yield from _bounds(path, bounds, is_length=need is None)
    yield from _preferences(tree, {name for name, bounds in given.items() if not isinstance(bounds, str)})


def _slides(cable: Tree, variable: str) -> str | None:
    """Return the clip whose place a variable is, where the cable slides through it; else None."""
    for name in clip_tables(cable):
        sliding = value(table(clip_tables(cable), name), "kind") in ("sleeve", "ring")
        if sliding and variable.endswith(f".{name}.at"):
            return name
    return None


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
    elif name.endswith((".length", ".at")) and isinstance(given[found[0]], (list, tuple)):
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
    optional = any(
        value(table(clips, name), "optional")
        for cable in table(tree, "cables")
        for clips in (clip_tables(table(tree, "cables", cable)),)
        for name in clips
    )
    if value(design, "minimise") == "clips" and not optional:
        yield ("design", "minimise"), 'found "clips", expected a clip with optional = true to do without'
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
    given = table(tree, "cables", cable)
    end = {**clip_tables(given), **{name: given.get(name) for name in ENDS}}.get(side)
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


# --- bodies -----------------------------------------------------------------------------------------------


def mistakes_of_bodies(tree: Tree) -> Iterator[Mistake]:
    """Yield the mistakes between bodies: what carries them, and what holds those that are free."""
    for name in table(tree, "bodies"):
        yield from mistakes_of_owner(tree, ("bodies", name), table(tree, "bodies", name), "parent")
    yield from _circles(table(tree, "bodies"))
    yield from _free(tree)


def mistakes_of_owner(tree: Tree, path: KeyPath, owner: Tree, key: str = "body") -> Iterator[Mistake]:
    """Check that the body which ``owner`` names exists."""
    name, bodies = value(owner, key), tree.get("bodies", {})
    if name is None or not isinstance(bodies, Mapping):
        return
    if not isinstance(name, str):
        yield (*path, key), f"found {shown(name)}, expected text in quotes"
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


def _free(tree: Tree) -> Iterator[Mistake]:
    """Check that free bodies go where their cables let them, and that these hold them."""
    bodies, held = table(tree, "bodies"), {WORLD}
    free = [name for name in bodies if value(table(bodies, name), "free") is True]
    for name in free:
        body, path = table(bodies, name), ("bodies", name)
        if body.get("motion") is not None:
            yield (*path, "motion"), "found one, expected none: a free body goes where its cables let it"
        if value(body, "parent") not in (None, WORLD):
            yield (*path, "parent"), f"found {shown(body['parent'])}, expected none: it hangs on its cables alone"
    for name in bodies:
        if value(table(bodies, name), "mass") and name not in free:
            yield ("bodies", name, "mass"), f"found {shown(bodies[name]['mass'])}, expected free = true beside it"
    joined = [_roots(bodies, table(tree, "cables", cable)) for cable in table(tree, "cables")]
    held |= {root for roots in joined for root in roots if root not in free}
    while any(held & roots and roots - held for roots in joined):
        held |= set().union(*(roots for roots in joined if held & roots))
    for name in free:
        if name not in held:
            words = "found no cable that leads from it to what stands or moves, expected one: nothing holds it"
            yield ("bodies", name, "free"), words


def _roots(bodies: Tree, cable: Tree) -> set[str]:
    """Return the bodies that at last carry what holds the place of a cable."""
    clips, roots = clip_tables(cable), set()
    for clamp in (table(cable, "start"), table(cable, "end"), *(table(clips, key) for key in clips)):
        body, way = value(clamp, "body") or WORLD, 0
        while (parent := value(table(bodies, body), "parent")) not in (None, WORLD) and way < len(bodies):
            body, way = parent, way + 1
        if "position" in clamp:
            roots.add(body)
    return roots

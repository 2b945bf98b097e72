"""Files that a problem file names: meshes, which are looked for, and libraries of cables, which are read.

A library is a TOML file with a table for each cable. ``from = "my_cables.toml#power"`` takes from its table ``[power]``
what the cable does not say itself.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from harness_opt.files.places import MEGABYTE, MOST_MESH_BYTES, Places
from harness_opt.files.schema import PART_SHAPES
from harness_opt.model.checks import INVALID, KeyPath, Mistake, Tree, one_of, shown, table, value
from harness_opt.model.parts import mesh_mistakes

MOST_LIBRARY_BYTES = MEGABYTE
OF_A_LIBRARY = (
    "diameter", "bending_stiffness", "torsional_stiffness", "density", "mass_per_length", "rest_curvature",
    "bend_radius_factors",
)  # fmt: skip
OF_A_MESH = {
    "mesh_unit": "a unit", "mesh_scale": "a scale", "mesh_sha256": "a SHA-256", "shell": "a shell", "up": "an axis",
}  # fmt: skip
NEEDED = ("diameter", "bending_stiffness", "torsional_stiffness")
MASSES = ("density", "mass_per_length")


def mistakes_of_parts(tree: Tree, places: Places) -> Iterator[Mistake]:
    """Yield what is wrong about the shapes of parts.

    Args:
        tree: the tables, with ``INVALID`` for values that are known to be wrong.
        places: where meshes may lie.
    """
    for name in table(tree, "parts"):
        yield from _part(tree, name, places)


def _part(tree: Tree, name: str, places: Places) -> Iterator[Mistake]:
    path, part = ("parts", name), table(tree, "parts", name)
    if not isinstance(tree["parts"][name], Mapping):
        return
    shapes = [shape for shape in PART_SHAPES if shape in part]
    if len(shapes) != 1:
        found = " and ".join(shapes) or "no shape"
        yield path, f"found {found}, expected exactly one of {', '.join(PART_SHAPES)}"
    for key, words in OF_A_MESH.items():
        if key in part and "mesh" not in part:
            yield (*path, key), f"found {words} without a mesh, expected it beside mesh only"
    if value(part, "mesh") is not None:
        yield from _mesh(path, part, places)


def _mesh(path: KeyPath, part: Tree, places: Places) -> Iterator[Mistake]:
    """Check the suffix, the unit, the place and the presence of a mesh file; what is in it is the scene's to read."""
    mesh = part["mesh"]
    for key, words in mesh_mistakes(mesh, "m" if "mesh_unit" in part else None):
        yield (*path, key), words
    why = places.fault(mesh, "a mesh", value(part, "mesh_sha256"), MOST_MESH_BYTES)
    if why:
        yield (*path, "mesh"), why


# --- libraries of cables -------------------------------------------------------------------------------


def with_cables(raw: Mapping[str, Any], places: Places, own: Path) -> tuple[dict[str, Any], list[Mistake]]:
    """Return the tables of a problem file with what its cables take from libraries, and the mistakes met.

    Args:
        raw: the nested tables, as TOML has them.
        places: where libraries may lie.
        own: the problem file, which is no library.
    """
    cables = raw.get("cables")
    if not isinstance(cables, Mapping):
        return dict(raw), []
    filled, mistakes = dict(cables), list[Mistake]()
    for name, cable in cables.items():
        if not isinstance(cable, Mapping) or not isinstance(cable.get("from"), str):
            continue
        path = ("cables", str(name), "from")
        taken, wrong = _taken(cable["from"], places, own)
        mistakes += [(path, words) for words in wrong]
        if wrong and not taken:  # what it would have said is not missing
            taken = dict.fromkeys(NEEDED, INVALID)
        if any(mass in cable for mass in MASSES):
            taken = {key: value for key, value in taken.items() if key not in MASSES}
        filled[name] = {**taken, **cable}
        if taken and not wrong:
            mistakes += [
                (("cables", str(name), key), f"found nothing, here or in {cable['from']}, expected a number above 0")
                for key in NEEDED
                if key not in filled[name]
            ]
    return {**raw, "cables": filled}, mistakes


def _taken(reference: str, places: Places, own: Path) -> tuple[dict[str, Any], list[str]]:
    """Return what a library says of a cable, and what is wrong with it."""
    try:
        table = _table_of(reference, places, own)
    except Refused as error:
        return {}, [str(error)]
    strange = [key for key in table if key not in OF_A_LIBRARY]
    wrong = [f"found {shown(key)} in {reference}, expected {one_of(OF_A_LIBRARY, key)}" for key in strange]
    return {key: value for key, value in table.items() if key in OF_A_LIBRARY}, wrong


class Refused(ValueError):
    """A reference that leads to no cable; in words."""


def _table_of(reference: str, places: Places, own: Path) -> Mapping[str, Any]:
    """Return the table of a cable in a library.

    Raises:
        Refused: there is none that may be read.
    """
    name, _, cable = reference.partition("#")
    if not (name and cable):
        raise Refused(f'found {shown(reference)}, expected a file and a cable, such as "my_cables.toml#power"')
    file, why = places.located(name), places.fault(name, "a library of cables", None, MOST_LIBRARY_BYTES)
    if why:
        raise Refused(why)
    if file == own:
        raise Refused(f"found {shown(reference)}, the problem file itself, expected a library of cables")
    try:
        tables = tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise Refused(f"found {shown(name)}, which can't be read ({error}), expected TOML") from None
    known = [key for key, table in tables.items() if isinstance(table, dict)]
    if cable not in known:
        raise Refused(f"found {shown(reference)}, expected {one_of(known, cable) or 'a table for each cable'} in it")
    if "from" in tables[cable]:
        raise Refused(f"found {shown(reference)}, which refers to another cable itself, expected its own values")
    found: Mapping[str, Any] = tables[cable]
    return found


def library_of(reference: str, places: Places) -> Path:
    """Return the file of a reference such as ``my_cables.toml#power``."""
    return places.located(reference.partition("#")[0])


def mistakes_of_limits(tree: Tree) -> Iterator[Mistake]:
    """Yield what is wrong about a bend limit in diameters."""
    limits, path = table(tree, "limits"), ("limits", "bend_radius_factor")
    factor = value(limits, "bend_radius_factor")
    if factor is None:
        return
    if "bend_radius" in limits:
        yield path, "found bend_radius as well, expected one of the two"
    for name in table(tree, "cables"):
        cable = table(tree, "cables", name)
        told = table(cable, "bend_radius_factors").get(factor) if isinstance(factor, str) else factor
        if "bend_radius" in cable:
            yield path, f"found cables.{name}.bend_radius as well, expected one of the two"
        if told is None:
            words = f"expected it in cables.{name}.bend_radius_factors, or in the library that the cable is from"
            yield path, f"found {shown(factor)}, {words}"


def bend_radii(limits: Any, cables: Mapping[str, Any]) -> tuple[float | None, dict[str, float | None]]:
    """Return the bend limit of a file for all cables, m, and those of their own by name.

    A limit in diameters that is the same for all is one for all.
    """
    own = {name: cable.bend_radius for name, cable in cables.items()}
    factor = limits.bend_radius_factor
    if factor is None:
        return limits.bend_radius, own
    radii = {
        name: float((cable.bend_radius_factors[factor] if isinstance(factor, str) else factor) * cable.diameter)
        for name, cable in cables.items()
    }
    return (next(iter(radii.values())), own) if len(set(radii.values())) == 1 else (None, {**radii})

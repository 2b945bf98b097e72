"""Checks of a problem file that need several keys of a part, or its mesh; the others stand in ``model/between``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from harness_opt.files.places import MOST_MESH_BYTES, Places
from harness_opt.files.schema import MESHES_IN_METRES, PART_SHAPES, UNITLESS_MESHES
from harness_opt.files.values import MESH_UNITS
from harness_opt.model.between import Tree, table, value
from harness_opt.model.words import KeyPath, Mistake, one_of, shown

NOT_READ = (".stp", ".step", ".igs", ".iges", ".x_t", ".sldprt", ".sldasm", ".ipt", ".catpart", ".prt", ".3mf", ".dae")


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
    if suffix in NOT_READ:
        yield (*path, "mesh"), f"found {shown(mesh)}, a kind of CAD file that is not read: export STL or GLB"
    elif suffix not in known:
        yield (*path, "mesh"), f"found {shown(mesh)}, expected a file ending in {one_of(known, suffix)}"
    elif suffix in UNITLESS_MESHES and "mesh_unit" not in part:
        words = f"expected {one_of(MESH_UNITS)}: {suffix} files carry no unit"
        yield (*path, "mesh_unit"), f"found nothing, {words}"
    why = places.fault(mesh, "a mesh", value(part, "mesh_sha256"), MOST_MESH_BYTES)
    if why:
        yield (*path, "mesh"), why

"""The tables of a problem file as calls of Python, each value where it belongs, with no check of its own."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import harness_opt as ho
from harness_opt.model.checks import Gathered, dotted

Tables = dict[str, Any]
SHAPES = {"box": ho.Box, "sphere": ho.Sphere, "cylinder": ho.Cylinder, "capsule": ho.Capsule}
OWN_NAMES = {"from_deg": "start", "to_deg": "stop", "from": "start", "to": "stop", "twist_deg_per_m": "twist"}


def mistakes_in_python(tables: Tables) -> list[str]:
    """Return what Python says of a problem with the values of ``tables``.

    Raises:
        TypeError, KeyError, ValueError: a key that Python has no name for, or that it cannot do without.
    """
    made = _Made()
    cables = {name: _run(made, name, dict(table)) for name, table in tables["cables"].items()}
    bodies = {
        name: ho.Body(_motion(made, name, table), **{key: value for key, value in table.items() if key != "motion"})
        for name, table in tables["bodies"].items()
    }
    parts = {name: _part(dict(table)) for name, table in tables["parts"].items()}
    if not made.told:
        varied = [ho.Variable(name, *bounds) for name, bounds in tables["design"]["variables"].items()]
        made(
            ho.Problem,
            cables=cables,
            bodies=bodies,
            parts=parts,
            limits=ho.Limits(**_renamed(tables["limits"])),
            design=ho.Design(tables["design"]["minimise"], tuple(varied)),
            title=tables["title"],
            gravity=tables["gravity"],
            **tables["motion"],
        )
    return made.told


class _Made(Gathered):
    """Makes things, and keeps what is said against them, each behind the keys that lead there."""

    def __call__(self, make: Any, *path: str, **given: Any) -> Any:
        try:
            return make(**given)
        except ho.ProblemError as error:
            self.told += [f"{dotted(path)}.{line}" if path else line for line in error.mistakes]
            return None


def _renamed(table: Tables) -> Tables:
    """Return a table by the names of Python, in radians."""
    scaled = {key: math.radians(value) if "_deg" in key else value for key, value in table.items()}
    return {OWN_NAMES.get(key, key): value for key, value in scaled.items()}


def _run(made: _Made, name: str, table: Tables) -> Any:
    path = ("cables", name)
    run = {key: table.pop(key) for key in ("bow", "fitted_at") if key in table}
    ends = {side: made(ho.End, *path, side, **table.pop(side)) for side in ("start", "end")}
    table["mass_per_length"] = 0.25 * math.pi * table["diameter"] ** 2 * table.pop("density")
    cable = made(ho.Cable, *path, **table)
    return None if None in (cable, *ends.values()) else made(ho.CableRun, *path, cable=cable, **ends, **run)


def _motion(made: _Made, name: str, table: Tables) -> Any:
    if "motion" not in table:
        return None
    given = dict(table["motion"])
    kind = {"hinge": ho.Hinge, "slide": ho.Slide}[given.pop("kind")]
    return made(kind, "bodies", name, "motion", **_renamed(given))


def _part(table: Tables) -> ho.Part:
    if "mesh" in table:
        scale = {"scale": table.pop("mesh_scale")} if "mesh_scale" in table else {}
        shape: Any = ho.MeshFile(Path(table.pop("mesh")), table.pop("mesh_unit", None), **scale)
    else:
        (kind,) = (key for key in SHAPES if key in table)
        shape = SHAPES[kind](**table.pop(kind))
    return ho.Part(shape, **table)

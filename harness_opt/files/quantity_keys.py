"""Every quantity of a problem file by its key: the numbers and texts of the file, and changes that no single key makes.

A key is the path of a value in the file, joined by dots: ``cables.lead.length``, ``parts.bracket.position.z``,
``bodies.arm.motion.to_deg``. Vectors have components (``.x``, ``.y``, ``.z``; a quaternion also ``.w``; other lists
``.0``, ``.1``). Beside the keys of the file stand changes, all 0 as given: ``cables.NAME.start.rotate_x_deg`` turns a
clamp about its own d1, d2 (y) or d3 (z), ``parts.NAME.rotate_x_deg`` a part about its own axes,
``cables.NAME.stiffness_percent`` makes a cable stiffer in bending and torsion alike, and ``cables.NAME.weight_percent``
heavier.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from harness_opt.errors import ProblemError
from harness_opt.files.schema import ProblemTable, RobustTable
from harness_opt.files.tolerance_table import tolerance
from harness_opt.model.checks import KeyPath, Mistake, by_name, dotted, one_of
from harness_opt.model.ends import ENDS

CLIPS = "clips"  # of a cable: an array of tables, each with its name
COMPONENTS = {3: "xyz", 4: "wxyz"}  # names of the entries of a list, by its length; others are numbered
STIFFNESSES = ("bending_stiffness", "torsional_stiffness")
WEIGHTS = ("density", "mass_per_length")  # one of the two is given, or none
TURNS = {f"rotate_{letter}_deg": axis for axis, letter in enumerate("xyz")}
PERCENT = {"stiffness_percent": STIFFNESSES, "weight_percent": WEIGHTS}
STILL = ("motion", "limits", "design")  # sections whose keys move no shape
REWRITTEN = ("density",)  # keys that a written file has in other words
FIXED = ("schema", "title", "robust")  # what no study varies


@dataclass(frozen=True)
class Quantity:
    """One quantity of a problem file.

    Args:
        key: what a user types.
        path: of the value in the file; of the table that it changes, where ``change`` names one.
        value: as given; None where the file leaves it out and has no default for it.
        component: which entry of the list at ``path``; None for all of it.
        change: "rotate_x_deg" and the like, "stiffness_percent" or "weight_percent"; empty for a value of the file.
    """

    key: str
    path: KeyPath
    value: Any
    component: int | None = None
    change: str = ""

    @property
    def unit(self) -> str:
        """The unit of small changes: "deg", "percent", or that of the key in SI units, empty."""
        return "deg" if self.key.endswith("_deg") else "percent" if self.change in PERCENT else ""


def known(tables: ProblemTable) -> dict[str, Quantity]:
    """Return the quantities of a problem file by key."""
    full = tables.model_dump(by_alias=True)
    found: dict[str, Quantity] = {}
    for quantity in (*_values(full), *_changes(full)):
        found.setdefault(quantity.key, quantity)  # a clip may be called as a key of its cable is: that key is meant
    return found


def unknown(quantities: Mapping[str, Quantity], key: str) -> str:
    """Return the words for a key that is none; the whole list would fill the screen."""
    forms = "a key of the problem such as cables.NAME.length, parts.NAME.position.z or cables.NAME.end.rotate_x_deg"
    asked = key if key.startswith(("cables.", "parts.", "bodies.")) else f"cables.{key}"
    nearest = one_of(quantities, asked).partition("; ")[2]
    return (
        f"found an unknown key, expected {forms}; {nearest}" if nearest else f"found an unknown key, expected {forms}"
    )


def differentiable(quantity: Quantity) -> bool:
    """Return whether margins have a derivative by ``quantity``: a number that moves a shape or a place."""
    if quantity.change:
        return True
    number = isinstance(quantity.value, (int, float)) and not isinstance(quantity.value, bool)
    part = quantity.path[0] == "parts" and quantity.path[-1] not in ("position", "quaternion")
    whole = quantity.path[-1] in ("turns", "fitted_at")  # or within bounds that a step may leave
    return number and quantity.path[0] not in STILL and not whole and not part


def robust_mistakes(tables: ProblemTable, robust: RobustTable) -> Iterator[Mistake]:
    """Yield the mistakes of a ``[robust]`` table that need the rest of the file."""
    quantities = known(tables)
    if not robust.tolerances:
        yield ("robust", "tolerances"), "found none, expected at least one to hold limits against"
    for name in ("samples", "seed"):
        if getattr(robust, name) < 0:
            yield ("robust", name), f"found {getattr(robust, name)}, expected a number of at least 0"
    for key, spread in robust.tolerances.items():
        path = ("robust", "tolerances", key)
        try:
            width = tolerance(spread.model_dump())
        except ProblemError as error:
            yield from ((path, line) for line in error.mistakes)
            continue
        if key not in quantities:
            yield path, unknown(quantities, key)
        elif quantities[key].path[-1] in REWRITTEN:
            words = "weight_percent of the cable, or rotate_x_deg of the clamp and the like"
            yield path, f"found a key that a redesigned file has in other words, expected {words}"
        elif not differentiable(quantities[key]):
            yield path, "found a tolerance of what is no number that moves a cable or a part, expected one that is"
        elif width.percent and not quantities[key].value:
            yield path, "found a tolerance in percent of 0, expected one in the key's own unit"


# --- finding -------------------------------------------------------------------------------------------


def _values(full: Any, path: KeyPath = ()) -> Iterator[Quantity]:
    """Yield the quantities that are values of the file, and the components of lists."""
    for name, value in full.items():
        here = (*path, name)
        if here[0] in FIXED or (len(here) == 3 and here[0] == "bodies" and _is_no_matter(full, name)):
            continue
        if path:
            yield Quantity(dotted(here), here, value)
        if isinstance(value, Mapping):
            yield from _values(value, here)
        elif name == CLIPS:  # told by their names, as in design variables
            for clip, own in by_name(value).items():
                fixed = {key: entry for key, entry in own.items() if key not in ("name", "kind")}
                for quantity in _values({clip: fixed}, here):
                    key = dotted((*path, *quantity.path[len(here) :]))
                    yield replace(quantity, key=key + quantity.key[len(dotted(quantity.path)) :])
        elif isinstance(value, (list, tuple)) and not any(isinstance(entry, Mapping) for entry in value):
            names = COMPONENTS.get(len(value), [str(i) for i in range(len(value))])
            for i, (letter, entry) in enumerate(zip(names, value, strict=True)):
                yield Quantity(f"{dotted(here)}.{letter}", here, entry, i)
            if not path:
                yield Quantity(dotted(here), here, value)


def _is_no_matter(body: Any, key: str) -> bool:
    """Whether a key of a body moves nothing: the mass of one that does not hang, the first guess of one that does."""
    return key in (("position", "quaternion") if body.get("free") else ("mass",))


def _changes(full: Any) -> Iterator[Quantity]:
    """Yield the changes that no single key makes."""
    for name, cable in full["cables"].items():
        path = ("cables", name)
        for change, keys in PERCENT.items():
            if any(cable[key] for key in keys):
                yield Quantity(dotted((*path, change)), path, 0.0, change=change)
        ends: dict[KeyPath, Any] = {(side,): cable[side] for side in ENDS}
        ends |= {(CLIPS, clip): own for clip, own in by_name(cable[CLIPS]).items()}
        for side, end in ends.items():
            if end["quaternion"] is not None or end["tangent"] is not None:
                for turn in TURNS:
                    yield Quantity(dotted((*path, side[-1], turn)), (*path, *side), 0.0, change=turn)
    for name in full["parts"]:
        for turn in TURNS:
            yield Quantity(dotted(("parts", name, turn)), ("parts", name), 0.0, change=turn)

"""Every quantity of a problem file by its key, read from and set in the file's tables.

A key is the path of a value in the file, joined by dots: ``cables.lead.length``, ``parts.bracket.position.z``,
``bodies.arm.motion.to_deg``. Vectors have components (``.x``, ``.y``, ``.z``; a quaternion also ``.w``; other lists
``.0``, ``.1``). Beside the keys of the file stand changes that no single key makes, all 0 as given:
``cables.NAME.start.rotate_x_deg`` turns a clamp about its own d1, d2 (y) or d3 (z), ``parts.NAME.rotate_x_deg`` a part
about its own axes, ``cables.NAME.stiffness_percent`` makes a cable stiffer in bending and torsion alike, and
``cables.NAME.weight_percent`` heavier.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import design_variables, rotations
from .errors import ProblemError
from .file_checks import SIDES, mistakes_between
from .file_schema import ProblemTable, structured
from .file_values import KeyPath, dotted, one_of
from .problem import Design, Part, Problem, Variable
from .problem_file import problem_from

Tree = dict[str, Any]

COMPONENTS = {3: "xyz", 4: "wxyz"}  # names of the entries of a list, by its length; others are numbered
STIFFNESSES = ("bending_stiffness", "torsional_stiffness")
WEIGHTS = ("density", "mass_per_length")  # one of the two is given, or none
TURNS = {f"rotate_{letter}_deg": axis for axis, letter in enumerate("xyz")}
PERCENT = {"stiffness_percent": STIFFNESSES, "weight_percent": WEIGHTS}
FIXED = ("schema", "title")  # keys that no study varies


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


class Quantities(Mapping[str, Quantity]):
    """The quantities of a problem file, by key.

    Args:
        tree: its tables, as TOML has them.
        file: where they lie, or would lie; paths inside start at its folder.

    Raises:
        ProblemError: the file has mistakes.
    """

    def __init__(self, tree: Tree, file: Path):
        self.tree, self.file = tree, file
        problem_from(tree, file)  # says what is wrong with the file, if anything
        full = ProblemTable.model_validate(tree).model_dump(by_alias=True)
        self._known = {quantity.key: quantity for quantity in (*_values(full), *_changes(full))}

    def __getitem__(self, key: str) -> Quantity:
        """Return the quantity called ``key``.

        Raises:
            ProblemError: there is none; the nearest is named.
        """
        if key not in self._known:
            raise ProblemError(f"{key}: found an unknown key, expected {self._nearest(key)}")
        return self._known[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    def _nearest(self, key: str) -> str:
        """Return what to type in the place of ``key``; the whole list would fill the screen."""
        forms = "a key of the problem such as cables.NAME.length, parts.NAME.position.z or cables.NAME.end.rotate_x_deg"
        asked = key if key.startswith(("cables.", "parts.", "bodies.")) else f"cables.{key}"
        nearest = one_of(self._known, asked).partition("; ")[2]
        return f"{forms}; {nearest}" if nearest else forms

    # -- setting -----------------------------------------------------------------------------------------------

    def changed(self, values: Mapping[str, Any]) -> Tree:
        """Return the file's tables with ``values`` by key put in; turns are left to :meth:`problem`."""
        tree = dict(self.tree)
        # changes in percent are of what stands there in the end
        for quantity, value in sorted(((self[key], value) for key, value in values.items()), key=_change):
            if quantity.change in PERCENT:
                table = _table(tree, quantity.path)
                for name in PERCENT[quantity.change]:
                    if name in table:
                        table[name] = _scaled(table[name], 1.0 + value / 100.0)
            elif not quantity.change:
                table, name = _table(tree, quantity.path[:-1]), quantity.path[-1]
                if quantity.component is None:
                    table[name] = value
                else:
                    given = self._known[dotted(quantity.path)].value
                    entries = list(table.get(name, given))
                    entries[quantity.component] = value
                    table[name] = entries
        return tree

    def problem(self, values: Mapping[str, Any], placed: Callable[[Tree], Tree] | None = None) -> Problem:
        """Return the problem with ``values`` by key put in.

        Args:
            values: by key.
            placed: has a last look at the tables before they are read, such as to say where files lie.

        Raises:
            ProblemError: an unknown key, or what the file would be refused for.
        """
        tree = self.changed(values)
        problem = problem_from(placed(tree) if placed else tree, self.file)
        turns = [(self[key], float(value)) for key, value in values.items() if self[key].change in TURNS]
        return _turned(problem, turns) if turns else problem

    def mistakes(self, values: Mapping[str, Any]) -> list[str]:
        """Return what makes ``values`` impossible whatever else changes, a line each; nothing where all is well.

        A cable too short for its clamps is not among them: a longer one beside it would do.
        """
        try:
            _, tree, wrong = structured(self.changed(values))
        except ProblemError as error:
            return list(error.mistakes)
        return [f"{dotted(path)}: {words}" for path, words in (*wrong, *mistakes_between(tree, self.file.parent))]


# --- finding -------------------------------------------------------------------------------------------


def _values(full: Any, path: KeyPath = ()) -> Iterator[Quantity]:
    """Yield the quantities that are values of the file, and the components of lists."""
    for name, value in full.items():
        here = (*path, name)
        if here[0] in FIXED:
            continue
        if path:
            yield Quantity(dotted(here), here, value)
        if isinstance(value, Mapping):
            yield from _values(value, here)
        elif isinstance(value, (list, tuple)):
            names = COMPONENTS.get(len(value), [str(i) for i in range(len(value))])
            for i, (letter, entry) in enumerate(zip(names, value, strict=True)):
                yield Quantity(f"{dotted(here)}.{letter}", here, entry, i)
            if not path:
                yield Quantity(dotted(here), here, value)


def _changes(full: Any) -> Iterator[Quantity]:
    """Yield the changes that no single key makes."""
    for name, cable in full["cables"].items():
        path = ("cables", name)
        for change, keys in PERCENT.items():
            if any(cable[key] for key in keys):
                yield Quantity(dotted((*path, change)), path, 0.0, change=change)
        for side in SIDES:
            if cable[side]["quaternion"] is not None or cable[side]["tangent"] is not None:
                for turn in TURNS:
                    yield Quantity(dotted((*path, side, turn)), (*path, side), 0.0, change=turn)
    for name in full["parts"]:
        for turn in TURNS:
            yield Quantity(dotted(("parts", name, turn)), ("parts", name), 0.0, change=turn)


# --- setting -------------------------------------------------------------------------------------------


def _change(entry: tuple[Quantity, Any]) -> bool:
    return bool(entry[0].change)


def _table(tree: Tree, path: KeyPath) -> Tree:
    """Return the table at ``path`` of ``tree``, each table on the way replaced by a copy that may be changed."""
    for name in path:
        tree[name] = dict(tree.get(name, {}))
        tree = tree[name]
    return tree


def _scaled(value: Any, factor: float) -> Any:
    return [factor * entry for entry in value] if isinstance(value, Sequence) else factor * value


def _turned(problem: Problem, turns: Sequence[tuple[Quantity, float]]) -> Problem:
    """Return ``problem`` with clamps and parts turned, each about its own x, then y, then z."""
    clamps = [(".".join((*quantity.path[1:], quantity.change)), angle) for quantity, angle in turns if _clamp(quantity)]
    if clamps:
        variables = tuple(Variable(name, angle, angle) for name, angle in clamps)
        given = dataclasses.replace(problem, design=Design(variables=variables))
        turned = design_variables.apply(given, [angle for _, angle in clamps])
        problem = dataclasses.replace(problem, cables=turned.cables)
    parts = dict(problem.parts)
    for name in dict.fromkeys(quantity.path[1] for quantity, _ in turns if not _clamp(quantity)):
        angles = {TURNS[q.change]: angle for q, angle in turns if q.path == ("parts", name)}
        parts[name] = _turned_part(parts[name], angles)
    return dataclasses.replace(problem, parts=parts)


def _clamp(quantity: Quantity) -> bool:
    return quantity.path[0] == "cables"


def _turned_part(part: Part, angles: Mapping[int, float]) -> Part:
    q = np.asarray(part.quaternion, dtype=float)
    for axis in sorted(angles):
        q = rotations.multiply(q, rotations.from_rotation_vector(np.deg2rad(angles[axis]) * np.eye(3)[axis]))
    return dataclasses.replace(part, quaternion=tuple(q.tolist()))

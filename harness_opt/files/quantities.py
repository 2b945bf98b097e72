"""The quantities of one problem, read from and set in the tables of its file; ``file_quantities`` has their keys."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.files.beside import between_with, mistakes_of_limits, mistakes_of_parts, robots_of, with_cables
from harness_opt.files.places import Places
from harness_opt.files.quantity_keys import PERCENT, TURNS, Quantity, known, unknown
from harness_opt.files.read import content_of, parse_problem, problem_from, toml_tables
from harness_opt.files.schema import ProblemTable
from harness_opt.files.values import structured
from harness_opt.files.write import problem_text
from harness_opt.model import design_variables
from harness_opt.model.checks import KeyPath, by_name, dotted
from harness_opt.model.design import Design, Variable
from harness_opt.model.parts import MeshFile, Part
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations

Tree = dict[str, Any]

UNNAMED = "problem.toml"  # where a problem that was in no file would lie


class Quantities(Mapping[str, Quantity]):
    """The quantities of a problem file, by key.

    Args:
        tree: its tables, as TOML has them.
        file: where they lie, or would lie; paths inside start at its folder.
        folders: from which it may read meshes and tables beside its own folder.

    Raises:
        ProblemError: the file has mistakes.
    """

    def __init__(self, tree: Tree, file: Path, folders: Iterable[str | os.PathLike[str]] = ()):
        self.file, self.places = file, Places.around(file.parent, folders)
        self.tree = with_cables(tree, self.places, file)[0]  # what is wrong there, the next line says
        problem_from(tree, self.places, file)  # says what is wrong with the file, if anything
        self._known = known(ProblemTable.model_validate(self.tree))

    def __getitem__(self, key: str) -> Quantity:
        """Return the quantity called ``key``.

        Raises:
            ProblemError: there is none; the nearest is named.
        """
        if key not in self._known:
            raise ProblemError(f"{key}: {unknown(self._known, key)}")
        return self._known[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

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
                    whole = (q.value for q in self._known.values() if q.path == quantity.path and q.component is None)
                    given = next(whole)
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
        problem = problem_from(placed(tree) if placed else tree, self.places, self.file)
        turns = [(self[key], float(value)) for key, value in values.items() if self[key].change in TURNS]
        return _turned(problem, turns) if turns else problem

    def mistakes(self, values: Mapping[str, Any]) -> list[str]:
        """Return what makes ``values`` impossible whatever else changes, a line each; nothing where all is well.

        A cable too short for its clamps is not among them: a longer one beside it would do.
        """
        try:
            _, tree, wrong = structured(self.changed(values), ProblemTable)
        except ProblemError as error:
            return list(error.mistakes)
        robots, of_robots = robots_of(tree, self.places, {})
        wrong += [
            *of_robots,
            *between_with(tree, robots),
            *mistakes_of_parts(tree, self.places),
            *mistakes_of_limits(tree),
        ]
        return [f"{dotted(path)}: {words}" for path, words in wrong]


def quantities_of(
    problem: Problem | str | os.PathLike[str], folders: Iterable[str | os.PathLike[str]] = ()
) -> Quantities:
    """Return the quantities of a problem by the keys of its file, or of the file that it would be written to.

    Args:
        problem: or the path of its file.
        folders: from which a file may read meshes and tables beside its own folder.

    Raises:
        ProblemError: no such file, or one with mistakes; a table of poses that is in no file.
    """
    if not isinstance(problem, Problem):
        file = Path(problem)
        return Quantities(toml_tables(content_of(file, "a problem file"), file), file, folders)
    file = problem.file or Path.cwd() / UNNAMED
    granted = {path.parent for path in _inputs(problem)}
    if problem.sha256 is not None and file.is_file():
        content = content_of(file, "a problem file")
        # its own words, such as density, where it is still what the file says
        unchanged = hashlib.sha256(content).hexdigest() == problem.sha256
        if unchanged and parse_problem(content, Places.around(file.parent, granted), file) == problem:
            return Quantities(toml_tables(content, file), file, granted)
    text, pending = problem_text(problem, file)
    if pending:
        names = ", ".join(path.name for path in pending)
        raise ProblemError(f"bodies: found motions in no file ({names}), expected those of a problem that was written")
    return Quantities(toml_tables(text.encode(), file), file, granted)


def _inputs(problem: Problem) -> Iterator[Path]:
    """Yield the files that a problem was allowed to read when it was made."""
    yield from (part.shape.path for part in problem.parts.values() if isinstance(part.shape, MeshFile))
    yield from (body.table for body in problem.bodies.values() if body.table is not None)
    yield from (file for robot in problem.robots.values() for file, _ in robot.files)


# --- setting -------------------------------------------------------------------------------------------


def _change(entry: tuple[Quantity, Any]) -> bool:
    return bool(entry[0].change)


def _table(tree: Tree, path: KeyPath) -> Tree:
    """Return the table at ``path`` of ``tree``, each table on the way replaced by a copy that may be changed."""
    for name in path:
        if isinstance(tree, list):  # of tables with names
            place = list(by_name(tree)).index(name)
            tree[place] = dict(tree[place])
            tree = tree[place]
        else:
            tree[name] = list(tree[name]) if isinstance(tree.get(name), list) else dict(tree.get(name, {}))
            tree = tree[name]
    return tree


def _scaled(value: Any, factor: float) -> Any:
    return [factor * entry for entry in value] if isinstance(value, Sequence) else factor * value


def _turned(problem: Problem, turns: Sequence[tuple[Quantity, float]]) -> Problem:
    """Return ``problem`` with clamps and parts turned, each about its own x, then y, then z."""
    clamps = [
        (f"{quantity.path[1]}.{quantity.path[-1]}.{quantity.change}", angle)
        for quantity, angle in turns
        if _clamp(quantity)
    ]
    if clamps:
        variables = tuple(Variable(name, angle, angle) for name, angle in clamps)
        given = problem.changed(design=Design(variables=variables))
        turned = design_variables.apply(given, [angle for _, angle in clamps])
        problem = problem.changed(cables=turned.cables)
    parts = dict(problem.parts)
    for name in dict.fromkeys(quantity.path[1] for quantity, _ in turns if not _clamp(quantity)):
        angles = {TURNS[q.change]: angle for q, angle in turns if q.path == ("parts", name)}
        parts[name] = _turned_part(parts[name], angles)
    return problem.changed(parts=parts)


def _clamp(quantity: Quantity) -> bool:
    return quantity.path[0] == "cables"


def _turned_part(part: Part, angles: Mapping[int, float]) -> Part:
    q = np.asarray(part.quaternion, dtype=float)
    for axis in sorted(angles):
        q = rotations.multiply(q, rotations.from_rotation_vector(np.deg2rad(angles[axis]) * np.eye(3)[axis]))
    return dataclasses.replace(part, quaternion=tuple(q.tolist()))

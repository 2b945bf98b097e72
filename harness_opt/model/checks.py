"""Checks of single values that a user gave: each returns the value, or says what was found and what is expected."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model.limits import quoted
from harness_opt.numerics import rotations

KeyPath = tuple[str, ...]  # the keys that lead to a value
Mistake = tuple[KeyPath, str]  # where, and "found ..., expected ..."

Tree = Mapping[str, Any]  # nested tables, as a problem file has them
INVALID = object()  # in the place of a value that is known to be wrong
ORIENTATIONS = ("quaternion", "tangent")  # what gives an end its section frame

LONGEST_SHOWN = 60  # characters of a wrong value that a message repeats
LARGEST = 1e100  # of any number, in any unit: squares and products of two or three must not overflow
SMALLEST = 1e-100  # of a number that has to be above 0: nothing that is divided by it may overflow

COUPLING = re.compile(
    r"\s*=\s*(?:(?P<factor>[-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\*\s*|(?P<minus>-)\s*)?"
    r"(?P<leader>.+?\.(?:length|at|position\.[xyz]|rotate_[xyz]_deg))"
    r"(?:\s*(?P<sign>[-+])\s*(?P<offset>[\d.]+(?:[eE][-+]?\d+)?))?\s*"
)
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
_COUNTED = {3: "[x, y, z], three numbers", 4: "[w, x, y, z], four numbers of a unit quaternion"}


class Gathered:
    """Gathers mistakes: each ``with`` of it ends with the one that was raised inside, and goes on.

    >>> found = Gathered()
    >>> with found:
    ...     positive("length", -1)
    >>> found.told
    ['length: found -1, expected a number above 0']
    """

    def __init__(self) -> None:
        self.told: list[str] = []

    def __enter__(self) -> Gathered:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> bool:
        if not isinstance(error, ProblemError):
            return False
        self.told += error.mistakes
        return True

    def raised(self) -> None:
        """Raise all of them, if there are any."""
        if self.told:
            raise ProblemError(self.told)


def numbers(name: str, value: ArrayLike, count: int) -> tuple[float, ...]:
    """Return ``value`` as ``count`` finite floats, or raise ProblemError naming ``name``."""
    wanted = _COUNTED.get(count, f"{count} finite numbers")
    typed = isinstance(value, (list, tuple)) and any(isinstance(item, (bool, str)) for item in value)
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        typed = True
    if typed or array.shape != (count,) or not np.all(np.abs(array) <= LARGEST):
        raise ProblemError(f"{name}: found {shown(value)}, expected {wanted}")
    return tuple(array.tolist())


def quaternion(name: str, value: ArrayLike) -> Quaternion:
    """Return ``value`` as a unit quaternion, or raise ProblemError naming ``name``."""
    unit_tolerance = 1e-6  # largest | |q| - 1 | that is taken as rounding of a typed unit quaternion
    q = numbers(name, value, 4)
    if abs(math.hypot(*q) - 1.0) > unit_tolerance:
        words = f"expected a unit quaternion [w, x, y, z] (this one is {math.hypot(*q):.6g} long)"
        raise ProblemError(f"{name}: found {shown(value)}, {words}")
    return tuple(rotations.unit(q).tolist())


def positive(name: str, value: float, *, zero: bool = False) -> float:
    """Return ``value`` as a finite number above 0 (or, with ``zero``, of at least 0), or raise ProblemError."""
    wanted = "a number of at least 0" if zero else "a number above 0"
    number = isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool)
    if not number or not (0 if zero else SMALLEST) <= value <= LARGEST:
        raise ProblemError(f"{name}: found {shown(value)}, expected {sized(wanted, value)}")
    return float(value)


def sized(wanted: str, value: object) -> str:
    """Return what is ``wanted``, with the bound that ``value`` goes beyond where its size is all that is wrong."""
    if not isinstance(value, (int, float)):
        return wanted
    most = f", at most {LARGEST:g} in size" if LARGEST < abs(value) < math.inf else ""
    return wanted + most + (f", at least {SMALLEST:g}" if 0 < value < SMALLEST else "")


def direction(name: str, value: ArrayLike) -> Vector:
    """Return ``value`` as a vector that is not zero, or raise ProblemError naming ``name``."""
    vector = numbers(name, value, 3)
    if not any(vector):
        raise ProblemError(f"{name}: found {shown(value)}, expected a direction, not zero")
    return vector  # type: ignore[return-value]


def table(tree: Any, *path: str) -> Tree:
    """Return the table at ``path``; an empty one where there is none."""
    for key in path:
        tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree if isinstance(tree, Mapping) else {}


def value(tree: Tree, key: str) -> Any:
    """Return the value of ``key``, or None where it is missing or already named as wrong."""
    found = tree.get(key)
    return None if found is INVALID else found


def by_name(tables: Sequence[Any]) -> dict[str, Any]:
    """Return an array of tables as tables by their names, or by their numbers, from 0, where a name is no key."""
    names = [table.get("name") if isinstance(table, Mapping) else None for table in tables]
    keys = [name if name and names.count(name) == 1 else number for number, name in enumerate(names)]
    return {str(key): one for key, one in zip(keys, tables, strict=True)}


def clip_tables(cable: Tree) -> dict[str, Any]:
    """Return the clips of a cable, by name; none where they are no array."""
    clips = cable.get("clips")
    return by_name(clips) if isinstance(clips, (list, tuple)) else {}


# --- how a mistake is told: the keys that lead to it, what was found, what is expected ----------------------


def shown(value: object) -> str:
    """Return ``value`` as a user would type it in TOML, at most :data:`LONGEST_SHOWN` characters."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, Mapping):
        return "a table"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(shown(item) for item in value[:LONGEST_SHOWN]) + "]"
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, int) and abs(value) > 10**LONGEST_SHOWN:
        # Python refuses to write out numbers of thousands of digits, which TOML's 0x... can hold
        return f"a number of about {round(math.log10(abs(value)))} digits"
    else:
        text = str(value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


def dotted(path: KeyPath) -> str:
    """Return the keys of ``path`` joined by dots, quoted where TOML asks for quotes."""
    return ".".join(quoted(key) for key in path)


def one_of(names: Iterable[str], asked: object = "") -> str:
    """Return ``one of 'a', 'b'``, and which of ``names`` comes nearest to ``asked``."""
    names = list(names)
    listed = ", ".join(repr(name) for name in names[:12]) + (", ..." if len(names) > 12 else "")
    near = get_close_matches(asked, names, n=1) if isinstance(asked, str) else []
    return f"{'one of ' if len(names) > 1 else ''}{listed}" + (f"; did you mean {near[0]!r}?" if near else "")


def coupling(text: str) -> tuple[str, float, float] | None:
    """Return the variable that ``text`` names, the factor and the offset; None where it is of another form.

    ``= NAME``, ``= -NAME``, ``= 2 * NAME``, each with ``+ 0.01`` or ``- 0.01`` behind or not.
    """
    found = COUPLING.fullmatch(text)
    if found is None:
        return None
    try:
        factor = float(found["factor"]) if found["factor"] else -1.0 if found["minus"] else 1.0
        offset = float((found["sign"] or "") + (found["offset"] or "0"))
    except ValueError:  # such as 1.2.3
        return None
    return (found["leader"], factor, offset) if max(abs(factor), abs(offset)) <= LARGEST else None

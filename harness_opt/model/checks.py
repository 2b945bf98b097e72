"""Checks of single values that a user gave: each returns the value, or says what was found and what is expected."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model.words import shown
from harness_opt.numerics import rotations

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
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ProblemError(f"{name}: found {shown(value)}, expected {wanted}") from None
    if array.shape != (count,) or not np.all(np.isfinite(array)):
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
    if not isinstance(value, (int, float, np.floating, np.integer)) or isinstance(value, bool):
        raise ProblemError(f"{name}: found {shown(value)}, expected {wanted}")
    if not math.isfinite(value) or value < 0 or (value == 0 and not zero):
        raise ProblemError(f"{name}: found {shown(value)}, expected {wanted}")
    return float(value)


def direction(name: str, value: ArrayLike) -> Vector:
    """Return ``value`` as a vector that is not zero, or raise ProblemError naming ``name``."""
    vector = numbers(name, value, 3)
    if not any(vector):
        raise ProblemError(f"{name}: found {shown(value)}, expected a direction, not a zero vector")
    return vector  # type: ignore[return-value]

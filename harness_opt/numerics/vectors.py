"""Lengths and dot products of stacks of vectors, and the types of arrays of numbers of things.

``np.einsum`` is several times faster here than ``np.linalg.norm`` and ``np.sum`` over a last axis of three.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics.rotations import Array

Indices = NDArray[np.int64]


def lengths(v: Array) -> Array:
    """Return the Euclidean lengths (...) of vectors (..., 3)."""
    return np.sqrt(dots(v, v))


def dots(u: Array, v: Array) -> Array:
    """Return the dot products (...) of vectors (..., 3) and (..., 3)."""
    products: Array = np.einsum("...i,...i->...", u, v)
    return products

"""Matrices of small rotations along a cable, on elements that share their end nodes, bordered by a closure."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

DEGREE = 3  # of the polynomials: order 6, at the least cost for an unknown
UNKNOWNS = 3 * (DEGREE + 1)  # small rotations of an element's nodes

Indices = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where the entries of the elements go in the bordered matrix [H A^T; A -] (column-major, symmetric).

    Args:
        nodes: of the elements, (elements, DEGREE + 1).
        free: whether a node may turn about its own axes, (nodes, 3).
        blocks: which entries of the elements' Hessians are used, (elements, UNKNOWNS, UNKNOWNS).
        chords: which entries of the chords' derivatives are used, (elements, 3, UNKNOWNS), or None.
        places: of all these, and of the diagonal, among the nonzeros.
        sparsity: of the matrix.
        inner: of H alone: which of the nonzeros are its, their rows, and where its columns begin among them.
    """

    nodes: Indices
    free: NDArray[np.bool_]
    blocks: NDArray[np.bool_]
    chords: NDArray[np.bool_] | None
    places: Indices
    sparsity: ca.Sparsity
    inner: tuple[Indices, Indices, Indices]


@functools.lru_cache(maxsize=64)
def pattern(elements: int, start_held: int, end_held: int, closed: bool) -> Pattern:
    """Return where entries go for so many elements.

    Args:
        elements: their number.
        start_held, end_held: how many of the rotations of the first and the last node are held.
        closed: with a border.
    """
    count = DEGREE * elements + 1
    nodes = DEGREE * np.arange(elements)[:, None] + np.arange(DEGREE + 1)
    free = np.ones((count, 3), dtype=bool)
    free[0, :start_held], free[-1, :end_held] = False, False
    number = np.full((count, 3), -1)
    size = int(free.sum())
    number[free] = np.arange(size)
    unknowns = number[nodes].reshape(elements, UNKNOWNS)
    row, column = np.broadcast_arrays(unknowns[:, :, None], unknowns[:, None, :])
    blocks = (row >= 0) & (column >= 0)
    rows, columns = [row[blocks]], [column[blocks]]
    chords = None
    if closed:
        across = np.broadcast_to(unknowns[:, None, :], (elements, 3, UNKNOWNS))
        down = np.broadcast_to(size + np.arange(3)[:, None], across.shape)
        chords = across >= 0
        corner = size + np.arange(3)  # a pivot is needed there, if only of zero
        rows += [down[chords], across[chords], corner]
        columns += [across[chords], down[chords], corner]
    rows.append(np.arange(size))
    columns.append(np.arange(size))
    order = size + (3 if closed else 0)
    keys, places = np.unique(np.concatenate(columns) * order + np.concatenate(rows), return_inverse=True)
    column, row = np.divmod(keys, order)
    starts = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=order))])
    own = np.flatnonzero((row < size) & (column < size))
    inner = own, row[own].astype(np.int32), np.searchsorted(column[own], np.arange(size + 1)).astype(np.int32)
    return Pattern(nodes, free, blocks, chords, places, ca.Sparsity(order, order, starts.tolist(), row.tolist()), inner)

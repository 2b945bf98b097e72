"""Neighbours in space: which of many boxes meet, and many points in bundles, level by level, in arrays."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

PAIRS_AT_ONCE = 500_000  # pairs of the tree's nodes that are opened together: some 100 MB


def meeting_boxes(lower: Array, upper: Array) -> Iterator[tuple[Indices, Indices]]:
    """Yield, in blocks, the numbers (k,), (k,) of all pairs of boxes that meet, each pair once.

    Args:
        lower, upper: corners of the boxes, (m, 3), m.
    """
    order, levels = _tree(lower, upper)
    root = np.zeros(1, dtype=np.int64)
    left = [(len(levels) - 1, root, root)]
    while left:
        level, i, j = left.pop()
        if level == 0:
            apart = i != j
            if np.any(apart):
                yield order[i[apart]], order[j[apart]]
            continue
        if len(i) > PAIRS_AT_ONCE:
            half = len(i) // 2
            left += [(level, i[half:], j[half:]), (level, i[:half], j[:half])]
            continue
        low, high = levels[level - 1]
        a = np.concatenate([2 * i, 2 * i, 2 * i + 1, 2 * i + 1])
        b = np.concatenate([2 * j, 2 * j + 1, 2 * j, 2 * j + 1])
        once = a <= b
        a, b = a[once], b[once]
        for x in range(3):  # axis by axis: most pairs are gone after the first
            meets = (low[x][a] <= high[x][b]) & (low[x][b] <= high[x][a])
            a, b = a[meets], b[meets]
        left.append((level - 1, a, b))


def bundles(vertices: Array, faces: Indices) -> list[Indices]:
    """Return the numbers of triangles in about sqrt(m) bundles of neighbours, each as large as the others.

    Each bundle is halved at the median along the longest side of its box, as the nodes of a k-d tree are: Bentley,
    "Multidimensional binary search trees used for associative searching", Commun. ACM 18 (1975).

    Args:
        vertices: (k, 3), m.
        faces: (m, 3), vertex numbers.
    """
    # moved along with the numbers, so that what a bundle needs lies together
    along = [vertices[:, x][faces].mean(axis=1) for x in range(3)]
    number = np.arange(len(faces))
    ends = [0, len(faces)]
    for _ in range(round(0.5 * math.log2(len(faces)))):
        halves = []
        for first, last in pairwise(ends):
            own = slice(first, last)
            longest = along[int(np.argmax([np.ptp(x[own]) for x in along]))]
            half = (last - first + 1) // 2
            order = np.argpartition(longest[own], half)
            for column in (*along, number):
                column[own] = column[own][order]
            halves += [first, first + half]
        ends = [*halves, len(faces)]
    return np.split(number, ends[1:-1])


def _tree(lower: Array, upper: Array) -> tuple[Indices, list[tuple[Array, Array]]]:
    """Return an order (m,) of the boxes along a curve, and the boxes (3, n), (3, n) of each level above it.

    The curve is that of Morton, "A computer oriented geodetic data base" (IBM, 1966): what is near on it is near in
    space. Level 0 holds the boxes in this order, each level above it those of pairs of neighbours, the last one all.
    """
    steps = 1023  # of the curve along each axis: 30 bits in all
    middle = 0.5 * (lower + upper)
    longest = np.ptp(middle, axis=0).max()
    cell = (steps / (longest if longest > 0 else 1.0) * (middle - middle.min(axis=0))).astype(np.int64)
    code = _spread(cell[:, 0]) | _spread(cell[:, 1]) << 1 | _spread(cell[:, 2]) << 2
    order = np.argsort(code, kind="stable")
    size = 1 << (len(order) - 1).bit_length()
    low, high = np.full((3, size), np.inf), np.full((3, size), -np.inf)
    low[:, : len(order)], high[:, : len(order)] = lower[order].T, upper[order].T
    levels = [(low, high)]
    while low.shape[1] > 1:
        low = np.minimum(low[:, ::2], low[:, 1::2])
        high = np.maximum(high[:, ::2], high[:, 1::2])
        levels.append((low, high))
    return order, levels


def _spread(x: Indices) -> Indices:
    """Return numbers (m,) of 10 bits with two zeros put behind each bit."""
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        x = (x | x << shift) & mask
    return x

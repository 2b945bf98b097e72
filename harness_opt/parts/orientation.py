"""Which way the triangles of a mesh face: made to close, and to face outward, piece by piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths

PAIRS_AT_A_TIME = 1_000_000  # point-triangle pairs at a time, so that temporaries stay below 100 MB


def winding_numbers(points: Array, corners: Array, areas: Array) -> Array:
    """Return the generalised winding numbers (n,) of points (n, 3): +-1 inside a closed surface, 0 outside.

    The sum of the triangles' solid angles over 4 pi: Van Oosterom and Strackee, "The solid angle of a plane
    triangle", IEEE Trans. Biomed. Eng. 30 (1983).

    Args:
        points: (n, 3), m.
        corners: of the triangles, (m, 3, 3), m.
        areas: twice their area vectors, (m, 3), m2.
    """
    step = max(1, PAIRS_AT_A_TIME // max(1, len(points)))
    turns = np.zeros(len(points))
    for first in range(0, len(corners), step):
        a, b, c = (corners[first : first + step, k] - points[:, None] for k in range(3))
        volume = np.einsum("nmi,mi->nm", a, areas[first : first + step])
        la, lb, lc = lengths(a), lengths(b), lengths(c)
        denominator = la * lb * lc + dots(a, b) * lc + dots(b, c) * la + dots(c, a) * lb
        turns += np.arctan2(volume, denominator).sum(axis=1) / (2 * np.pi)
    return turns


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of m faces, 3 m of them, so sorted that those with the same two corners follow each other.

    Args:
        face: (3 m,), that each edge is of.
        upward: (3 m,), whether that face runs through it from the lower corner number to the higher.
        first: (e,), where the edges of each two corners begin.
    """

    face: Indices
    upward: NDArray[np.bool_]
    first: Indices

    @staticmethod
    def of(faces: Indices) -> Edges:
        """Return the edges of ``faces`` (m, 3)."""
        start, end = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
        # one number for both corners: sorted ten times as fast as rows
        key = np.minimum(start, end) * (int(faces.max(initial=0)) + 1) + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        key, upward = key[order], (start < end)[order]
        first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
        return Edges(order % len(faces), upward, first)

    @property
    def uses(self) -> Indices:
        """How many faces have each edge, (e,)."""
        return np.diff(self.first, append=len(self.face))

    @property
    def shared(self) -> Indices:
        """The places (n, 2) of each edge that two faces share with no third one."""
        found: Indices = self.first[self.uses == 2][:, None] + np.arange(2)
        return found

    @property
    def pairs(self) -> Indices:
        """The faces (n, 2) that share such an edge."""
        return self.face[self.shared]

    @property
    def balanced(self) -> bool:
        """Whether every edge is run through as often one way as the other."""
        return not np.any(np.add.reduceat(np.where(self.upward, 1, -1), self.first))

    def turned(self, flip: NDArray[np.bool_]) -> Edges:
        """Return the edges with the faces at ``flip`` (m,) turned round."""
        return Edges(self.face, self.upward ^ flip[self.face], self.first)


def joined(pairs: Indices, count: int) -> Indices:
    """Return which piece (count,) each of so many things belongs to, where ``pairs`` (n, 2) of them are joined."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ones = np.ones(len(pairs), dtype=np.int8)
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def closed_outward(vertices: Array, faces: Indices) -> tuple[bool, Indices]:
    """Return whether ``faces`` (m, 3) close, and if so, the faces turned so that each piece has its inside within.

    They close where every edge is run through as often one way as the other: exactly then the winding number is whole
    away from the surface, whether or not an edge belongs to more than two faces. Faces that do not, but would once
    some are turned round, are turned round.
    """
    edges = Edges.of(faces)
    if not edges.balanced:
        flip = _disagreeing(edges, len(faces))
        edges = edges.turned(flip)
        if not edges.balanced:
            return False, faces
        faces = _flipped(faces, flip)
    return True, _outward(vertices, faces, _pieces(edges, len(faces)))


def _flipped(faces: Indices, flip: NDArray[np.bool_]) -> Indices:
    """Return ``faces`` (m, 3) with those at ``flip`` (m,) turned round."""
    return np.where(flip[:, None], faces[:, ::-1], faces)


def _disagreeing(edges: Edges, count: int) -> NDArray[np.bool_]:
    """Return which of ``count`` faces are to be turned round so that neighbours run through their edge both ways."""
    # Two copies of each face, as it is and turned round; neighbours that agree on their edge join equal
    # copies. A component of this graph is a consistent choice of copies, its mirror image the opposite one.
    one, other = edges.pairs.T
    upward = edges.upward[edges.shared]
    turned = upward[:, 0] == upward[:, 1]
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * turned, other + count * ~turned])
    label = joined(np.column_stack([rows, columns]), 2 * count)
    flip = label[:count] > label[count:]
    component = np.minimum(label[:count], label[count:])
    # most faces of a component are taken to be right, so that cavities stay cavities
    flip ^= (np.bincount(component, weights=flip) > 0.5 * np.bincount(component))[component]
    return flip


def _outward(vertices: Array, faces: Indices, piece: Indices) -> Indices:
    """Return closed ``faces`` (m, 3) so turned that each ``piece`` (m,) has its inside within.

    A piece that faces inward and lies wholly inside the others is a cavity, and stays; one that reaches out of
    them, or stands alone, was turned inside out in the file: where it overlaps others its winding would cancel
    theirs.
    """
    corners_asked = 50  # corners of a piece that faces inward that are asked whether they lie inside the others
    corners = vertices[faces]
    middle = vertices.mean(axis=0)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volumes = np.bincount(piece, weights=dots(corners[:, 0] - middle, areas))
    if volumes.sum() < 0:
        faces, corners, areas, volumes = faces[:, ::-1], corners[:, ::-1], -areas, -volumes
    right = volumes[piece] > 0
    turned = np.zeros(len(volumes), dtype=bool)
    for inward in np.flatnonzero(volumes < 0):
        own = np.unique(faces[piece == inward])
        asked = own[:: max(1, len(own) // corners_asked)]
        inside = np.abs(winding_numbers(vertices[asked], corners[right], areas[right])) > 0.5
        turned[inward] = not np.all(inside)
    return _flipped(faces, turned[piece])


def _pieces(edges: Edges, count: int) -> Indices:
    """Return which piece each of ``count`` faces belongs to, (count,): pieces are joined by edges of two faces.

    Where more faces meet at an edge, as where two bodies touch, such a piece may be a part of a surface only; what
    does not close by itself is one piece with its neighbours.
    """
    piece = joined(edges.pairs, count)
    uses = edges.uses
    if uses.max() == 2:  # all are, where they close
        return piece
    crowded = np.repeat(uses > 2, uses)
    edge = np.repeat(np.arange(len(uses)), uses)[crowded]
    way = np.where(edges.upward[crowded], 1.0, -1.0)
    pieces = int(piece.max()) + 1
    both, index = np.unique(edge * pieces + piece[edges.face[crowded]], return_inverse=True)
    edge, owner = both // pieces, both % pieces
    torn = np.isin(owner, owner[np.bincount(index, weights=way) != 0])
    edge, owner = edge[torn], owner[torn]
    next_to = edge[1:] == edge[:-1]  # sorted by edge
    return joined(np.column_stack([owner[:-1], owner[1:]])[next_to], pieces)[piece]

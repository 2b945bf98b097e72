"""Which way the triangles of a mesh face: made to close, and to face outward, piece by piece."""

from __future__ import annotations

import numpy as np

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


def outward(vertices: Array, faces: Indices) -> Indices:
    """Return closed ``faces`` (m, 3) so turned that each piece has its inside within.

    A piece that faces inward and lies wholly inside the others is a cavity, and stays; one that reaches out of
    them, or stands alone, was turned inside out in the file: where it overlaps others its winding would cancel
    theirs.
    """
    corners_asked = 50  # corners of a piece that faces inward that are asked whether they lie inside the others
    piece = _pieces(faces)
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
    return np.where(turned[piece][:, None], faces[:, ::-1], faces)


def _pieces(faces: Indices) -> Indices:
    """Return the number (m,) of the piece that each face belongs to: pieces are joined by edges of two faces.

    Where more faces meet at an edge, as where two bodies touch, such a piece may be a part of a surface only; what
    does not close by itself is one piece with its neighbours.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    def joined(pairs: Indices, count: int) -> Indices:
        ones = np.ones(len(pairs), dtype=np.int8)
        graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1])

    pairs, edges = neighbours(faces)
    piece = joined(pairs % len(faces), len(faces))
    _, edge, uses = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    crowded = np.flatnonzero(uses[edge] > 2)
    if not len(crowded):
        return piece
    owner, way = piece[crowded % len(faces)], np.where(edges[crowded, 0] < edges[crowded, 1], 1.0, -1.0)
    both, index = np.unique(np.column_stack([edge[crowded], owner]), axis=0, return_inverse=True)
    torn = np.isin(both[:, 1], both[np.bincount(index.reshape(-1), weights=way) != 0, 1])
    both = both[torn]
    next_to = both[1:, 0] == both[:-1, 0]  # sorted by edge
    return joined(np.column_stack([both[:-1, 1], both[1:, 1]])[next_to], int(piece.max()) + 1)[piece]


def neighbours(faces: Indices) -> tuple[Indices, Indices]:
    """Return the edges (n, 2), by number, that two faces share, and all edges as :func:`_edges` lists them."""
    edges = _edges(faces)
    _, edge, uses = np.unique(_edge_keys(edges), return_inverse=True, return_counts=True)
    order = np.argsort(edge, kind="stable")
    return order[uses[edge[order]] == 2].reshape(-1, 2), edges


def closing(faces: Indices) -> tuple[bool, Indices]:
    """Return whether ``faces`` (m, 3) close, and the faces, some turned round where that makes them close.

    They close where every edge is run through as often one way as the other: exactly then the winding number
    is whole away from the surface, whether or not an edge belongs to more than two faces.
    """
    if _balanced(faces):
        return True, faces
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    # Two copies of each face, as it is and turned round; neighbours that agree on their edge join equal
    # copies. A component of this graph is a consistent choice of copies, its mirror image the opposite one.
    count = len(faces)
    pairs, edges = neighbours(faces)
    owner, upward = np.tile(np.arange(count), 3), edges[:, 0] < edges[:, 1]
    one, other = owner[pairs].T
    turned = upward[pairs[:, 0]] == upward[pairs[:, 1]]
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * turned, other + count * ~turned])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    label = connected_components(graph, directed=False)[1]
    flip = label[:count] > label[count:]
    component = np.minimum(label[:count], label[count:])
    # most faces of a component are taken to be right, so that cavities stay cavities
    flip ^= (np.bincount(component, weights=flip) > 0.5 * np.bincount(component))[component]
    repaired = np.where(flip[:, None], faces[:, ::-1], faces)
    return (True, repaired) if _balanced(repaired) else (False, faces)


def _balanced(faces: Indices) -> bool:
    """Whether every edge of ``faces`` is run through as often one way as the other."""
    edges = _edges(faces)
    _, index = np.unique(_edge_keys(edges), return_inverse=True)
    return not np.any(np.bincount(index, weights=np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0)))


def _edge_keys(edges: Indices) -> Indices:
    """Return a number (n,) for each of ``edges`` (n, 2), whichever way it runs: sorted ten times as fast as rows."""
    found: Indices = edges.min(axis=1) * (int(edges.max(initial=0)) + 1) + edges.max(axis=1)
    return found


def _edges(faces: Indices) -> Indices:
    """Return the edges (3 m, 2) of ``faces`` (m, 3), each the way its face runs through it."""
    return np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])

"""Triangle meshes from files: read by trimesh, merged, and turned so that they close where they can.

trimesh is imported when the first mesh is read.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .errors import ProblemError
from .problem import MeshFile
from .rotations import Array
from .vectors import Indices

METRES = {None: 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}  # None: the format is in metres itself
FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf")
MOST_FACES = 10_000_000


def read_mesh(key: str, mesh: MeshFile) -> tuple[Array, Indices, bool]:
    """Return the vertices (k, 3), m, of ``mesh``, its faces (m, 3), and whether these close.

    Args:
        key: what the problem calls it, for messages.
        mesh: its path and unit.

    Raises:
        ProblemError: a file that cannot be read, has no triangles, too many, or numbers that are not finite;
            an unknown format or unit.
    """
    vertices, faces = _read(key, mesh)
    closed, faces = _orient(faces)
    return vertices * METRES[mesh.unit], faces, closed


def _read(key: str, mesh: MeshFile) -> tuple[Array, Indices]:
    """Return the vertices (k, 3), in the file's unit and merged, and the faces (m, 3) of ``mesh``."""
    import trimesh

    if mesh.path.suffix.lower() not in FORMATS:
        raise ProblemError(f"{key}: found {mesh.path.name!r}, expected a file ending in {', '.join(FORMATS)}")
    if mesh.unit not in METRES:
        raise ProblemError(f"{key}_unit: found {mesh.unit!r}, expected one of m, cm, mm, in")
    try:
        loaded: Any = trimesh.load_scene(mesh.path, process=False).to_mesh()
    except Exception as error:  # the readers of foreign files fail in as many ways as there are files
        raise ProblemError(f"{key}: found {mesh.path} unreadable ({error}), expected a triangle mesh") from error
    if len(loaded.faces) == 0:
        raise ProblemError(f"{key}: found no triangles in {mesh.path}, expected a triangle mesh")
    if len(loaded.faces) > MOST_FACES:
        raise ProblemError(f"{key}: found {len(loaded.faces):,} triangles, expected at most {MOST_FACES:,}")
    if not np.all(np.isfinite(loaded.vertices)):
        raise ProblemError(f"{key}: found vertices that are not finite in {mesh.path}, expected numbers")
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    faces = np.asarray(loaded.faces, dtype=np.int64)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return np.array(loaded.vertices, dtype=float), faces[distinct]


def _orient(faces: Indices) -> tuple[bool, Indices]:
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
    edges = _edges(faces)
    owner, upward = np.tile(np.arange(count), 3), edges[:, 0] < edges[:, 1]
    _, edge, uses = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge, kind="stable")
    pairs = order[uses[edge[order]] == 2].reshape(-1, 2)
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
    key = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    _, index = np.unique(key, return_inverse=True)
    return not np.any(np.bincount(index, weights=np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0)))


def _edges(faces: Indices) -> Indices:
    """Return the edges (3 m, 2) of ``faces`` (m, 3), each the way its face runs through it."""
    return np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])

"""Triangle meshes from files: read by trimesh, merged, and turned so that they close, outward, where they can.

trimesh is imported when the first mesh is read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .errors import ProblemError
from .mesh_orientation import closing, outward
from .problem import MeshFile
from .rotations import Array
from .vectors import Indices

METRES = {None: 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}  # None: the format is in metres itself
FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf")
MOST_FACES = 10_000_000
STL_HEAD, STL_FACE = 84, 50  # bytes of a binary STL file: its head, which ends in the count, and one triangle


def read_mesh(key: str, mesh: MeshFile) -> tuple[Array, Indices, bool]:
    """Return the vertices (k, 3), m, of ``mesh``, its faces (m, 3), and whether these close.

    Args:
        key: what the problem calls it, for messages.
        mesh: its path and unit.

    Raises:
        ProblemError: a file that cannot be read, has no triangles, too many, or numbers that are not finite;
            an unknown format or unit; a surface that is not closed where no shell was asked for.
    """
    vertices, faces = _read(key, mesh)
    closed, faces = closing(faces)
    if not (closed or mesh.shell):
        raise ProblemError(
            f"{key}: found a surface that is not closed in {mesh.path}, expected a closed one, or shell = true "
            "beside it: a shell has no inside, and a cable there goes unnoticed"
        )
    return vertices * METRES[mesh.unit], outward(vertices, faces) if closed else faces, closed


def _read(key: str, mesh: MeshFile) -> tuple[Array, Indices]:
    """Return the vertices (k, 3), in the file's unit and merged, and the faces (m, 3) of ``mesh``."""
    import trimesh

    if mesh.path.suffix.lower() not in FORMATS:
        raise ProblemError(f"{key}: found {mesh.path.name!r}, expected a file ending in {', '.join(FORMATS)}")
    if mesh.unit not in METRES:
        raise ProblemError(f"{key}_unit: found {mesh.unit!r}, expected one of m, cm, mm, in")
    # a file of twenty million triangles would first have to be held
    _refuse_many(key, _binary_stl_faces(mesh.path))
    try:
        loaded: Any = trimesh.load_scene(mesh.path, process=False).to_mesh()
    except Exception as error:  # the readers of foreign files fail in as many ways as there are files
        raise ProblemError(f"{key}: found {mesh.path} unreadable ({error}), expected a triangle mesh") from error
    if len(loaded.faces) == 0:
        raise ProblemError(f"{key}: found no triangles in {mesh.path}, expected a triangle mesh")
    _refuse_many(key, len(loaded.faces))
    if not np.all(np.isfinite(loaded.vertices)):
        raise ProblemError(f"{key}: found vertices that are not finite in {mesh.path}, expected numbers")
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    faces = np.asarray(loaded.faces, dtype=np.int64)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return np.array(loaded.vertices, dtype=float), faces[distinct]


def _refuse_many(key: str, faces: int) -> None:
    """Raise where there are too many ``faces``."""
    if faces > MOST_FACES:
        raise ProblemError(f"{key}: found {faces:,} triangles, expected at most {MOST_FACES:,}")


def _binary_stl_faces(path: Path) -> int:
    """Return how many triangles a binary STL file says it has, if it is long enough for them; else 0."""
    if path.suffix.lower() != ".stl" or not path.is_file():
        return 0
    with path.open("rb") as file:
        head = file.read(STL_HEAD)
    count = int.from_bytes(head[-4:], "little") if len(head) == STL_HEAD else 0
    return count if path.stat().st_size == STL_HEAD + STL_FACE * count else 0

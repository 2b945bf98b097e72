"""Triangle meshes from files: read by trimesh, merged, and turned so that they close, outward, where they can.

trimesh is imported when the first mesh is read.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.files.places import MOST_MESH_BYTES
from harness_opt.model.parts import MeshFile
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices
from harness_opt.parts.mesh_headers import Refused, beside, is_text, refuse_faces
from harness_opt.parts.orientation import closing, outward

_UNHEARD = logging.NullHandler()
SOLIDS = re.compile(rb"^[ \t]*(?:end)?solid\b.*$", re.IGNORECASE | re.MULTILINE)
TEXTURES = re.compile(rb"/[^\s/]*")  # numbers of texture corners and normals, behind that of a corner
METRES = {None: 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}  # None: the format is in metres itself
FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf")
LONGEST = 200  # characters of what a reader says
FARTHEST = 1e9  # of a corner from the origin, in the file's unit; beyond, merging corners would overflow


def read_mesh(key: str, mesh: MeshFile) -> tuple[Array, Indices, bool]:
    """Return the vertices (k, 3), m, of ``mesh``, its faces (m, 3), and whether these close.

    Args:
        key: what the problem calls it, for messages.
        mesh: its path, unit and axis that points up.

    Raises:
        ProblemError: a file that cannot be read, has no triangles, too many, or numbers that are not finite;
            an unknown format, unit or axis; a surface that is not closed where no shell was asked for.
    """
    vertices, faces = _read(key, mesh)
    if mesh.up_axis == "y":
        vertices = vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0]  # (x, -z, y)
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

    logging.getLogger("trimesh").addHandler(_UNHEARD)  # what it meets on the way; what stops it comes as an exception
    if mesh.path.suffix.lower() not in FORMATS:
        raise ProblemError(f"{key}: found {mesh.path.name!r}, expected a file ending in {', '.join(FORMATS)}")
    if mesh.unit not in METRES:
        raise ProblemError(f"{key}_unit: found {mesh.unit!r}, expected one of m, cm, mm, in")
    if mesh.up_axis not in ("y", "z"):
        raise ProblemError(f"{key.removesuffix('mesh')}up: found {mesh.up!r}, expected one of 'y', 'z'")
    try:
        files = beside(mesh.path, MOST_MESH_BYTES)
        with np.errstate(all="ignore"):
            options: dict[str, Any] = {"process": False, "skip_materials": True, "resolver": files}
            suffix = mesh.path.suffix.lower()
            if suffix == ".obj":
                loaded: Any = trimesh.load_scene(_bare(mesh.path.read_bytes()), file_type="obj", **options)
            elif suffix == ".stl" and is_text(mesh.path):
                loaded = trimesh.load_scene(_one_solid(mesh.path.read_bytes()), file_type="stl", **options)
            else:
                loaded = trimesh.load_scene(mesh.path, **options)
            refuse_faces(sum(_faces_placed(loaded)))
            loaded = loaded.to_mesh()
        vertices, faces = np.asarray(loaded.vertices, dtype=float), np.asarray(loaded.faces, dtype=np.int64)
        _refuse_damage(vertices, faces)
    except Refused as error:
        raise ProblemError(f"{key}: {error} ({mesh.path})") from None
    except Exception as error:  # the readers of foreign files fail in as many ways as there are files
        words = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
        raise ProblemError(f"{key}: found {mesh.path} unreadable ({words}), expected a triangle mesh") from error
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    faces = np.asarray(loaded.faces, dtype=np.int64)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    if not np.any(distinct):
        raise ProblemError(f"{key}: found no triangle with an area in {mesh.path}, expected a triangle mesh")
    return np.array(loaded.vertices, dtype=float), faces[distinct]


def _bare(content: bytes) -> io.BytesIO:
    """Return the corners and faces alone of an OBJ file: each group and material would be a mesh of its own."""
    lines = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    kept = [line for line in map(bytes.strip, lines) if line.startswith((b"v ", b"v\t", b"f ", b"f\t"))]
    return io.BytesIO(TEXTURES.sub(b"", b"\n".join(kept)) + b"\n")


def _one_solid(content: bytes) -> io.BytesIO:
    """Return the triangles of all solids of an STL file in one: each would be a mesh of its own."""
    return io.BytesIO(b"solid all\n" + SOLIDS.sub(b"", content) + b"\nendsolid all\n")


def _faces_placed(scene: Any) -> Iterator[int]:
    """Yield how many triangles each node of a scene shows: one mesh may be shown many times."""
    for node in scene.graph.nodes_geometry:
        yield len(getattr(scene.geometry[scene.graph[node][1]], "faces", ()))


def _refuse_damage(vertices: Array, faces: Indices) -> None:
    """Raise where corners and triangles are no mesh."""
    if not len(faces):
        raise Refused("no triangles")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.shape[1:] != (3,):
        raise Refused("corners that are not in space")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise Refused("triangles with corners that are not there")
    if not np.all(np.isfinite(vertices)):
        raise Refused("corners that are not finite")
    far = float(np.max(np.abs(vertices)))
    if far > FARTHEST:
        raise Refused(f"a corner {far:.3g} units from the origin", f"at most {FARTHEST:g}")

"""Triangle meshes from files: read, merged, and turned so that they close, outward, where they can.

Binary STL and glTF are read here; text STL, OBJ and PLY by trimesh, which is imported when the first of them is.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.files.places import MOST_MESH_BYTES, unreadable
from harness_opt.model.checks import shown
from harness_opt.model.parts import MeshFile
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices
from harness_opt.parts.gltf_file import read_gltf
from harness_opt.parts.mesh_headers import STL_HEAD, Refused, beside, is_text, refuse_faces, refuse_text
from harness_opt.parts.orientation import closed_outward

_UNHEARD = logging.NullHandler()
SOLIDS = re.compile(rb"^[ \t]*(?:end)?solid\b.*$", re.IGNORECASE | re.MULTILINE)
NOUGHT = re.compile(rb"[\s][-+]?0+(?=\s|$)")  # among the corners of faces
TEXTURES = re.compile(rb"/[^\s/]*")  # numbers of texture corners and normals, behind that of a corner
METRES = {None: 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}  # None: the format is in metres itself
LONGEST = 200  # characters of what a reader says
SAME = 1e-8  # of the file's unit: corners that near are one
MIXERS = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64)  # splitmix64's
FARTHEST = 1e9  # of a corner from the origin, in the file's unit; beyond, merging corners would overflow


def read_mesh(key: str, mesh: MeshFile) -> tuple[Array, Indices, bool]:
    """Return the vertices (k, 3), m, of ``mesh``, its faces (m, 3), and whether these close.

    Args:
        key: what the problem calls it, for messages.
        mesh: its path, unit and axis that points up.

    Raises:
        ProblemError: a file that cannot be read, has no triangles, too many, or numbers that are not finite;
            a surface that is not closed where no shell was asked for.
    """
    vertices, faces = _read(key, mesh)
    if mesh.up_axis == "y":
        vertices = vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0]  # (x, -z, y)
    vertices = vertices * mesh.scale
    if np.prod(np.sign(mesh.scale)) < 0:
        faces = faces[:, ::-1]  # mirrored: what was outside would be inside
    closed, faces = closed_outward(vertices, faces)
    if not (closed or mesh.shell):
        raise ProblemError(
            f"{key}: found a surface that is not closed in {mesh.path}, expected a closed one, or shell = true "
            "beside it: a shell has no inside, and a cable there goes unnoticed"
        )
    return vertices * METRES[mesh.unit], faces, closed


def _read(key: str, mesh: MeshFile) -> tuple[Array, Indices]:
    """Return the vertices (k, 3), in the file's unit and merged, and the faces (m, 3) of ``mesh``."""
    why = unreadable(mesh.path, MOST_MESH_BYTES)
    if why:
        raise ProblemError(f"{key}: found {shown(str(mesh.path))}, {why}, expected a mesh")
    try:
        files = beside(mesh.path, MOST_MESH_BYTES)
        with np.errstate(all="ignore"):  # what is not finite is refused in words
            vertices, faces = _corners_and_faces(mesh.path, files)
        _refuse_damage(vertices, faces)
    except Refused as error:
        raise ProblemError(f"{key}: {error} ({mesh.path})") from None
    except (MemoryError, RecursionError):
        raise
    except Exception as error:  # the readers of foreign files fail in as many ways as there are files
        words = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
        raise ProblemError(f"{key}: found {mesh.path} unreadable ({words}), expected a triangle mesh") from error
    vertices, faces = merged(vertices, faces)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    if not np.any(distinct):
        raise ProblemError(f"{key}: found no triangle with an area in {mesh.path}, expected a triangle mesh")
    return vertices, faces[distinct]


def _corners_and_faces(file: Path, files: Mapping[str, bytes]) -> tuple[Array, Indices]:
    """Return the corners (k, 3), as the file has them, and the faces (m, 3); ``files`` are those that it names."""
    suffix = file.suffix.lower()
    if suffix in (".gltf", ".glb"):
        return read_gltf(file, files)
    if suffix == ".stl" and not is_text(file):
        return _binary_stl(file)
    import trimesh  # half a second that the formats above do without

    logging.getLogger("trimesh").addHandler(_UNHEARD)  # what it meets on the way; what stops it comes as an exception
    options: dict[str, Any] = {"process": False, "skip_materials": True, "resolver": files}
    loaded: Any
    if suffix == ".obj":
        loaded = trimesh.load_scene(_bare(file.read_bytes()), file_type="obj", **options)
    elif suffix == ".stl":
        content = file.read_bytes()
        refuse_text(content)
        loaded = trimesh.load_scene(_one_solid(content), file_type="stl", **options)
    else:
        loaded = trimesh.load_scene(file, **options)
    refuse_faces(sum(_faces_placed(loaded)))
    loaded = loaded.to_mesh()
    return np.asarray(loaded.vertices, dtype=float), np.asarray(loaded.faces, dtype=np.int64)


def _binary_stl(file: Path) -> tuple[Array, Indices]:
    """Return the corners (3 m, 3) and faces (m, 3) of a binary STL file, each triangle with corners of its own."""
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    corners = np.fromfile(file, triangle, offset=STL_HEAD)["corners"].reshape(-1, 3).astype(float)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def merged(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """Return the vertices that ``faces`` use, those at one place as one, in the order they come in, and the faces.

    Places are compared by a number made of their coordinates, rounded to :data:`SAME`: sorting it takes a tenth of the
    time that sorting rows does.
    """
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    kept = np.flatnonzero(used)
    rounded = np.rint(vertices[kept] / SAME).astype(np.int64).view(np.uint64)
    key = rounded[:, 0] * MIXERS[0]
    for column in (1, 2):
        key = (key ^ (key >> np.uint64(29))) * MIXERS[column] + rounded[:, column]
    order = np.argsort(key, kind="stable")
    key = key[order]
    begins = np.concatenate([[True], key[1:] != key[:-1]])
    ordered = rounded[order]
    same = np.all(ordered[1:] == ordered[:-1], axis=1)
    if not np.all(begins[1:] | same):  # two places with one key: as good as never
        order = np.lexsort(rounded.T)
        ordered = rounded[order]
        begins = np.concatenate([[True], np.any(ordered[1:] != ordered[:-1], axis=1)])
    first = order[begins]
    new = np.zeros(len(kept), dtype=bool)
    new[first] = True
    number = np.zeros(len(vertices), dtype=np.int64)
    number[kept[order]] = (np.cumsum(new) - 1)[first][np.cumsum(begins) - 1]
    return vertices[kept[new]], number[faces]


def _bare(content: bytes) -> io.BytesIO:
    """Return the corners and faces alone of an OBJ file: each group and material would be a mesh of its own."""
    lines = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    kept = [line for line in map(bytes.strip, lines) if line.startswith((b"v ", b"v\t", b"f ", b"f\t"))]
    faces = [k for k, line in enumerate(kept) if line.startswith(b"f")]
    text = TEXTURES.sub(b"", b"\n".join(kept[k] for k in faces))
    if NOUGHT.search(text):
        raise Refused("a triangle with corner 0", "corners counted from 1")
    if b"-" in text:
        kept = list(_counted(kept))
        text = TEXTURES.sub(b"", b"\n".join(kept[k] for k in faces))
    corners = b"\n".join(line for line in kept if line.startswith(b"v"))
    return io.BytesIO(corners + b"\n" + text + b"\n")


def _counted(lines: Sequence[bytes]) -> Iterator[bytes]:
    """Yield the lines of an OBJ file with corners that were counted back from the last one counted from the first."""
    count = 0
    for line in lines:
        count += line.startswith(b"v")
        if not line.startswith(b"f") or b"-" not in line:
            yield line
            continue
        numbers = [int(number) for number in TEXTURES.sub(b"", line).split()[1:]]
        if any(number < -count for number in numbers):
            raise Refused("a triangle with a corner before the first", "corners that are there")
        yield b"f " + b" ".join(b"%d" % (n if n > 0 else count + 1 + n) for n in numbers)


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

"""Triangles of glTF and GLB files: the Khronos specification 2.0, of which corners and triangles alone are read.

Arrays may be sparse (section 3.6.2.3) and of whole numbers that stand for shares (3.11, KHR_mesh_quantization). What a
file announces is held against the bytes that it has before memory is given to it.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices
from harness_opt.parts.mesh_headers import COMPONENTS, GLB_HEAD, Refused, gltf_head, refuse_faces

NUMBERS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # by componentType, 3.6.2.2
# extensions that a file may require: of numbers that are understood here, or of what has no say in a shape
QUANTIZED = "KHR_mesh_quantization"
LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of a primitive, 3.7.2.1
CHUNK_HEAD = 8  # bytes: length and kind


def read_gltf(file: Path, files: Mapping[str, bytes]) -> tuple[Array, Indices]:
    """Return the corners (k, 3), m, of the scene that a file shows, its y axis up, and the triangles (m, 3).

    Args:
        file: a ``.gltf`` or ``.glb``.
        files: content of the files that it names, by the name it has for them.

    Raises:
        Refused: it requires an extension that is not known here, or announces more than it holds.
        ValueError, KeyError, TypeError, IndexError: it is damaged.
    """
    head = gltf_head(file)
    for name in head.get("extensionsRequired", ()):
        if name != QUANTIZED and not str(name).startswith(LOOKS):
            raise Refused(f"the required extension {name!r}", f"{QUANTIZED} at most: export the mesh uncompressed")
    numbers = _Numbers(head, file, files)
    pieces: dict[int, tuple[Array, Indices]] = {}
    corners: list[Array] = []
    triangles: list[Indices] = []
    count = faces = 0
    for mesh, placement in _shown(head):
        if mesh not in pieces:
            pieces[mesh] = _piece(head["meshes"][mesh], numbers)
        points, indices = pieces[mesh]
        faces += len(indices)
        refuse_faces(faces)
        mirrored = np.linalg.det(placement[:3, :3]) < 0  # turns front to back, 3.7.4
        corners.append(points @ placement[:3, :3].T + placement[:3, 3])
        triangles.append((indices[:, ::-1] if mirrored else indices) + count)
        count += len(points)
    if not corners:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    return np.vstack(corners), np.vstack(triangles)


class _Numbers:
    """The arrays of a file, by the number of their accessor."""

    def __init__(self, head: Mapping[str, Any], file: Path, files: Mapping[str, bytes]):
        self._head = head
        self._buffers = [_buffer(buffer, file, files) for buffer in head.get("buffers", ())]
        self._bytes = sum(map(len, self._buffers))

    def array(self, number: int) -> Any:
        """Return an accessor's rows as they are meant: shares where it is normalised."""
        accessor = self._head["accessors"][_natural(number)]
        count, kind = _natural(accessor["count"]), np.dtype(NUMBERS[accessor["componentType"]])
        columns = COMPONENTS[accessor["type"]]
        if "bufferView" in accessor:
            rows = self._rows(accessor, count, kind, columns)
        elif count * columns > self._bytes:
            raise Refused(f"{count * columns:,} numbers announced in {self._bytes:,} bytes")
        else:
            rows = np.zeros((count, columns), dtype=kind)
        if "sparse" in accessor:
            rows = self._patched(rows, accessor["sparse"], kind, columns)
        return _shares(rows) if accessor.get("normalized") else rows

    def _patched(self, rows: Any, sparse: Mapping[str, Any], kind: np.dtype[Any], columns: int) -> Any:
        """Return ``rows`` with those replaced that a sparse accessor names."""
        count, places = _natural(sparse["count"]), sparse["indices"]
        at = self._rows(places, count, np.dtype(NUMBERS[places["componentType"]]), 1)[:, 0].astype(np.int64)
        if count > len(rows) or np.any(np.diff(at) <= 0) or (count and at[-1] >= len(rows)):
            raise Refused("a sparse array whose places do not follow each other within it")
        rows = rows.copy()
        rows[at] = self._rows(sparse["values"], count, kind, columns)
        return rows

    def _rows(self, place: Mapping[str, Any], count: int, kind: np.dtype[Any], columns: int) -> Any:
        """Return ``count`` rows of numbers from a buffer view, which may lie apart (3.6.2.4)."""
        view = self._head["bufferViews"][_natural(place["bufferView"])]
        buffer = self._buffers[_natural(view["buffer"])]
        begin, length = _natural(view.get("byteOffset", 0)), _natural(view["byteLength"])
        offset, width = _natural(place.get("byteOffset", 0)), columns * kind.itemsize
        stride = _natural(view.get("byteStride", 0)) or width
        needed = offset + (count - 1) * stride + width if count else 0
        if needed > length or begin + length > len(buffer) or stride < width:
            raise Refused(f"{count:,} rows announced in {length:,} of {len(buffer):,} bytes")
        rows = np.ndarray((count, columns), kind, buffer, begin + offset, (stride, kind.itemsize))
        return rows.copy()  # aligned, and not a part of the file any more


def _buffer(buffer: Mapping[str, Any], file: Path, files: Mapping[str, bytes]) -> bytes:
    """Return the bytes of a buffer: beside the file, within its JSON, or behind it."""
    name = buffer.get("uri", "")
    if not name:
        content = _chunk(file)
    elif name.startswith("data:"):
        try:
            content = base64.b64decode(name.partition(",")[2], validate=True)
        except binascii.Error as error:
            raise Refused(f"data that are not base64 ({error})") from error
    else:
        content = files[name]
    if _natural(buffer["byteLength"]) > len(content):
        raise Refused(f"{buffer['byteLength']:,} bytes announced of {len(content):,}")
    return content


def _chunk(file: Path) -> bytes:
    """Return the binary chunk of a GLB file (4.4)."""
    if file.suffix.lower() != ".glb":
        raise Refused("a buffer without a place")
    with file.open("rb") as stream:
        start = stream.read(GLB_HEAD)
        stream.seek(int.from_bytes(start[12:16], "little"), 1)
        length = int.from_bytes(stream.read(CHUNK_HEAD)[:4], "little")
        return stream.read(min(length, file.stat().st_size))


def _shares(rows: Any) -> Array:
    """Return whole numbers as the shares of one that they stand for (3.11)."""
    kind = rows.dtype
    shares: Array = rows if kind.kind == "f" else np.maximum(rows / float(np.iinfo(kind).max), -1.0)
    return shares


def _piece(mesh: Mapping[str, Any], numbers: _Numbers) -> tuple[Array, Indices]:
    """Return the corners (k, 3) and triangles (m, 3) of a mesh's primitives; points and lines are none."""
    corners: list[Array] = [np.zeros((0, 3))]
    triangles: list[Indices] = [np.zeros((0, 3), dtype=np.int64)]
    count = 0
    for primitive in mesh["primitives"]:
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in primitive["attributes"]:
            continue
        points = np.asarray(numbers.array(primitive["attributes"]["POSITION"]), dtype=float)
        if points.shape[1] != 3:
            raise Refused("corners that are not in space")
        if "indices" in primitive:
            order = numbers.array(primitive["indices"])[:, 0].astype(np.int64)
        else:
            order = np.arange(len(points))
        if len(order) and order.max() >= len(points):
            raise Refused("triangles with corners that are not there")
        corners.append(points)
        triangles.append(_triangles(order, mode) + count)
        count += len(points)
    return np.vstack(corners), np.vstack(triangles)


def _triangles(order: Indices, mode: int) -> Indices:
    """Return the triangles (m, 3) that corners in a row stand for."""
    if mode == TRIANGLES:
        if len(order) % 3:
            raise Refused(f"{len(order):,} corners of triangles", "three for each")
        return order.reshape(-1, 3)
    count = max(len(order) - 2, 0)
    k = np.arange(count)
    if mode == FAN:
        return np.column_stack([order[k + 1], order[k + 2], np.broadcast_to(order[:1], count)])
    odd = k % 2  # every other one of a strip is turned back
    return np.column_stack([order[k], order[k + 1 + odd], order[k + 2 - odd]])


def _shown(head: Mapping[str, Any]) -> Iterator[tuple[int, Array]]:
    """Yield the mesh of each node that the file's scene shows, and where it stands, (4, 4)."""
    nodes = head.get("nodes", ())
    if head.get("scenes"):
        waiting = [(k, np.eye(4)) for k in head["scenes"][_natural(head.get("scene", 0))].get("nodes", ())]
    else:
        below = {child for node in nodes for child in node.get("children", ())}
        waiting = [(k, np.eye(4)) for k in range(len(nodes)) if k not in below]
    while waiting:
        number, above = waiting.pop()
        node = nodes[_natural(number)]
        placement = above @ _placement(node)
        if "mesh" in node:
            yield _natural(node["mesh"]), placement
        waiting += [(child, placement) for child in reversed(node.get("children", ()))]


def _placement(node: Mapping[str, Any]) -> Array:
    """Return the matrix (4, 4) of a node in the one above (3.5.3)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    placement = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    placement[:3, :3] = rotations.matrix(rotations.unit([w, x, y, z])) * np.asarray(
        node.get("scale", np.ones(3)), float
    )
    placement[:3, 3] = node.get("translation", np.zeros(3))
    return placement


def _natural(number: Any) -> int:
    """Return a whole number of at least 0: below 0 Python counts from the end."""
    if type(number) is not int or number < 0:
        raise Refused(f"{number!r}", "a whole number of at least 0 in a triangle mesh")
    return number

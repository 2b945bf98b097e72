"""glTF as its specification has it: sparse arrays, whole numbers that stand for shares, strips, mirrors, extensions."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from harness_opt.errors import ProblemError
from harness_opt.model.parts import MeshFile
from harness_opt.parts.gltf_file import read_gltf
from harness_opt.parts.mesh_file import read_mesh
from harness_opt.parts.mesh_headers import beside

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


class Made:
    """A file that is put together piece by piece."""

    def __init__(self) -> None:
        self.data, self.views, self.accessors = b"", [], []

    def view(self, array: np.ndarray, stride: int = 0) -> int:
        rows = np.atleast_2d(array.T).T
        width = rows.shape[1] * rows.itemsize
        content = b"".join(row.tobytes().ljust(stride or width, b"\xaa") for row in rows)
        self.data += bytes(-len(self.data) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)})
        if stride:
            self.views[-1]["byteStride"] = stride
        self.data += content
        return len(self.views) - 1

    def accessor(self, array: np.ndarray, kind: str, stride: int = 0, **more: object) -> int:
        array = np.asarray(array).astype(f"<{kind}")
        name = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        view = self.view(array, stride)
        self.accessors.append(
            {"bufferView": view, "componentType": KINDS[kind], "count": len(array), "type": name, **more}
        )
        return len(self.accessors) - 1

    def file(self, path: Path, nodes: list | None = None, primitive: dict | None = None, **more: object) -> Path:
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        head = {
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": len(self.data), "uri": uri}],
            "bufferViews": self.views,
            "accessors": self.accessors,
            "meshes": [{"primitives": [primitive or {"attributes": {"POSITION": 0}, "indices": 1}]}],
            "nodes": nodes or [{"mesh": 0}],
            "scenes": [{"nodes": list(range(len(nodes or [0])))}],
            **more,
        }
        if path.suffix == ".glb":
            del head["buffers"][0]["uri"]
            text = json.dumps(head).encode()
            text += b" " * (-len(text) % 4)
            chunks = (
                struct.pack("<I4s", len(text), b"JSON")
                + text
                + struct.pack("<I4s", len(self.data), b"BIN\0")
                + self.data
            )
            path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        else:
            path.write_text(json.dumps(head))
        return path


def read(file: Path) -> np.ndarray:
    """Return the triangles (m, 3, 3)."""
    vertices, faces = read_gltf(file, beside(file, 10**9))
    return vertices[faces]


def tetrahedron(kind: str = "f4", scale: float = 1.0, stride: int = 0, **more: object) -> Made:
    made = Made()
    made.accessor(scale * CORNERS, kind, stride, **more)
    made.accessor(FACES.ravel(), "u2")
    return made


@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
@pytest.mark.parametrize("stride", [0, 20])
def test_plain_numbers(tmp_path, suffix, stride):
    file = tetrahedron(stride=stride).file(tmp_path / f"m{suffix}")
    np.testing.assert_array_equal(read(file), CORNERS[FACES])
    assert read_mesh("m", MeshFile(file))[2]


@pytest.mark.parametrize(("kind", "one"), [("i1", 127), ("u1", 255), ("i2", 32767), ("u2", 65535)])
def test_whole_numbers_that_stand_for_shares(tmp_path, kind, one):
    shares = tetrahedron(kind, one, normalized=True).file(
        tmp_path / "a.gltf", extensionsRequired=["KHR_mesh_quantization"]
    )
    np.testing.assert_allclose(read(shares), CORNERS[FACES], atol=1e-15)
    whole = tetrahedron(kind, one).file(tmp_path / "b.gltf", extensionsRequired=["KHR_mesh_quantization"])
    np.testing.assert_array_equal(read(whole), one * CORNERS[FACES])


def test_the_smallest_whole_number_is_no_less_than_minus_one(tmp_path):
    made = Made()
    made.accessor(np.where(CORNERS > 0, -128, 0), "i1", normalized=True)
    made.accessor(FACES.ravel(), "u2")
    np.testing.assert_array_equal(read(made.file(tmp_path / "m.gltf")), -CORNERS[FACES])


def test_the_quantised_box_of_an_issue(tmp_path):
    node = {"mesh": 0, "scale": [0.01] * 3, "translation": [1, 1, 1]}
    file = tetrahedron("i2", 32767, 8, normalized=True).file(tmp_path / "m.gltf", [node])
    corners = read(file).reshape(-1, 3)
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[1.0] * 3, [1.01] * 3], rtol=1e-12)


@pytest.mark.parametrize("base", [True, False])
def test_sparse_arrays(tmp_path, base):
    made = Made()
    if base:
        made.accessor(np.where(np.arange(4)[:, None] == 2, 7.0, CORNERS), "f4")
    else:
        made.accessors.append({"componentType": KINDS["f4"], "count": 4, "type": "VEC3"})
    changed = [2] if base else [1, 2, 3]
    places = made.view(np.array(changed, dtype="<u2"))
    values = made.view(CORNERS[changed].astype("<f4"))
    made.accessors[0]["sparse"] = {
        "count": len(changed), "indices": {"bufferView": places, "componentType": KINDS["u2"]},
        "values": {"bufferView": values},
    }  # fmt: skip
    made.accessor(FACES.ravel(), "u2")
    np.testing.assert_array_equal(read(made.file(tmp_path / "m.gltf")), CORNERS[FACES])


@pytest.mark.parametrize("places", [[2, 1], [1, 1], [0, 4]])
def test_sparse_arrays_that_are_none(tmp_path, places):
    made = tetrahedron()
    made.accessors[0]["sparse"] = {
        "count": 2, "indices": {"bufferView": made.view(np.array(places, dtype="<u2")), "componentType": KINDS["u2"]},
        "values": {"bufferView": made.view(CORNERS[:2].astype("<f4"))},
    }  # fmt: skip
    with pytest.raises(ProblemError, match="a sparse array whose places do not follow each other within it"):
        read_mesh("m", MeshFile(made.file(tmp_path / "m.gltf")))


def test_sparse_arrays_of_nothing_but_zeros_are_held_against_the_file(tmp_path):
    made = tetrahedron()
    indices = {"bufferView": made.view(np.array([0], dtype="<u2")), "componentType": KINDS["u2"]}
    sparse = {"count": 1, "indices": indices, "values": {"bufferView": made.view(CORNERS[:1].astype("<f4"))}}
    made.accessors[0] = {"componentType": KINDS["f4"], "count": 20_000_000, "type": "VEC3", "sparse": sparse}
    with pytest.raises(ProblemError, match=r"found 60,000,000 numbers announced in \d+ bytes"):
        read_mesh("m", MeshFile(made.file(tmp_path / "m.gltf")))


def test_strips_fans_and_plain_corners(tmp_path):
    strip = Made()
    strip.accessor(CORNERS, "f4")
    strip.accessor([0, 1, 2, 3], "u1")
    for mode, faces in ((5, [[0, 1, 2], [1, 3, 2]]), (6, [[1, 2, 0], [2, 3, 0]])):
        file = strip.file(tmp_path / "m.gltf", primitive={"attributes": {"POSITION": 0}, "indices": 1, "mode": mode})
        np.testing.assert_array_equal(read(file), CORNERS[faces])
    plain = Made()
    plain.accessor(CORNERS[:3], "f4")
    file = plain.file(tmp_path / "p.gltf", primitive={"attributes": {"POSITION": 0}})
    np.testing.assert_array_equal(read(file), CORNERS[None, :3])
    lines = strip.file(tmp_path / "l.gltf", primitive={"attributes": {"POSITION": 0}, "indices": 1, "mode": 1})
    with pytest.raises(ProblemError, match="found no triangles"):
        read_mesh("m", MeshFile(lines))


def test_nodes_place_turn_scale_and_mirror(tmp_path):
    half = np.sqrt(0.5)
    nodes = [
        {"children": [1], "translation": [1, 2, 3]},
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 1, 1]},
        {"mesh": 0, "scale": [-1, 1, 1]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]},
    ]
    file = tetrahedron().file(tmp_path / "m.gltf", nodes, scenes=[{"nodes": [0, 2, 3]}])
    found = read(file).reshape(3, 4, 3, 3)
    expected = {
        tuple(np.round(np.vstack(part).min(axis=0), 9))
        for part in (
            CORNERS @ [[0, 2, 0], [-1, 0, 0], [0, 0, 1]] + [1, 2, 3],
            CORNERS * [-1, 1, 1],
            CORNERS + np.array([5, 6, 7]),
        )
    }
    assert {tuple(np.round(part.reshape(-1, 3).min(axis=0), 9)) for part in found} == expected
    volumes = [np.einsum("mi,mi->", part[:, 0], np.cross(part[:, 1], part[:, 2])) for part in found]
    assert all(volume > 0 for volume in volumes), "mirrored ones are turned outward again"


@pytest.mark.parametrize(
    "name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_something_new", "KHR_texture_basisu"]
)
def test_required_extensions(tmp_path, name):
    file = tetrahedron().file(tmp_path / "m.gltf", extensionsRequired=[name])
    if name.startswith("KHR_texture"):
        assert len(read(file)) == 4
        return
    with pytest.raises(ProblemError, match=f"found the required extension '{name}', expected KHR_mesh_quantization"):
        read_mesh("m", MeshFile(file))


SPOILT = {
    "a view beyond its buffer": lambda made: made.views[0].update(byteLength=10**6),
    "more rows than bytes": lambda made: made.accessors[0].update(count=5),
    "a stride of nothing": lambda made: made.views[0].update(byteStride=1),
    "an offset before the first": lambda made: made.views[0].update(byteOffset=-4),
    "a buffer counted from the end": lambda made: made.views[0].update(buffer=-1),
    "a count that is no number": lambda made: made.accessors[0].update(count=4.0),
    "corners that are not there": lambda made: made.accessors[0].update(count=3),
    "an unknown kind of number": lambda made: made.accessors[0].update(componentType=5130),
    "half a triangle": lambda made: made.accessors[1].update(count=11),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_damage_is_refused(tmp_path, kind):
    made = tetrahedron()
    SPOILT[kind](made)
    with pytest.raises(ProblemError, match=r"^m: found "):
        read_mesh("m", MeshFile(made.file(tmp_path / "m.gltf")))


def test_it_reads_what_trimesh_reads(tmp_path):
    scene = trimesh.Scene(
        [trimesh.creation.annulus(1, 2, 3), trimesh.creation.icosphere().apply_translation((9, 0, 0))]
    )
    scene.export(tmp_path / "m.glb")
    found, theirs = read(tmp_path / "m.glb"), trimesh.load_mesh(tmp_path / "m.glb")
    assert sorted(map(tuple, found.reshape(-1, 9).tolist())) == sorted(
        map(tuple, np.asarray(theirs.triangles).reshape(-1, 9).tolist())
    )


# --- OBJ -------------------------------------------------------------------------------------------------

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


@pytest.mark.parametrize("face", ["f 0 1 2", "f 1 0 2", "f 1 2 0", "f 1/1/1 0/2/2 3/3/3", "f 1 2 -0", "f 1 2 3 00"])
def test_corner_0_of_an_obj_file(tmp_path, face):
    (tmp_path / "m.obj").write_text(f"{TETRAHEDRON}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n{face}\n")
    with pytest.raises(ProblemError, match="found a triangle with corner 0, expected corners counted from 1"):
        read_mesh("m", MeshFile(tmp_path / "m.obj", "m"))


def test_corners_counted_back(tmp_path):
    (tmp_path / "m.obj").write_text(f"{TETRAHEDRON}f -4 -2 -3\nf -4 -3 4\nf 1 -1 3\nv 9 9 9\nf -4/1 -3/2 -2/3\n")
    vertices, faces, closed = read_mesh("m", MeshFile(tmp_path / "m.obj", "m"))
    assert closed and len(faces) == 4
    np.testing.assert_array_equal(np.sort(vertices, axis=0), np.sort(CORNERS, axis=0))
    (tmp_path / "m.obj").write_text(f"{TETRAHEDRON}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 -5\n")
    with pytest.raises(ProblemError, match="found a triangle with a corner before the first"):
        read_mesh("m", MeshFile(tmp_path / "m.obj", "m"))

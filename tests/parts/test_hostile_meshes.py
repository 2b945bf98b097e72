"""Meshes from many hands: what they may announce, and where they may lead."""

from __future__ import annotations

import base64
import json
import struct
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from harness_opt.errors import ProblemError
from harness_opt.model.parts import MeshFile
from harness_opt.parts import mesh_headers as mesh_sizes
from harness_opt.parts.mesh_file import read_mesh


def gltf(path: Path, **changes: object) -> Path:
    """Write a glTF file of one triangle, its numbers inside, with some of its tables changed."""
    data = np.eye(3, dtype="<f4").tobytes() + np.arange(3, dtype="<u4").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    head = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": uri, "byteLength": 48}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0] * 3, "max": [1] * 3},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        **changes,
    }
    path.write_text(json.dumps(head))
    return path


ZEROS = {"componentType": 5126, "count": 2**31, "type": "VEC3"}
BUFFER = {"buffer": 0, "byteLength": 36}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"accessors": [ZEROS, ZEROS]}, "an array of 6,442,450,944 numbers, expected at most"),
        ({"accessors": [{**ZEROS, "count": 1000}] * 2}, "zeros that is in no buffer"),
        ({"accessors": [{**ZEROS, "count": -1}] * 2}, "an array of -3 numbers"),
        ({"nodes": [{"mesh": 0}] * (mesh_sizes.MOST_NODES + 1)}, "10,001 nodes, expected at most 10,000"),
        (
            {"nodes": [{"mesh": 0, "children": [k + 1]} for k in range(200)] + [{}]},
            "nodes that lie deep below each other",
        ),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}] * 10_001}]}, "of 10,001 pieces"),
        ({"nodes": [{"mesh": 0, "children": [1]}, {"mesh": 0, "children": [0]}]}, "nodes in a circle"),
        ({"nodes": [{"children": [2]}, {"children": [2]}, {"mesh": 0}]}, "a node in two places"),
        ({"buffers": [{"uri": "../secret.bin", "byteLength": 48}]}, "a file outside its folder"),
        ({"buffers": [{"uri": "%2e%2e/secret.bin", "byteLength": 48}]}, "a file outside its folder"),
        ({"buffers": [{"uri": "/etc/passwd", "byteLength": 48}]}, "a file outside its folder"),
        ({"buffers": [{"uri": "none.bin", "byteLength": 48}]}, "no file 'none.bin'"),
        ({"bufferViews": [{**BUFFER, "byteLength": 1000}] * 2}, "3 rows announced in 1,000 of 48 bytes"),
        ({"accessors": []}, "unreadable"),
        ({"meshes": "none"}, "unreadable"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_gltf_files_announce(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    (tmp_path / "secret.bin").write_bytes(bytes(48))
    (tmp_path / "deep").mkdir()
    with pytest.raises(ProblemError, match="found") as error:
        read_mesh("parts.p.mesh", MeshFile(gltf(tmp_path / "deep" / "m.gltf", **changes), shell=True))
    assert words in str(error.value)


def test_a_gltf_file_that_is_none_of_these(tmp_path: Path) -> None:
    vertices, faces, closed = read_mesh("m", MeshFile(gltf(tmp_path / "m.gltf"), shell=True))
    assert (len(vertices), len(faces), closed) == (3, 1, False)
    (tmp_path / "a b.bin").write_bytes(np.eye(3, dtype="<f4").tobytes() + np.arange(3, dtype="<u4").tobytes())
    beside = gltf(tmp_path / "n.gltf", buffers=[{"uri": "a%20b.bin", "byteLength": 48}])
    np.testing.assert_array_equal(read_mesh("m", MeshFile(beside, shell=True))[0], vertices)


def test_one_mesh_shown_ten_thousand_times(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(mesh_sizes, "MOST_FACES", 1000)
    crowd = gltf(tmp_path / "m.gltf", nodes=[{"mesh": 0}] * 1001, scenes=[{"nodes": list(range(1001))}])
    with pytest.raises(ProblemError, match="found 1,001 triangles, expected at most 1,000"):
        read_mesh("m", MeshFile(crowd, shell=True))


@pytest.mark.parametrize("element", ["vertex", "face"])
@pytest.mark.parametrize("count", [10**12, -1])
def test_what_ply_files_announce(tmp_path: Path, element: str, count: int) -> None:
    for form in ("ascii", "binary_little_endian"):
        head = f"ply\nformat {form} 1.0\nelement {element} {count}\nproperty float x\nend_header\n"
        (tmp_path / "m.ply").write_text(head)
        with pytest.raises(ProblemError, match="elements announced in"):
            read_mesh("m", MeshFile(tmp_path / "m.ply", "mm"))


def test_a_glb_file_with_more_json_than_file(tmp_path: Path) -> None:
    (tmp_path / "m.glb").write_bytes(struct.pack("<4sIIII", b"glTF", 2, 2**32 - 1, 2**32 - 1, 0x4E4F534A))
    with pytest.raises(ProblemError, match="bytes of JSON announced"):
        read_mesh("m", MeshFile(tmp_path / "m.glb"))


def test_many_groups_and_solids_are_one_mesh(tmp_path: Path) -> None:
    """Each would take as long as all before it."""
    count = 20_000
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    (tmp_path / "m.stl").write_text(f" SOLID x\n{facet}endsolid x\n" * count)
    corners = "mtllib ../m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n"
    groups = "".join(f"o a{k}\ng b{k}\nusemtl c{k}\nf 1/1/1 2//1 \\\n3\n" for k in range(count))
    (tmp_path / "m.obj").write_text(corners + groups)
    for name in ("m.stl", "m.obj"):
        begin = time.monotonic()
        vertices, faces, _ = read_mesh("m", MeshFile(tmp_path / name, "m", shell=True))
        assert time.monotonic() - begin < 10.0
        assert (len(vertices), len(faces)) == (3, count)
        assert {tuple(v) for v in vertices} == {(0, 0, 0), (1, 0, 0), (0, 1, 0)}


@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_long_texts_are_refused(tmp_path: Path, suffix: str, monkeypatch) -> None:
    monkeypatch.setattr(mesh_sizes, "MOST_TEXT", 100)
    data = trimesh.creation.box().export(file_type=suffix, **({"encoding": "ascii"} if suffix == "ply" else {}))
    (tmp_path / f"m.{suffix}").write_bytes(data.encode() if isinstance(data, str) else data)
    with pytest.raises(ProblemError, match="MB of text, expected at most 0"):
        read_mesh("m", MeshFile(tmp_path / f"m.{suffix}", "mm"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "found"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -9\n", "found"),
        ("v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "corners that are not finite"),
        ("v 0 0 0\nv 1 0 0\nv 0 1e30 0\nf 1 2 3\n", "a corner 1e+30 units from the origin, expected at most 1e+09"),
        ("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "found"),
        ("v 0 0 0\nf 1 1 1\n", "no triangle"),
        ("mtllib ../../secret.mtl\nv 0 0 0\n", "found"),
    ],
)
def test_meshes_that_are_none(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "m.obj").write_text(text)
    with pytest.raises(ProblemError) as error:
        read_mesh("m", MeshFile(tmp_path / "m.obj", "mm", shell=True))
    assert words in str(error.value) and "\n" not in str(error.value)

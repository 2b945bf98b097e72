"""Files from many hands: where they may lie, how large they may be, and what they may announce."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import struct
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.cli.redesign import interrupted
from harness_opt.errors import HarnessError, ProblemError
from harness_opt.files import arrays as stored_arrays
from harness_opt.files import places as file_places
from harness_opt.files import read as problem_file
from harness_opt.files.read import read_problem, write_problem
from harness_opt.files.stored_results import read_motion, read_results
from harness_opt.files.values import dotted
from harness_opt.model.parts import MeshFile
from harness_opt.parts import mesh_headers as mesh_sizes
from harness_opt.parts.mesh_file import read_mesh
from harness_opt.parts.scene import load_scene
from oracles.flap import FLAP, PLAIN, put
from oracles.problem_files import HINGE, MESH, changed, mistakes, same, written

OUTSIDE = "a file outside the problem's folder"
links = pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")

# --- where files may lie -------------------------------------------------------------------------------


@pytest.fixture
def inside(folder: Path) -> Path:
    """A folder for a problem file beside that of the mesh, which is outside of it."""
    (folder / "inside").mkdir()
    return folder / "inside"


def naming(mesh: str) -> str:
    return changed(("meshes/housing.stl", mesh))


@pytest.mark.parametrize("name", ["../meshes/housing.stl", "x/../../meshes/housing.stl", "HERE/meshes/housing.stl"])
def test_meshes_outside_are_refused_unless_their_folder_is_given(folder: Path, inside: Path, name: str) -> None:
    (inside / "x").mkdir()
    file = written(inside, naming(name.replace("HERE", folder.as_posix())))
    (line,) = mistakes(file)
    assert line.startswith("parts.housing.mesh: found ") and OUTSIDE in line and "--files" in line
    assert read_problem(file, [folder / "meshes"]).parts["housing"].shape.path.is_file()
    with pytest.raises(ProblemError, match=OUTSIDE):
        read_problem(file, [folder / "mesh"])  # the beginning of a name is no folder


def test_dots_that_lead_back_are_no_matter(folder: Path) -> None:
    problem = read_problem(written(folder, naming("meshes/../meshes/./housing.stl")))
    assert problem.parts["housing"].shape.path.samefile(folder / "meshes" / "housing.stl")


def test_nothing_is_told_of_files_outside(folder: Path, inside: Path) -> None:
    """Whether they are there, empty or folders: a problem file is no way to ask."""
    (folder / "empty.stl").touch()
    names = ("../empty.stl", "../none.stl", "..", "../meshes", "/etc/passwd", "/dev/zero")
    lines = [mistakes(written(inside, naming(name))) for name in names]
    told = {
        line.partition("found ")[2].partition(", ")[2] for found in lines for line in found if "ending in" not in line
    }
    assert len(told) == 1 and OUTSIDE in told.pop()


@links
def test_links_count_where_they_lead(folder: Path, inside: Path) -> None:
    (inside / "link.stl").symlink_to(folder / "meshes" / "housing.stl")
    (inside / "linked").symlink_to(folder / "meshes")
    for name in ("link.stl", "linked/housing.stl"):
        assert OUTSIDE in mistakes(written(inside, naming(name)))[0]
        read_problem(written(inside, naming(name)), [folder / "meshes"])
    # within the folder they are as good as what they lead to, and so is a folder reached by a link
    (folder / "near.stl").symlink_to("meshes/housing.stl")
    read_problem(written(folder, naming("near.stl")))
    (inside / "whole").symlink_to(folder)
    read_problem(inside / "whole" / "lift.toml")


@links
def test_links_in_a_circle(folder: Path) -> None:
    (folder / "a.stl").symlink_to("b.stl")
    (folder / "b.stl").symlink_to("a.stl")
    assert mistakes(written(folder, naming("a.stl")))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_pipes_and_devices_are_no_meshes(folder: Path) -> None:
    os.mkfifo(folder / "pipe.stl")  # reading it would wait for ever
    assert "a device or a pipe" in mistakes(written(folder, naming("pipe.stl")))[0]


@pytest.mark.parametrize("name", [r"\\\\host\\share\\x.stl", "//host/share/x.stl"])
def test_files_on_other_computers_are_not_even_asked_for(folder: Path, name: str) -> None:
    (line,) = mistakes(written(folder, naming(name)))
    assert "on another computer" in line


def test_tables_of_poses_keep_to_the_same_rule(folder: Path, inside: Path) -> None:
    (folder / "arm.csv").write_text("t,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n1,0,0,0.01,1,0,0,0\n")
    text = changed((HINGE, 'kind = "poses"\nfile = "../arm.csv"\n'), (MESH, "sphere = { radius = 0.01 }"))
    (line,) = mistakes(written(inside, text))
    assert line.startswith("bodies.arm.motion.file: ") and OUTSIDE in line
    read_problem(written(inside, text), [folder])


def test_a_checksum_lets_a_file_in_and_only_that(folder: Path, inside: Path) -> None:
    mesh = folder / "meshes" / "housing.stl"
    digest = hashlib.sha256(mesh.read_bytes()).hexdigest()
    text = changed(("meshes/housing.stl", "../meshes/housing.stl"), ("clearance = 0.006", f'mesh_sha256 = "{digest}"'))
    read_problem(written(inside, text))
    read_problem(written(inside, text.replace(digest, digest.upper())))
    mesh.write_bytes(mesh.read_bytes() + b" ")
    assert "not what it was when this problem was written" in mistakes(written(inside, text))[0]
    read_problem(inside / "lift.toml", [folder])
    assert "64 hexadecimal digits" in mistakes(written(inside, text.replace(digest, "abc")))[0]
    without = changed((MESH, "sphere = { radius = 1 }"), ("clearance = 0.006", f'mesh_sha256 = "{digest}"'))
    assert "found a SHA-256 without a mesh" in mistakes(written(inside, without))[0]


def test_written_problems_run_from_where_they_lie(folder: Path) -> None:
    problem = read_problem(written(folder, changed()))
    file = write_problem(problem, folder / "far" / "away.toml")
    assert same(read_problem(file), problem)
    assert main(["check", str(file)]) == 0
    beside = write_problem(problem, folder / "beside.toml")
    assert "sha256" not in beside.read_text(), "none is needed there"


def test_the_folders_of_the_command_line(folder: Path, inside: Path, capsys) -> None:
    trimesh.creation.box((10, 20, 30)).export(folder / "box.stl")
    text = FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "../box.stl"\nmesh_unit = "mm"')
    file = str(inside / put(text, str(inside / "flap.toml")))
    out = str(inside / "out")
    given = ["--files", str(folder)]
    for command in ("check", "simulate", "redesign"):
        assert main([command, file]) == 2
        assert "--files" in capsys.readouterr().err
    assert main(["check", file, *given]) == 0
    assert main(["simulate", file, *given, *PLAIN, "-o", out]) == 0
    assert main(["export", out, "--to", "csv"]) == 2
    assert main(["export", out, "--to", "csv", *given]) == 0
    assert main(["redesign", file, *given, *PLAIN, "-o", str(inside / "better")]) == 0
    assert main(["simulate", str(inside / "better" / "redesigned.toml"), *PLAIN, "-o", out]) == 0


# --- how much they may be ------------------------------------------------------------------------------


def test_large_files_are_refused_before_they_are_read(folder: Path, monkeypatch) -> None:
    file = written(folder, changed())
    huge = folder / "meshes" / "housing.stl"
    with huge.open("wb") as stream:
        stream.truncate(file_places.MOST_MESH_BYTES + 1)  # a hole: nothing is written
    assert "a file of 600 MB, of which at most 600 are read" in mistakes(file)[0]
    with file.open("wb") as stream:
        stream.truncate(problem_file.MOST_BYTES + 1)
    assert "a file of 4 MB, of which at most 4 are read" in mistakes(file)[0]


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no endless file")
def test_an_endless_problem_file() -> None:
    assert mistakes(Path("/dev/zero")) == ["found more than 4 MB, expected a problem file"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x." * 3000 + "y = 1", "more keys or levels"),
        ("[" + "x." * 3000 + "y]", "more keys or levels"),
        ("\n".join(f"k{i} = 1" for i in range(problem_file.MOST_KEYS + 1)), "more keys or levels"),
        ("schema = 1\n" + "\n".join(f"[cables.c{i}]" for i in range(101)), "cables: found 101, expected at most 100"),
        ("schema = 1\n" + "\n".join(f"[parts.c{i}]" for i in range(1001)), "parts: found 1,001, expected at most"),
    ],
)
def test_more_than_anybody_types(folder: Path, text: str, words: str) -> None:
    (line,) = mistakes(written(folder, text))
    assert words in line


def test_thousands_of_mistakes_are_counted(folder: Path) -> None:
    lines = mistakes(written(folder, "schema = 1\n" + "\n".join(f"k{i} = 1" for i in range(1000))))
    assert len(lines) == problem_file.MOST_MISTAKES + 1
    assert lines[-1] == "found 801 more mistakes, expected none"  # the keys, and that there is no cable


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
        ({"bufferViews": [{**BUFFER, "byteLength": 1000}] * 2}, "unreadable"),
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


def test_triangles_of_all_parts_together(folder: Path, monkeypatch) -> None:
    monkeypatch.setattr("harness_opt.parts.scene.MOST_FACES", 20)
    text = changed() + "\n[parts.second]\n" + MESH
    with pytest.raises(ProblemError, match="parts: found 24 triangles up to second, expected at most 20 in all"):
        load_scene(read_problem(written(folder, text)))


def test_packed_meshes_are_not_unpacked(folder: Path) -> None:
    for name in ("bomb.stl.gz", "bomb.zip", "bomb.3mf", "bomb.stl.bz2"):
        (folder / name).write_bytes(b"PK")
        assert "expected a file ending in" in mistakes(written(folder, naming(name)))[0]


# --- results -------------------------------------------------------------------------------------------


@pytest.fixture
def result(here: Path) -> Path:
    assert main(["simulate", put(FLAP), *PLAIN, "-q", "-o", "out"]) == 0
    return here / "out"


def spoil(result: Path, name: str, **arrays: np.ndarray) -> None:
    with np.load(result / name) as stored:
        kept = dict(stored)
    np.savez(result / name, **{**kept, **arrays})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("motion", np.array([0.0, np.nan])),
        ("motion", np.zeros((2, 2))),
        ("lead/position", np.zeros((1, 1, 3))),
        ("lead/force", np.full((4, 101, 3), np.inf)),
        ("lead/s", np.zeros(101)),
        ("lead/s", np.array(["x"])),
        ("lead/residual", np.zeros(3)),
    ],
    ids=str,
)
def test_arrays_that_do_not_fit(result: Path, key: str, value: np.ndarray) -> None:
    spoil(result, "motion.npz", **{key: value})
    with pytest.raises(ProblemError, match="found a damaged result"):
        read_results(result)
    with pytest.raises(HarnessError, match="found a damaged result"):
        read_motion(result)
    assert main(["export", str(result), "--to", "csv"]) == 2


def test_what_is_not_known_of_a_frame_may_be_missing(result: Path) -> None:
    with np.load(result / "motion.npz") as stored:
        kept = {name: stored[name] for name in stored.files if not name.endswith("residual")}
    np.savez(result / "motion.npz", **kept)
    assert np.all(np.isnan(read_results(result).cables["lead"].residual))


def test_archives_that_promise_more_than_they_hold(result: Path, monkeypatch) -> None:
    head = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    with (
        zipfile.ZipFile(result / "motion.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("motion.npy", "w") as f,
    ):
        np.lib.format.write_array_header_1_0(f, head)
    with pytest.raises(ProblemError, match="damaged"):
        read_results(result)
    # and what unpacks to more than fits is refused before it is unpacked
    with zipfile.ZipFile(result / "motion.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("motion.npy", bytes(10**6))
    assert (result / "motion.npz").stat().st_size < 2000
    monkeypatch.setattr(stored_arrays, "MOST_BYTES", 10**5)
    with pytest.raises(ProblemError, match="1,000,000 bytes of arrays, of which at most 100,000 are read"):
        read_results(result)


def test_archives_of_profiles_too(tmp_path: Path, monkeypatch) -> None:
    np.savez_compressed(
        tmp_path / "p.npz", **{"profiles/position": np.zeros((2000, 3)), "profiles/rotation": np.zeros(9)}
    )
    monkeypatch.setattr(stored_arrays, "MOST_BYTES", 10_000)
    with pytest.raises(ProblemError, match="bytes of arrays, of which at most 10,000 are read"):
        ho.load_profiles(tmp_path / "p.npz")


def test_pickles_are_not_opened(result: Path) -> None:
    spoil(result, "motion.npz", motion=np.array([print], dtype=object))
    with pytest.raises(ProblemError, match="damaged"):
        read_results(result)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("name", ["motion.npz", "summary.json", "flap.toml"])
def test_results_with_pipes_for_files(here: Path, result: Path, name: str) -> None:
    """Opening one would wait for ever."""
    file = here / name if name == "flap.toml" else result / name
    file.unlink()
    os.mkfifo(file)
    assert main(["export", str(result), "--to", "csv"]) == 2


@pytest.mark.parametrize("content", [b"\xff", b"[]", b'{"command": "simulate"}', b'{"a":' * 10_000])
def test_summaries_that_are_none(result: Path, content: bytes) -> None:
    (result / "summary.json").write_bytes(content)
    with pytest.raises(ProblemError, match="found"):
        read_results(result)
    with pytest.raises(HarnessError, match="found"):
        read_motion(result)


def test_a_summary_with_a_number_of_a_thousand_digits(result: Path) -> None:
    summary = result / "summary.json"
    text = re.sub(r'"margin": [^,]*', '"margin": ' + "9" * 1000, summary.read_text())
    summary.write_text(text)
    with pytest.raises(HarnessError, match="found a damaged result"):
        read_motion(result)


def test_no_shape_that_is_not_finite_is_written(result: Path) -> None:
    stored = read_results(result)
    cable = stored.cables["lead"]
    cable.force[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="not finite in lead/force"):
        stored_arrays.write_arrays(result / "other.npz", stored.motion, {"lead": cable})
    assert not (result / "other.npz").exists()


def test_what_a_file_holds_does_not_steer_the_terminal(here: Path, capsys) -> None:
    title = 'title = "clear \\u001b[2J bell \\u0007 c1 \\u009b31m turned \\u202e"'
    assert main(["check", put(FLAP.replace('title = "A flap"', title))]) == 0
    out = capsys.readouterr().out
    assert "clear ?[2J bell ? c1 ?31m turned ?" in out
    assert main(["check", put(FLAP.replace("[parts.ball]", '[parts."a\\u009bb"]'))]) == 2
    assert "\x9b" not in capsys.readouterr().err


def test_long_names(folder: Path) -> None:
    (line,) = mistakes(written(folder, changed(("[parts.housing]", f"[parts.{'x' * 200}]"))))
    assert line == f"parts.{'x' * 100}: found a longer name, expected 100 letters at most"


def test_long_tables_of_poses(folder: Path) -> None:
    (folder / "arm.csv").write_text("t,x,y,z,qw,qx,qy,qz\n" * 100_001)
    (line,) = mistakes(written(folder, changed((HINGE, 'kind = "poses"\nfile = "arm.csv"\n'))))
    assert "arm.csv: found 100,001 lines, expected at most 100,000" in line


def test_keys_in_messages_are_quoted() -> None:
    assert dotted(("parts", 'a"b\n')) == 'parts."a\\"b\\n"'


@pytest.mark.parametrize("text", ["x." * 3000 + "y = 1", "[vary]\n" + "x." * 3000 + "y = 1", "k = {" * 500])
@pytest.mark.parametrize("command", ["study", "sensitivity"])
def test_study_files_are_no_deeper_than_problem_files(here: Path, capsys, command: str, text: str) -> None:
    Path("study.toml").write_text(text)
    assert main([command, "study.toml"]) == 2
    assert capsys.readouterr().err.startswith("study.toml: ")
    assert os.listdir() == ["study.toml"]


@pytest.mark.parametrize(
    "damage",
    [
        {"problem": []},
        {"redesign": None},
        {"redesign": {"variables": {"lead.length": {"after": "long"}}}},
        {"redesign": {"variables": {"lead.length": {}}}},
        {"redesign": {"variables": {"lead.length": {"after": 0.3}}, "history": [{"colour": "red"}]}},
        {"redesign": {"variables": {"lead.length": {"after": 0.3}}, "history": 3}},
    ],
    ids=str,
)
def test_a_damaged_redesign_is_begun_anew(here: Path, damage: dict[str, object]) -> None:
    problem = read_problem(put(FLAP))
    content = {"command": "redesign", "versions": {"harness-opt": "0"}, "reason": "interrupted"}
    content |= {"problem": {"sha256": problem.sha256}, "redesign": {"variables": {"lead.length": {"after": 0.3}}}}
    (here / "out").mkdir()
    (here / "out" / "summary.json").write_text(json.dumps(content))
    assert interrupted(here / "out", problem) is not None
    (here / "out" / "summary.json").write_text(json.dumps(content | damage))
    assert interrupted(here / "out", problem) is None

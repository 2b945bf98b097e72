"""Files for ``scripts/checks/fuzz.py`` to spoil, and ways to spoil them: a few bytes, or a few keys and values."""

from __future__ import annotations

import json
import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
CHANGES = (1, 1, 1, 2, 4)  # of one file; most often so few that what follows is reached

SMALL = """\
schema = 1
title = "All kinds of files"
gravity = [0, 0, -9.81]

[cables.lead]
length = 0.3
diameter = 0.005
bending_stiffness = [2e-3, 3e-3]
torsional_stiffness = 1.5e-3
density = 2500
rest_curvature = [0, 0.5, 0]
start = { position = [0, 0, 0], tangent = [0, 0, 1], roll_deg = 10 }
end = { body = "flap", position = [0.15, 0.02, 0], quaternion = [0, 1, 0, 0], turns = 0 }
bow = [1, 0, 0]

[bodies.flap.motion]
kind = "poses"
file = "flap.csv"

[bodies.drawer.motion]
kind = "slide"
direction = [0, 1, 0]
from = 0
to = 0.02

[motion]
duration = 2
spatial_step = 0.01

[parts.wall]
mesh = "meshes/wall.SUFFIX"
mesh_unit = "mm"
position = [0.1, 0.1, 0.1]
quaternion = [0.7071, 0, 0, 0.7071]
clearance = 0.001

[parts.ball]
body = "drawer"
sphere = { radius = 0.01 }
position = [-0.1, 0, 0]

[limits]
clearance = 0.002
bend_radius = 0.01
twist_deg_per_m = 700
clamp_force = 20
clamp_moment = 0.5

[design]
minimise = "length"

[design.variables]
"lead.length" = [0.25, 0.45]
"lead.end.rotate_x_deg" = [-20, 20]
"""
FORMATS = ("stl", "obj", "ply", "glb", "gltf")

NUMBERS = [
    "nan", "inf", "-inf", "0", "-0.0", "-1", "1e-320", "1e-100", "1e99", "1e308", "-1e308", "9" * 400, "0x" + "f" * 50,
    "0.1", "3", "1e5", "2020-01-01", "true", '""', "[]", "{}", "1_000", "1e", "12:00:00",
]  # fmt: skip
WORDS = [
    "../../../../etc/passwd", "/dev/zero", "/dev/stdin", "/proc/self/mem", ".", "..", "~", "a\\u0000b", "C:\\\\con",
    "//host/share/x.stl", "http://localhost/x.stl", "<script>alert(1)</script>", "{{ 7 * 7 }}", "%s%n", "\\u202e", "é",
    "x" * 5000, "world", "lead", "flap", "lead.length", "start", "hinge", "poses", "-o", "nul", "meshes", " ",
]  # fmt: skip
TOKENS = [b"\0", b"\xff\xfe", b"\n", b"[", b"]", b"[[", b'"""', b"'''", b"=", b".", b",", b"#", b"\xed\xa0\x80", b"\r"]


# --- spoiling ------------------------------------------------------------------------------------------


def spoilt_bytes(content: bytes, dice: random.Random) -> bytes:
    """Return ``content`` with a few bytes or stretches changed, taken out, doubled, put in or cut off."""
    data = bytearray(content)
    for _ in range(dice.choice(CHANGES)):
        # files begin with what says how long they are: half of the changes go there
        end = len(data) if dice.random() < 0.5 else min(len(data), 200)
        at = dice.randrange(end + 1)
        length = min(dice.choice([1, 1, 2, 4, 8, 64, 4096]), len(data) - at)
        kind = dice.randrange(6)
        if kind == 0:
            data[at : at + length] = dice.randbytes(length)
        elif kind == 1:
            del data[at : at + length]
        elif kind == 2:
            data[at:at] = data[at : at + length] * dice.choice([1, 2, 100])
        elif kind == 3:
            data[at:at] = dice.choice([*TOKENS, *(w.encode() for w in NUMBERS), *(w.encode() for w in WORDS)])
        elif kind == 4 and dice.random() < 0.3:
            del data[at:]
        else:
            for place in range(at, min(at + 4, len(data))):  # a number of four bytes, such as a count
                data[place] = dice.choice([0x00, 0x7F, 0x80, 0xFF])
    return bytes(data)


def spoilt_lines(text: str, dice: random.Random) -> str:
    """Return a text of keys and values, or of rows, with a few of them changed to what somebody might type."""
    lines = text.split("\n")
    for _ in range(dice.choice(CHANGES)):
        at = dice.randrange(len(lines))
        line = lines[at]
        kind = dice.randrange(7)
        if kind == 0:
            del lines[at]
            lines = lines or [""]
        elif kind == 1:
            lines.insert(dice.randrange(len(lines)), line)
        elif kind == 2 and "=" in line:  # another value
            key, _, _ = line.partition("=")
            other = dice.choice(lines).partition("=")[2]
            lines[at] = f"{key}= {dice.choice([*NUMBERS, other, json.dumps(dice.choice(WORDS))])}"
        elif kind == 3:  # another number somewhere in it
            words = line.replace(",", " , ").replace("]", " ] ").replace("[", " [ ").split(" ")
            places = [k for k, word in enumerate(words) if word[:1].isdigit() or word[:1] == "-"]
            if places:
                words[dice.choice(places)] = dice.choice(NUMBERS)
            lines[at] = " ".join(words)
        elif kind == 4 and line:  # a letter more, less or another
            place = dice.randrange(len(line))
            lines[at] = line[:place] + dice.choice(["", "x", "_", '"', "é", "\t"]) + line[place + 1 :]
        elif kind == 5 and '"' in line:  # another word
            before, _, after = line.partition('"')
            lines[at] = f'{before}"{dice.choice(WORDS)}"{after.partition(chr(34))[2]}'
        else:
            other = dice.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
    return "\n".join(lines)


@dataclass(frozen=True)
class Example:
    """A folder with a problem file in it, whole.

    Args:
        file: name of the problem file.
        contents: of all its files, by name from its folder.
    """

    file: str
    contents: dict[str, bytes]

    def spoilt(self, dice: random.Random) -> dict[str, bytes]:
        """Return the contents with one of the files spoilt."""
        name = self.file if dice.random() < 0.5 else dice.choice(sorted(self.contents))
        content = self.contents[name]
        if name.endswith((".toml", ".csv", ".json", ".gltf", ".obj")) and dice.random() < 0.7:
            return self.contents | {
                name: spoilt_lines(content.decode(errors="replace"), dice).encode(errors="surrogatepass")
            }
        return self.contents | {name: spoilt_bytes(content, dice)}


def examples() -> list[Example]:
    """Return the shipped problems, and a small one for each format of meshes."""
    found = []
    for file in sorted(PROBLEMS.glob("*/*.toml")):
        used = [file, *(f for kind in ("meshes/*", "motion/*") for f in file.parent.glob(kind) if f.is_file())]
        if file.parent.name != "robot_wrist" and b"[vary]" not in file.read_bytes():
            found.append(Example(file.name, {f.relative_to(file.parent).as_posix(): f.read_bytes() for f in used}))
    return [*found, *(small(suffix, ascii_) for suffix in FORMATS for ascii_ in ((False, True) if suffix in
            ("stl", "ply") else (False,)))]  # fmt: skip


def small(suffix: str, ascii_: bool) -> Example:
    """Return a problem that has all kinds of files, its mesh in the format ``suffix``."""
    box = trimesh.creation.box((60, 40, 30))
    text = SMALL.replace("SUFFIX", suffix)
    if suffix == "gltf":
        from trimesh.exchange.gltf import export_gltf

        exported = export_gltf(trimesh.Scene(box))
        files = {f"meshes/{'wall.gltf' if name == 'model.gltf' else name}": data for name, data in exported.items()}
    elif suffix == "stl" and ascii_:
        files = {"meshes/wall.stl": box.export(file_type="stl_ascii").encode()}
    else:
        options = {"encoding": "ascii"} if suffix == "ply" and ascii_ else {}
        data = box.export(file_type=suffix, **options)
        files = {f"meshes/wall.{suffix}": data.encode() if isinstance(data, str) else data}
    rows = ["t,x,y,z,qw,qx,qy,qz"]
    for k in range(8):
        angle = 0.05 * k
        rows.append(f"{0.25 * k},{0.002 * k},0,0,{np.cos(angle / 2):.17g},0,{np.sin(angle / 2):.17g},0")
    return Example("small.toml", {"small.toml": text.encode(), "flap.csv": "\n".join([*rows, ""]).encode(), **files})


def put(contents: dict[str, bytes], folder: Path) -> None:
    """Write ``contents`` into ``folder``."""
    for name, content in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)

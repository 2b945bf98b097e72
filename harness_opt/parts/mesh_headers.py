"""How much a mesh file would make of itself, told from its first lines: before memory is given to what it announces.

Readers of foreign formats take a file's word for how many elements follow. A file of a few hundred bytes can so ask for
more memory than there is; here that is refused.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

# 0.75 kB each where all have corners of their own and something comes near to all of them: 6 GB are the most
MOST_FACES = 7_500_000
MOST_NUMBERS = 12 * MOST_FACES  # that one array may hold: as many triangles with corners of their own, and normals
MOST_TEXT = 250_000_000  # bytes of a mesh written as text, which takes ten times as much while it is read
MOST_NODES = 10_000  # of the tree in a glTF file, and pieces of its meshes: each takes a while to place
DEEPEST = 100  # nodes below each other
STL_HEAD, STL_FACE = 84, 50  # bytes of a binary STL file: its head, which ends in the count, and one triangle
PLY_HEAD = 64 * 1024  # bytes in which the header of a PLY file must end
GLB_HEAD = 20  # bytes of a GLB file before its JSON: magic, version, length, and the length and kind of the chunk
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}  # glTF 2.0, 3.6.2.1
MESH = "a triangle mesh"


COMMA = re.compile(rb"^[ \t]*vertex[^\n]*,[^\n]*", re.IGNORECASE | re.MULTILINE)
LONGEST_LINE = 60  # letters of a wrong line that are repeated
LONGEST_TAIL = 1000  # bytes at the end of a text in which its end has to be


class Refused(ValueError):
    """A file that is not read.

    Args:
        found: what is wrong with it.
        expected: instead.
    """

    def __init__(self, found: str, expected: str = MESH):
        self._words = found, expected
        super().__init__(f"found {found}, expected {expected}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes it anew in another process."""
        return type(self), self._words


def beside(file: Path, most_bytes: int) -> dict[str, bytes]:
    """Check what ``file`` announces, and return the files that it needs beside it, by the name it has for them.

    Args:
        file: a mesh.
        most_bytes: that it and what it needs may have together.

    Raises:
        Refused: it announces too much, or names files outside its folder.
        ValueError, KeyError, TypeError: it is damaged.
        OSError: it cannot be read.
    """
    suffix = file.suffix.lower()
    if suffix == ".stl":
        _stl(file)
    elif suffix == ".obj":
        _refuse_long(file)
    elif suffix == ".ply":
        _ply(file)
    else:
        head = gltf_head(file)
        _refuse_accessors(head)
        return _buffers(head, file, most_bytes)
    return {}


def _refuse_long(file: Path) -> None:
    size = file.stat().st_size
    if size > MOST_TEXT:
        raise Refused(f"{size / 1e6:,.0f} MB of text", f"at most {MOST_TEXT / 1e6:,.0f}")


def refuse_faces(count: int) -> None:
    """Raise where there are more triangles than anything here is made for."""
    if count > MOST_FACES:
        raise Refused(f"{count:,} triangles", f"at most {MOST_FACES:,}, among which a search takes 6 GB")


def _stl(file: Path) -> None:
    with file.open("rb") as stream:
        head = stream.read(STL_HEAD)
    count = int.from_bytes(head[-4:], "little") if len(head) == STL_HEAD else 0
    size, announced = file.stat().st_size, STL_HEAD + STL_FACE * count
    if len(head) < STL_HEAD and not head.lstrip().lower().startswith(b"solid"):
        raise Refused(f"{size} bytes, too few for an STL file")
    if size == announced:
        refuse_faces(count)
    elif size < announced and not head.lstrip().lower().startswith(b"solid"):
        raise Refused(f"a file cut short: {size:,} of the {announced:,} bytes that {count:,} triangles take, or no STL")
    else:
        _refuse_long(file)


def refuse_text(content: bytes) -> None:
    """Raise where the text of an STL file has decimal commas, or ends before its end."""
    comma = COMMA.search(content)
    if comma is not None:
        line = content.count(b"\n", 0, comma.start()) + 1
        words = comma[0].strip().decode("utf-8", "replace")[:LONGEST_LINE]
        raise Refused(f"a comma in line {line}, {words!r}", "decimal points: export it with these")
    if b"endsolid" not in content[-LONGEST_TAIL:].lower():
        raise Refused("a file cut short: its last solid has no end (endsolid)")


def is_text(file: Path) -> bool:
    """Return whether an STL file is written as text: it begins as such, and is not as long as a binary one would be."""
    with file.open("rb") as stream:
        head = stream.read(STL_HEAD)
    count = int.from_bytes(head[-4:], "little")
    return head.lstrip().lower().startswith(b"solid") and file.stat().st_size != STL_HEAD + STL_FACE * count


def _ply(file: Path) -> None:
    """Check that no more elements are announced than there are bytes: each takes one at least."""
    size = file.stat().st_size
    with file.open("rb") as stream:
        head = stream.read(PLY_HEAD)
    lines = head.split(b"\n")
    ends = [k for k, line in enumerate(lines) if line.strip() == b"end_header"]
    if not ends:
        raise Refused("no end of its header")
    lines = lines[: ends[0]]
    if any(line.split()[:2] == [b"format", b"ascii"] for line in lines):
        _refuse_long(file)
    for line in lines:
        words = line.split()
        if words[:1] == [b"element"]:
            count = int(words[2])
            if not 0 <= count <= size:
                raise Refused(f"{count:,} elements announced in {size:,} bytes")
            if words[1] == b"face":
                refuse_faces(count)


# --- glTF ----------------------------------------------------------------------------------------------


def gltf_head(file: Path) -> dict[str, Any]:
    """Return the JSON of a glTF file, or of the first chunk of a GLB file."""
    if file.suffix.lower() == ".gltf":
        _refuse_long(file)
        content = file.read_bytes()
    else:
        with file.open("rb") as stream:
            start = stream.read(GLB_HEAD)
            length = int.from_bytes(start[12:16], "little")
            if length > min(MOST_TEXT, file.stat().st_size):
                raise Refused(f"{length:,} bytes of JSON announced")
            content = stream.read(length)
    head = json.loads(content)
    if not isinstance(head, dict):
        raise Refused("JSON that is no table")
    return head


def _refuse_accessors(head: dict[str, Any]) -> None:
    """Check the arrays that a glTF file announces, and how often its tree repeats its meshes."""
    for accessor in head.get("accessors", ()):
        count = accessor["count"] * COMPONENTS[accessor["type"]]
        if not 0 <= count <= MOST_NUMBERS:
            raise Refused(f"an array of {count:,} numbers", f"at most {MOST_NUMBERS:,}")
        if "bufferView" not in accessor and count and "sparse" not in accessor and not accessor.get("extensions"):
            # allowed, and then it is all zeros: which no mesh is
            raise Refused(f"an array of {count:,} zeros that is in no buffer")
    pieces = sum(len(mesh["primitives"]) for mesh in head.get("meshes", ()))
    if pieces > MOST_NODES:
        raise Refused(f"meshes of {pieces:,} pieces", f"at most {MOST_NODES:,}")
    nodes = head.get("nodes", ())
    if len(nodes) > MOST_NODES:
        raise Refused(f"{len(nodes):,} nodes", f"at most {MOST_NODES:,}")
    refuse_faces(math.ceil(sum(_placed(head)) / 3))
    _refuse_loops(nodes)


def _placed(head: dict[str, Any]) -> Iterator[int]:
    """Yield how many corners of triangles each node of the tree shows."""
    accessors = head.get("accessors", ())
    corners = []
    for mesh in head.get("meshes", ()):
        used = [p.get("indices", p["attributes"].get("POSITION")) for p in mesh["primitives"]]
        corners.append(sum(accessors[k]["count"] for k in used if k is not None))
    yield from (corners[node["mesh"]] for node in head.get("nodes", ()) if "mesh" in node)


def _refuse_loops(nodes: Any) -> None:
    """Check that no node stands below itself, or below two others (glTF 2.0, 3.5.2)."""
    children = [child for node in nodes for child in node.get("children", ())]
    if len(set(children)) < len(children):
        raise Refused("a node in two places of its tree")
    reached = [k for k in range(len(nodes)) if k not in set(children)]
    seen = depth = 0
    while reached:
        seen, depth = seen + len(reached), depth + 1
        if depth > DEEPEST:
            raise Refused("nodes that lie deep below each other", f"at most {DEEPEST}")
        reached = [child for k in reached for child in nodes[k].get("children", ())]
    if seen < len(nodes):
        raise Refused("nodes in a circle")


def _buffers(head: dict[str, Any], file: Path, most_bytes: int) -> dict[str, bytes]:
    """Return the files with a glTF file's numbers, which lie beside it or below."""
    found: dict[str, bytes] = {}
    folder = file.parent.resolve()
    size = file.stat().st_size
    for buffer in head.get("buffers", ()):
        name = buffer.get("uri", "")
        if not name or name.startswith("data:"):
            continue
        other = (folder / unquote(name)).resolve()
        if not other.is_relative_to(folder):
            raise Refused(f"{name[:60]!r}, a file outside its folder", "its numbers beside it or below")
        if not other.is_file():
            raise Refused(f"no file {name[:60]!r}", "its numbers beside it or below")
        size += other.stat().st_size
        if size > most_bytes:
            raise Refused(f"{size / 1e6:,.0f} MB with the files it names", f"at most {most_bytes / 1e6:,.0f}")
        found[name] = other.read_bytes()
    return found

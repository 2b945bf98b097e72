"""A motion as animated glTF 2.0 in one binary file, for viewers, presentations and the web.

A cable is a skin: each station is a joint that carries its ring of the tube, so that position and turn of every
section are played as they were solved, and between two frames joints go straight and turn evenly. The format is
written here, for no library that is kept up writes animated skins. Specification: Khronos glTF 2.0.12, sections 3
and 4.
"""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness_opt.model.results import CableMotion, Motion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene
from harness_opt.parts.triangles import triangles
from harness_opt.report.colours import CABLES, MOVING_PART, STILL_PART

SIDES = 16  # of a tube
FLOAT, USHORT, UINT = 5126, 5123, 5125  # component types, section 3.6.2.2
ARRAY, ELEMENTS = 34962, 34963  # buffer targets
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
MAGIC, VERSION, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
UPRIGHT = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]  # x, y, z, w: from z up, ours, to y up, glTF's


class _Writer:
    """Collects numbers and the tree that says what they are."""

    def __init__(self) -> None:
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "harness-opt"},
            "nodes": [], "meshes": [], "materials": [], "skins": [], "accessors": [], "bufferViews": [],
        }  # fmt: skip
        self.binary = bytearray()
        self.samplers: list[dict[str, Any]] = []
        self.channels: list[dict[str, Any]] = []

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Add an entry to one of the lists of the tree and return its number."""
        self.tree[kind].append(entry)
        return len(self.tree[kind]) - 1

    def numbers(self, values: NDArray[Any], component: int, target: int | None = None) -> int:
        """Add an array (n,) or (n, k) and return the number of its accessor."""
        types = {FLOAT: np.float32, USHORT: np.uint16, UINT: np.uint32}
        flat = np.ascontiguousarray(values, dtype=types[component])
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": flat.nbytes}
        if target is not None:
            view["target"] = target
        self.binary += flat.astype(flat.dtype.newbyteorder("<")).tobytes()
        self.binary += bytes(-len(self.binary) % 4)
        rows = flat.reshape(len(flat), -1)
        entry = {
            "bufferView": self.add("bufferViews", view),
            "componentType": component,
            "count": len(rows),
            "type": KINDS[rows.shape[1]],
            "min": rows.min(axis=0).tolist(),
            "max": rows.max(axis=0).tolist(),
        }
        return self.add("accessors", entry)

    def material(self, name: str, colour: str) -> int:
        """Add a material and return its number; glTF's colours are linear, ours sRGB (IEC 61966-2-1)."""
        parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        surface = {"baseColorFactor": [*linear, 1.0], "metallicFactor": 0.1, "roughnessFactor": 0.6}
        return self.add("materials", {"name": name, "pbrMetallicRoughness": surface, "doubleSided": True})

    def animate(self, node: int, times: int, position: Array, quaternion: Array) -> None:
        """Move a node through poses (P, 3) and (P, 4)."""
        for path, values in (("translation", position), ("rotation", _shortest(quaternion)[:, [1, 2, 3, 0]])):
            self.samplers.append({"input": times, "output": self.numbers(values, FLOAT), "interpolation": "LINEAR"})
            self.channels.append({"sampler": len(self.samplers) - 1, "target": {"node": node, "path": path}})

    def bytes(self) -> bytes:
        """Return the file, section 4 of the specification."""
        if self.channels:
            self.tree["animations"] = [{"name": "motion", "samplers": self.samplers, "channels": self.channels}]
        self.tree["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps({key: value for key, value in self.tree.items() if value != []}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
        chunks += struct.pack("<II", len(self.binary), BINARY_CHUNK) + bytes(self.binary)
        return struct.pack("<III", MAGIC, VERSION, 12 + len(chunks)) + chunks


def gltf(motion: Motion, scene: Scene) -> bytes:
    """Return a motion with its parts as a binary glTF file.

    Args:
        motion: with at least one frame; it plays as long as its problem says.
        scene: its parts.
    """
    writer = _Writer()
    root = writer.add("nodes", {"name": "z up", "rotation": UPRIGHT, "children": []})
    children = writer.tree["nodes"][root]["children"]
    tops = [root]
    moves = len(motion.motion) > 1
    times = writer.numbers(motion.motion * motion.problem.duration, FLOAT) if moves else -1
    for body in sorted({part.body for part in scene.parts.values()}):
        children.append(_body(writer, motion, scene, body, times))
    for number, (name, shapes) in enumerate(motion.cables.items()):
        radius = motion.problem.cables[name].cable.radius
        material = writer.material(name, CABLES[number % len(CABLES)])
        joints, skinned = _cable(writer, name, shapes.line, radius, material, times)
        children += joints
        tops.append(skinned)
    writer.tree["scenes"] = [{"name": motion.problem.title or "motion", "nodes": tops}]
    writer.tree["scene"] = 0
    return writer.bytes()


def _body(writer: _Writer, motion: Motion, scene: Scene, body: str, times: int) -> int:
    """Add a body with its parts and its motion, and return its node."""
    moving = motion.problem.is_moved(body)
    position, quaternion = motion.problem.poses(body, motion.motion)
    held = []
    for part in (part for part in scene.parts.values() if part.body == body):
        vertices, faces = triangles(part)
        primitive = {
            "attributes": {"POSITION": writer.numbers(vertices, FLOAT, ARRAY)},
            "indices": writer.numbers(faces.reshape(-1), UINT, ELEMENTS),
            "material": writer.material(part.name, MOVING_PART if moving else STILL_PART),
        }
        mesh = writer.add("meshes", {"name": part.name, "primitives": [primitive]})
        held.append(writer.add("nodes", {"name": part.name, "mesh": mesh}))
    node = writer.add("nodes", {"name": body, "children": held, **_pose(position[0], quaternion[0])})
    if moving and times >= 0:
        writer.animate(node, times, position, quaternion)
    return node


def _cable(
    writer: _Writer, name: str, shapes: CableMotion, radius: float, material: int, times: int
) -> tuple[list[int], int]:
    """Add a cable as a skin on joints, and return the joints' nodes and that of the skin."""
    rings, normals, owner, faces = _tube(len(shapes.s), radius)
    position, quaternion = shapes.position[0], shapes.quaternion[0]
    placed = position[owner] + rotations.rotate(quaternion[owner], rings)
    joints = [
        writer.add("nodes", {"name": f"{name} {k}", **_pose(*pose)})
        for k, pose in enumerate(zip(position, quaternion, strict=True))
    ]
    if times >= 0:
        for k, joint in enumerate(joints):
            writer.animate(joint, times, shapes.position[:, k], shapes.quaternion[:, k])
    frames = np.zeros((len(joints), 4, 4))
    frames[:, :3, :3] = np.swapaxes(rotations.matrix(quaternion), -1, -2)  # inverse of the first pose
    frames[:, :3, 3] = -np.einsum("kij,kj->ki", frames[:, :3, :3], position)
    frames[:, 3, 3] = 1.0
    columns = np.swapaxes(frames, -1, -2).reshape(len(joints), 16)  # matrices are written by columns
    skin = {"joints": joints, "inverseBindMatrices": writer.numbers(columns, FLOAT)}
    weights = np.tile([1.0, 0.0, 0.0, 0.0], (len(owner), 1))
    attributes = {
        "POSITION": writer.numbers(placed, FLOAT, ARRAY),
        "NORMAL": writer.numbers(rotations.rotate(quaternion[owner], normals), FLOAT, ARRAY),
        "JOINTS_0": writer.numbers(np.column_stack([owner, *np.zeros((3, len(owner)))]), USHORT, ARRAY),
        "WEIGHTS_0": writer.numbers(weights, FLOAT, ARRAY),
    }
    indices = writer.numbers(faces.reshape(-1), UINT, ELEMENTS)
    primitive = {"attributes": attributes, "indices": indices, "material": material}
    mesh = writer.add("meshes", {"name": name, "primitives": [primitive]})
    # a skinned mesh has its place from its joints alone, section 3.7.3.3, so its node stands outside of their tree
    return joints, writer.add("nodes", {"name": name, "mesh": mesh, "skin": writer.add("skins", skin)})


def _tube(stations: int, radius: float) -> tuple[Array, Array, NDArray[Any], NDArray[Any]]:
    """Return vertices and normals (k, 3) in the frames of their stations, the stations (k,), and faces (m, 3)."""
    angle = 2 * math.pi * np.arange(SIDES) / SIDES
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)])
    owner = np.repeat(np.arange(stations), SIDES)
    normals = [np.tile(out, (stations, 1))]
    vertices = [radius * normals[0]]
    j, k = np.meshgrid(np.arange(SIDES), SIDES * np.arange(stations - 1))
    a, b = (k + j).ravel(), (k + (j + 1) % SIDES).ravel()
    faces = [np.column_stack([a, b, a + SIDES]), np.column_stack([b, b + SIDES, a + SIDES])]
    first = SIDES * stations
    for station, way in ((0, -1.0), (stations - 1, 1.0)):  # flat ends
        vertices.append(np.vstack([radius * out, np.zeros(3)]))
        normals.append(np.tile([0.0, 0.0, way], (SIDES + 1, 1)))
        owner = np.append(owner, np.full(SIDES + 1, station))
        ring, middle = np.arange(SIDES), np.full(SIDES, SIDES)
        turned = np.column_stack([ring, (ring + 1) % SIDES, middle] if way > 0 else [(ring + 1) % SIDES, ring, middle])
        faces.append(first + turned)
        first += SIDES + 1
    return np.vstack(vertices), np.vstack(normals), owner, np.vstack(faces)


def _pose(position: Array, quaternion: Array) -> dict[str, list[float]]:
    w, x, y, z = (float(part) for part in quaternion)
    return {"translation": [float(part) for part in position], "rotation": [x, y, z, w]}


def _shortest(quaternion: Array) -> Array:
    """Return ``quaternion`` (P, 4) with signs such that each is near the one before: viewers interpolate between."""
    same = np.einsum("pi,pi->p", quaternion[1:], quaternion[:-1]) >= 0
    return quaternion * np.cumprod(np.append(1.0, np.where(same, 1.0, -1.0)))[:, None]

"""The problem and the parts that a result was made with, written into its folder: who shows it needs nothing else.

A problem file that runs from where it lies, with every mesh as it was understood: merged, turned outward, in metres, in
the coordinates of its body. PLY with double precision, so that no digit is lost.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from harness_opt.files.stored_results import USED
from harness_opt.files.write import problem_text
from harness_opt.model.parts import MeshFile, Part
from harness_opt.model.problem import Problem
from harness_opt.parts.mesh import Mesh
from harness_opt.parts.scene import Scene

MESHES = "meshes"  # folder of them, beside the problem


def write_used(folder: Path, problems: Mapping[str, Problem], scene: Scene) -> None:
    """Write what a result was made with into its ``folder``.

    Args:
        folder: of the result; it must be there.
        problems: by the names that their files get; all of them have the same parts.
        scene: these parts.

    Raises:
        OSError: the disk refuses.
    """
    place = folder / USED
    (place / MESHES).mkdir(parents=True)
    meshes: dict[str, MeshFile] = {}
    for name, part in scene.parts.items():
        if isinstance(part, Mesh):
            meshes[name] = MeshFile(place / MESHES / f"{len(meshes)}.ply", "m", shell=not part.closed)
            _write_ply(meshes[name].path, part)
    for name, problem in problems.items():
        text, tables = problem_text(_carried(problem, meshes), place / name)
        (place / name).write_bytes(text.encode())
        for table, content in tables.items():
            table.write_bytes(content)


def _carried(problem: Problem, meshes: Mapping[str, MeshFile]) -> Problem:
    """Return ``problem`` with its meshes where they are carried, and tables of poses that are in no file yet."""
    parts = {
        name: Part(meshes[name], part.body, clearance=part.clearance) if name in meshes else part
        for name, part in problem.parts.items()
    }
    bodies = {name: body.without_file for name, body in problem.bodies.items()}
    return dataclasses.replace(problem, parts=parts, bodies=bodies, robots={}, file=None, sha256=None)


def _write_ply(file: Path, mesh: Mesh) -> None:
    """Write the triangles of a mesh, m, and the corners that they use."""
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.faces] = True
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {np.count_nonzero(used)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(mesh.faces), dtype=[("corners", "u1"), ("numbers", "<i4", (3,))])
    rows["corners"], rows["numbers"] = 3, (np.cumsum(used) - 1)[mesh.faces]
    with file.open("wb") as stream:
        stream.write(head.encode())
        stream.write(mesh.vertices[used].astype("<f8").tobytes())
        stream.write(rows.tobytes())

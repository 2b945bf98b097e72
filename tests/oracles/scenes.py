"""Parts that the tests of distances and of clearances share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.ends import End
from harness_opt.model.parts import Box, Capsule, Cylinder, MeshFile, Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene

POSE = {"position": (0.02, -0.01, 0.03), "quaternion": tuple(rotations.normalise([0.9, 0.2, -0.3, 0.1]))}


def _meshes():
    """Meshes by name, in mm, each with what makes it hard."""
    box = trimesh.creation.box((60, 40, 20))
    inverted = box.copy()
    inverted.invert()
    some = box.copy()
    some.faces[::3] = some.faces[::3, ::-1]
    open_box = trimesh.Trimesh(box.vertices, box.faces[2:], process=False)
    slivers = np.vstack([box.faces, [[0, 0, 1], [2, 3, 3]]])
    degenerate = trimesh.Trimesh(np.vstack([box.vertices, box.vertices[:2].mean(0)]), slivers, process=False)
    degenerate.faces = np.vstack([degenerate.faces, [[0, 8, 1], [1, 8, 0]]])
    shell = trimesh.util.concatenate([trimesh.creation.box((60, 60, 60)), trimesh.creation.box((40, 40, 40))])
    shell.faces[12:] = shell.faces[12:, ::-1]
    muddled = shell.copy()
    wrong = [1, 4, 12, 13]  # the first face of the cavity among them
    muddled.faces[wrong] = muddled.faces[wrong][:, ::-1]
    # a right box and one inside out through its end: where they overlap their windings would cancel
    crossed = trimesh.util.concatenate([box, box.copy().apply_translation((40, 0, 0))])
    crossed.faces[12:] = crossed.faces[12:, ::-1]
    # they share an edge, which four faces use
    twins = trimesh.util.concatenate([box, box.copy().apply_translation((60, 40, 0))])
    return {
        "box": box,
        "icosphere": trimesh.creation.icosphere(subdivisions=3, radius=40),
        "annulus": trimesh.creation.annulus(15, 40, 25, sections=48),
        "inverted": inverted,
        "partly inverted": some,
        "degenerate": degenerate,
        "cavity": shell,
        "partly inverted cavity": muddled,
        "twins": twins,
        "crossed": crossed,
        "open": open_box,
    }


MESHES = _meshes()

SHAPES = {
    "box": Box((0.06, 0.04, 0.02)),
    "sphere": Sphere(0.03),
    "cylinder": Cylinder(0.02, 0.05),
    "capsule": Capsule(0.02, 0.05),
}


def problem_with(part: Part, **more) -> Problem:
    """A problem of one cable and this part."""
    run = CableRun(Cable(0.3, 0.005, 1e-3, 1e-3), End(position=(0, 0, 0)), End(position=(0, 0, 0.3)))
    return Problem({"lead": run}, parts={"part": part}, **more)


def load_mesh(mesh, folder: Path, suffix: str = "stl", **pose):
    """The part that ``mesh`` becomes when written to ``folder`` and read again."""
    path = folder / f"mesh.{suffix}"
    mesh.export(path)
    unit = None if suffix == "glb" else "mm"
    file = MeshFile(path, unit, shell=True, up="z")  # whatever its format says
    return load_scene(problem_with(Part(file, **pose))).parts["part"]

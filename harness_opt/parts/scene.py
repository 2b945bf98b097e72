"""Parts to stay clear of: what a problem describes, as geometry that answers distances of points.

A primitive is a closed form (``primitives.py``), a mesh is read (``mesh_file.py``) and asked
through coal (``mesh.py``), which is imported when the first is asked.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model.parts import MeshFile, Part
from harness_opt.model.plausibility import part_doubts
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from harness_opt.parts.geometry import Geometry
from harness_opt.parts.mesh import Mesh
from harness_opt.parts.mesh_file import read_mesh
from harness_opt.parts.mesh_headers import MOST_FACES
from harness_opt.parts.outer_surface import CLOSED_GAP
from harness_opt.parts.primitives import Primitive

__all__ = ["Geometry", "Mesh", "Primitive", "Scene", "load_scene"]


@dataclass(frozen=True, eq=False)
class Scene:
    """All parts of a problem.

    Args:
        parts: by name.
        warnings: for the user, one line each: what was found that limits the answers.
    """

    parts: Mapping[str, Geometry] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def load_scene(problem: Problem) -> Scene:
    """Return the parts of ``problem`` as geometry; imports trimesh only where a mesh is text, OBJ or PLY.

    Raises:
        ProblemError: a mesh that cannot be read, has no triangles, too many, or numbers that are not finite;
            a primitive without size. One line per mistake.
    """
    parts: dict[str, Geometry] = {}
    mistakes: list[str] = []
    for name, part in problem.parts.items():
        try:
            parts[name] = _geometry(name, part)
        except ProblemError as error:
            mistakes += error.mistakes
        count = sum(len(part.faces) for part in parts.values() if isinstance(part, Mesh))
        if count > MOST_FACES:
            mistakes.append(f"parts: found {count:,} triangles up to {name}, expected at most {MOST_FACES:,} in all")
            break
    if mistakes:
        raise ProblemError(mistakes)
    open_ones = (
        f"parts.{name}.mesh: the surface is not closed, so what is inside it goes unnoticed"
        for name, part in parts.items()
        if not part.closed
    )
    sizes = (line for name, part in parts.items() for line in part_doubts(problem, name, part.upper - part.lower))
    return Scene(parts, (*open_ones, *sizes))


def _geometry(name: str, part: Part) -> Geometry:
    """Return one part as geometry; raises as :func:`load_scene` does."""
    shape = part.shape
    if isinstance(shape, MeshFile):
        if importlib.util.find_spec("coal") is None:
            words = "found no coal, which measures distances to meshes, expected it: it is not offered for Windows"
            raise ProblemError(f"parts.{name}.mesh: {words}; boxes, spheres, cylinders and capsules need none")
        vertices, faces, closed = read_mesh(f"parts.{name}.mesh", shape)
        gap = CLOSED_GAP * float(np.abs(vertices).max())  # before the pose: it was the file that rounded
        vertices = part.position + rotations.rotate(part.quaternion, vertices)
        return Mesh.of(name, part.body, vertices, faces, closed, gap)
    for key, size in vars(shape).items():
        numbers = np.atleast_1d(np.asarray(size, dtype=float))
        if not (np.all(np.isfinite(numbers)) and np.all(numbers > 0)):
            kind = type(shape).__name__.lower()
            raise ProblemError(f"parts.{name}.{kind}.{key}: found {size!r}, expected a length above 0 m")
    return Primitive.of(name, part.body, shape, part.position, part.quaternion)

"""Parts as triangles: for whatever draws or exports them, with as many as there is room for."""

from __future__ import annotations

import numpy as np

from harness_opt.model.parts import Box, Capsule, Cylinder
from harness_opt.numerics.rotations import Array, matrix
from harness_opt.numerics.vectors import Indices
from harness_opt.parts.primitives import Primitive
from harness_opt.parts.scene import Geometry, Mesh


def triangles(part: Geometry) -> tuple[Array, Indices]:
    """Return the vertices (k, 3), m, and faces (m, 3) of a part in the coordinates of its body.

    Raises:
        TypeError: neither a mesh nor a primitive.
    """
    cylinder_sides = 48  # sides of a cylinder
    if isinstance(part, Mesh):
        return part.vertices, part.faces
    if not isinstance(part, Primitive):
        raise TypeError(f"found a part of the kind {type(part).__name__}, expected a mesh or a primitive")
    import trimesh

    shape = part.shape
    if isinstance(shape, Box):
        made = trimesh.creation.box(shape.size)
    elif isinstance(shape, Cylinder):
        made = trimesh.creation.cylinder(shape.radius, shape.length, sections=cylinder_sides)
    elif isinstance(shape, Capsule):
        made = trimesh.creation.capsule(shape.length, shape.radius, count=[cylinder_sides, cylinder_sides // 2])
        made.apply_translation([0.0, 0.0, -made.bounds.mean(axis=0)[2]])
    else:
        made = trimesh.creation.icosphere(subdivisions=4, radius=shape.radius)
    vertices = np.asarray(made.vertices) @ matrix(part.quaternion).T + part.position
    return vertices, np.asarray(made.faces)


def on_grid(vertices: Array, faces: Indices, most: int) -> tuple[Array, Array, Indices, Indices]:
    """Return lower corner (3,) and steps (3,) of a grid, vertices (k, 3) as whole numbers on it, and faces (m, 3).

    Vertices at one place of the grid are one. It is as coarse as leaves at most ``most`` faces, but no coarser than
    16 steps a side; faces without area go (Rossignac and Borrel, 1993: vertex clustering).
    """
    first_coarser = 2048  # steps of the first grid that merges vertices on purpose
    coarsest_grid = 16  # steps of the coarsest grid that a part is rounded to
    grid = 65_535  # steps along the longest side of a part's box: vertices are 16-bit numbers
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    vertices, faces = vertices[used], (np.cumsum(used) - 1)[faces]
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    cells = grid
    while True:
        step = np.maximum(np.max(upper - lower) / cells, 1e-12) * np.ones(3)
        rounded = np.rint((vertices - lower) / step).astype(np.int64)
        # one number for a place: sorted ten times as fast as rows
        place, index = np.unique(rounded @ [1 << 32, 1 << 16, 1], return_inverse=True)
        kept = index[faces]
        solid = (kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 2] != kept[:, 0])
        kept = kept[solid]
        if len(kept) <= most or cells <= coarsest_grid:
            return lower, step, np.column_stack([place >> 32, place >> 16 & grid, place & grid]), kept
        cells = min(cells // 2, first_coarser)

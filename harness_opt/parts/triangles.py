"""Parts as triangles: for whatever draws or exports them, with as many as there is room for."""

from __future__ import annotations

import numpy as np

from harness_opt.model.parts import Box, Capsule, Cylinder, Sphere
from harness_opt.numerics.rotations import Array, matrix
from harness_opt.numerics.vectors import Indices
from harness_opt.parts.primitives import Primitive
from harness_opt.parts.scene import Geometry, Mesh

SIDES = 48  # of a round part


def triangles(part: Geometry, sides: int = SIDES) -> tuple[Array, Indices]:
    """Return the vertices (k, 3), m, and faces (m, 3) of a part in the coordinates of its body.

    Args:
        part: a mesh, or a primitive.
        sides: of a round primitive, even.

    Raises:
        TypeError: neither a mesh nor a primitive.
    """
    if isinstance(part, Mesh):
        return part.vertices, part.faces
    if not isinstance(part, Primitive):
        raise TypeError(f"found a part of the kind {type(part).__name__}, expected a mesh or a primitive")
    shape = part.shape
    if isinstance(shape, Box):
        vertices, faces = _box(0.5 * np.array(shape.size))
    else:
        vertices, faces = _revolved(_profile(shape, sides), sides)
    return vertices @ matrix(part.quaternion).T + part.position, faces


def _box(half: Array) -> tuple[Array, Indices]:
    """Return the box whose corners are plus and minus ``half`` (3,)."""
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))  # seen from outside
    return half * corners, np.array([(a, *rest) for a, b, c, d in sides for rest in ((b, c), (c, d))])


def _profile(shape: Cylinder | Capsule | Sphere, sides: int) -> Array:
    """Return the outline (k, 2) of a solid of revolution: distance from its axis, z; from its lower pole up."""
    half = 0.5 * getattr(shape, "length", 0.0)
    if isinstance(shape, Cylinder):
        return np.array([[0.0, -half], [shape.radius, -half], [shape.radius, half], [0.0, half]])
    up = np.linspace(-0.5 * np.pi, 0.5 * np.pi, sides // 2 + 1)
    z = shape.radius * np.sin(up)
    around = np.column_stack([shape.radius * np.cos(up), z])
    if not half:
        return around
    middle = len(up) // 2
    lift = np.array([0.0, half])
    return np.vstack([around[: middle + 1] - lift, around[middle:] + lift])


def _revolved(profile: Array, sides: int) -> tuple[Array, Indices]:
    """Return the surface that ``profile`` (k, 2), from pole to pole, sweeps about the z axis."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    radius, z = profile[1:-1].T
    rings = np.stack(
        [radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle), np.repeat(z[:, None], sides, axis=1)],
        axis=-1,
    ).reshape(-1, 3)
    low, high = len(rings), len(rings) + 1
    vertices = np.vstack([rings, [0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]])
    here = np.arange(sides)
    after = np.roll(here, -1)
    faces = [np.column_stack([np.full(sides, low), after, here])]
    for k in range(len(radius) - 1):
        a, b = k * sides + here, k * sides + after
        faces += [np.column_stack([a, b, b + sides]), np.column_stack([a, b + sides, a + sides])]
    top = (len(radius) - 1) * sides
    faces.append(np.column_stack([np.full(sides, high), top + here, top + after]))
    return vertices, np.vstack(faces)


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

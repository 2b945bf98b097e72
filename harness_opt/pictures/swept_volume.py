"""The room that a cable takes over a motion, as one closed surface to load in CAD.

Between two frames and two stations a straight cable that moves straight stays in the convex hull of four balls. The
union of these hulls holds every solved shape and the straight way from each to the next; it is made by manifold3d,
whose unions are closed surfaces by construction. Imported when asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.limits import bending
from harness_opt.errors import HarnessError
from harness_opt.model.results import Motion
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

ROUGHNESS = 0.05  # radii, that the chords between two stations may miss the cable by
MOST_PIECES = 4_000  # hulls: a few seconds
BALL = 2  # times that an icosahedron is refined to stand for a ball: 162 corners


@dataclass(frozen=True, eq=False)
class SweptVolume:
    """A closed surface around all shapes of a cable.

    Args:
        vertices: (k, 3), world, m.
        faces: (m, 3), vertex numbers, turned outward.
        volume: m3.
        excess: by how much the surface lies outside what the cable sweeps, at most, m; it never lies inside.
    """

    vertices: Array
    faces: Indices
    volume: float
    excess: float


def swept_volume(motion: Motion, name: str) -> SweptVolume:
    """Return what the cable called ``name`` sweeps.

    Args:
        motion: with at least one frame.
        name: of one of its cables.

    Raises:
        HarnessError: manifold3d is missing, or finds no surface; one line.
    """
    try:
        from manifold3d import Error, Manifold, OpType
    except ImportError as error:
        raise HarnessError('found no manifold3d, expected the extra "harness-opt[meshes]"') from error
    import trimesh

    shapes, radius = motion.cables[name].line, motion.problem.cables[name].cable.radius
    stations, sag = _stations(shapes.s, float(np.max(bending(shapes))), ROUGHNESS * radius)
    frames, missed = _frames(motion.motion, shapes.position[:, stations], MOST_PIECES // max(len(stations) - 1, 1))
    corners = shapes.position[np.ix_(frames, stations)]
    ball = trimesh.creation.icosphere(subdivisions=BALL)
    inscribed = float(np.min(np.einsum("mi,mi->m", ball.triangles_center, ball.face_normals)))
    outer = (radius + sag + missed) / inscribed  # the faces of the ball touch the cable, not its corners
    around = outer * np.asarray(ball.vertices)
    following = np.arange(1, len(frames)) if len(frames) > 1 else np.zeros(1, dtype=int)
    pieces = []
    for k in following:
        for j in range(len(stations) - 1):
            four = corners[max(k - 1, 0) : k + 1, j : j + 2].reshape(-1, 3)
            pieces.append(Manifold.hull_points((four[:, None] + around).reshape(-1, 3)))
    whole = Manifold.batch_boolean(pieces, OpType.Add)
    if whole.status() != Error.NoError or whole.is_empty():
        raise HarnessError(f"found no surface around what {name} sweeps ({whole.status()}), expected one")
    mesh = whole.to_mesh64()
    vertices, faces = np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64)
    return SweptVolume(vertices, faces, float(whole.volume()), outer - radius)


def for_stl(vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """Return a closed surface as STL holds it, with numbers of 32 bits, and closed still.

    Corners that these make one are one, triangles that lose their area go, and so do two that are left back to back:
    every edge keeps as many triangles on one side as on the other.

    Args:
        vertices: (k, 3), in the unit of the file.
        faces: (m, 3).
    """
    rounded = vertices.astype(np.float32) + np.float32(0)  # -0 is 0
    unique, index = np.unique(rounded, axis=0, return_inverse=True)
    kept = index.reshape(-1)[faces]
    kept = kept[(kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 2] != kept[:, 0])]
    first = np.argmin(kept, axis=1)
    turned = np.stack([np.take_along_axis(kept, (first[:, None] + k) % 3, axis=1)[:, 0] for k in range(3)], axis=1)
    back = turned[:, [0, 2, 1]]
    both = {tuple(face) for face in turned.tolist()} & {tuple(face) for face in back.tolist()}
    alone = np.array([tuple(face) not in both for face in turned.tolist()], dtype=bool)
    return unique.astype(float), turned[alone]


def _stations(s: Array, curvature: float, tolerance: float) -> tuple[Indices, float]:
    """Return stations whose chords miss the curve by at most ``tolerance``, and by how much they do, m.

    A chord of length h misses a curve of curvature k by at most k h^2 / 8.
    """
    longest = math.sqrt(8.0 * tolerance / curvature) if curvature > 0 else math.inf
    count = int(np.clip(math.ceil(s[-1] / longest), 1, len(s) - 1)) if math.isfinite(longest) else 1
    kept = np.unique(np.rint(np.linspace(0, len(s) - 1, count + 1)).astype(int))
    step = float(np.max(np.diff(s[kept])))
    return kept, curvature * step**2 / 8.0


def _frames(motion: Array, position: Array, most: int) -> tuple[Indices, float]:
    """Return at most ``most`` + 1 frames, and by how much the straight way between them misses the others, m."""
    kept = np.unique(np.rint(np.linspace(0, len(motion) - 1, min(len(motion), most + 1))).astype(int))
    if len(kept) == len(motion):
        return kept, 0.0
    after = np.clip(np.searchsorted(kept, np.arange(len(motion)), side="right"), 1, len(kept) - 1)
    low, high = kept[after - 1], kept[after]
    share = ((np.arange(len(motion)) - low) / (high - low))[:, None, None]
    straight = (1 - share) * position[low] + share * position[high]
    return kept, float(np.max(np.linalg.norm(position - straight, axis=-1)))

"""Where a picture is taken from: across the plane of the motion, far enough to see all of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from harness_opt.numerics.rotations import Array
from harness_opt.pictures.drawing import DrawnFrame
from harness_opt.report import viewpoint

if TYPE_CHECKING:
    import pyvista as pv

VIEW_ANGLE = 18.0  # degrees that the picture is high; a long lens, so that sizes compare across it
TANGENT = math.tan(math.radians(VIEW_ANGLE / 2))
MARGIN = 0.07  # share of the picture left free on each side
TITLE_ROOM = 0.10  # share of its height kept free for the words above


@dataclass(frozen=True, eq=False)
class Camera:
    """Where a picture is taken from.

    Args:
        focus: the point in its middle, m, (3,).
        right, up, back: unit vectors of the picture, ``back`` towards the eye, (3,).
        distance: from the eye to the focus, m.
        aspect: width over height.
    """

    focus: Array
    right: Array
    up: Array
    back: Array
    distance: float
    aspect: float

    @staticmethod
    def of(frames: Sequence[DrawnFrame], meshes: Mapping[str, pv.PolyData], aspect: float) -> Camera:
        """Return the camera that sees the motions of ``frames`` whole, across the plane they happen in.

        Of the views from both sides, the one from which parts hide least of the cables.
        """
        outlines = {name: viewpoint.extremes(np.asarray(mesh.points, dtype=float)) for name, mesh in meshes.items()}
        motions = [one.motion for one in frames]
        lines = [np.vstack([c.position.reshape(-1, 3) for c in m.cables.values()]) for m in motions]
        held = zip(motions, lines, strict=True)
        seen = np.vstack([viewpoint.whole(m.problem, m.motion, outlines, points) for m, points in held])
        right, up, back = viewpoint.clearest(motions[-1], frames[-1].scene)
        wide, high = TANGENT * aspect * (1 - 2 * MARGIN), TANGENT * (1 - 2 * MARGIN - TITLE_ROOM)
        flat = seen @ np.column_stack([right, up, back])
        middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
        x, y, z = (flat - middle).T
        distance = float(np.max(z + np.maximum(np.abs(x) / wide, np.abs(y) / high)))
        middle[1] += TITLE_ROOM * distance * TANGENT  # the words above push the rest down
        return Camera(np.column_stack([right, up, back]) @ middle, right, up, back, distance, aspect)

    @property
    def eye(self) -> Array:
        """Where it stands, m, (3,)."""
        return self.focus + self.distance * self.back

    def apply(self, plotter: pv.Plotter) -> None:
        """Give the active view of ``plotter`` this camera."""
        camera = plotter.camera
        camera.position, camera.focal_point, camera.up = tuple(self.eye), tuple(self.focus), tuple(self.up)
        camera.view_angle = VIEW_ANGLE
        plotter.reset_camera_clipping_range()

    def project(self, points: Array) -> Array:
        """Return where ``points`` (n, 3), m, stand in the picture, (n, 2), 0 to 1 from its lower left."""
        offset = points - self.eye
        depth = -(offset @ self.back) * 2 * TANGENT
        return 0.5 + np.column_stack([offset @ self.right / (depth * self.aspect), offset @ self.up / depth])

    def unproject(self, at: Array, like: Array) -> Array:
        """Return the point (3,), m, that stands ``at`` (2,) in the picture, as deep as ``like`` (3,)."""
        depth = (self.eye - like) @ self.back
        x, y = (np.asarray(at) - 0.5) * 2 * TANGENT * depth
        found: Array = self.eye - depth * self.back + x * self.aspect * self.right + y * self.up
        return found

    def in_front(self, mesh: pv.PolyData) -> pv.PolyData:
        """Return ``mesh`` shrunk towards the eye: it looks the same, and nothing hides it."""
        mesh = mesh.copy()
        mesh.points = self.eye + 0.3 * (np.asarray(mesh.points) - self.eye)
        return mesh

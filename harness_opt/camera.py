"""Where a picture is taken from: across the plane of the motion, far enough to see all of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from . import rotations
from .drawing import Moment
from .rotations import Array

if TYPE_CHECKING:
    import pyvista as pv

VIEW_ANGLE = 18.0  # degrees that the picture is high; a long lens, so that sizes compare across it
TANGENT = math.tan(math.radians(VIEW_ANGLE / 2))
ELEVATION = 20.0  # degrees above the plane of view, so that depth shows
ASIDE = 16.0  # degrees off the normal of the plane of motion, for the same
MARGIN = 0.07  # share of the picture left free on each side
TITLE_ROOM = 0.10  # share of its height kept free for the words above
NEAR, NEXT = 1.0, 0.15  # extents of the cables: parts that reach up to here are shown whole, others so far


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
    def of(moments: Sequence[Moment], meshes: Mapping[str, pv.PolyData], aspect: float) -> Camera:
        """Return the camera that sees the motions of ``moments`` whole, across the plane they happen in.

        Of the views from both sides, the one from which parts hide least of the cables.
        """
        seen = _seen(moments, meshes)
        normal = _plane_normal(moments)
        views = [_axes(normal, aside, sign) for sign in (1.0, -1.0) for aside in (ASIDE, -ASIDE)]
        hidden = [_hidden(moments, meshes, axes[2]) for axes in views]
        right, up, back = views[int(np.argmin(hidden))]
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
        return self.eye - depth * self.back + x * self.aspect * self.right + y * self.up

    def in_front(self, mesh: pv.PolyData) -> pv.PolyData:
        """Return ``mesh`` shrunk towards the eye: it looks the same, and nothing hides it."""
        mesh = mesh.copy()
        mesh.points = self.eye + 0.3 * (np.asarray(mesh.points) - self.eye)
        return mesh


def _seen(moments: Sequence[Moment], meshes: Mapping[str, pv.PolyData]) -> Array:
    """Return points (n, 3) that the picture must hold: the cables, and the parts near them.

    Of a part that reaches far away only what is next to the cables counts: a cable on a ship is not to be a
    dot on a ship.
    """
    cables = np.vstack([c.position.reshape(-1, 3) for moment in moments for c in moment.motion.cables.values()])
    lower, upper = cables.min(axis=0), cables.max(axis=0)
    diagonal = float(np.linalg.norm(upper - lower))
    points = [cables]
    for moment in moments:
        at = moment.motion.motion[:: max(1, len(moment.motion.motion) // 8)]
        for name, part in moment.scene.parts.items():
            position, q = moment.motion.problem.poses(part.body, at)
            reached = (rotations.rotate(q[:, None], _extremes(meshes[name])) + position[:, None]).reshape(-1, 3)
            far = max(float(np.max(lower - reached)), float(np.max(reached - upper)))
            around = diagonal * (NEAR if far <= NEAR * diagonal else NEXT)
            points.append(np.clip(reached, lower - around, upper + around))
    return np.vstack(points)


def _extremes(mesh: pv.PolyData) -> Array:
    """Return the points (n, 3) of ``mesh`` that lie farthest out in 128 directions."""
    points = np.asarray(mesh.points, dtype=float)
    turns = np.arange(128) + 0.5
    z = 1 - turns / 64
    around = math.pi * (1 + math.sqrt(5)) * turns  # the golden angle spreads directions evenly
    directions = np.column_stack([np.sqrt(1 - z * z) * np.cos(around), np.sqrt(1 - z * z) * np.sin(around), z])
    # one at a time: all at once would take a gigabyte for a million points
    return points[np.unique([np.argmax(points @ direction) for direction in directions])]


def _plane_normal(moments: Sequence[Moment]) -> Array:
    """Return the unit normal (3,) of the plane in which points of the cables move mostly.

    The direction in which they move least; where that leaves two, the one in which the cables extend less.
    """
    spread = np.zeros((3, 3))
    for shapes in (c for moment in moments for c in moment.motion.cables.values()):
        moved = (shapes.position - shapes.position.mean(axis=0)).reshape(-1, 3)
        extent = (shapes.position - shapes.position.mean(axis=(0, 1))).reshape(-1, 3)
        for share, points in ((1.0, moved), (0.2, extent)):
            total = float(np.sum(points * points))
            spread += share * points.T @ points / max(total, 1e-30)
    return np.linalg.eigh(spread)[1][:, 0]


def _axes(normal: Array, aside: float, sign: float) -> tuple[Array, Array, Array]:
    """Return right, up and back of a picture along ``normal``, ``aside`` degrees off and from above; z up."""
    azimuth = math.atan2(sign * normal[1], sign * normal[0])
    steep = abs(normal[2]) > math.sin(math.radians(60))  # a plane that lies flat is looked at from well above
    if steep:
        azimuth = -math.pi / 2 if sign > 0 else math.pi / 2
    azimuth += math.radians(aside)
    elevation = math.radians(55.0 if steep else ELEVATION)
    level = math.cos(elevation)
    back = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])
    right = rotations.normalise(np.cross([0.0, 0.0, 1.0], back))
    return right, np.cross(back, right), back


def _hidden(moments: Sequence[Moment], meshes: Mapping[str, pv.PolyData], back: Array) -> int:
    """Return how many points of the cables parts hide from an eye far off along ``back`` (3,)."""
    hidden = 0
    for moment in moments:
        points = np.vstack([c.position[moment.frame, ::5] for c in moment.motion.cables.values()])
        for name, part in moment.scene.parts.items():
            position, q = moment.pose(part.body)
            home = rotations.conjugate(q)
            ray = meshes[name].length * 4.0 * rotations.rotate(home, back)
            starts = rotations.rotate(home, points - position)
            hidden += sum(len(meshes[name].ray_trace(start, start + ray, first_point=True)[0]) > 0 for start in starts)
    return hidden

"""What is drawn at one moment of a motion: parts as solids, cables as tubes in the colours of their clearances.

No theme is changed: every colour and every size is given where it is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance import along_cable as colouring
from harness_opt.clearance.centreline import Curve
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.model.cable import CableRun
from harness_opt.model.parts import Box, Capsule, Cylinder
from harness_opt.model.results import CableMotion, Motion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Geometry, Mesh, Primitive, Scene
from harness_opt.pictures.opengl import load_pyvista
from harness_opt.report.colours import CABLES, EDGE, HIT_PART, MOVING_PART, SHORT, STILL_PART, TOUCHES, rgb

if TYPE_CHECKING:
    import pyvista as pv

SIZE = (1600, 900)  # pixels: a slide of 16 : 9
SIDES = 24  # of a tube
POINTS = 241  # along a drawn cable, so that colours change where they should
FEATURE_ANGLE = 30.0  # degrees between faces from which an edge is drawn

TUBE: dict[str, Any] = {"ambient": 0.12, "specular": 0.25, "render": False}


@dataclass(frozen=True, eq=False)
class DrawnFrame:
    """One frame of a motion.

    Args:
        motion: the whole of it.
        scene: its parts.
        frame: its number.
        still: clearances of that frame alone.
        palette: the cables' colours, in order.
    """

    motion: Motion
    scene: Scene
    frame: int
    still: ClearanceResult
    palette: tuple[str, ...] = CABLES

    @staticmethod
    def of(motion: Motion, scene: Scene, frame: int, palette: tuple[str, ...] = CABLES) -> DrawnFrame:
        """Return a frame of ``motion``, its clearances measured."""
        only = slice(frame, frame + 1)
        cables = {name: shapes.frames(only) for name, shapes in motion.cables.items()}
        return DrawnFrame(motion, scene, frame, measure(motion.problem, scene, motion.motion[only], cables), palette)

    @property
    def colours(self) -> dict[str, str]:
        """The colour of each cable, by name."""
        return {name: self.palette[i % len(self.palette)] for i, name in enumerate(self.motion.cables)}

    @property
    def touched(self) -> set[str]:
        """Names of the parts that a cable runs into."""
        return {pair.obstacle.name for pair in self.still.pairs if pair.worst < 0 and not pair.obstacle.is_cable}

    def pose(self, body: str) -> tuple[Array, Array]:
        """Return the position (3,) and quaternion (4,) of ``body``."""
        return pose_at(self.motion, self.frame, body)


def pose_at(motion: Motion, frame: int, body: str) -> tuple[Array, Array]:
    """Return the position (3,) and quaternion (4,) of ``body`` in a frame of ``motion``."""
    position, quaternion = motion.problem.poses(body, motion.motion[frame])
    return position[0], quaternion[0]


def look(shown: DrawnFrame, part: Geometry) -> tuple[float, str]:
    """Return the opacity and the colour of a part; what a cable runs into is glass, to see it inside."""
    if part.name in shown.touched:
        return 0.42, HIT_PART
    return 1.0, MOVING_PART if shown.motion.problem.is_moved(part.body) else STILL_PART


def add_solid(plotter: pv.Plotter, name: str, mesh: pv.PolyData, opacity: float, colour: str) -> None:
    """Draw a solid with smooth faces and its sharp edges."""
    actor = plotter.add_mesh(mesh, name=name, color=colour, opacity=opacity, ambient=0.15, specular=0.1, render=False)
    actor.prop.interpolation = "phong"
    edges = mesh.extract_feature_edges(FEATURE_ANGLE, manifold_edges=False, non_manifold_edges=False)
    if edges.n_cells:
        style: dict[str, Any] = {"color": EDGE, "line_width": 2, "lighting": False, "render": False}
        plotter.add_mesh(edges, name=f"edges of {name}", opacity=min(1.0, 2.5 * opacity), **style)


def add_cable(plotter: pv.Plotter, shown: DrawnFrame, name: str) -> pv.Actor:
    """Draw a cable in the colours of its clearances, and return its actor."""
    drawn = tube(*cable_colours(shown, name), shown.motion.problem.cables[name].cable.radius)
    return plotter.add_mesh(drawn, name=f"cable:{name}", scalars="colour", rgb=True, reset_camera=False, **TUBE)


def cable_colours(shown: DrawnFrame, name: str) -> tuple[Array, Array]:
    """Return points (n, 3) along a cable, m, world, and their colours (n, 3), 0 to 255.

    Red where it touches something, orange where a clearance, the bend radius or the twist breaks its limit.
    """
    shapes, frame = shown.motion.cables[name], shown.frame
    s = np.linspace(0.0, shapes.s[-1], POINTS)
    points = curve_of(shapes).at(np.full(len(s), frame), s)
    several = colouring.Points(name, np.array([frame]), s, points[None])
    state = colouring.states(shown.motion, shown.scene, shown.still.pairs, several, _reach(shown))[1][0]
    colours = np.tile(rgb(shown.colours[name]), (len(s), 1))
    colours[state == colouring.SHORT] = rgb(SHORT)
    colours[state == colouring.TOUCHES] = rgb(TOUCHES)
    return points, colours


def _reach(shown: DrawnFrame) -> float:
    """Return how far to look for what a limit says anything about, m."""
    return max((pair.limit or 0.0 for pair in shown.still.pairs), default=0.0)


def solid(part: Geometry) -> pv.PolyData:
    """Return a part as a surface with normals, in the coordinates of its body, m."""
    pyvista = load_pyvista()
    if isinstance(part, Mesh):
        mesh = pyvista.PolyData.from_regular_faces(part.vertices, part.faces)
    else:
        assert isinstance(part, Primitive)
        shape, along = part.shape, (0.0, 0.0, 1.0)
        if isinstance(shape, Box):
            mesh = pyvista.Cube(x_length=shape.size[0], y_length=shape.size[1], z_length=shape.size[2])
        elif isinstance(shape, Cylinder):
            mesh = pyvista.Cylinder(direction=along, radius=shape.radius, height=shape.length, resolution=96)
        elif isinstance(shape, Capsule):
            mesh = pyvista.Capsule(direction=along, radius=shape.radius, cylinder_length=shape.length, resolution=48)
        else:
            mesh = pyvista.Sphere(radius=shape.radius, theta_resolution=64, phi_resolution=64)
        mesh = mesh.triangulate().clean().transform(placement(part.position, part.quaternion), inplace=False)
    found: pv.PolyData = mesh.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=FEATURE_ANGLE, consistent_normals=False
    )
    return found


def clamped(run: CableRun, shapes: CableMotion) -> dict[str, int]:
    """Return the stations at the clamps and clips of a cable, by name, along it."""
    return dict(zip(run.clamps, (0, *shapes.clip_stations, len(shapes.s) - 1), strict=True))


def tube(points: Array, colours: Array | None, radius: float) -> pv.PolyData:
    """Return the tube around ``points`` (n, 3), m, with ``colours`` (n, 3) as its point data "colour"."""
    line = load_pyvista().MultipleLines(points)
    if colours is not None:
        line.point_data["colour"] = colours.astype(np.uint8)
    found: pv.PolyData = line.tube(radius=radius, n_sides=SIDES, capping=True)
    return found


def curve_of(shapes: CableMotion) -> Curve:
    """Return the centrelines of a cable between its stations."""
    return Curve(shapes.s, shapes.position, rotations.tangent(shapes.quaternion))


def placement(position: Array, quaternion: Array) -> Array:
    """Return the matrix (4, 4) that puts a body at ``position`` (3,), m, turned by ``quaternion`` (4,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotations.matrix(quaternion), position
    return matrix


def light(plotter: pv.Plotter) -> None:
    """Light the active view from over the eye's shoulders; strong enough that white stays white."""
    pyvista = load_pyvista()
    for position, intensity in (((-0.6, 0.9, 1.0), 0.9), ((0.9, 0.1, 0.8), 0.38), ((0.0, -0.8, 0.6), 0.16)):
        plotter.add_light(
            pyvista.Light(position=position, light_type="camera light", intensity=intensity), only_active=True
        )

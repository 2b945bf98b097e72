"""One motion in a view of a window: parts, cables, clamp frames, ghosts, and the line to what is nearest."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance.pairs import PairClearance
from harness_opt.model.results import Motion
from harness_opt.parts.scene import Scene
from harness_opt.pictures.drawing import (
    POINTS,
    TUBE,
    DrawnFrame,
    add_cable,
    add_solid,
    clamped,
    curve_of,
    look,
    placement,
    pose_at,
    tube,
)
from harness_opt.pictures.opengl import load_pyvista
from harness_opt.report.colours import AXES, INK, MOVING_PART, TOUCHES, Key, ramp, rgb

if TYPE_CHECKING:
    import pyvista as pv

    from harness_opt.numerics.rotations import Array

    Colours = Callable[[str, int, Array, Array], Array]  # of a cable's points: its name, frame, s (n,), points (n, 3)

EXTREMES = (0, -1)  # frames that are drawn faintly
TRIAD = 5.0  # diameters of the cable, of the arrows of a clamp's frame
KEY_GAP = 14  # pixels between a key and its words
IN_FRONT = -66_000.0  # units of depth, by which VTK draws a line before everything


class SceneView:
    """A motion in the active view of a plotter.

    Its actors are named ``part:NAME``, ``cable:NAME``, ``clamp:NAME:END``, ``ghost ...``, ``witness`` and ``words``.

    Args:
        plotter: whose active view is drawn in.
        motion, scene: what is drawn.
        meshes: the parts in the coordinates of their bodies.
        title: what stands above.
        palette: the cables' colours, in order.
    """

    def __init__(
        self,
        plotter: pv.Plotter,
        motion: Motion,
        scene: Scene,
        meshes: Mapping[str, pv.PolyData],
        title: str,
        palette: tuple[str, ...],
    ):
        """Draw what only moves; :meth:`show` draws the rest."""
        self.plotter, self.motion, self.scene, self.title, self.palette = plotter, motion, scene, title, palette
        self.renderer = plotter.renderer
        self._drawn: dict[int, DrawnFrame] = {}
        for name, part in scene.parts.items():
            add_solid(plotter, f"part:{name}", meshes[name], *look(self.drawn(0), part))
        for name in motion.cables:
            size = TRIAD * motion.problem.cables[name].cable.diameter
            for end in motion.problem.cables[name].clamps:
                actor = plotter.add_mesh(_triad(size), name=f"clamp:{name}:{end}", scalars="colour", rgb=True)
                actor.prop.lighting = False
        self._add_ghosts(meshes)

    def drawn(self, frame: int) -> DrawnFrame:
        """Return a frame with its clearances; measured once."""
        if frame not in self._drawn:
            self._drawn[frame] = DrawnFrame.of(self.motion, self.scene, frame, self.palette)
        return self._drawn[frame]

    def nearest(self, at: float) -> int:
        """Return the solved frame nearest to ``at``, 0 to 1."""
        return int(np.argmin(np.abs(self.motion.motion - at)))

    def show(self, frame: int, colours: Colours | None, *, ghosts: bool, frames: bool) -> None:
        """Show a frame.

        Args:
            frame: its number.
            colours: of the cables; None for those of the limits.
            ghosts, frames: whether the ends of the motion, and the frames of the clamps, are to be seen.
        """
        shown, actors = self.drawn(frame), self.renderer.actors
        for name, part in self.scene.parts.items():
            for key in {f"part:{name}", f"edges of part:{name}"} & set(actors):
                actors[key].user_matrix = placement(*shown.pose(part.body))
            actors[f"part:{name}"].prop.opacity, actors[f"part:{name}"].prop.color = look(shown, part)
        for name, shapes in self.motion.cables.items():
            if colours is None:
                add_cable(self.plotter, shown, name)
            else:
                s = np.linspace(0.0, shapes.s[-1], POINTS)
                points = curve_of(shapes).at(np.full(len(s), frame), s)
                drawn = tube(points, colours(name, frame, s, points), self.motion.problem.cables[name].cable.radius)
                style: dict[str, Any] = {"scalars": "colour", "rgb": True, "reset_camera": False}
                self.plotter.add_mesh(drawn, name=f"cable:{name}", **style, **TUBE)
            for end, station in clamped(self.motion.problem.cables[name], shapes).items():
                actor = actors[f"clamp:{name}:{end}"]
                actor.user_matrix = placement(shapes.position[frame, station], shapes.quaternion[frame, station])
                actor.visibility = frames
        for name, actor in actors.items():
            if name.startswith(("ghost", "edges of ghost")):
                actor.visibility = ghosts and not name.endswith(f":{frame}")
        self._point(shown)

    def show_key(self, key: Key | None) -> None:
        """Show what the colours mean; None for the colours of the limits, which need no key."""
        for title in list(self.plotter.scalar_bars.keys()):
            self.plotter.remove_scalar_bar(title, render=False)
        if key is None:
            return
        pyvista = load_pyvista()
        table = pyvista.LookupTable(values=np.column_stack([ramp(np.linspace(0, 1, 256)), np.full(256, 255)]))
        table.scalar_range = (0.0, 1.0)
        table.annotations = {at: words for at, words, _ in key.ticks}
        mapper = pyvista.DataSetMapper()
        mapper.lookup_table = table
        add_bar: Any = self.plotter.add_scalar_bar  # typed as the method of another class
        bar = add_bar(
            title=f"{key.title}\n", mapper=mapper, n_labels=0, vertical=True, position_x=0.13, position_y=0.42,
            width=0.05, height=0.38, color=INK, title_font_size=16, label_font_size=13, render=False,
        )  # fmt: skip
        bar.SetAnnotationLeaderPadding(KEY_GAP)

    def _add_ghosts(self, meshes: Mapping[str, pv.PolyData]) -> None:
        """Draw the cables and the moving parts faintly at both ends of the motion."""
        problem, shown = self.motion.problem, self.drawn(0)
        if not problem.moves:
            return
        for number in EXTREMES:
            frame = number % len(self.motion.motion)
            for name, shapes in self.motion.cables.items():
                faint = tube(shapes.line.position[frame], None, problem.cables[name].cable.radius)
                style: dict[str, Any] = {"color": shown.colours[name], "opacity": 0.22, "render": False}
                self.plotter.add_mesh(faint, name=f"ghost cable:{name}:{frame}", **style)
            for name, part in self.scene.parts.items():
                if problem.is_moved(part.body):
                    placed = meshes[name].transform(placement(*pose_at(self.motion, frame, part.body)), inplace=False)
                    add_solid(self.plotter, f"ghost part:{name}:{frame}", placed, 0.1, MOVING_PART)

    def _point(self, shown: DrawnFrame) -> None:
        """Draw the line between a cable and what is nearest to its limit, and say how long it is."""
        plotter, at = self.plotter, float(self.motion.motion[shown.frame])
        words, colour = f"{self.title}\n{self.motion.problem.moments.words(at)}", INK
        near = [pair for pair in shown.still.pairs if math.isfinite(pair.worst)]
        pair = min(near, key=lambda pair: pair.worst - (pair.limit or 0.0), default=None)
        if pair is not None:
            broken = pair.worst < (pair.limit or 0.0)
            point = pair.nearest.point[0]
            line = load_pyvista().Line(point, point + pair.worst * pair.nearest.normal[0])
            colour = TOUCHES if broken else INK
            actor = plotter.add_mesh(line, name="witness", color=colour, line_width=5, lighting=False, render=False)
            actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, IN_FRONT)
            words += f"\n{distance_words(pair)}"
        style: dict[str, Any] = {"position": (0.03, 0.85), "viewport": True, "font_size": 11, "name": "words"}
        plotter.add_text(words, color=colour, render=False, **style)


def distance_words(pair: PairClearance) -> str:
    """Return how far a cable is from an obstacle at its nearest, such as "lead: 9.1 mm deep in bracket"."""
    other = pair.obstacle.words(pair.cable)
    return f"{pair.cable}: {1e3 * abs(pair.worst):.1f} mm {'deep in' if pair.worst < 0 else 'to'} {other}"


def _triad(size: float) -> pv.PolyData:
    """Return the arrows of a section frame, d1 red, d2 green, d3 blue, as point data "colour"."""
    pyvista = load_pyvista()
    arrows = [pyvista.Arrow(direction=axis, scale=size) for axis in np.eye(3)]
    for arrow, colour in zip(arrows, AXES, strict=True):
        arrow.point_data["colour"] = np.tile(rgb(colour), (arrow.n_points, 1)).astype(np.uint8)
    found: pv.PolyData = pyvista.merge(arrows)
    return found

"""A window on a result folder: the scene, and a slider to scrub through the motion."""

from __future__ import annotations

import json
import os
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .camera import Camera
from .drawing import EDGE, ENDS, INK, SIZE, Moment, add_cable, add_solid, light, look, placement, rgb, solid
from .errors import HarnessError
from .opengl import drawable, has_screen, load_pyvista, quiet
from .problem_file import read_problem
from .results import CableMotion, Motion
from .scene import load_scene

if TYPE_CHECKING:
    import pyvista as pv

TICK = 40  # ms between two pictures while the window plays
KEPT = ("s", "position", "quaternion", "curvature", "force", "moment")  # of a cable, in every motion.npz


def show(folder: str | os.PathLike[str]) -> None:
    """Open a window on a result folder and return when it is closed; a slider moves along the motion.

    Space plays, the arrow keys step, "w" goes to the worst moment, "q" closes.

    Raises:
        HarnessError: the folder holds no result, pyvista is missing, or there is no display; one line.
        ProblemError: its problem file, or a mesh, can't be read any more.
    """
    motion, worst = read_motion(folder)
    load_pyvista()
    with quiet():
        visible = not sys.platform.startswith("linux") or has_screen()
    if not visible:
        raise HarnessError("found no display to open a window on, expected one (the pictures in the folder need none)")
    Window(motion, worst).plotter.show()


def read_motion(folder: str | os.PathLike[str]) -> tuple[Motion, float]:
    """Return the motion that a result folder holds, and where its tightest limit stands, 0 to 1.

    What ``motion.npz`` need not keep of a cable, its stability and errors, is NaN.

    Raises:
        HarnessError: files are missing, or are not what ``harness-opt`` writes.
        ProblemError: the problem file can't be read any more.
    """
    folder = Path(folder)
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        with np.load(folder / "motion.npz", allow_pickle=False) as file:
            arrays = dict(file)
        source, rows = summary["problem"]["file"], [r for r in summary["limits"] if r["margin"] is not None]
        tight = min(rows, key=lambda r: r["margin"] / (abs(r["limit"]) or 1.0), default={"motion": 0.0})
        unknown = [np.full(len(arrays["motion"]), np.nan)] * 4
        cables = {
            name: CableMotion(*(arrays[f"{name}/{key}"] for key in KEPT), *unknown)
            for name in (key.removesuffix("/position") for key in arrays if key.endswith("/position"))
        }
    except OSError as error:
        raise HarnessError(f"{folder}: found no {error.filename or error}, expected a result folder") from error
    except (ValueError, KeyError, TypeError) as error:
        raise HarnessError(f"{folder}: found a damaged result ({error!r}), expected a whole one") from error
    if source is None:
        raise HarnessError(f"{folder}: found no name of a problem file, expected one to know the parts by")
    problem = read_problem(folder / source)
    if set(cables) != set(problem.cables) or not len(arrays["motion"]):
        raise HarnessError(f"{folder}: found shapes of {sorted(cables)}, expected {sorted(problem.cables)}")
    return Motion(problem, arrays["motion"], cables), float(tight["motion"])


class Window:
    """The scene of a motion that can be moved along it.

    Args:
        motion: what to show; only solved frames are.
        worst: of the motion, 0 to 1, where the key "w" goes.
        off_screen: draw without a window, for tests.
    """

    def __init__(self, motion: Motion, worst: float, *, off_screen: bool = False):
        """Set the scene and show the worst moment."""
        self.motion, self.worst, self.playing, self.at = motion, worst, False, 0.0
        self.slider: Any = None
        self.scene = load_scene(motion.problem)
        self._moments: dict[int, Moment] = {}
        pyvista = load_pyvista()
        title = motion.problem.title or "harness-opt"
        with drawable() if off_screen else nullcontext():
            self.plotter = pyvista.Plotter(off_screen=off_screen, window_size=list(SIZE), title=title, lighting="none")
        self.plotter.set_background("white")
        light(self.plotter)
        meshes = {name: solid(part) for name, part in self.scene.parts.items()}
        for name, part in self.scene.parts.items():
            add_solid(self.plotter, f"part:{name}", meshes[name], *look(self._moment(0), part))
        for name in motion.cables:
            size = 5.0 * motion.problem.cables[name].cable.diameter
            for end in ENDS:
                actor = self.plotter.add_mesh(_triad(size), name=f"clamp:{name}:{end}", scalars="colour", rgb=True)
                actor.prop.lighting = False
        Camera.of([self._moment(0)], meshes, SIZE[0] / SIZE[1]).apply(self.plotter)
        self.plotter.enable_anti_aliasing("msaa")
        self._controls()
        self.go(worst)

    @property
    def frame(self) -> int:
        """The solved frame nearest to where the motion stands."""
        return int(np.argmin(np.abs(self.motion.motion - self.at)))

    def go(self, at: float) -> None:
        """Show the solved frame nearest to ``at``, 0 to 1."""
        self.at = min(1.0, max(0.0, at))
        frame, actors = self.frame, self.plotter.actors
        moment = self._moment(frame)
        for name, part in self.scene.parts.items():
            for key in {f"part:{name}", f"edges of part:{name}"} & set(actors):
                actors[key].user_matrix = placement(*moment.pose(part.body))
            actors[f"part:{name}"].prop.opacity, actors[f"part:{name}"].prop.color = look(moment, part)
        for name, shapes in self.motion.cables.items():
            add_cable(self.plotter, moment, name)
            for end, station in ENDS.items():
                pose = placement(shapes.position[frame, station], shapes.quaternion[frame, station])
                actors[f"clamp:{name}:{end}"].user_matrix = pose
        if self.slider is not None:
            self.slider.GetRepresentation().SetValue(self.at)
        self.plotter.reset_camera_clipping_range()
        self.plotter.render()

    def tick(self, seconds: float) -> None:
        """Let ``seconds`` pass where it plays; after the end it starts again."""
        if self.playing:
            after = self.at + seconds / self.motion.problem.duration
            self.go(0.0 if self.at >= 1.0 else after)

    def toggle(self) -> None:
        """Play, or stop playing."""
        self.playing = not self.playing

    def step(self, by: int) -> None:
        """Go ``by`` frames on."""
        last = len(self.motion.motion) - 1
        self.go(float(self.motion.motion[min(max(self.frame + by, 0), last)]))

    def _moment(self, frame: int) -> Moment:
        if frame not in self._moments:
            self._moments[frame] = Moment.of(self.motion, self.scene, frame)
        return self._moments[frame]

    def _controls(self) -> None:
        plotter, moves = self.plotter, len(self.motion.motion) > 1
        keys = "space: play    left, right: step    w: worst moment    q: close" if moves else "q: close"
        plotter.add_text(keys, position=(0.03, 0.02), viewport=True, font_size=9, color=EDGE)
        if not moves:
            return
        self.slider = plotter.add_slider_widget(
            self.go, (0.0, 1.0), value=self.at, title="motion", pointa=(0.6, 0.08), pointb=(0.97, 0.08),
            color=INK, fmt="%.3f", style="modern", slider_width=0.02, tube_width=0.004, title_height=0.02,
            interaction_event="always",
        )  # fmt: skip
        for key, action in (("space", self.toggle), ("w", lambda: self.go(self.worst))):
            plotter.add_key_event(key, action)
        plotter.add_key_event("Left", lambda: self.step(-1))
        plotter.add_key_event("Right", lambda: self.step(1))
        plotter.add_timer_event(max_steps=2**31 - 1, duration=TICK, callback=lambda _: self.tick(1e-3 * TICK))


def _triad(size: float) -> pv.PolyData:
    """Return the arrows of a section frame, d1 red, d2 green, d3 blue, as point data "colour"."""
    pyvista = load_pyvista()
    arrows = [pyvista.Arrow(direction=axis, scale=size) for axis in np.eye(3)]
    for arrow, colour in zip(arrows, ("#d62728", "#2ca02c", "#1f5fd0"), strict=True):
        arrow.point_data["colour"] = np.tile(rgb(colour), (arrow.n_points, 1)).astype(np.uint8)
    return pyvista.merge(arrows)

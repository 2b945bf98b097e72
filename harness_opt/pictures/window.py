"""A window on a result folder: the scene, and a slider to scrub through the motion."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance import along_cable as colouring
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.errors import HarnessError
from harness_opt.files.stored_results import read_motion
from harness_opt.model.results import Motion
from harness_opt.parts.scene import Scene, load_scene
from harness_opt.pictures.camera import Camera
from harness_opt.pictures.drawing import SIZE, light, solid
from harness_opt.pictures.opengl import drawable, has_screen, load_pyvista, quiet
from harness_opt.pictures.scene_view import SceneView
from harness_opt.report.colours import CABLES, EDGE, INK, Key, keys, ramp

if TYPE_CHECKING:
    from harness_opt.numerics.rotations import Array

__all__ = ["Window", "show"]

TICK = 40  # ms between two pictures while the window plays
MODES = ("limits", "clearance", "bend", "twist")  # ways to colour a cable, in the order that "c" goes through
KEYS = "space: play    left, right: step    w: worst moment    c: colours    g: ghosts    f: clamp frames    q: close"


def show(folder: str | os.PathLike[str]) -> None:
    """Open a window on a result folder and return when it is closed; a slider moves along the motion.

    Space plays, the arrow keys step, "w" goes to the worst moment, "c" changes what the cables are coloured by, "g"
    shows the ends of the motion faintly, "f" the frames of the clamps, "q" closes. A redesign is shown beside the
    design given.

    Args:
        folder: of the result.

    Raises:
        HarnessError: the folder holds no result, pyvista is missing, or there is no display; one line.
        ProblemError: its problem file, or a mesh, can't be read any more.
    """
    motion, before, worst = read_motion(folder)
    load_pyvista()
    with quiet():
        visible = not sys.platform.startswith("linux") or has_screen()
    if not visible:
        page = Path(folder) / "report.html"
        instead = f"open {page} in a browser instead" if page.is_file() else "the pictures in the folder need none"
        raise HarnessError(f"found no display to open a window on, expected one ({instead})")
    Window(motion, worst, before=before).plotter.show()


class Window:
    """The scene of a motion that can be moved along it.

    Args:
        motion: what to show; only solved frames are.
        worst: of the motion, 0 to 1, where the key "w" goes.
        before: of the design given, shown beside it.
        scene: the parts; None loads them.
        off_screen: draw without a window, for films and tests.
        size: width and height, pixels.
    """

    def __init__(
        self,
        motion: Motion,
        worst: float,
        *,
        before: Motion | None = None,
        scene: Scene | None = None,
        off_screen: bool = False,
        size: tuple[int, int] = SIZE,
    ):
        """Set the scene and show the worst moment."""
        self.motion, self.worst, self.playing, self.at = motion, worst, False, 0.0
        self.mode, self.ghosts, self.frames = MODES[0], not off_screen, not off_screen
        self.slider: Any = None
        self._keys: dict[str, Key] = {}
        self._film = off_screen
        scene = load_scene(motion.problem) if scene is None else scene
        pyvista = load_pyvista()
        shown = [motion] if before is None else [before, motion]
        title = motion.problem.title or "harness-opt"
        with drawable() if off_screen else nullcontext():
            self.plotter = pyvista.Plotter(
                off_screen=off_screen, window_size=list(size), title=title, lighting="none", shape=(1, len(shown)),
                border=False,
            )  # fmt: skip
        meshes = {name: solid(part) for name, part in scene.parts.items()}
        titles = [title] if before is None else ["Before", "After"]
        self.views = []
        for column, (one, words) in enumerate(zip(shown, titles, strict=True)):
            self.plotter.subplot(0, column)
            self.plotter.set_background("white")
            light(self.plotter)
            self.views.append(SceneView(self.plotter, one, scene, meshes, words, CABLES))
            self.plotter.enable_anti_aliasing("msaa")
        camera = Camera.of(
            [view.drawn(view.nearest(worst)) for view in self.views], meshes, size[0] / len(shown) / size[1]
        )
        for column in range(len(shown)):
            self.plotter.subplot(0, column)
            camera.apply(self.plotter)
        if not off_screen or before is not None:
            self.plotter.link_views()
        self._controls()
        self.go(worst)

    @property
    def frame(self) -> int:
        """The solved frame nearest to where the motion stands."""
        return self.views[-1].nearest(self.at)

    def go(self, at: float) -> None:
        """Show the solved frames nearest to ``at``, 0 to 1."""
        self.at = min(1.0, max(0.0, at))
        for column, view in enumerate(self.views):
            self.plotter.subplot(0, column)
            view.show(view.nearest(self.at), self._colours(view), ghosts=self.ghosts, frames=self.frames)
            self.plotter.reset_camera_clipping_range()
        if self.slider is not None:
            self.slider.GetRepresentation().SetValue(self.at)
        if not self._film:
            self.plotter.render()

    def picture(self) -> Array:
        """Return what is seen (height, width, 3), 0 to 255."""
        self.plotter.render()
        found: Array = self.plotter.screenshot(None, return_img=True)
        return found

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

    def colour_by(self, mode: str) -> None:
        """Colour the cables by "limits", "clearance", "bend" or "twist"."""
        if not self._keys and mode != MODES[0]:
            self._keys = keys([(view.motion, _measured(view)) for view in self.views])
        self.mode = mode
        self.plotter.subplot(0, len(self.views) - 1)
        self.views[-1].show_key(self._keys.get(mode))
        self.go(self.at)

    def _colours(self, view: SceneView) -> Callable[[str, int, Array, Array], Array] | None:
        """Return what gives the colours (n, 3) of points of a cable; None leaves those of the limits."""
        if self.mode == MODES[0]:
            return None
        key, mode = self._keys[self.mode], self.mode

        def colours(name: str, frame: int, s: Array, points: Array) -> Array:
            shapes = view.motion.cables[name]
            darboux = shapes.curvature[frame]
            if mode == "bend":
                return ramp(np.interp(s, shapes.s, np.linalg.norm(darboux[:, :2], axis=-1)) / key.most)
            if mode == "twist":
                return ramp(np.interp(s, shapes.s, np.degrees(np.abs(darboux[:, 2]))) / key.most)
            pairs = view.drawn(frame).still.pairs
            several = colouring.Points(name, np.array([frame]), s, points[None])
            nearest = colouring.states(view.motion, view.scene, pairs, several, key.most)[0][0]
            return ramp(1.0 - np.minimum(nearest, key.most) / key.most)

        return colours

    def _controls(self) -> None:
        plotter, moves = self.plotter, len(self.motion.motion) > 1
        if self._film:
            return
        plotter.subplot(0, 0)
        plotter.add_text(KEYS if moves else "q: close", position=(0.03, 0.02), viewport=True, font_size=8, color=EDGE)
        actions: dict[str, Callable[[], None]] = {
            "c": lambda: self.colour_by(MODES[(MODES.index(self.mode) + 1) % len(MODES)]),
            "g": lambda: self._switch("ghosts"),
            "f": lambda: self._switch("frames"),
        }
        if moves:
            plotter.subplot(0, len(self.views) - 1)
            self.slider = plotter.add_slider_widget(
                self.go, (0.0, 1.0), value=self.at, title="motion", pointa=(0.6, 0.09), pointb=(0.97, 0.09),
                color=INK, fmt="%.3f", style="modern", slider_width=0.02, tube_width=0.004, title_height=0.02,
                interaction_event="always",
            )  # fmt: skip
            actions |= {
                "space": self.toggle,
                "w": lambda: self.go(self.worst),
                "Left": lambda: self.step(-1),
                "Right": lambda: self.step(1),
            }
            plotter.add_timer_event(max_steps=2**31 - 1, duration=TICK, callback=lambda _: self.tick(1e-3 * TICK))
        for key, action in actions.items():
            plotter.add_key_event(key, action)

    def _switch(self, name: str) -> None:
        """Show what was hidden, or hide it."""
        setattr(self, name, not getattr(self, name))
        self.go(self.at)


def _measured(view: SceneView) -> ClearanceResult:
    """Return the clearances of a whole motion."""
    return measure(view.motion.problem, view.scene, view.motion.motion, view.motion.cables)

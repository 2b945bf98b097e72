"""Pictures of a result: stills for a report. The window to scrub through the motion stands in ``window.py``."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance.limits import all_limits, most_urgent
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.model.limits import LimitKind
from harness_opt.model.results import LimitResult, Motion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene, load_scene
from harness_opt.pictures.camera import TANGENT, TITLE_ROOM, Camera
from harness_opt.pictures.drawing import (
    SIZE,
    TUBE,
    DrawnFrame,
    add_cable,
    add_solid,
    cable_colours,
    clamped,
    curve_of,
    light,
    look,
    placement,
    pose_at,
    solid,
    tube,
)
from harness_opt.pictures.opengl import drawable, load_pyvista
from harness_opt.pictures.window import show
from harness_opt.report.colours import CABLES, EDGE, INK, MOVING_PART, SHORT, SLEEVE, TOUCHES, rgb

if TYPE_CHECKING:
    import pyvista as pv

    from harness_opt.design.result import Redesign

__all__ = ["View", "show", "still", "worst_view", "write_pictures"]

GHOSTS = (0.0, 1 / 3, 2 / 3, 1.0)  # moments of the motion that are drawn faintly
GHOST_GAP = 0.1  # of the motion, within which a ghost would hide in the moment shown
RING = 2.6  # radii of the cable, of the ring around the worst
LEAST_RING = 16  # pixels
LETTER = 1.0  # mean width of a letter in pixels, for each point of its size
KEY_ROOM = 0.09  # share of the picture's height kept free for the keys below
PADDING = 9  # pixels around the words at the worst
CHANGES_NAMED = 2  # design variables in a title


@dataclass(frozen=True, eq=False)
class View:
    """One picture: a moment, the limit to point at in it, and what is written above."""

    shown: DrawnFrame
    row: LimitResult
    title: str

    @property
    def violated(self) -> bool:
        """Whether the limit is."""
        return self.row.margin < 0

    @property
    def witness(self) -> tuple[Array, Array]:
        """Where the worst stands: points (3,) on the cable and on the obstacle, world, m."""
        row = self.row
        for pair in self.shown.still.pairs:
            if pair.id == row.id:
                point = pair.nearest.point[0]
                return point + pair.worst * pair.nearest.normal[0], point
        curve = curve_of(self.shown.motion.cables[row.cable])
        on_axis = curve.at(np.array([row.frame]), np.array([row.arc_length]))[0]
        return on_axis, on_axis


def worst_view(
    motion: Motion, scene: Scene, rows: Sequence[LimitResult], title: str, palette: tuple[str, ...] = CABLES
) -> View:
    """Return the view of the row of ``rows`` that people look at first.

    Without rows of what is anywhere near, the smallest clearance to a part, or else the smallest bend radius.
    """
    near = [row for row in rows if math.isfinite(row.worst)] or _rows_of_zero(motion, scene)
    row = most_urgent(motion.problem, near)
    return View(DrawnFrame.of(motion, scene, row.frame, palette), row, title)


def _rows_of_zero(motion: Motion, scene: Scene) -> tuple[LimitResult, ...]:
    """Return the rows that limits of 0 would have: of the clearances to parts, and of the bend radius."""
    found = measure(motion.problem, scene, motion.motion, motion.cables)
    touching = replace(found, pairs=tuple(replace(pair, limit=0.0) for pair in found.pairs))
    problem = motion.problem.changed(limits=replace(motion.problem.limits, bend_radius=0.0))
    return all_limits(problem, motion, touching)


def still_names(result: Motion | Redesign) -> list[str]:
    """Return the names of the pictures that :func:`write_pictures` draws of ``result``."""
    motion = result if isinstance(result, Motion) else result.motion
    if not len(motion.motion):
        return []  # nothing was solved, so there is nothing to see
    return ["worst.png"] if isinstance(result, Motion) else ["worst.png", "before_after.png"]


def write_pictures(
    result: Motion | Redesign,
    folder: str | os.PathLike[str],
    clearances: ClearanceResult | None = None,
    drawn: Callable[[], None] = lambda: None,
) -> list[str]:
    """Write the pictures of a result as PNG files of 1600 x 900 pixels, and return their names.

    Args:
        result: a motion (``worst.png``), or a redesign (that of the new design, and ``before_after.png``).
        folder: made where it is missing.
        clearances: of the motion; None measures them here. A redesign brings its own.
        drawn: called after each.

    Raises:
        HarnessError: pyvista or OpenGL is missing; one line with the remedy.
        ProblemError: a mesh that cannot be read.
    """
    motion = result if isinstance(result, Motion) else result.motion
    if not still_names(result):
        return []
    scene = load_scene(motion.problem)
    if isinstance(result, Motion):
        if clearances is None:
            clearances = measure(motion.problem, scene, motion.motion, motion.cables)
        title = motion.problem.title or "Worst moment"
        rows = all_limits(motion.problem, motion, clearances)
        views = [worst_view(motion, scene, rows, title)]
        asked = {"worst.png": views}
    else:
        changed = _changes(result)
        views = [
            worst_view(result.motion_before, scene, result.limits_before or (), "Before"),
            worst_view(motion, scene, result.limits, f"After: {changed}"),
        ]
        asked = {"worst.png": [replace(views[1], title=f"Redesigned: {changed}")], "before_after.png": views}
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, shown in asked.items():
        plotter = still(shown, alike=views)
        try:
            plotter.screenshot(folder / name)
            drawn()
        finally:
            plotter.close()
    return list(asked)


def still(views: Sequence[View], alike: Sequence[View] = ()) -> pv.Plotter:
    """Return the off-screen plotter of one view, or of two side by side under one camera.

    Its actors are named ``part:NAME``, ``cable:NAME`` and, for what is drawn faintly, ``ghost ...``.

    Args:
        views: what to draw, from left to right; all have the same parts.
        alike: views whose motions choose the camera; none takes ``views``.

    Raises:
        HarnessError: pyvista or OpenGL is missing.
    """
    pyvista = load_pyvista()
    with drawable():
        plotter = pyvista.Plotter(
            off_screen=True, window_size=list(SIZE), shape=(1, len(views)), border=False, lighting="none"
        )
    meshes = {name: solid(part) for name, part in views[0].shown.scene.parts.items()}
    camera = Camera.of([view.shown for view in alike or views], meshes, SIZE[0] / len(views) / SIZE[1])
    for column, view in enumerate(views):
        plotter.subplot(0, column)
        plotter.set_background("white")
        _draw_ghosts(plotter, view.shown, meshes)
        _draw_frame(plotter, view.shown, meshes)
        light(plotter)
        camera.apply(plotter)
        plotter.enable_anti_aliasing("ssaa")
    occupied = np.any(plotter.screenshot(None, return_img=True) < 250, axis=-1)
    for column, mask in enumerate(np.split(occupied, len(views), axis=1)):
        plotter.subplot(0, column)
        _point_at_worst(plotter, views[column], camera, mask)
        _write_words(plotter, views[column])
        plotter.reset_camera_clipping_range()  # what is drawn in front must not be cut off
    plotter.render()
    found: pv.Plotter = plotter
    return found


def _draw_frame(plotter: pv.Plotter, shown: DrawnFrame, meshes: Mapping[str, pv.PolyData]) -> None:
    """Draw the parts and cables of ``shown`` as they are, and a sleeve around each clamped end."""
    problem = shown.motion.problem
    for name, part in shown.scene.parts.items():
        placed = meshes[name].transform(placement(*shown.pose(part.body)), inplace=False)
        add_solid(plotter, f"part:{name}", placed, *look(shown, part))
    for name, shapes in shown.motion.cables.items():
        add_cable(plotter, shown, name).prop.interpolation = "phong"
        radius = problem.cables[name].cable.radius
        for end, station in clamped(problem.cables[name], shapes).items():
            inward = rotations.tangent(shapes.quaternion[shown.frame, station]) * (-1 if end == "end" else 1)
            place = shapes.position[shown.frame, station]
            sleeve = tube(np.array([place - 0.4 * radius * inward, place + 2.2 * radius * inward]), None, 1.5 * radius)
            plotter.add_mesh(sleeve, name=f"clamp:{name}:{end}", color=SLEEVE, **TUBE)


def _draw_ghosts(plotter: pv.Plotter, shown: DrawnFrame, meshes: Mapping[str, pv.PolyData]) -> None:
    """Draw the moving parts and the cables faintly at other moments of the motion."""
    motion, problem = shown.motion, shown.motion.problem
    for frame in {int(np.argmin(np.abs(motion.motion - at))) for at in GHOSTS}:
        if abs(motion.motion[frame] - motion.motion[shown.frame]) < GHOST_GAP:
            continue
        for name, part in shown.scene.parts.items():
            if problem.is_moved(part.body):
                placed = meshes[name].transform(placement(*pose_at(motion, frame, part.body)), inplace=False)
                add_solid(plotter, f"ghost part:{name}:{frame}", placed, 0.13, MOVING_PART)
        for name, shapes in motion.cables.items():
            faint = tube(shapes.line.position[frame], None, problem.cables[name].cable.radius)
            name_there = f"ghost cable:{name}:{frame}"
            plotter.add_mesh(faint, name=name_there, color=shown.colours[name], opacity=0.22, render=False)


def _point_at_worst(plotter: pv.Plotter, view: View, camera: Camera, occupied: Array) -> None:
    """Mark the witness with a ring and a line between its points, and write its value beside it.

    Args:
        occupied: (h, w), True where the picture is not white; the words go where it is.
    """
    pyvista = load_pyvista()
    on_cable, on_obstacle = view.witness
    middle = 0.5 * (on_cable + on_obstacle)
    style: dict[str, Any] = {"color": TOUCHES if view.violated else INK, "lighting": False, "render": False}
    pixel = camera.distance * 2 * TANGENT / SIZE[1]  # m
    size = max(RING * view.shown.motion.problem.cables[view.row.cable].cable.radius, LEAST_RING * pixel)
    ring = pyvista.Disc(center=middle, inner=size, outer=size + 4.5 * pixel, normal=camera.back, c_res=64)
    plotter.add_mesh(camera.in_front(ring), name="marker", **style)
    if np.linalg.norm(on_cable - on_obstacle) > 0:
        line = camera.in_front(pyvista.Line(on_obstacle, on_cable))
        plotter.add_mesh(line, name="witness", line_width=8, **style)
    pixels = np.array(occupied.shape[::-1])
    at, words = camera.project(middle[None])[0], _value_words(view.row)
    corner, box = _free_place(at, words, occupied)
    end = np.clip(at, corner, corner + box)
    start = at + (end - at) * min(1.0, size / pixel / max(1e-9, float(np.linalg.norm((end - at) * pixels))))
    leader = pyvista.Line(camera.unproject(start, middle), camera.unproject(end, middle))
    plotter.add_mesh(camera.in_front(leader), name="leader", line_width=4, **style)
    _write(plotter, words, tuple(corner + PADDING / pixels), 13, style["color"]).prop.bold = True


def _free_place(at: Array, words: str, occupied: Array) -> tuple[Array, Array]:
    """Return lower left corner (2,) and size (2,) of the emptiest box for ``words`` near ``at`` (2,)."""
    height, width = occupied.shape
    box = np.array([13 * LETTER * len(words) + 2 * PADDING, 40]) / (width, height)
    best, corner = math.inf, np.full(2, 0.05)
    for reach in (0.12, 0.18, 0.26, 0.36):
        for angle in np.arange(16) * math.tau / 16:
            way = np.array([math.cos(angle) * height / width, math.sin(angle)])
            low = at + reach * way + np.where(way < -0.1, -box, np.where(way > 0.1, 0.0, -0.5 * box))
            if np.any(low < (0.02, KEY_ROOM)) or low[0] + box[0] > 0.98 or low[1] + box[1] > 1 - TITLE_ROOM:
                continue
            columns = slice(int(low[0] * width), int((low[0] + box[0]) * width))
            rows = slice(int((1 - low[1] - box[1]) * height), int((1 - low[1]) * height))
            cost = 3.0 * float(np.mean(occupied[rows, columns])) + reach
            if cost < best:
                best, corner = cost, low
    return corner, box


def _write_words(plotter: pv.Plotter, view: View) -> None:
    """Write what is seen above the picture, and what its colours mean below it."""
    row, shown, moves = view.row, view.shown, view.shown.motion.problem.moves
    words = [f"{row.cable}: {_value_words(row)}"]
    if row.limit:
        answer = {"no": "violated", "yes": "held", "uncertain": "not certain"}[row.holds]
        words.append(f"limit {_quantity(row.id.kind, row.limit)} {answer}")
    if moves:
        words.append(f"at {shown.motion.problem.moments.words(row.motion)}")
    _write(plotter, view.title, (0.03, 0.935), 17, INK).prop.bold = True
    _write(plotter, ", ".join(words), (0.03, 0.892), 12, TOUCHES if view.violated else INK)
    used = {tuple(colour) for name in shown.colours for colour in cable_colours(shown, name)[1]}
    states = {"touches": TOUCHES, "breaks a limit": SHORT}
    keys = shown.colours | {word: key for word, key in states.items() if tuple(rgb(key)) in used}
    x = 0.03
    for word, key in (keys | ({"faint: at other moments": EDGE} if moves else {})).items():
        _write(plotter, word, (x, 0.03), 11, key).prop.bold = word in keys
        x += (11 * LETTER * len(word) + 35) / _width(plotter)


def _write(plotter: pv.Plotter, words: str, at: tuple[float, ...], size: int, colour: str) -> Any:
    """Write ``words`` with their lower left corner ``at``, 0 to 1 in the active view, and return the actor.

    They are written smaller than ``size`` where they would run out of the view.
    """
    fitting = int((0.99 - at[0]) * _width(plotter) / (LETTER * max(1, len(words))))
    size = max(6, min(size, fitting))
    text = plotter.add_text(words, position=at, viewport=True, font_size=size, color=colour, render=False)
    text.prop.background_color, text.prop.background_opacity = "white", 0.75
    return text


def _width(plotter: pv.Plotter) -> int:
    """Return the width of the active view, pixels."""
    return SIZE[0] // len(plotter.renderers)


def _changes(design: Redesign) -> str:
    """Return what a redesign changed, the largest share of its range first."""

    def share(name: str) -> float:
        variable = design.variables[name]
        return abs(variable.after - variable.before) / (variable.upper - variable.lower)

    moved = sorted((n for n, v in design.variables.items() if v.after != v.before), key=share, reverse=True)
    words = []
    for name in moved[:CHANGES_NAMED]:
        unit, factor = ("deg", 1.0) if name.endswith("_deg") else ("mm", 1e3)
        before, after = (factor * getattr(design.variables[name], when) for when in ("before", "after"))
        words.append(f"{name.removesuffix('_deg')} {before:.1f} to {after:.1f} {unit}")
    more = f" and {len(moved) - CHANGES_NAMED} more" if len(moved) > CHANGES_NAMED else ""
    return ", ".join(words) + more or "nothing changed"


def _quantity(kind: LimitKind, value: float) -> str:
    """Return an SI value of a limit in the unit shown, to as many digits as a picture has room for."""
    shown = value * kind.from_si * kind.unit.factor
    return f"{shown:.{min(kind.unit.digits, 1)}f} {kind.unit.name}"


def _value_words(row: LimitResult) -> str:
    kind, obstacle = row.id.kind, row.id.obstacle
    if obstacle is None:
        return f"{kind.words} {_quantity(kind, row.worst)}"
    return f"{_quantity(kind, abs(row.worst))} {'deep in' if row.worst < 0 else 'to'} {obstacle.words(row.cable)}"

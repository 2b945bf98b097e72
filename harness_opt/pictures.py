"""Pictures of a result: stills for a report, and a window to scrub through the motion.

pyvista, and VTK with it, is imported inside the functions: it costs a second. No theme is changed: every
colour and every size is given where it is used.

Where no screen is to be had, VTK 9.7 tries X11, EGL and OSMesa in turn, and takes the whole process down with
a segmentation fault where it finds none, or no libX11 or libXcursor. So :func:`_off_screen_window` looks for
them first and tells VTK which to take.
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import rotations
from .clearance import ClearanceResult, Curve, PairClearance, measure
from .errors import HarnessError
from .limits import cable_limits
from .problem import Box, Capsule, Cylinder
from .problem_file import read_problem
from .results import CableMotion, LimitResult, Motion
from .rotations import Array
from .scene import Geometry, Mesh, Primitive, Scene, load_scene

if TYPE_CHECKING:
    import pyvista as pv

    from .outer_loop import Redesign

SIZE = (1600, 900)  # pixels: a slide of 16 : 9
VIEW_ANGLE = 18.0  # degrees; a long lens, so that sizes compare across the picture
ELEVATION = 20.0  # degrees above the plane of view, so that depth shows
ASIDE = 16.0  # degrees off the normal of the plane of motion, for the same
MARGIN = 0.07  # share of the picture left free on each side
TITLE_ROOM = 0.10  # share of its height kept free for the words above
NEAR, NEXT = 1.0, 0.15  # extents of the cables: parts that reach up to here are shown whole, others so far
GHOSTS = (0.0, 1 / 3, 2 / 3, 1.0)  # moments of the motion that are drawn faintly
GHOST_GAP = 0.1  # of the motion, within which a ghost would hide in the moment shown
TICK = 40  # ms between two pictures while the window plays

SIDES = 24  # of a tube
POINTS = 241  # along a drawn cable, so that colours change where they should
FEATURE_ANGLE = 30.0  # degrees between faces from which an edge is drawn
RING = 2.6  # radii of the cable, of the ring around the worst
LEAST_RING = 16  # pixels
LETTER = 1.0  # mean width of a letter in pixels, for each point of its size
PADDING = 9  # pixels around the words at the worst
CHANGES_NAMED = 2  # design variables in a title

TOUCHES, SHORT = "#e0141e", "#f28e1c"
CABLES = ("#1f6fb4", "#2a9d5c", "#8a4fbf", "#0e8f9c", "#6b4e2e", "#5b6770")  # far from the two of trouble
AFTER = ("#1a9850", "#1f6fb4", "#0e8f9c", "#8a4fbf", "#5b6770", "#6b4e2e")  # the cables of a redesign
STILL_PART, MOVING_PART, HIT_PART = "#c9cdd2", "#a9b4c2", "#f0a8a4"
SLEEVE, EDGE, INK = "#4a525b", "#3c434b", "#1e2328"
TUBE: dict[str, Any] = {"ambient": 0.12, "specular": 0.25, "render": False}

ENDS = {"start": 0, "end": -1}  # of a cable, and their stations
KEPT = ("s", "position", "quaternion", "curvature", "force", "moment")  # of a cable, in every motion.npz
WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
REMEDY = "install it (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri), or use --no-pictures"


@dataclass(frozen=True, eq=False)
class Moment:
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
    def of(motion: Motion, scene: Scene, frame: int, palette: tuple[str, ...] = CABLES) -> Moment:
        """Return a frame of ``motion``, its clearances measured."""
        only = slice(frame, frame + 1)
        cables = {
            name: CableMotion(shapes.s, *(value[only] for key, value in vars(shapes).items() if key != "s"))
            for name, shapes in motion.cables.items()
        }
        return Moment(motion, scene, frame, measure(motion.problem, scene, motion.motion[only], cables), palette)

    @property
    def colours(self) -> dict[str, str]:
        """The colour of each cable, by name."""
        return {name: self.palette[i % len(self.palette)] for i, name in enumerate(self.motion.cables)}

    @property
    def touched(self) -> set[str]:
        """Names of the parts that a cable runs into."""
        return {pair.obstacle for pair in self.still.pairs if pair.worst < 0 and pair.obstacle in self.scene.parts}

    def pose(self, body: str) -> tuple[Array, Array]:
        """Return the position (3,) and quaternion (4,) of ``body``."""
        position, quaternion = self.motion.problem.body(body).poses(self.motion.motion[self.frame])
        return position[0], quaternion[0]


@dataclass(frozen=True, eq=False)
class View:
    """One picture: a moment, the limit to point at in it, and what is written above."""

    moment: Moment
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
        for pair in self.moment.still.pairs:
            if row.name == "clearance" and (pair.cable, pair.obstacle) == (row.cable, row.part):
                point = pair.nearest.point[0]
                return point + pair.worst * pair.nearest.normal[0], point
        curve = _curve(self.moment.motion.cables[row.cable])
        on_axis = curve.at(np.array([row.frame]), np.array([row.arc_length]))[0]
        return on_axis, on_axis


def worst_view(
    motion: Motion, scene: Scene, rows: Sequence[LimitResult], title: str, palette: tuple[str, ...] = CABLES
) -> View:
    """Return the view of the row of ``rows`` that people look at first.

    A violated limit comes before one that holds, clearance before bend radius before the rest, and then the
    smallest margin. Without rows, the smallest clearance to a part, or else the smallest bend radius.
    """
    order = {"clearance": 0, "bend_radius": 1}

    def urgency(row: LimitResult) -> tuple[bool, int, float]:
        scale = row.limit + motion.problem.cables[row.cable].cable.radius
        return row.margin >= 0, order.get(row.name, 2), row.margin / scale

    row = min(rows or _rows_of_zero(motion, scene), key=urgency)
    return View(Moment.of(motion, scene, row.frame, palette), row, title)


def _rows_of_zero(motion: Motion, scene: Scene) -> tuple[LimitResult, ...]:
    """Return the rows that limits of 0 would have: of the clearances to parts, and of the bend radius."""
    found = measure(motion.problem, scene, motion.motion, motion.cables)
    touching = replace(found, pairs=tuple(replace(pair, limit=0.0) for pair in found.pairs))
    problem = replace(motion.problem, limits=replace(motion.problem.limits, bend_radius=0.0))
    return (*touching.limits, *cable_limits(problem, motion))


# --- stills ---------------------------------------------------------------------------------------------


def write_pictures(
    result: Motion | Redesign, folder: str | os.PathLike[str], clearances: ClearanceResult | None = None
) -> list[str]:
    """Write the pictures of a result as PNG files of 1600 x 900 pixels, and return their names.

    Args:
        result: a motion (``worst.png``), or a redesign (that of the new design, and ``before_after.png``).
        folder: made where it is missing.
        clearances: of the motion; None measures them here. A redesign brings its own.

    Raises:
        HarnessError: pyvista or OpenGL is missing; one line with the remedy.
        ProblemError: a mesh that cannot be read.
    """
    motion = result if isinstance(result, Motion) else result.motion
    if not len(motion.motion):
        return []  # nothing was solved, so there is nothing to see
    scene = load_scene(motion.problem)
    if isinstance(result, Motion):
        if clearances is None:
            clearances = measure(motion.problem, scene, motion.motion, motion.cables)
        title = motion.problem.title or "Worst moment"
        rows = (*clearances.limits, *cable_limits(motion.problem, motion))
        views = [worst_view(motion, scene, rows, title)]
        drawn = {"worst.png": views}
    else:
        changed = _changes(result)
        views = [
            worst_view(result.motion_before, scene, result.limits_before, "Before"),
            worst_view(motion, scene, result.limits, f"After: {changed}", AFTER),
        ]
        drawn = {"worst.png": [replace(views[1], title=f"Redesigned: {changed}")], "before_after.png": views}
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, shown in drawn.items():
        plotter = still(shown, alike=views)
        try:
            plotter.screenshot(folder / name)
        finally:
            plotter.close()
    return list(drawn)


def still(views: Sequence[View], alike: Sequence[View] = ()) -> pv.Plotter:
    """Return the off-screen plotter of one view, or of two side by side under one camera.

    Its actors are named ``part:NAME``, ``cable:NAME`` and, for what is drawn faintly, ``ghost ...``.

    Args:
        views: what to draw, from left to right; all have the same parts.
        alike: views whose motions choose the camera; none takes ``views``.

    Raises:
        HarnessError: pyvista or OpenGL is missing.
    """
    pyvista = _pyvista()
    with _drawable():
        plotter = pyvista.Plotter(
            off_screen=True, window_size=list(SIZE), shape=(1, len(views)), border=False, lighting="none"
        )
    meshes = {name: solid(part) for name, part in views[0].moment.scene.parts.items()}
    camera = Camera.of([view.moment for view in alike or views], meshes, SIZE[0] / len(views) / SIZE[1])
    for column, view in enumerate(views):
        plotter.subplot(0, column)
        plotter.set_background("white")
        _draw_ghosts(plotter, view.moment, meshes)
        _draw_moment(plotter, view.moment, meshes)
        _light(plotter)
        camera.apply(plotter)
        plotter.enable_anti_aliasing("ssaa")
    occupied = np.any(plotter.screenshot(None, return_img=True) < 250, axis=-1)
    for column, mask in enumerate(np.split(occupied, len(views), axis=1)):
        plotter.subplot(0, column)
        _point_at_worst(plotter, views[column], camera, mask)
        _write_words(plotter, views[column])
        plotter.reset_camera_clipping_range()  # what is drawn in front must not be cut off
    plotter.render()
    return plotter


def _draw_moment(plotter: pv.Plotter, moment: Moment, meshes: Mapping[str, pv.PolyData]) -> None:
    """Draw the parts and cables of ``moment`` as they are, and a sleeve around each clamped end."""
    problem = moment.motion.problem
    for name, part in moment.scene.parts.items():
        placed = meshes[name].transform(_matrix(*moment.pose(part.body)), inplace=False)
        _add_solid(plotter, f"part:{name}", placed, *_look(moment, part))
    for name, shapes in moment.motion.cables.items():
        radius = problem.cables[name].cable.radius
        tube = _tube(*cable_colours(moment, name), radius)
        actor = plotter.add_mesh(tube, name=f"cable:{name}", scalars="colour", rgb=True, **TUBE)
        actor.prop.interpolation = "phong"
        for end, station in ENDS.items():
            inward = rotations.tangent(shapes.quaternion[moment.frame, station]) * (1 if station == 0 else -1)
            place = shapes.position[moment.frame, station]
            sleeve = _tube(np.array([place - 0.4 * radius * inward, place + 2.2 * radius * inward]), None, 1.5 * radius)
            plotter.add_mesh(sleeve, name=f"clamp:{name}:{end}", color=SLEEVE, **TUBE)


def _draw_ghosts(plotter: pv.Plotter, moment: Moment, meshes: Mapping[str, pv.PolyData]) -> None:
    """Draw the moving parts and the cables faintly at other moments of the motion."""
    motion, problem = moment.motion, moment.motion.problem
    for frame in {int(np.argmin(np.abs(motion.motion - at))) for at in GHOSTS}:
        if abs(motion.motion[frame] - motion.motion[moment.frame]) < GHOST_GAP:
            continue
        ghost = replace(moment, frame=frame)
        for name, part in moment.scene.parts.items():
            if problem.body(part.body).motion is not None:
                placed = meshes[name].transform(_matrix(*ghost.pose(part.body)), inplace=False)
                _add_solid(plotter, f"ghost part:{name}:{frame}", placed, 0.13, MOVING_PART)
        for name, shapes in motion.cables.items():
            tube = _tube(shapes.position[frame], None, problem.cables[name].cable.radius)
            name_there = f"ghost cable:{name}:{frame}"
            plotter.add_mesh(tube, name=name_there, color=moment.colours[name], opacity=0.22, render=False)


def _look(moment: Moment, part: Geometry) -> tuple[float, str]:
    """Return the opacity and the colour of a part; what a cable runs into is glass, to see it inside."""
    if part.name in moment.touched:
        return 0.42, HIT_PART
    return 1.0, STILL_PART if moment.motion.problem.body(part.body).motion is None else MOVING_PART


def _add_solid(plotter: pv.Plotter, name: str, mesh: pv.PolyData, opacity: float, colour: str) -> None:
    """Draw a solid with smooth faces and its sharp edges."""
    actor = plotter.add_mesh(mesh, name=name, color=colour, opacity=opacity, ambient=0.15, specular=0.1, render=False)
    actor.prop.interpolation = "phong"
    edges = mesh.extract_feature_edges(FEATURE_ANGLE, manifold_edges=False, non_manifold_edges=False)
    if edges.n_cells:
        faint = min(1.0, 2.5 * opacity)
        plotter.add_mesh(
            edges,
            name=f"edges of {name}",
            color=EDGE,
            line_width=2,
            opacity=faint,
            lighting=False,
            render=False,
        )


def cable_colours(moment: Moment, name: str) -> tuple[Array, Array]:
    """Return points (n, 3) along a cable, m, world, and their colours (n, 3), 0 to 255.

    Red where it touches something, orange where a clearance or the bend radius is below its limit.
    """
    problem, shapes, frame = moment.motion.problem, moment.motion.cables[name], moment.frame
    s = np.linspace(0.0, shapes.s[-1], POINTS)
    points = _curve(shapes).at(np.full(len(s), frame), s)
    curvature = np.interp(s, shapes.s, np.linalg.norm(shapes.curvature[frame, :, :2], axis=-1))
    touches, short = np.zeros(len(s), dtype=bool), curvature * (problem.limits.bend_radius or 0.0) > 1.0
    for pair in moment.still.pairs:
        if name != pair.cable and pair.obstacle != f"cable:{name}":
            continue
        clearance = _clearance_along(moment, pair, name, s, points)
        counts = (s >= pair.excluded[0]) & (s <= s[-1] - pair.excluded[1])
        touches |= counts & (clearance < 0)
        short |= counts & (clearance < (pair.limit or 0.0))
    colours = np.tile(_rgb(moment.colours[name]), (len(s), 1))
    colours[short] = _rgb(SHORT)
    colours[touches] = _rgb(TOUCHES)
    return points, colours


def _clearance_along(moment: Moment, pair: PairClearance, name: str, s: Array, points: Array) -> Array:
    """Return the clearances (n,) in ``pair`` of the points (n, 3) of its cable ``name`` at ``s`` (n,), m."""
    problem, frame = moment.motion.problem, moment.frame
    own = problem.cables[name].cable
    if pair.obstacle in moment.scene.parts:
        part = moment.scene.parts[pair.obstacle]
        position, q = moment.pose(part.body)
        local = rotations.rotate(rotations.conjugate(q), points - position)
        return part.signed_distance(local)[0] - own.radius
    other = pair.obstacle.removeprefix("cable:") if pair.cable == name else pair.cable
    shapes = moment.motion.cables[other]
    apart = np.linalg.norm(points[:, None] - shapes.position[frame], axis=-1)
    if other == name:  # what is near along the cable is near, as `clearance.measure` says
        gap = 0.5 * math.pi * (own.diameter + (problem.limits.clearance or 0.0))
        apart = np.where(np.abs(s[:, None] - shapes.s) < gap, np.inf, apart)
    return apart.min(axis=1) - own.radius - problem.cables[other].cable.radius


def _point_at_worst(plotter: pv.Plotter, view: View, camera: Camera, occupied: Array) -> None:
    """Mark the witness with a ring and a line between its points, and write its value beside it.

    Args:
        occupied: (h, w), True where the picture is not white; the words go where it is.
    """
    pyvista = _pyvista()
    on_cable, on_obstacle = view.witness
    middle = 0.5 * (on_cable + on_obstacle)
    style: dict[str, Any] = {"color": TOUCHES if view.violated else INK, "lighting": False, "render": False}
    pixel = camera.distance * 2 * camera.tangent / SIZE[1]  # m
    size = max(RING * view.moment.motion.problem.cables[view.row.cable].cable.radius, LEAST_RING * pixel)
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
            if np.any(low < 0.02) or low[0] + box[0] > 0.98 or low[1] + box[1] > 1 - TITLE_ROOM:
                continue
            columns = slice(int(low[0] * width), int((low[0] + box[0]) * width))
            rows = slice(int((1 - low[1] - box[1]) * height), int((1 - low[1]) * height))
            cost = 3.0 * float(np.mean(occupied[rows, columns])) + reach
            if cost < best:
                best, corner = cost, low
    return corner, box


def _write_words(plotter: pv.Plotter, view: View) -> None:
    """Write what is seen above the picture, and what its colours mean below it."""
    row, moment, moves = view.row, view.moment, view.moment.motion.problem.moves
    words = [f"{row.cable}: {_value_words(row)}"]
    if row.limit:
        words.append(f"limit {_quantity(row.name, row.limit)} {'violated' if view.violated else 'held'}")
    if moves:
        words.append(f"at {100 * row.motion:.0f} % of the motion")
    _write(plotter, view.title, (0.03, 0.935), 17, INK).prop.bold = True
    _write(plotter, ", ".join(words), (0.03, 0.892), 12, TOUCHES if view.violated else INK)
    used = {tuple(colour) for name in moment.colours for colour in cable_colours(moment, name)[1]}
    states = {"touches": TOUCHES, "below a limit": SHORT}
    keys = moment.colours | {word: key for word, key in states.items() if tuple(_rgb(key)) in used}
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


# --- window ---------------------------------------------------------------------------------------------


def show(folder: str | os.PathLike[str]) -> None:
    """Open a window on a result folder and return when it is closed; a slider moves along the motion.

    Space plays, the arrow keys step, "w" goes to the worst moment, "q" closes.

    Raises:
        HarnessError: the folder holds no result, pyvista is missing, or there is no display; one line.
        ProblemError: its problem file, or a mesh, can't be read any more.
    """
    motion, worst = read_motion(folder)
    _pyvista()
    with _quiet():
        visible = not sys.platform.startswith("linux") or _screen()
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
        pyvista = _pyvista()
        title = motion.problem.title or "harness-opt"
        with _drawable() if off_screen else nullcontext():
            self.plotter = pyvista.Plotter(off_screen=off_screen, window_size=list(SIZE), title=title, lighting="none")
        self.plotter.set_background("white")
        _light(self.plotter)
        meshes = {name: solid(part) for name, part in self.scene.parts.items()}
        for name, part in self.scene.parts.items():
            _add_solid(self.plotter, f"part:{name}", meshes[name], *_look(self._moment(0), part))
        for name in motion.cables:
            size = 5.0 * motion.problem.cables[name].cable.diameter
            for end in ENDS:
                actor = self.plotter.add_mesh(_triad(size), name=f"clamp:{name}:{end}", scalars="colour", rgb=True)
                actor.prop.lighting = False
        Camera.of([self._moment(0)], meshes, SIZE[0] / SIZE[1]).apply(self.plotter)
        self.plotter.enable_anti_aliasing("msaa")
        self._controls()
        self.go(worst)

    def go(self, at: float) -> None:
        """Show the solved frame nearest to ``at``, 0 to 1."""
        self.at = min(1.0, max(0.0, at))
        frame = int(np.argmin(np.abs(self.motion.motion - self.at)))
        moment, actors = self._moment(frame), self.plotter.actors
        for name, part in self.scene.parts.items():
            for key in {f"part:{name}", f"edges of part:{name}"} & set(actors):
                actors[key].user_matrix = _matrix(*moment.pose(part.body))
            actors[f"part:{name}"].prop.opacity, actors[f"part:{name}"].prop.color = _look(moment, part)
        for name, shapes in self.motion.cables.items():
            tube = _tube(*cable_colours(moment, name), self.motion.problem.cables[name].cable.radius)
            self.plotter.add_mesh(tube, name=f"cable:{name}", scalars="colour", rgb=True, reset_camera=False, **TUBE)
            for end, station in ENDS.items():
                pose = _matrix(shapes.position[frame, station], shapes.quaternion[frame, station])
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
        frame = int(np.argmin(np.abs(self.motion.motion - self.at))) + by
        self.go(float(self.motion.motion[min(max(frame, 0), len(self.motion.motion) - 1)]))

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
    pyvista = _pyvista()
    arrows = [pyvista.Arrow(direction=axis, scale=size) for axis in np.eye(3)]
    for arrow, colour in zip(arrows, ("#d62728", "#2ca02c", "#1f5fd0"), strict=True):
        arrow.point_data["colour"] = np.tile(_rgb(colour), (arrow.n_points, 1)).astype(np.uint8)
    return pyvista.merge(arrows)


# --- camera ---------------------------------------------------------------------------------------------


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
        tangent = math.tan(math.radians(VIEW_ANGLE / 2))
        wide, high = tangent * aspect * (1 - 2 * MARGIN), tangent * (1 - 2 * MARGIN - TITLE_ROOM)
        flat = seen @ np.column_stack([right, up, back])
        middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
        x, y, z = (np.abs(flat - middle) * (1, 1, 0) + (flat - middle) * (0, 0, 1)).T
        distance = float(np.max(z + np.maximum(x / wide, y / high)))
        middle[1] += TITLE_ROOM * distance * tangent  # the words above push the rest down
        return Camera(np.column_stack([right, up, back]) @ middle, right, up, back, distance, aspect)

    @property
    def tangent(self) -> float:
        """Of half the angle that the picture is high."""
        return math.tan(math.radians(VIEW_ANGLE / 2))

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
        depth = -(offset @ self.back) * 2 * self.tangent
        return 0.5 + np.column_stack([offset @ self.right / (depth * self.aspect), offset @ self.up / depth])

    def unproject(self, at: Array, like: Array) -> Array:
        """Return the point (3,), m, that stands ``at`` (2,) in the picture, as deep as ``like`` (3,)."""
        depth = (self.eye - like) @ self.back
        x, y = (np.asarray(at) - 0.5) * 2 * self.tangent * depth
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
            position, q = moment.motion.problem.body(part.body).poses(at)
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
    back = np.array(
        [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        ]
    )
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


# --- shapes ---------------------------------------------------------------------------------------------


def solid(part: Geometry) -> pv.PolyData:
    """Return a part as a surface with normals, in the coordinates of its body, m."""
    pyvista = _pyvista()
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
        mesh = mesh.triangulate().clean().transform(_matrix(part.position, part.quaternion), inplace=False)
    return mesh.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=FEATURE_ANGLE, consistent_normals=False
    )


def _tube(points: Array, colours: Array | None, radius: float) -> pv.PolyData:
    """Return the tube around ``points`` (n, 3), m, with ``colours`` (n, 3) as its point data "colour"."""
    line = _pyvista().MultipleLines(points)
    if colours is not None:
        line.point_data["colour"] = colours.astype(np.uint8)
    return line.tube(radius=radius, n_sides=SIDES, capping=True)


def _curve(shapes: CableMotion) -> Curve:
    return Curve(shapes.s, shapes.position, rotations.tangent(shapes.quaternion))


def _matrix(position: Array, quaternion: Array) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotations.matrix(quaternion), position
    return matrix


def _rgb(colour: str) -> Array:
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], dtype=float)


def _light(plotter: pv.Plotter) -> None:
    """Light the active view from over the eye's shoulders; strong enough that white stays white."""
    pyvista = _pyvista()
    for position, intensity in (((-0.6, 0.9, 1.0), 0.9), ((0.9, 0.1, 0.8), 0.38), ((0.0, -0.8, 0.6), 0.16)):
        plotter.add_light(
            pyvista.Light(position=position, light_type="camera light", intensity=intensity), only_active=True
        )


# --- words ----------------------------------------------------------------------------------------------

UNITS = {  # by limit: factor, digits and name
    "clearance": (1e3, ".1f", "mm"),
    "bend_radius": (1e3, ".1f", "mm"),
    "twist": (180 / math.pi, ".0f", "deg/m"),
    "clamp_force": (1.0, ".3g", "N"),
    "clamp_moment": (1.0, ".3g", "N m"),
}


def _quantity(name: str, value: float) -> str:
    factor, digits, unit = UNITS[name]
    return f"{value * factor:{digits}} {unit}"


def _value_words(row: LimitResult) -> str:
    if row.name != "clearance":
        return f"{row.name.replace('_', ' ')} {_quantity(row.name, row.worst)}"
    other = row.part or ""
    if other == f"cable:{row.cable}":
        other = "itself"
    other = other.removeprefix("cable:")
    return f"{_quantity(row.name, abs(row.worst))} {'deep in' if row.worst < 0 else 'to'} {other}"


# --- OpenGL ---------------------------------------------------------------------------------------------


def _pyvista() -> Any:
    """Return the package, imported when it is needed."""
    try:
        import pyvista
    except ImportError as error:
        raise HarnessError('found no pyvista, expected the extra "harness-opt[pictures]"') from error
    return pyvista


@contextmanager
def _drawable() -> Iterator[None]:
    """Let VTK make an off-screen window of the kind that works here, without a word on stderr.

    Raises:
        HarnessError: none does.
    """
    _pyvista()
    before = os.environ.get(WINDOW_VARIABLE)
    with _quiet():
        window = before or _off_screen_window()
    if window:
        os.environ[WINDOW_VARIABLE] = window  # VTK reads it when a window is made, and has no other way to ask
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(WINDOW_VARIABLE, None)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep VTK from warning on stderr of what was only tried."""
    from vtkmodules.vtkCommonCore import vtkLogger

    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)


def _off_screen_window() -> str | None:
    """Return the name of the kind of window that VTK can draw in without a screen; None leaves it to VTK."""
    if not sys.platform.startswith("linux"):
        return None
    from vtkmodules import vtkRenderingOpenGL2 as gl

    if _loads("libEGL.so.1") and gl.vtkEGLRenderWindow().SupportsOpenGL():
        return "vtkEGLRenderWindow"
    if _screen():
        return "vtkXOpenGLRenderWindow"
    if any(_loads(f"libOSMesa.so.{version}") for version in (8, 6)):
        return "vtkOSOpenGLRenderWindow"
    raise HarnessError(f"found no OpenGL that works (EGL, X11 or OSMesa), expected one: {REMEDY}")


def _screen() -> bool:
    """Whether an X server answers and can draw."""
    from vtkmodules import vtkRenderingOpenGL2 as gl

    asked = os.environ.get("DISPLAY") and _loads("libX11.so.6") and _loads("libXcursor.so.1")
    return bool(asked) and bool(gl.vtkXOpenGLRenderWindow().SupportsOpenGL())


def _loads(library: str) -> bool:
    """Whether the system has a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True

"""Pictures of the rig's wrapped shapes: runs below each other, distances of the ends beside each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from twist_rig_runs import CABLE, STEP, Array, Run

from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from harness_opt.pictures import drawing
from harness_opt.pictures.opengl import drawable, load_pyvista
from harness_opt.report import colours

SHOWN = (0.98, 0.8, 0.6, 0.4, 0.2)  # distances of the ends
PIXELS = 3_200  # a metre, in the large pictures
ELEVATION = 25.0  # degrees, of the eye, above the plane across the one in which the cable would sag
ROOM = 0.012  # m, around a shape
HEADER, FOOTER, NARROW = 0.05, 0.022, 0.1  # m: lines of the title, words in a cell, and the room they take
LETTER = 0.0082  # m, of the names of the rows
LIGHT, DARK = "#f5c542", "#1f5fa8"  # the two halves of the cable's surface
FIXED, CHUCK = "#6a737d", "#b07a2a"
CLAMP = 0.012  # m, length of a clamp


def sheet(file: Path, runs: Sequence[Run], names: Sequence[str], title: str, width: int | None = None) -> None:
    """Draw runs below each other and distances of the ends beside each other, all to one scale.

    Args:
        file: PNG.
        runs: a row each.
        names: of the rows.
        title: above.
        width: pixels; None leaves it at PIXELS a metre.
    """
    pyvista = load_pyvista()
    moments = [[_drawn_frame(found, distance) for distance in SHOWN] for found in runs]
    boxes = np.array([[_box(shown) for shown in line] for line in moments])  # (rows, columns, low and high, 2)
    low, high = boxes[..., 0, :], boxes[..., 1, :]
    wide = np.maximum(np.max(high[..., 0] - low[..., 0], axis=0) + 2 * ROOM, NARROW)
    tall = np.max(high[..., 1] - low[..., 1], axis=1) + 2 * ROOM + FOOTER
    label = LETTER * max(len(line) for name in names for line in name.split("\n"))
    columns, lines = np.append(label, wide), np.append(HEADER, tall)
    scale = PIXELS if width is None else width / columns.sum()
    size = [round(scale * columns.sum()), round(scale * lines.sum())]
    with drawable():
        plotter = pyvista.Plotter(
            off_screen=True, window_size=size, border=False, lighting="none", shape=(len(lines), len(columns)),
            row_weights=list(lines), col_weights=list(columns), groups=[(0, slice(None))],
        )  # fmt: skip
    letter = scale / PIXELS
    plotter.subplot(0, 0)
    plotter.set_background("white")
    _write(plotter, title, (0.008, 0.5), 22 * letter)
    for column, distance in enumerate(SHOWN):
        x = (columns[: column + 1].sum() + 0.5 * wide[column]) / columns.sum()
        _write(plotter, f"{distance:g} L", (x - 0.012, 0.08), 20 * letter)
    for line, found in enumerate(runs):
        plotter.subplot(line + 1, 0)
        plotter.set_background("white")
        _write(plotter, names[line], (0.06, 0.5), 18 * letter)
        for column, shown in enumerate(moments[line]):
            plotter.subplot(line + 1, column + 1)
            plotter.set_background("white")
            middle = 0.5 * (low[line, column] + high[line, column]) - (0.0, 0.5 * FOOTER)
            _aim(plotter, middle, tall[line])
            _write(plotter, _words(found, column), (0.04, 0.02), 12.5 * letter)
            if shown is not None:
                _draw(plotter, shown)
                plotter.reset_camera_clipping_range()
    plotter.screenshot(file)
    plotter.close()


def _frame(found: Run, distance: float) -> int | None:
    """Return the frame in which the ends stand ``distance`` apart, or None where it was not reached."""
    came = found.came
    near = came[np.abs(found.rig.distance[came] - distance) < 0.5 * STEP]
    return int(near[0]) if len(near) else None


def _drawn_frame(found: Run, distance: float) -> drawing.DrawnFrame | None:
    frame = _frame(found, distance)
    return None if frame is None else drawing.DrawnFrame.of(found.motion, load_scene(found.motion.problem), frame)


def _axes() -> Array:
    """Return right, up and towards the eye as rows (3, 3): the cable runs along y, and sags along z."""
    sine, cosine = math.sin(math.radians(ELEVATION)), math.cos(math.radians(ELEVATION))
    return np.array([[0.0, 1.0, 0.0], [-sine, 0.0, cosine], [cosine, 0.0, sine]])


def _box(shown: drawing.DrawnFrame | None) -> Array:
    """Return the lower left and the upper right (2, 2), m, of what a cell has to hold, in the plane of view."""
    if shown is None:
        return np.zeros((2, 2))
    shapes = shown.motion.cables[CABLE]
    place = shapes.position[shown.frame]
    out = CLAMP * rotations.tangent(shapes.quaternion[shown.frame, [0, -1]]) * ((-1.0,), (1.0,))
    flat = np.vstack([place, place[[0, -1]] + out]) @ _axes()[:2].T
    return np.array([flat.min(axis=0), flat.max(axis=0)])


def _aim(plotter: Any, middle: Array, height: float) -> None:
    """Look at ``middle`` (2,), m in the plane of view, without perspective; the view is ``height`` m high."""
    right, up, back = _axes()
    focus = middle[0] * right + middle[1] * up
    camera = plotter.camera
    camera.position, camera.focal_point, camera.up = tuple(focus + 2.0 * back), tuple(focus), tuple(up)
    camera.parallel_projection, camera.parallel_scale = True, 0.5 * float(height)
    plotter.enable_anti_aliasing("ssaa")


def _draw(plotter: Any, shown: drawing.DrawnFrame) -> None:
    """Draw the cable, red where it touches itself, and the clamps; half of all surfaces is light, to show the twist."""
    shapes, frame = shown.motion.cables[CABLE], shown.frame
    radius = shown.motion.problem.cables[CABLE].cable.radius
    points, colours = drawing.cable_colours(shown, CABLE)
    plotter.add_mesh(_surface(points, colours, shapes, frame, radius), scalars="colour", rgb=True, **drawing.TUBE)
    for station, sign, colour in ((0, -1.0, FIXED), (-1, 1.0, CHUCK)):
        place, q = shapes.position[frame, station], shapes.quaternion[frame, station]
        out = sign * rotations.tangent(q)
        block = drawing.tube(np.array([place, place + CLAMP * out]), None, 2.2 * radius)
        plotter.add_mesh(block, color=colour, **drawing.TUBE)
        side = rotations.rotate(q, np.array([1.0, 0.0, 0.0]))  # d1: the middle of the light half
        mark = np.array([place, place + CLAMP * out]) + 2.0 * radius * side
        plotter.add_mesh(drawing.tube(mark, None, 0.45 * radius), color=LIGHT, **drawing.TUBE)
    drawing.light(plotter)


def _surface(points: Array, colours: Array, shapes: Any, frame: int, radius: float) -> Any:
    """Return the cable's surface, its colours on the cells."""
    s = np.linspace(0.0, shapes.s[-1], len(points))
    q = rotations.normalise(
        np.stack([np.interp(s, shapes.s, shapes.quaternion[frame, :, i]) for i in range(4)], axis=1)
    )
    angle = np.linspace(-0.5 * math.pi, 1.5 * math.pi, drawing.SIDES + 1)
    around = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    grid = points[None] + radius * rotations.rotate(q[None], around[:, None])
    surface = load_pyvista().StructuredGrid(*np.moveaxis(grid, -1, 0)[..., None])
    halves = np.where(np.cos(0.5 * (angle[1:] + angle[:-1]))[:, None, None] > 0, colours.rgb(LIGHT), colours.rgb(DARK))
    touches = np.all(colours == colours.rgb(colours.TOUCHES), axis=1)
    touches = touches[1:] | touches[:-1]
    painted = np.where(touches[None, :, None], colours.rgb(colours.TOUCHES), halves)
    surface.cell_data["colour"] = painted.transpose(1, 0, 2).reshape(-1, 3).astype(np.uint8)
    return surface.extract_surface(algorithm=None).compute_normals(split_vertices=False, cell_normals=False)


def _words(found: Run, column: int) -> str:
    """Return what is written below a shape."""
    frame = _frame(found, SHOWN[column])
    if frame is None:
        last = len(found.motion.motion) - 1
        return f"no stable shape\nbelow {found.place(last)}" if last >= 0 else "no shape found"
    words = f"twist {found.twist[frame]:+.2f}, writhe {found.writhe[frame]:+.2f}"
    before = _frame(found, SHOWN[column - 1]) if column else None
    snaps = [s.frame for s in found.motion.snaps if before is not None and before < s.frame <= frame]
    if found.slipped is not None and found.slipped <= frame:
        return f"{words}\nthrough itself at {found.place(found.slipped)}"
    if found.touches is not None and found.touches <= frame:
        return f"{words}\ntouches from {found.place(found.touches)}"
    return f"{words}\nsnapped at {', '.join(map(found.place, snaps))}" if snaps else words


def _write(plotter: Any, words: str, at: tuple[float, float], size: float) -> None:
    text = plotter.add_text(words, position=at, viewport=True, font_size=max(4, round(size)), color=colours.INK)
    text.prop.background_color, text.prop.background_opacity = "white", 0.7


def draw_twists(file: Path, runs: Sequence[Run], width: int | None = None) -> None:
    """Draw the wrapped shapes of one reading: twists below each other, distances beside each other."""
    drawn = [found for found in runs if found.motion.cables]
    ratio = drawn[0].rig.cable.stiffness[2] / drawn[0].rig.cable.stiffness[0]
    title = f"End turned by the angle on the left, then brought in; kz/kx = {ratio:.3g}. Twist and writhe in turns"
    sheet(file, drawn, [f"{found.rig.twist:.0f} deg" for found in drawn], title, width)


def draw_readings(file: Path, runs: Sequence[Run]) -> None:
    """Draw both readings of the rigidity at one twist."""
    names = [f"{f.rig.reading} mN m2\nkz/kx = {f.rig.cable.stiffness[2] / f.rig.cable.stiffness[0]:.3g}" for f in runs]
    turned = f"Turned by {runs[0].rig.twist:.0f} degrees, then brought together"
    title = f"{turned}: both readings of Table 1. Twist and writhe in turns"
    sheet(file, runs, names, title)

"""The pictures of docs/tutorial.md: drawn by matplotlib (extra "studies"), as SVG, from shapes that are solved here.

python scripts/docs/pictures.py writes docs/pictures/*.svg.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

import harness_opt as ho
from harness_opt.cli.template import write_template
from harness_opt.numerics import rotations

matplotlib.use("svg")
from matplotlib import pyplot as plt

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "pictures"
INK, CABLE, FIRST, LAST = "#222222", "#c2410c", "#94a3b8", "#cbd5e1"
RED, GREEN, BLUE = "#dc2626", "#15803d", "#1d4ed8"  # d1, d2, d3
STYLE = {"svg.fonttype": "none", "svg.hashsalt": "harness-opt", "font.size": 10, "font.family": "sans-serif"}
ARROW = {"arrowstyle": "-|>", "lw": 1.8, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 13}
MM = 1e3


def main() -> None:
    """Draw all pictures."""
    FOLDER.mkdir(exist_ok=True)
    with plt.rc_context(STYLE), tempfile.TemporaryDirectory() as folder:
        template = ho.read_problem(write_template(Path(folder) / "lid"))
        drawn, turned = with_roll(template, 0.0), with_roll(template, 180.0)
        save("scene", scene(turned))
        save("frame", frame())
        save("roll", roll())
        save("uturn", uturn(drawn, turned))
        save("before_after", before_after(turned))


def save(name: str, figure: Any) -> None:
    """Write a figure without the date, so that the same picture is the same file."""
    file = FOLDER / f"{name}.svg"
    figure.savefig(file, bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    text = "\n".join(line.rstrip() for line in file.read_text(encoding="utf-8").splitlines())
    file.write_text(text + "\n", encoding="utf-8")
    print(f"{file.name}: {file.stat().st_size / 1000:.0f} kB")


def with_roll(problem: ho.Problem, degrees: float) -> ho.Problem:
    """Return the template's problem with no roll at its wall's clamp, and with ``degrees`` at its lid's."""
    run = problem.cables["lead"]
    start, end = (
        dataclasses.replace(side, roll=None, roll_deg=roll) for side, roll in ((run.start, 0.0), (run.end, degrees))
    )
    return dataclasses.replace(problem, cables={"lead": dataclasses.replace(run, start=start, end=end)})


# --- side views -----------------------------------------------------------------------------------------


def box(axes: Any, centre: tuple[float, float], size: tuple[float, float], turned: float, **style: Any) -> None:
    """Draw a box of the template (mm, x and z), turned about the hinge at x = 300 mm, z = 0."""
    dx, dz = 0.5 * size[0], 0.5 * size[1]
    corners = np.array(centre) + np.array([(-dx, -dz), (dx, -dz), (dx, dz), (-dx, dz)])
    axes.add_patch(plt.Polygon(about_hinge(corners, turned), closed=True, **style))


def about_hinge(points: Any, degrees: float) -> Any:
    """Turn points (mm, x and z) about the hinge's axis, y."""
    angle, hinge = np.radians(degrees), np.array([300.0, 0.0])
    c, s = np.cos(angle), np.sin(angle)
    return (np.asarray(points, dtype=float) - hinge) @ np.array([[c, s], [-s, c]]).T + hinge


def parts(axes: Any, lid: float) -> None:
    """Draw wall and panel with the lid at an angle, degrees."""
    box(axes, (0, 20), (100, 40), 0.0, fc="#e2e8f0", ec="#475569")
    box(axes, (200, 30), (200, 20), lid, fc="#e2e8f0", ec="#475569")
    axes.plot(300, 0, "o", ms=6, mfc="white", mec=INK)


def scene(problem: ho.Problem) -> Any:
    """The drawn lid, closed: parts, clamps, tangents."""
    motion = ho.simulate(problem, frames=[0.0])
    shape = motion.cables["lead"].position[0] * MM
    figure, axes = plt.subplots(figsize=(7.4, 4.2))
    parts(axes, 0.0)
    axes.plot(shape[:, 0], shape[:, 2], color=CABLE, lw=5, solid_capstyle="butt", alpha=0.85)
    middle = 32
    axes.annotate("", shape[middle + 6, [0, 2]], shape[middle, [0, 2]], arrowprops={**ARROW, "color": INK})
    axes.annotate("arc length s grows\nfrom start to end", shape[middle, [0, 2]], (-75, 180), ha="left", color=INK)
    for at, to, words, place in (
        ((0, 50), (0, 88), 'start\nbody = "world"\nposition = [0, 0, 0.05]\ntangent = [0, 0, 1]', (-160, 58)),
        ((180, 50), (180, 12), 'end\nbody = "lid"\nposition = [0.18, 0, 0.05]\ntangent = [0, 0, -1]', (197, 66)),
    ):
        axes.annotate("", to, at, arrowprops={**ARROW, "color": BLUE})
        axes.plot(*at, "o", color=BLUE, ms=5)
        axes.text(*place, words, color=BLUE, va="bottom", family="monospace", fontsize=8)
    axes.text(0, 16, "wall", ha="center")
    axes.text(247, 27, "panel", ha="center")
    axes.text(300, -16, "hinge: point = [0.3, 0, 0], axis = [0, 1, 0]", ha="center", fontsize=8, family="monospace")
    axes.annotate("", (-105, 25), (-105, -10), arrowprops={**ARROW, "color": INK})
    axes.annotate("", (-70, -10), (-105, -10), arrowprops={**ARROW, "color": INK})
    axes.text(-105, 28, "z", ha="center")
    axes.text(-66, -10, "x", va="center")
    axes.text(-105, -22, "y points into the page", ha="left", va="top", fontsize=8)
    bare(axes, (-165, 400), (-35, 225))
    return figure


def bare(axes: Any, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Take everything from axes but what is drawn, the same scale both ways."""
    axes.set_aspect("equal")
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.axis("off")


def before_after(problem: ho.Problem) -> Any:
    """The lid at five moments, as drawn and as redesigned."""
    found = ho.redesign(problem)
    figure, both = plt.subplots(1, 2, figsize=(9, 3.9))
    pairs = ((found.motion_before, "as drawn"), (found.motion, "redesigned"))
    for axes, (motion, title) in zip(both, pairs, strict=True):
        shapes = motion.cables["lead"].position * MM
        last = len(motion.motion) - 1
        box(axes, (200, 30), (200, 20), 0.0, fc="none", ec=FIRST, ls=":")
        parts(axes, 60.0)
        for frame in np.linspace(0, last, 5).round().astype(int):
            style = {"color": CABLE, "lw": 3.5} if frame == last else {"color": FIRST, "lw": 1.5}
            axes.plot(shapes[frame, :, 0], shapes[frame, :, 2], **style)
        length = motion.problem.cables["lead"].cable.length
        axes.set_title(f"{title}: {MM * length:.1f} mm long", fontsize=10)
        bare(axes, (-70, 345), (-12, 300))
    return figure


# --- what a clamp's axes are ----------------------------------------------------------------------------


def seen(point: Any) -> Any:
    """Project a point in space (x right, y away, z up) onto the page."""
    x, y, z = np.moveaxis(np.asarray(point, dtype=float), -1, 0)
    return np.stack([x + 0.45 * y, z + 0.35 * y], axis=-1)


def arrow(axes: Any, start: Any, way: Any, colour: str, words: str, off: tuple[float, float] = (0, 0)) -> None:
    """Draw an arrow in space with its name at the tip."""
    a, b = seen(start), seen(np.asarray(start) + np.asarray(way))
    axes.annotate("", b, a, arrowprops={**ARROW, "color": colour})
    tip = b + 0.11 * (b - a) / np.linalg.norm(b - a) + np.array(off)
    axes.text(*tip, words, color=colour, ha="center", va="center")


def tube(axes: Any, start: Any, way: Any, radius: float, colour: str) -> None:
    """Draw a straight piece of cable along x."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = np.stack([0 * angle, radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    ends = [seen(np.asarray(start) + ring), seen(np.asarray(start) + np.asarray(way) + ring)]
    hull = np.vstack(ends)
    from scipy.spatial import ConvexHull

    axes.add_patch(plt.Polygon(hull[ConvexHull(hull).vertices], fc=colour, ec=INK, lw=0.8, alpha=0.9))
    axes.add_patch(plt.Polygon(ends[1], fc="#fed7aa", ec=INK, lw=0.8))


def frame() -> Any:
    """The axes of the section at a start and at an end: d3 along growing arc length at both."""
    figure, axes = plt.subplots(figsize=(8.2, 3.1))
    at_start, at_end = "at the start, d3 points\ninto the cable", "at the end, d3 points\nout of the cable"
    for x, words, way in ((0.0, at_start, 1.6), (4.4, at_end, -1.6)):
        low = np.array((x - 0.25 if way > 0 else x, -0.55, -0.55))
        face = seen(low + np.array([(0, 0, 0), (0, 1.1, 0), (0, 1.1, 1.1), (0, 0, 1.1)]))
        axes.add_patch(plt.Polygon(face, fc="#cbd5e1", ec="#475569"))
        origin = (x, 0.0, 0.0)
        if way > 0:
            tube(axes, origin, (way, 0, 0), 0.22, "#fdba74")
        else:
            tube(axes, (x + way, 0, 0), (-way, 0, 0), 0.22, "#fdba74")
        arrow(axes, origin, (0, 0, 1.25), RED, "d1")
        arrow(axes, origin, (0, -1.35, 0), GREEN, "d2")
        arrow(axes, origin, (1.25, 0, 0), BLUE, "d3", (0, 0.14) if way > 0 else (0, 0))
        axes.text(x + 0.2, -1.35, words, ha="center", va="top", fontsize=9)
    axes.annotate("", (3.0, 1.05), (1.4, 1.05), arrowprops={**ARROW, "color": INK, "lw": 1.2})
    axes.text(2.2, 1.18, "arc length s grows", ha="center", fontsize=9)
    bare(axes, (-1.2, 6.3), (-1.95, 1.75))
    return figure


def roll() -> Any:
    """Roll, seen against d3: from where it is counted, and which way."""
    figure, axes = plt.subplots(figsize=(6.2, 3.4))
    axes.add_patch(plt.Circle((0, 0), 0.55, fc="#fed7aa", ec=INK))
    for degrees, alpha in ((0.0, 0.35), (30.0, 1.0)):
        turn = np.radians(degrees)
        for angle, colour, name in ((turn, RED, f"d1 at roll_deg = {degrees:g}"), (turn + np.pi / 2, GREEN, "d2")):
            tip = 1.25 * np.array([np.cos(angle), np.sin(angle)])
            axes.annotate("", tip, (0, 0), arrowprops={**ARROW, "color": colour, "alpha": alpha})
            left = name.startswith("d1")
            where = {"ha": "left" if left else "center", "va": "center"}
            axes.text(*(1.08 * tip), name, color=colour, alpha=max(alpha, 0.6), **where)
    axes.plot(0, 0, "o", ms=9, mfc="white", mec=BLUE)
    axes.plot(0, 0, "o", ms=3, color=BLUE)
    axes.text(-0.08, -0.16, "d3, towards you", color=BLUE, ha="center", va="top", fontsize=9)
    arc = np.radians(np.linspace(3, 26, 20))
    axes.plot(0.9 * np.cos(arc), 0.9 * np.sin(arc), color=INK, lw=1)
    axes.annotate("", (0.9 * np.cos(arc[-1]), 0.9 * np.sin(arc[-1])), (0.9 * np.cos(arc[-4]), 0.9 * np.sin(arc[-4])),
                  arrowprops={**ARROW, "lw": 1, "color": INK, "mutation_scale": 9})  # fmt: skip
    axes.text(
        1.35, -0.42, "the body's x axis, seen along d3\n(its y axis where d3 lies along x)", fontsize=8.5, va="top"
    )
    axes.plot([0, 1.3], [0, -0.0], color=INK, lw=0.8, ls=":")
    axes.annotate("", (1.15, -0.03), (1.5, -0.4), arrowprops={"arrowstyle": "-", "lw": 0.7, "color": INK})
    bare(axes, (-1.4, 3.4), (-1.05, 1.5))
    return figure


# --- what roll does to a cable that turns round ---------------------------------------------------------


def uturn(drawn: ho.Problem, turned: ho.Problem) -> Any:
    """The cable over the closed lid with d1 along it: twisted by half a turn, and not twisted."""
    figure = plt.figure(figsize=(9, 4.1))
    both = ((drawn, "roll_deg = 0 at both ends"), (turned, "roll_deg = 180 at the end, or no roll"))
    for place, (problem, words) in enumerate(both):
        axes = figure.add_subplot(1, 2, place + 1, projection="3d", proj_type="ortho")
        shapes = ho.simulate(problem, frames=[0.0]).cables["lead"]
        r, d1 = shapes.position[0] * MM, rotations.rotate(shapes.quaternion[0], (1.0, 0.0, 0.0))
        axes.plot(*r.T, color=CABLE, lw=3)
        for k in range(0, len(r), 5):
            tip = r[k] + 28 * d1[k]
            axes.plot(*np.stack([r[k], tip]).T, color=RED, lw=1.4)
        most = np.degrees(np.abs(shapes.curvature[0, :, 2]).max())
        axes.set_title(f"{words}\ntwist at most {most:.0f} deg/m", fontsize=9)
        axes.set_box_aspect(np.ptp(np.vstack([r, r + 28 * d1, r - 28 * d1]), axis=0))
        axes.view_init(elev=22, azim=-68)
        axes.set_axis_off()
    figure.subplots_adjust(wspace=0.0)
    return figure


if __name__ == "__main__":
    main()

"""What does the cable of the paper's rig do when it is twisted further and further, and which rigidity makes it wrap?

    python scripts/twist_rig.py -o results/twist_rig --jobs 2
    python scripts/twist_rig.py --quick

The rig of section 5 of Liu et al.: a straight cable, one end turned about its own tangent, then brought towards the
other. Table 1 prints its bending rigidity as "0.134.5", so both readings of ``problems/twist_rig`` are taken. Here the
end turns by 90 to 1080 degrees (the paper's model ends at 360) while it stands at 0.98 of the cable's length, and
then comes in to 0.2: the history of the rig, so that the number of turns is what was turned in and not what a first
guess makes of it. What :func:`harness_opt.equilibrium` finds at 0.98 with no history is compared.

A table on the terminal, ``twist_rig.csv`` (a row a run), ``frames.csv`` (a row a frame), ``wrapping.png`` (how the
twist turns into loops), ``wrapping_134_5.png`` and ``readings.png`` (both readings at 180 degrees). The model knows
no contact: what follows the first touch is not what a real cable does, and a loop may pull through itself, which
takes two turns out of it. Table and pictures say where.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import harness_opt as ho
from harness_opt import drawing, rotations
from harness_opt.opengl import drawable, load_pyvista
from harness_opt.scene import load_scene

Array = np.ndarray
FILES = {"0.1345": "twist_rig.toml", "134.5": "twist_rig_134_5.toml"}  # by reading of the bending rigidity, mN m2
PROBLEMS = Path(__file__).resolve().parent.parent / "problems" / "twist_rig"
CABLE = "cable"
TWISTS, QUICK_TWISTS = (90, 180, 270, 360, 540, 720, 1080), (90, 180, 360)  # degrees
NEAR, FAR = 0.2, 0.98  # distance of the ends, in lengths of the cable
SHOWN = (0.98, 0.8, 0.6, 0.4, 0.2)
TURN_STEP, STEP = 5.0, 0.01  # degrees and lengths of the cable between two frames; twice that in a quick run
TOUCHING = 0.0  # m, clearance of the cable to itself below which it touches
SAME = 1e-4  # of the length: what two shapes of one branch may differ by
OUT = 1e4  # lengths of the cable, to which its ends are lengthened for the writhe
CHORDS = 300  # of the polygon for the writhe; half as many for its error


# --- the rig ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rig:
    """One run: a reading, a twist, and the poses of the moving end.

    Args:
        reading: key of FILES.
        twist: degrees.
        problem: with the end on a body that turns, then slides.
        angle: of the end at each frame, degrees, (P,).
        distance: of the ends at each frame, in lengths of the cable, (P,).
    """

    reading: str
    twist: float
    problem: ho.Problem
    angle: Array
    distance: Array

    @property
    def cable(self) -> ho.Cable:
        """The cable."""
        return self.problem.cables[CABLE].cable

    @property
    def frames(self) -> Array:
        """Values of the motion at which the frames stand: at the poses given, (P,)."""
        return np.linspace(0.0, 1.0, len(self.angle))


def rig(reading: str, twist: float, coarser: int = 1) -> Rig:
    """Return the rig that turns its end by ``twist`` degrees at FAR and brings it in to NEAR."""
    shipped = ho.read_problem(PROBLEMS / FILES[reading])
    run = shipped.cables[CABLE]
    turns = math.ceil(twist / (coarser * TURN_STEP))
    comes = round((FAR - NEAR) / (coarser * STEP))
    angle = np.append(np.linspace(0.0, twist, turns + 1), np.full(comes, twist))
    distance = np.append(np.full(turns, FAR), np.linspace(FAR, NEAR, comes + 1))
    along = rotations.tangent(run.start.quaternion)
    turned = rotations.from_rotation_vector(np.radians(angle)[:, None] * along)
    chuck = ho.Poses(
        tuple(np.arange(len(angle), dtype=float)),
        tuple(map(tuple, run.cable.length * distance[:, None] * along)),
        tuple(map(tuple, turned)),
    )
    end = ho.End((0.0, 0.0, 0.0), run.start.quaternion, body="chuck")
    problem = dataclasses.replace(
        shipped,
        cables={CABLE: ho.CableRun(run.cable, run.start, end)},
        bodies={"chuck": ho.Body(chuck)},
        limits=ho.Limits(clearance=TOUCHING),
    )
    return Rig(reading, twist, problem, angle, distance)


# --- twist and writhe ---------------------------------------------------------------------------------------


def writhe(points: Array) -> float:
    """Return the writhe of a polygon (n, 3), in turns: the exact Gauss integral over all pairs of its sides.

    Klenin and Langowski, "Computation of writhe in modeling of supercoiled DNA", Biopolymers 54 (2000), method 1a.
    """
    side = np.diff(points, axis=0)
    i, j = np.triu_indices(len(side), 2)
    r13, r14 = points[j] - points[i], points[j + 1] - points[i]
    r23, r24 = points[j] - points[i + 1], points[j + 1] - points[i + 1]
    normals = [np.cross(a, b) for a, b in ((r13, r14), (r14, r24), (r24, r23), (r23, r13))]
    size = [np.linalg.norm(n, axis=1, keepdims=True) for n in normals]
    n = [a / np.where(b > 0.0, b, 1.0) for a, b in zip(normals, size, strict=True)]
    corners = sum(np.arcsin(np.clip(np.sum(n[k] * n[(k + 1) % 4], axis=1), -1.0, 1.0)) for k in range(4))
    sign = np.sign(np.sum(np.cross(side[j], side[i]) * r13, axis=1))
    return float(np.sum(corners * sign)) / (2.0 * math.pi)


def cable_writhe(shapes: Any, frame: int) -> float:
    """Return the writhe of the cable with its ends lengthened straight, in turns.

    That of the polygon through CHORDS points, and of half as many, extrapolated: its error falls with the square.
    """
    curve, tangent = drawing.curve_of(shapes), rotations.tangent(shapes.quaternion[frame])
    out = OUT * shapes.s[-1]
    found = []
    for chords in (CHORDS // 2, CHORDS):
        points = curve.at(np.full(chords + 1, frame), np.linspace(0.0, shapes.s[-1], chords + 1))
        found.append(writhe(np.vstack([points[0] - out * tangent[0], points, points[-1] + out * tangent[-1]])))
    return found[1] + (found[1] - found[0]) / 3.0


def cable_twist(shapes: Any) -> Array:
    """Return the twist of the cable in each frame, in turns, (P,): the integral of omega_3 by Simpson's rule."""
    weights = np.ones(len(shapes.s))
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    return shapes.curvature[..., 2] @ weights * (shapes.s[1] - shapes.s[0]) / 3.0 / (2.0 * math.pi)


# --- a run ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """What came of a rig.

    Args:
        rig: what was run.
        motion: what was solved of it.
        clearance: of the cable to itself, m, (P,).
        twist, writhe: turns, (P,).
        seconds: wall time of the motion.
        cold: what a cold start at FAR finds.
    """

    rig: Rig
    motion: ho.Motion
    clearance: Array
    twist: Array
    writhe: Array
    seconds: float
    cold: str

    @property
    def shapes(self) -> Any:
        """The frames solved."""
        return self.motion.cables[CABLE]

    @property
    def came(self) -> Array:
        """The frames in which the end comes in, the twist being complete."""
        solved = np.arange(len(self.motion.motion))
        return solved[self.rig.angle[solved] >= self.rig.twist]

    @property
    def turns(self) -> Array:
        """Twist and writhe, (P,): what was turned in, unless the cable has pulled through itself."""
        return self.twist + self.writhe

    @property
    def slipped(self) -> int | None:
        """The first frame with other turns than were turned in."""
        off = np.flatnonzero(np.abs(self.turns - self.rig.angle[: len(self.turns)] / 360.0) > 0.5)
        return int(off[0]) if len(off) else None

    @property
    def touches(self) -> int | None:
        """The first frame in which the cable touches itself."""
        hit = np.flatnonzero(self.clearance < TOUCHING)
        return int(hit[0]) if len(hit) else None

    def place(self, frame: int | None) -> str:
        """Return where the end stands in a frame, in words."""
        if frame is None:
            return "-"
        turning = f" ({self.rig.angle[frame]:.0f} deg)" if self.rig.angle[frame] < self.rig.twist else ""
        return f"{self.rig.distance[frame]:.2f} L{turning}"


def run(reading: str, twist: float, coarser: int) -> Run:
    """Simulate one rig and measure its shapes."""
    wanted = rig(reading, twist, coarser)
    begin = time.perf_counter()
    motion = ho.simulate(wanted.problem, frames=wanted.frames, throw=False)
    seconds = time.perf_counter() - begin
    if not motion.cables:
        nothing = np.zeros(0)
        return Run(wanted, motion, nothing, nothing, nothing, seconds, "")
    shapes = motion.cables[CABLE]
    clearance = np.concatenate([pair.clearance for pair in ho.clearances(motion).pairs])
    turns = np.array([cable_writhe(shapes, frame) for frame in range(len(shapes.position))])
    found = Run(wanted, motion, clearance, cable_twist(shapes), turns, seconds, "")
    return dataclasses.replace(found, cold=cold_start(found))


def cold_start(found: Run) -> str:
    """Return what :func:`harness_opt.equilibrium` finds, with the turns asked for, where the run begins to come in."""
    wanted = found.rig
    turns = math.ceil(wanted.twist / 360.0 - 0.5)  # the rest, at most half a turn, is the clamp's own
    start = wanted.problem.cables[CABLE].start
    end = wanted.problem.ends(CABLE, [float(wanted.frames[np.flatnonzero(wanted.angle >= wanted.twist)[0]])])[0][1]
    end = dataclasses.replace(end, turns=turns)
    shape = ho.equilibrium(wanted.cable, start, end, wanted.problem.gravity, throw=False)
    if not shape.ok:
        return "no shape"
    if not shape.stable:
        return "unstable"
    single = dataclasses.replace(
        found.shapes.first(1), **{key: getattr(shape, key)[None] for key in ("position", "quaternion", "curvature")}
    )
    linked = float(cable_twist(single)[0]) + cable_writhe(single, 0)
    if abs(linked - wanted.twist / 360.0) > 0.5:
        return f"{linked:+.2f} turns"
    if not len(found.came):
        return "a shape"
    there = found.shapes.position[found.came[0]]
    middle = 0.5 * (there[0] + there[-1])
    swapped = 2.0 * middle * (1, 1, 0) + there[::-1] * (-1, -1, 1)  # half a turn about the vertical, ends swapped
    apart = min(np.max(np.linalg.norm(shape.position - other, axis=1)) for other in (there, swapped))
    return "the same" if apart < SAME * wanted.cable.length else "another"


# --- tables -----------------------------------------------------------------------------------------------


def row(found: Run) -> dict[str, str]:
    """Return one line of the table, by its column."""
    wanted, motion = found.rig, found.motion
    stiffness = wanted.cable.stiffness
    head = {"twist deg": f"{wanted.twist:.0f}", "kz/kx": f"{stiffness[2] / stiffness[0]:.4g}"}
    if not motion.cables:
        return head | {"frames": f"0 of {len(wanted.frames)}"}
    shapes = found.shapes
    last = len(motion.motion) - 1
    snaps = [found.place(snap.frame) for snap in motion.snaps]
    coming = [at for at in snaps if "deg" not in at]
    return head | {
        "frames": f"{last + 1} of {len(wanted.frames)}",
        "stable": f"{np.count_nonzero(shapes.stable)}",
        "snaps turning": f"{len(snaps) - len(coming)}",
        "snaps coming in": ", ".join(coming) or "-",
        "ends at": found.place(last),
        "error": f"{np.max(shapes.estimated_error):.0e}",
        "residual": f"{np.max(shapes.residual):.0e}",
        "bend radius mm": f"{1e3 / np.max(np.linalg.norm(shapes.curvature[..., :2], axis=-1)):.1f}",
        "twist left rad": f"{2 * math.pi * found.twist[last]:+.2f}",
        "writhe": f"{found.writhe[last]:+.3f}",
        "turns": f"{found.turns[last]:+.4f}",
        "touches itself": found.place(found.touches),
        "turns lost": found.place(found.slipped),
        "cold start": found.cold,
        "s": f"{found.seconds:.0f}",
    }


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """Return rows as text in columns."""
    names = list(max(rows, key=len))
    wide = [max(len(name), *(len(line.get(name, "")) for line in rows)) for name in names]
    lines = [names, *([line.get(name, "") for name in names] for line in rows)]
    return "\n".join("  ".join(word.rjust(w) for word, w in zip(line, wide, strict=True)).rstrip() for line in lines)


def write_csv(file: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Write rows, the first of which has all columns."""
    rows = list(rows)
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(max(rows, key=len)))
        writer.writeheader()
        writer.writerows(rows)


def frame_rows(found: Run) -> Iterable[dict[str, object]]:
    """Return a line for each frame of a run, SI units and turns."""
    wanted, snapped = found.rig, {snap.frame for snap in found.motion.snaps}
    along = rotations.tangent(wanted.problem.cables[CABLE].start.quaternion)
    for k in range(len(found.motion.motion)):
        shapes = found.shapes
        yield {
            "reading": wanted.reading,
            "twist_deg": wanted.twist,
            "turned_deg": round(float(wanted.angle[k]), 6),
            "distance": round(float(wanted.distance[k]), 6),
            "twist_turns": found.twist[k],
            "writhe_turns": found.writhe[k],
            "clamp_twist_moment": shapes.moment[k, 0] @ along,
            "clamp_pull": shapes.force[k, 0] @ along,
            "bend_radius": 1.0 / np.max(np.linalg.norm(shapes.curvature[k, :, :2], axis=-1)),
            "self_clearance": found.clearance[k],
            "stable": bool(shapes.stable[k]),
            "stability_margin": shapes.stability_margin[k],
            "snapped": k in snapped,
            "estimated_error": shapes.estimated_error[k],
        }


# --- pictures ---------------------------------------------------------------------------------------------

PIXELS = 3_200  # a metre, in the large pictures
ELEVATION = 25.0  # degrees, of the eye, above the plane across the one in which the cable would sag
ROOM = 0.012  # m, around a shape
HEADER, FOOTER, NARROW = 0.05, 0.022, 0.092  # m: lines of the title, words in a cell, and the room they take
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
    moments = [[_moment(found, distance) for distance in SHOWN] for found in runs]
    boxes = np.array([[_box(moment) for moment in line] for line in moments])  # (rows, columns, low and high, 2)
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
        for column, moment in enumerate(moments[line]):
            plotter.subplot(line + 1, column + 1)
            plotter.set_background("white")
            middle = 0.5 * (low[line, column] + high[line, column]) - (0.0, 0.5 * FOOTER)
            _aim(plotter, middle, tall[line])
            _write(plotter, _words(found, column), (0.04, 0.02), 12.5 * letter)
            if moment is not None:
                _draw(plotter, moment)
                plotter.reset_camera_clipping_range()
    plotter.screenshot(file)
    plotter.close()


def _frame(found: Run, distance: float) -> int | None:
    """Return the frame in which the ends stand ``distance`` apart, or None where it was not reached."""
    came = found.came
    near = came[np.abs(found.rig.distance[came] - distance) < 0.5 * STEP]
    return int(near[0]) if len(near) else None


def _moment(found: Run, distance: float) -> drawing.Moment | None:
    frame = _frame(found, distance)
    return None if frame is None else drawing.Moment.of(found.motion, load_scene(found.motion.problem), frame)


def _axes() -> Array:
    """Return right, up and towards the eye as rows (3, 3): the cable runs along y, and sags along z."""
    sine, cosine = math.sin(math.radians(ELEVATION)), math.cos(math.radians(ELEVATION))
    return np.array([[0.0, 1.0, 0.0], [-sine, 0.0, cosine], [cosine, 0.0, sine]])


def _box(moment: drawing.Moment | None) -> Array:
    """Return the lower left and the upper right (2, 2), m, of what a cell has to hold, in the plane of view."""
    if moment is None:
        return np.zeros((2, 2))
    shapes = moment.motion.cables[CABLE]
    place = shapes.position[moment.frame]
    out = CLAMP * rotations.tangent(shapes.quaternion[moment.frame, [0, -1]]) * ((-1.0,), (1.0,))
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


def _draw(plotter: Any, moment: drawing.Moment) -> None:
    """Draw the cable, red where it touches itself, and the clamps; half of all surfaces is light, to show the twist."""
    shapes, frame = moment.motion.cables[CABLE], moment.frame
    radius = moment.motion.problem.cables[CABLE].cable.radius
    points, colours = drawing.cable_colours(moment, CABLE)
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
    halves = np.where(np.cos(0.5 * (angle[1:] + angle[:-1]))[:, None, None] > 0, drawing.rgb(LIGHT), drawing.rgb(DARK))
    touches = np.all(colours == drawing.rgb(drawing.TOUCHES), axis=1)
    touches = touches[1:] | touches[:-1]
    painted = np.where(touches[None, :, None], drawing.rgb(drawing.TOUCHES), halves)
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
        return f"{words}\npulled through itself at {found.place(found.slipped)}"
    if found.touches is not None and found.touches <= frame:
        return f"{words}\ntouches itself from {found.place(found.touches)}"
    return f"{words}\nsnapped at {', '.join(map(found.place, snaps))}" if snaps else words


def _write(plotter: Any, words: str, at: tuple[float, float], size: float) -> None:
    text = plotter.add_text(words, position=at, viewport=True, font_size=max(4, round(size)), color=drawing.INK)
    text.prop.background_color, text.prop.background_opacity = "white", 0.7


# --- the study --------------------------------------------------------------------------------------------


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/twist_rig"), help="folder of the results")
    parser.add_argument("--quick", action="store_true", help="three twists, and half of the frames")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    twists, coarser = (QUICK_TWISTS, 2) if options.quick else (TWISTS, 1)
    asked = [(reading, twist) for reading in FILES for twist in twists]
    with ProcessPoolExecutor(options.jobs) as pool:
        pending = [pool.submit(run, *one, coarser) for one in asked]
        runs = {}
        for one, future in zip(asked, pending, strict=True):
            runs[one] = future.result()
            print(f"{one[0]} mN m2, {one[1]} degrees: {runs[one].seconds:.0f} s {runs[one].motion.message}", flush=True)
    rows = [row(found) for found in runs.values()]
    print("\n" + table(rows))
    write_csv(options.output / "twist_rig.csv", rows)
    write_csv(options.output / "frames.csv", (line for found in runs.values() for line in frame_rows(found)))
    for reading, name in (("0.1345", "wrapping.png"), ("134.5", "wrapping_134_5.png")):
        draw_twists(options.output / name, [runs[reading, twist] for twist in twists])
    draw_readings(options.output / "readings.png", [runs[reading, 180] for reading in FILES])
    print(f"\nResults: {options.output}")


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


if __name__ == "__main__":
    main()

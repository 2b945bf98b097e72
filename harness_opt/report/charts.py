"""Curves over the motion as plain numbers of a picture: where lines, ticks and limits go; a page draws them as SVG."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.limits import STRAIGHT, bending
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.model.limits import LimitKind, Obstacle
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.model.spans import clip_key
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

WIDTH, HEIGHT = 360, 190  # of a picture, in its own unit
LEFT, RIGHT, TOP, BOTTOM = 46, 10, 10, 24  # kept free around the curves
TICKS = 4  # about as many along the height
ROOM = 0.06  # of the range, kept free above and below
REACH = 4.0  # times the limit, or the worst: what lies beyond says "far away" and is cut off
MOST_POINTS = 600  # of a drawn curve: more than the picture has pixels
COLOURS = 8  # of series
MOST_SERIES = 8  # drawn in one picture: as many as there are colours
STRAIGHT_FROM = 1e5  # mm: what bends less is straight, and what is that far away is far
MM = 1e3


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves of one quantity over the motion.

    Args:
        title, unit: of the quantity.
        motion: (P,), 0 to 1.
        series: values (P,) by name, in ``unit``; NaN where not known.
        limits: lines to stay on one side of, in ``unit``.
        most: whether the limits are most that is allowed, or else least.
        before: the same of the design given: its motion, and values by name.
        bounded: whether the picture ends where large values mean "far away"; it says where curves go beyond.
        left_out: how many series are not among these, for they stay farther from the limit.
    """

    title: str
    unit: str
    motion: Array
    series: Mapping[str, Array]
    limits: Sequence[float] = ()
    most: bool = True
    before: tuple[Array, Mapping[str, Array]] | None = None
    bounded: bool = False
    left_out: int = 0


@dataclass(frozen=True, eq=False)
class Drawn:
    """A chart laid out in a picture of :data:`WIDTH` by :data:`HEIGHT`.

    Args:
        chart: what is drawn.
        lines: SVG path of each series; empty where nothing is known.
        before: the same of the design given.
        limits: heights of the limits.
        broken: upper edge and height of the bands that break a limit.
        ticks: height and words of each.
        snaps: places along the motion.
        colours: number of the colour of each series, of the design given too.
        beyond: SVG path along the upper edge of each series, where it lies beyond.
        most: the largest of all values, in words.
        numbers: place and number of each series, where there are several.
    """

    chart: Chart
    lines: Mapping[str, str]
    before: Mapping[str, str]
    limits: tuple[float, ...]
    broken: tuple[tuple[float, float], ...]
    ticks: tuple[tuple[float, str], ...]
    snaps: tuple[float, ...]
    colours: Mapping[str, int]
    beyond: Mapping[str, str]
    most: str
    numbers: tuple[tuple[float, float, str], ...]


# --- what is drawn -------------------------------------------------------------------------------------


def charts(
    motion: Motion, measured: ClearanceResult, name: str, given: tuple[Motion, ClearanceResult] | None = None
) -> Iterator[Chart]:
    """Give the charts of one cable: clearance, bend radius, twist, clamp force and moment, stability.

    Args:
        motion, measured: what was simulated, and its clearances.
        name: of the cable.
        given: the same of the design before, where there was another.
    """
    old = given[0].cables.get(name) if given else None
    at = given[0].motion if given else np.zeros(0)
    near, left_out = _nearest(measured, name)
    if near:
        earlier = _clearances(given[1], name) if given and old else {}
        shown = (at, {series: earlier[series] for series in near if series in earlier}) if earlier else None
        least = sorted({MM * pair.limit for pair in measured.pairs if pair.cable == name and pair.limit is not None})
        yield Chart("Clearance", "mm", motion.motion, near, least, False, shown, True, left_out)
    now = _quantities(motion, name)
    then = _quantities(given[0], name) if given and old else {}
    for title, (unit, limit, most) in _kinds(motion.problem, name).items():
        if not now[title]:  # of clips, where there are none
            continue
        before = (at, then[title]) if then else None
        yield Chart(
            title,
            unit,
            motion.motion,
            now[title],
            () if limit is None else (limit,),
            most,
            before,
            not most and limit != 0,
        )


def _clearances(measured: ClearanceResult, name: str) -> dict[str, Array]:
    itself = Obstacle(name, is_cable=True)
    found = {}  # but of what is never near
    for pair in measured.pairs:
        if math.isfinite(pair.worst) and (name == pair.cable or pair.obstacle == itself):
            other = pair.obstacle if name == pair.cable else Obstacle(pair.cable, is_cable=True)
            found[other.words(name)] = MM * pair.clearance
    return found


def _nearest(measured: ClearanceResult, name: str) -> tuple[dict[str, Array], int]:
    """Return the clearances that come nearest to zero, at most :data:`MOST_SERIES`, and how many others there are."""
    found = _clearances(measured, name)
    order = sorted(found, key=lambda series: float(np.min(found[series])))[:MOST_SERIES]
    return {series: found[series] for series in found if series in order}, len(found) - len(order)


TITLES = {
    LimitKind.BEND_RADIUS: "Smallest bend radius",
    LimitKind.TWIST: "Largest twist",
    LimitKind.CLAMP_FORCE: "Clamp force",
    LimitKind.CLAMP_MOMENT: "Clamp moment",
    LimitKind.TRAVEL: "Travel through a clip",
    LimitKind.CLIP_FORCE: "Clip force",
    LimitKind.CLIP_MOMENT: "Clip moment",
}


def _kinds(problem: Problem, cable: str) -> dict[str, tuple[str, float | None, bool]]:
    """Return unit, limit in that unit, and whether it is the most allowed, by title, of a cable."""
    found: dict[str, tuple[str, float | None, bool]] = {}
    for kind, title in TITLES.items():
        limit = problem.cable_limit(kind, cable)
        shown = None if limit is None else kind.unit.factor * kind.from_si * limit
        found[title] = (kind.unit.name, shown, not kind.is_least)
    return found | {"Stability margin": ("", 0.0, False)}


def _quantities(motion: Motion, cable: str) -> dict[str, dict[str, Array]]:
    """Return the curves (P,) of a cable by title and name, in the units of :func:`_kinds`."""
    shapes, run = motion.cables[cable], motion.problem.cables[cable]

    def ends(load: Array) -> dict[str, Array]:
        return {end: np.linalg.norm(load[:, at], axis=-1) for end, at in (("start", 0), ("end", -1))}

    def clips(load: Array) -> dict[str, Array]:
        at = np.array(shapes.clip_stations, dtype=int)
        jumps = np.linalg.norm(load[:, at] - load[:, at + 1], axis=-1)
        return {clip.name: jumps[:, k] for k, clip in enumerate(run.clips)}

    curvature = np.maximum(np.max(bending(shapes), axis=1), STRAIGHT)
    return {
        "Smallest bend radius": {"": MM / curvature},
        "Largest twist": {"": np.degrees(np.max(np.abs(shapes.curvature[..., 2]), axis=1))},
        "Clamp force": ends(shapes.force),
        "Clamp moment": ends(shapes.moment),
        "Travel through a clip": {clip: MM * (at - at.min()) for clip, at in slides(motion, cable).items()},
        "Clip force": clips(shapes.force),
        "Clip moment": clips(shapes.moment),
        "Stability margin": {"": shapes.stability_margin},
    }


def slides(motion: Motion, cable: str) -> dict[str, Array]:
    """Return the arc lengths (P,), m, at which ``cable`` stands in the clips that it slides through, by their names."""
    found, clips = motion.problem.found, [clip.name for clip in motion.problem.cables[cable].clips if clip.slides]
    return {name: found[clip_key(cable, name)].arc_lengths(motion.motion) for name in clips}


# --- where it goes -------------------------------------------------------------------------------------


def drawn(chart: Chart, snaps: Sequence[float] = ()) -> Drawn:
    """Return ``chart`` laid out, with ``snaps`` at these places of the motion, 0 to 1."""
    every = [*chart.series.values(), *(chart.before[1].values() if chart.before else ())]
    low, high = _range(chart, every)

    def height(value: float) -> float:
        return round(HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM), 1)

    def path(motion: Array, values: Array) -> str:
        return _path(motion, np.clip(values, low, high), height)[0]

    earlier, most = chart.before, max((float(v[np.isfinite(v)].max(initial=-math.inf)) for v in every), default=0.0)
    beyond = {
        name: _path(chart.motion, np.clip(values, low, high), height, high)[1] for name, values in chart.series.items()
    }
    bands = [(TOP, height(limit)) if chart.most else (height(limit), HEIGHT - BOTTOM) for limit in chart.limits[:1]]
    return Drawn(
        chart,
        {
            name: _path(chart.motion, np.clip(values, low, high), height, high)[0]
            for name, values in chart.series.items()
        },
        {name: path(earlier[0], values) for name, values in earlier[1].items()} if earlier else {},
        tuple(height(limit) for limit in chart.limits),
        tuple((top, round(bottom - top, 1)) for top, bottom in bands if bottom > top),
        tuple((height(tick), f"{tick:.10g}") for tick in ticks(low, high)),
        tuple(place(snap) for snap in snaps),
        {
            name: number % COLOURS
            for number, name in enumerate(dict.fromkeys([*chart.series, *(earlier[1] if earlier else ())]))
        },
        {name: line for name, line in beyond.items() if line},
        "far" if most > STRAIGHT_FROM else f"up to {most:.3g} {chart.unit}".rstrip(),
        _numbers(chart, low, high, height),
    )


def _numbers(
    chart: Chart, low: float, high: float, height: Callable[[float], float]
) -> tuple[tuple[float, float, str], ...]:
    """Return where the numbers of several series stand: at their right ends, in turn further to the left."""
    if len(chart.series) < 2:
        return ()
    found = []
    for number, values in enumerate(chart.series.values()):
        known = np.flatnonzero(np.isfinite(values))
        if len(known):
            k = int(known[np.argmin(np.abs(chart.motion[known] - (0.97 - 0.11 * (number % 8))))])
            y = height(float(np.clip(values[k], low, high)))
            found.append((place(float(chart.motion[k])), round(max(y - 3.0, TOP + 8.0), 1), str(number + 1)))
    return tuple(found)


def place(motion: float) -> float:
    """Return how far to the right a moment of the motion stands."""
    return round(LEFT + motion * (WIDTH - LEFT - RIGHT), 1)


def _range(chart: Chart, every: Sequence[Array]) -> tuple[float, float]:
    """Return the smallest and the largest value that the picture shows."""
    values = np.concatenate([np.ravel(v) for v in every]) if every else np.zeros(0)
    values = values[np.isfinite(values)]
    low = min([0.0, *chart.limits, *values[:1], float(values.min(initial=0.0))])
    high = max([*chart.limits, float(values.max(initial=0.0))])
    if chart.bounded and len(values):
        nearest = max([abs(float(values.min())), *(abs(limit) for limit in chart.limits)])
        high = min(high, REACH * nearest) if nearest > 0 else high
    span = high - low or 1.0
    return low - (ROOM * span if low < 0 else 0.0), high + ROOM * span


def ticks(low: float, high: float) -> list[float]:
    """Return round numbers between ``low`` and ``high``: multiples of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough * (1 - 1e-9))
    return [step * k for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def _path(motion: Array, values: Array, height: Callable[[float], float], edge: float = math.inf) -> tuple[str, str]:
    """Return the SVG path of a curve, with gaps where its value is not known, and that of its stretches at ``edge``."""
    found: tuple[list[str], list[str]] = ([], [])
    pens = [math.nan, math.nan]  # where each stands, across
    before = None
    for index in _kept(values):
        if not math.isfinite(values[index]):
            before = None
            continue
        x, y = place(float(motion[index])), height(float(values[index]))
        if before is None:
            found[0].append(f"M{x} {y}")
            pens[0] = x
        else:
            which = int(values[before] >= edge and values[index] >= edge)
            start = place(float(motion[before]))
            if pens[which] != start:
                found[which].append(f"M{start} {height(float(values[before]))}")
            found[which].append(f"L{x} {y}")
            pens[which] = x
        before = index
    return " ".join(found[0]), " ".join(found[1])


def _kept(values: Array) -> Indices:
    """Return the frames that a curve is drawn through: all, or of each stretch the lowest and the highest."""
    if len(values) <= MOST_POINTS:
        return np.arange(len(values))
    kept = {0, len(values) - 1}
    for stretch in np.array_split(np.arange(len(values)), MOST_POINTS // 2):
        known = stretch[np.isfinite(values[stretch])]
        if len(known):
            kept |= {int(known[np.argmin(values[known])]), int(known[np.argmax(values[known])])}
    return np.array(sorted(kept))

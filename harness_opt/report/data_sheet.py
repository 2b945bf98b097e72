"""A motion in the words of cable makers' data sheets: diameters, degrees per metre, ranges and cycles, sag.

A cable's life is stated for a bend radius in diameters and for how far its bending and twist range in each cycle. One
cycle is the motion and back the same way, unless the motion itself comes back to where it began. Cycles are counted
by the rainflow method, ASTM E1049-85 (2017), section 5.4.4, with the package ``rainflow``.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness_opt.clearance.limits import STRAIGHT, bending
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion
from harness_opt.model.spans import clip_key
from harness_opt.numerics.rotations import Array
from harness_opt.report.words import LARGE

Json = dict[str, Any]

HEAD_CLIPS = ("Clip", "Kind", "Held by", "Along the cable", "Largest force", "Largest moment")
MOST_CYCLES = 4  # listed for each quantity, the largest first
CLOSED = 1e-6  # m and rad-like: bodies whose poses differ by less at the end are back where they began
LEAST_RANGE = 1e-3  # of the largest range: smaller cycles wear nothing and are not listed
STILL = 1e-9  # of the largest value: a smaller range is rounding
DIRECTIONS = 360  # across the section, half a degree apart: a range is found to 1e-5 of itself


@dataclass(frozen=True)
class Cycle:
    """A cycle that rainflow counting found, ``count`` times in each cycle of the motion; in the unit of its history."""

    range: float
    mean: float
    count: float


@dataclass(frozen=True)
class Ranging:
    """How far something ranges in one cycle of the motion, where along the cable it ranges most.

    Args:
        range: largest less smallest value.
        arc_length: where that is, m.
        cycles: rainflow counts there, the largest range first.
    """

    range: float
    arc_length: float
    cycles: tuple[Cycle, ...]


@dataclass(frozen=True)
class DataSheet:
    """What one cable goes through.

    Args:
        bend_radius: smallest, m.
        bend_diameters: the same, in diameters of the cable.
        twist: largest, rad/m.
        bend: range of the curvature, 1/m, in the direction across the section in which it is largest.
        twisting: range of the twist, rad/m.
        sag: how far the cable hangs below the lower of its ends, along gravity, m; None without gravity.
        reach: sides of the box along the world's axes that holds the cable at all moments, m.
    """

    bend_radius: float
    bend_diameters: float
    twist: float
    bend: Ranging
    twisting: Ranging
    sag: float | None
    reach: tuple[float, float, float]


def data_sheets(motion: Motion) -> dict[str, DataSheet]:
    """Return the data sheet of each cable of a motion; none where no frame was solved."""
    if not len(motion.motion):
        return {}
    return {name: _sheet(motion.problem, name, shapes) for name, shapes in motion.cables.items()}


@dataclass(frozen=True)
class Mark:
    """Where a cable is cut, or marked for a clip.

    Args:
        cable: its name.
        at: "start", "end", or the name of the clip.
        arc_length: along the cable, m.
        apart: from the mark before, m.
        body: that holds it there.
    """

    cable: str
    at: str
    arc_length: float
    apart: float
    body: str


def cut_list(problem: Problem) -> list[Mark]:
    """Return how to cut and mark the cables that have clips, along each; none is marked where it slides."""
    found = []
    for name, run in problem.cables.items():
        if not run.clips:
            continue
        at = [("start", 0.0, run.start.body)]
        at += [(clip.name, clip.at, clip.body) for clip in run.clips if not clip.slides]
        at.append(("end", run.cable.length, run.end.body))
        places = [0.0, *(place for _, place, _ in at)]
        found += [Mark(name, mark, place, place - places[k], body) for k, (mark, place, body) in enumerate(at)]
    return found


def cut_list_text(marks: Sequence[Mark]) -> str:
    """Return a cut list as CSV, in mm."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["cable", "mark", "arc_length_mm", "from_mark_before_mm", "body"])
    writer.writerows(
        [mark.cable, mark.at, f"{1e3 * mark.arc_length:.10g}", f"{1e3 * mark.apart:.10g}", mark.body] for mark in marks
    )
    return text.getvalue()


def _sheet(problem: Problem, name: str, shapes: CableMotion) -> DataSheet:
    cable, closed = problem.cables[name].cable, _comes_back(problem)
    radius = 1.0 / max(float(np.max(bending(shapes))), STRAIGHT)
    places = shapes.position.reshape(-1, 3)
    x, y, z = (float(side) for side in np.ptp(places, axis=0) + cable.diameter)
    return DataSheet(
        bend_radius=radius,
        bend_diameters=radius / cable.diameter,
        twist=float(np.max(np.abs(shapes.curvature[..., 2]))),
        bend=_bend_ranging(shapes, closed),
        twisting=_twist_ranging(shapes, closed),
        sag=_sag(np.asarray(problem.gravity, dtype=float), shapes),
        reach=(x, y, z),
    )


def _comes_back(problem: Problem) -> bool:
    """Return whether all bodies end the motion where they began it."""
    for name in problem.bodies:
        position, quaternion = problem.poses(name, [0.0, 1.0])
        turned = 1.0 - abs(float(quaternion[0] @ quaternion[1]))
        if np.max(np.abs(position[1] - position[0])) > CLOSED or turned > CLOSED**2:
            return False
    return True


def _bend_ranging(shapes: CableMotion, closed: bool) -> Ranging:
    """Return how the curvature ranges along the direction across the section, and at the place, where it does most."""
    angles = np.arange(DIRECTIONS) * math.pi / DIRECTIONS
    across = np.stack([np.cos(angles), np.sin(angles)])
    ranges = np.array([np.ptp(vectors @ across, axis=0) for vectors in shapes.curvature[..., :2].swapaxes(0, 1)])
    station, direction = np.unravel_index(int(np.argmax(ranges)), ranges.shape)
    history = shapes.curvature[:, station, :2] @ across[:, direction]
    return Ranging(float(ranges[station, direction]), float(shapes.s[station]), rainflow_cycles(history, closed))


def _twist_ranging(shapes: CableMotion, closed: bool) -> Ranging:
    twist = shapes.curvature[..., 2]
    ranges = np.ptp(twist, axis=0)
    station = int(np.argmax(ranges))
    return Ranging(float(ranges[station]), float(shapes.s[station]), rainflow_cycles(twist[:, station], closed))


def rainflow_cycles(history: Array, closed: bool) -> tuple[Cycle, ...]:
    """Return the cycles of a history that is repeated for ever, the largest range first.

    Args:
        history: (P,).
        closed: whether it comes back to where it began; one that does not goes back the same way.
    """
    import rainflow

    total = float(np.ptp(history)) if len(history) else 0.0
    if total <= STILL * float(np.max(np.abs(history), initial=0.0)):
        return ()
    whole = history if closed else np.concatenate([history, history[-2::-1]])
    # so begun, a repeated history has whole cycles only: ASTM E1049-85, 5.4.5; both ends of it are one moment
    first = int(np.argmax(whole))
    repeated = np.concatenate([whole[first:-1], whole[: first + 1]])
    found: dict[tuple[int, int], Cycle] = {}
    for size, mean, count, _, _ in rainflow.extract_cycles(repeated):
        if size > LEAST_RANGE * total:  # what agrees to that counts as equal, so that the way back adds to the way out
            key = (round(size / (LEAST_RANGE * total)), round(mean / (LEAST_RANGE * total)))
            before = found.get(key, Cycle(float(size), float(mean), 0.0))
            found[key] = Cycle(before.range, before.mean, before.count + count)
    return tuple(sorted(found.values(), key=lambda cycle: -cycle.range))


def _sag(gravity: Array, shapes: CableMotion) -> float | None:
    """Return how far the cable hangs below the lower of its ends, at most, m."""
    weight = float(np.linalg.norm(gravity))
    if not weight:
        return None
    depth = shapes.position @ (gravity / weight)  # (P, N)
    below = depth.max(axis=1) - np.maximum(depth[:, 0], depth[:, -1])
    return float(np.max(below))


# --- tables of a page ---------------------------------------------------------------------------


def sheet_rows(motion: Motion, sheets: Mapping[str, DataSheet]) -> Json:
    """Return the data sheets as a table: a column for each cable, and a note on what a cycle is."""
    cables = motion.problem.cables

    def ranging(found: Ranging, scale: float, unit: str) -> str:
        return f"{scale * found.range:.3g} {unit}, at {1e3 * found.arc_length:.0f} mm"

    def cycles(found: Ranging, scale: float, unit: str) -> str:
        listed = [f"{cycle.count:g} x {scale * cycle.range:.3g}" for cycle in found.cycles[:MOST_CYCLES]]
        more = ", ..." if len(found.cycles) > MOST_CYCLES else ""
        return f"{', '.join(listed)}{more} {unit}" if listed else "none"

    turn = math.degrees(1.0)
    rows = {
        "Length": [f"{1e3 * cables[n].cable.length:.1f} mm" for n in sheets],
        "Diameter": [f"{1e3 * cables[n].cable.diameter:.2f} mm" for n in sheets],
        "Smallest bend radius": [_straight(s.bend_radius, f"{1e3 * s.bend_radius:.1f} mm") for s in sheets.values()],
        "in diameters": [_straight(s.bend_radius, f"{s.bend_diameters:.1f}") for s in sheets.values()],
        "Largest twist": [f"{turn * s.twist:.0f} deg/m" for s in sheets.values()],
        "Bending range in a cycle": [ranging(s.bend, 1.0, "1/m") for s in sheets.values()],
        "Bending cycles (rainflow)": [cycles(s.bend, 1.0, "1/m") for s in sheets.values()],
        "Strain range at the surface": [
            f"{100 * cables[n].cable.radius * s.bend.range:.2g} %" for n, s in sheets.items()
        ],
        "Twist range in a cycle": [ranging(s.twisting, turn, "deg/m") for s in sheets.values()],
        "Twist cycles (rainflow)": [cycles(s.twisting, turn, "deg/m") for s in sheets.values()],
        "Sag below the lower end": ["-" if s.sag is None else f"{1e3 * s.sag:.1f} mm" for s in sheets.values()],
        "Room taken, along x, y, z": [
            " x ".join(f"{1e3 * side:.0f}" for side in s.reach) + " mm" for s in sheets.values()
        ],
    }
    note = (
        "A cycle is the motion and back the same way, unless the motion ends where it began. Strain: as if the cable "
        "were solid; the strands of a cable slide, so theirs is less."
    )
    return {"names": list(sheets), "rows": list(rows.items()), "note": note}


def _straight(radius: float, words: str) -> str:
    return words if radius < LARGE else "straight"


def clip_rows(motion: Motion) -> Json | None:
    """Return what the clips do as a table; None where cables have none."""
    rows = []
    for use in clip_uses(motion):
        slid = (
            f"{1e3 * use.least:.1f} to {1e3 * use.most:.1f} mm" if use.most > use.least else f"{1e3 * use.first:.1f} mm"
        )
        rows.append(
            (f"{use.cable}, {use.clip}", use.kind, use.body, slid, f"{use.force:.2f} N", f"{use.moment:.3f} N m")
        )
    return {"head": HEAD_CLIPS, "rows": rows} if rows else None


# --- clips -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ClipUse:
    """What a clip does over the motion.

    Args:
        cable, clip, kind, body: as described.
        first, least, most: arc lengths at which the cable stands in it, m: in the first frame, and over the motion.
        force, moment: the largest that it applies to the cable, N and N m.
    """

    cable: str
    clip: str
    kind: str
    body: str
    first: float
    least: float
    most: float
    force: float
    moment: float


def clip_uses(motion: Motion) -> Iterator[ClipUse]:
    """Give what all clips of a solved motion do, along each cable."""
    for name, shapes in motion.cables.items():
        for clip, station in zip(motion.problem.cables[name].clips, shapes.clip_stations, strict=True):
            found = motion.problem.found.get(clip_key(name, clip.name))
            slides = found is not None and found.places is not None
            places = found.arc_lengths(motion.motion) if found is not None and slides else np.array([clip.at])
            force, moment = (
                float(np.max(np.linalg.norm(load[:, station] - load[:, station + 1], axis=1)))
                for load in (shapes.force, shapes.moment)
            )
            ways = float(places[0]), float(places.min()), float(places.max())
            yield ClipUse(name, clip.name, clip.kind, clip.body, *ways, force, moment)

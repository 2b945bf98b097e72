"""Is a verdict ever falsely green? Random scenes with coarse steps, against brute force on 20 times the frames.

    python scripts/checks/verdicts.py                  # 200 scenes, half an hour
    python scripts/checks/verdicts.py 30 --seed 4      # others
    python scripts/checks/verdicts.py 1 --first 17     # one of them, row by row
    python scripts/checks/verdicts.py 20 --heavy       # heavy cables on steps of 10 and 2 mm: what a certificate takes

The brute force knows nothing of certificates: distances by the closed forms of boxes, balls, cylinders and capsules
(meshes are made of boxes) from many points of every frame, what counts near clamps by the rule that the guide states,
and bends, twists and loads as they are in the stations of all frames. What it finds is there; so a "yes" with less than
nothing to spare is wrong, and so is a certificate that says that nothing is that bad.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import math
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from verdict_scenes import FINER, KINDS, Drawn, draw

import harness_opt as ho
from harness_opt.clearance.limits import all_limits
from harness_opt.model.limits import LimitKind
from harness_opt.model.results import CableMotion, LimitResult
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

BETWEEN = 4  # points of the brute force for each station
NOTHING = 2e-3  # of a diameter, or of a limit: by this the brute force may be off itself
MOST_BETWEEN = 40  # moments that are looked at for each frame, of what moves fast
CLOSE = 5  # frames in which two cables are nearest, looked at more finely
GRID = 41  # places on either cable round the nearest ones there


# --- brute force ------------------------------------------------------------------------------------------


def box_distance(points: Array, size: Array) -> Array:
    """Return the signed distances (...,) of points (..., 3) to a box about the origin, m."""
    q = np.abs(points) - 0.5 * np.asarray(size)
    return np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(axis=-1), 0.0)


def distance(points: Array, shape: object, boxes: tuple[Array, Array] | None) -> Array:
    """Return the signed distances (...,) of points (..., 3) to a part, in its own coordinates, m.

    Of a mesh of several boxes too small within it; its sign is right.
    """
    if boxes is not None:
        return np.min([box_distance(points - centre, size) for centre, size in zip(*boxes, strict=True)], axis=0)
    if isinstance(shape, ho.Box):
        return box_distance(points, shape.size)
    if isinstance(shape, ho.Sphere):
        return np.linalg.norm(points, axis=-1) - shape.radius
    along = np.abs(points[..., 2]) - 0.5 * shape.length
    across = np.linalg.norm(points[..., :2], axis=-1)
    if isinstance(shape, ho.Capsule):
        return np.hypot(across, np.maximum(along, 0.0)) - shape.radius
    q = np.stack([across - shape.radius, along], axis=-1)
    return np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(axis=-1), 0.0)


def dense(shapes: CableMotion, between: int = BETWEEN) -> tuple[Array, Array]:
    """Return arc lengths (M,) and points (P, M, 3), m: splines through the stations of every frame."""
    s = np.interp(np.arange((len(shapes.s) - 1) * between + 1) / between, np.arange(len(shapes.s)), shapes.s)
    return s, np.moveaxis(CubicSpline(shapes.s, np.moveaxis(shapes.position, 1, 0))(s), 0, 1)


def to_part(drawn: Drawn, cable: str, name: str) -> float:
    """Return the smallest clearance of a cable to a part that counts in any frame, m.

    Where the cable moves by more than a quarter of its diameter against the part between two frames, and does not snap,
    splines through all frames stand in for it in between.
    """
    problem, fine = drawn.problem, drawn.fine
    radius, part = problem.cables[cable].cable.radius, problem.parts[name]
    s, points = dense(fine.cables[cable])
    seen, steps = from_part(problem, part, fine.motion, points), 1
    ways = np.linalg.norm(np.diff(seen, axis=0), axis=-1).max() if len(seen) > 1 else 0.0
    if not any(snap.cable == cable for snap in fine.snaps):
        steps = int(np.clip(math.ceil(ways / (0.5 * radius)), 1, MOST_BETWEEN))
    clearance = [shape_clearance(drawn, name, seen, radius)]
    spline = CubicSpline(fine.motion, points) if steps > 1 else None
    for k in range(1, steps):
        times = fine.motion[:-1] + k / steps * np.diff(fine.motion)
        clearance.append(shape_clearance(drawn, name, from_part(problem, part, times, spline(times)), radius))
    return counted(np.concatenate(clearance), s, drawn, cable, name)


def from_part(problem: ho.Problem, part: ho.Part, times: Array, points: Array) -> Array:
    """Return points (P, M, 3), world, in a part's own coordinates at motion values (P,)."""
    position, turn = problem.poses(part.body, times)
    return in_part(part, rotations.rotate(rotations.conjugate(turn)[:, None], points - position[:, None]))


def in_part(part: ho.Part, points: Array) -> Array:
    """Return points (..., 3) of a body in the coordinates of its part."""
    return rotations.rotate(rotations.conjugate(np.asarray(part.quaternion)), points - np.asarray(part.position))


def shape_clearance(drawn: Drawn, name: str, points: Array, radius: float) -> Array:
    """Return the clearances (...,) of places on a cable (..., 3) in the coordinates of part ``name``, m."""
    return distance(points, drawn.problem.parts[name].shape, drawn.boxes.get(name)) - radius


def counted(clearance: Array, s: Array, drawn: Drawn, cable: str, name: str) -> float:
    """Return the smallest of clearances (P, M) that counts: near a clamp only where its holder is entered again."""
    problem = drawn.problem
    run, part, limit = problem.cables[cable], problem.parts[name], problem.limits.clearance
    radius, again = run.cable.radius, math.inf
    counts = np.ones(len(s), dtype=bool)
    for given, from_end in ((run.start, s), (run.end, s[-1] - s)):
        if given.holders is not None:
            holds = name in given.holders
        else:
            holds = shape_clearance(drawn, name, in_part(part, np.asarray(given.position)), radius) < 0
        if given.body != part.body or not holds:
            continue
        near = from_end <= (max(radius + limit, 4 * radius) if given.let_off is None else given.let_off)
        counts &= ~near
        way = clearance[:, near] if given is run.start else clearance[:, near][:, ::-1]
        left = np.maximum.accumulate(way >= 0, axis=1)
        depth = float(np.where(left, way, np.inf).min(initial=math.inf))
        if depth < -0.02 * radius - NOTHING * 2 * radius:  # touching is none
            again = min(again, depth)
    return min(float(clearance[:, counts].min(initial=math.inf)), again)


def to_cable(drawn: Drawn, cable: str, other: str) -> float:
    """Return the smallest clearance between two cables, or a cable and itself, that counts in any frame, m."""
    runs, shapes = drawn.problem.cables, drawn.fine.cables
    radii = runs[cable].cable.radius + runs[other].cable.radius
    gap = 0.5 * math.pi * (radii + drawn.problem.limits.clearance)
    one, two = shapes[cable], shapes[other]

    def counts(s: Array, t: Array) -> Array:
        if cable == other:
            return t - s[:, None] >= gap
        keep = np.ones((len(s), len(t)), dtype=bool)
        for mine, near in ((runs[cable].start, s < gap), (runs[cable].end, one.s[-1] - s < gap)):
            for its, its_near in ((runs[other].start, t < gap), (runs[other].end, two.s[-1] - t < gap)):
                if mine.body == its.body and math.dist(mine.position, its.position) < radii:
                    keep &= ~(near[:, None] & its_near)
        return keep

    allowed = counts(one.s, two.s)
    if not np.any(allowed):
        return math.inf
    least = []
    for p, q in zip(one.position, two.position, strict=True):
        square = np.sum(p * p, -1)[:, None] + np.sum(q * q, -1) - 2 * p @ q.T
        square[~allowed] = np.inf
        least.append((float(square.min()), int(square.argmin())))
    order = np.argsort([value for value, _ in least])[:CLOSE]
    best = math.inf
    for frame in order:
        i, j = divmod(least[frame][1], len(two.s))
        s, t = (np.linspace(x.s[max(k - 2, 0)], x.s[min(k + 2, len(x.s) - 1)], GRID) for x, k in ((one, i), (two, j)))
        p, q = (CubicSpline(x.s, x.position[frame])(at) for x, at in ((one, s), (two, t)))
        ways = np.linalg.norm(p[:, None] - q, axis=-1)
        best = min(best, float(ways[counts(s, t)].min(initial=math.inf)))
    return best - radii


def true_worst(drawn: Drawn, row: LimitResult) -> float:
    """Return the worst that the brute force finds of what a row is about, in its unit."""
    kind, shapes = row.id.kind, drawn.fine.cables[row.cable]
    if kind is LimitKind.CLEARANCE:
        obstacle = row.id.obstacle
        find = to_cable if obstacle.is_cable else to_part
        return find(drawn, row.cable, obstacle.name)
    if kind is LimitKind.BEND_RADIUS:
        return 1.0 / max(float(np.linalg.norm(shapes.curvature[..., :2], axis=-1).max()), 1e-9)
    if kind is LimitKind.TWIST:
        return float(np.abs(shapes.curvature[..., 2]).max())
    loads = shapes.force if kind is LimitKind.CLAMP_FORCE else shapes.moment
    return float(np.linalg.norm(loads[:, [0, -1]], axis=-1).max())


# --- a verdict --------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Judged:
    """A row of a scene, and what the brute force says of it.

    Args:
        scene, kind: number and kind of the scene.
        row: as the program gives it.
        true: the worst that the brute force finds.
        slack: by which that may be off, in the unit of the row.
        snaps: whether a cable of it snaps somewhere, on the coarse step or on many frames.
    """

    scene: int
    kind: str
    row: LimitResult
    true: float
    slack: float
    snaps: bool

    @property
    def margin(self) -> float:
        """What there is to spare in truth."""
        return self.true - self.row.limit if self.row.id.kind.is_least else self.row.limit - self.true

    @property
    def wrong_yes(self) -> bool:
        """Whether the row holds, and does not."""
        return self.row.holds == "yes" and self.margin < -self.slack

    @property
    def wrong_certificate(self) -> bool:
        """Whether something is worse than a certified row allows."""
        beyond = self.row.margin - self.margin
        return self.row.certified and math.isfinite(beyond) and beyond > self.row.tolerance + self.slack

    @property
    def words(self) -> str:
        """One line."""
        row = self.row
        return (
            f"{self.scene:4d} {self.kind:12s} {row.id!s:28s} limit {row.limit:.6g} worst {row.worst:.6g} "
            f"+- {row.tolerance:.2g} at {row.motion:.5f}, s {row.arc_length:.4g}: {row.holds}, true {self.true:.6g}"
            + (f" ({row.reason})" if row.reason else "")
        )


@dataclasses.dataclass(frozen=True)
class Seen:
    """What a scene gave: its rows, frames solved between others, and whether it came another way than on many frames.

    Args:
        rows: judged.
        frames, inserted: of the coarse step, and solved between them.
        elsewhere: the largest difference of a shape from that on many frames, in lengths of the cable.
        noted: whether a snap was seen on either way.
        warned: warnings of numpy and others.
    """

    rows: list[Judged]
    frames: int
    inserted: int
    elsewhere: float
    noted: bool
    warned: list[str]


def judged(drawn: Drawn, number: int, kind: str) -> Seen | None:
    """Return what the program says of a scene on its coarse step, judged; None where it finds no shape."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            motion = ho.simulate(drawn.problem, frames=drawn.frames)
        except ho.SolveError:
            return None
        found = ho.clearances(motion)
        rows = all_limits(drawn.problem, motion, found)
    jumping = {snap.cable for snap in (*motion.snaps, *drawn.fine.snaps)}
    judged_rows = []
    for row in rows:
        diameter = drawn.problem.cables[row.cable].cable.diameter
        slack = NOTHING * (diameter if row.id.kind is LimitKind.CLEARANCE else row.limit)
        of = {row.cable, row.id.obstacle.name} if row.id.obstacle and row.id.obstacle.is_cable else {row.cable}
        judged_rows.append(Judged(number, kind, row, true_worst(drawn, row), slack, bool(of & jumping)))
    return Seen(
        rows=judged_rows,
        frames=len(motion.motion),
        inserted=sum(found.inserted.values()),
        elsewhere=apart(motion, drawn.fine),
        noted=bool(motion.snaps or drawn.fine.snaps),
        warned=[str(warning.message) for warning in caught],
    )


def apart(coarse: ho.Motion, fine: ho.Motion) -> float:
    """Return how far shapes of the same moments are apart, at most, in lengths of the cable."""
    most = 0.0
    for name, shapes in coarse.cables.items():
        other = fine.cables[name]
        points = CubicSpline(other.s, np.moveaxis(other.position[::FINER], 1, 0))(shapes.s)
        most = max(most, float(np.abs(np.moveaxis(points, 0, 1) - shapes.position).max()) / shapes.s[-1])
    return most


def scenes(seed: int, numbers: range) -> Iterator[tuple[int, str, Seen | None]]:
    """Give the number, the kind and what there was to see of each scene; None where there was no shape."""
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:
            kind = KINDS[number % len(KINDS)]
            drawn = draw(seed, number, Path(folder))
            yield number, kind, None if drawn is None else judged(drawn, number, kind)


def heavy(seed: int, numbers: range) -> None:
    """Print what the certificates of heavy cables, w L^3 / B from 1e3 to 1e5, take on steps of 10 and 2 mm."""
    more: dict[float, list[int]] = {0.01: [], 0.002: []}
    uncertified: list[str] = []
    rows = 0
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for number in numbers:
            for step, inserted in more.items():
                drawn = draw(seed, len(KINDS) * number + KINDS.index("heavy"), Path(folder), step, 1)
                if drawn is None:
                    continue
                found = ho.clearances(drawn.fine)
                limits = all_limits(drawn.problem, drawn.fine, found)
                rows += len(limits)
                uncertified += [f"{number} {step} {row.id}: {row.reason}" for row in limits if not row.certified]
                inserted.append(sum(found.inserted.values()))
        warned = len(caught)
    for step, inserted in more.items():
        print(
            f"{1e3 * step:g} mm: {len(inserted)} scenes, {np.median(inserted):.0f} more frames, at most {max(inserted)}"
        )
    print(f"{rows} rows, {len(uncertified)} not certified, {warned} warnings", *uncertified, sep="\n  ")


def why(row: Judged) -> str:
    """Return why a row is uncertain, in a few words."""
    if row.snaps:
        return "snap"
    reason = row.row.reason.partition("): ")[2] or row.row.reason
    return reason.partition(":")[2].strip() or reason or "margin below the tolerance"


def main() -> None:
    """Judge the scenes, and print what they came to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--heavy", action="store_true", help="heavy cables alone, on steps of 10 and 2 mm")
    options = parser.parse_args()
    if options.heavy:
        heavy(options.seed, range(options.first, options.first + options.count))
        return
    rows: list[Judged] = []
    counts: collections.Counter[str] = collections.Counter()
    elsewhere, inserted = [], collections.defaultdict(list)
    begin = time.perf_counter()
    for number, kind, seen in scenes(options.seed, range(options.first, options.first + options.count)):
        counts["no shape somewhere" if seen is None else "scenes"] += 1
        if seen is None:
            continue
        rows += seen.rows
        inserted[kind].append(seen.inserted)
        counts["warnings"] += len(seen.warned)
        if seen.elsewhere > 1e-3:
            elsewhere.append((number, kind, seen.elsewhere, seen.noted))
        for row in seen.rows:
            if options.count == 1 or row.wrong_yes or row.wrong_certificate or row.row.holds == "uncertain":
                what = "WRONG YES " if row.wrong_yes else "WRONG CERTIFICATE " if row.wrong_certificate else ""
                print(what + row.words, flush=True)
    print(f"\n{dict(counts)}, {time.perf_counter() - begin:.0f} s")
    print(f"rows: {dict(collections.Counter(row.row.holds for row in rows))} of {len(rows)}")
    uncertain = [row for row in rows if row.row.holds == "uncertain"]
    for reason, count in collections.Counter(map(why, uncertain)).most_common():
        print(f"  uncertain: {count:4d} {reason}")
    print(f"wrong yes: {sum(row.wrong_yes for row in rows)}")
    print(f"greens that rest on rows not certified: {sum(r.row.holds == 'yes' and not r.row.certified for r in rows)}")
    print(f"wrong certificates: {sum(row.wrong_certificate for row in rows)}")
    for kind, some in inserted.items():
        print(f"frames solved between others, {kind}: {np.median(some):.0f} in the median, at most {max(some)}")
    for number, kind, far, noted in elsewhere:
        print(f"  another way, by {far:.1e} L: scene {number}, {kind}, {'a snap noted' if noted else 'NO SNAP NOTED'}")


if __name__ == "__main__":
    main()

"""The bodies of a problem file: their keys, what their motions are read to, and the CSV tables that these name."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from harness_opt.errors import ProblemError
from harness_opt.files.places import MEGABYTE, Places
from harness_opt.files.values import QUATERNION_TOLERANCE, Digest, Direction, Number, Table, Text, Vector
from harness_opt.model.between import Tree, table
from harness_opt.model.bodies import SHORTEST, WORLD, BodyMotion, Hinge, Poses, Slide
from harness_opt.model.checks import LARGEST, Mistake, shown
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

HEADER = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
GAP = 10.0  # a time interval this many medians long is a gap: a spline would invent the motion in it
MOST_LINES = 100_000  # a thousand a second for more than a minute; more take long and tell nothing more
MOST_MISTAKES = 10  # a table with the wrong columns is wrong in every line; the first few tell it
MOST_TABLE_BYTES = 20 * MEGABYTE  # a hundred thousand rows of eight doubles


class HingeTable(Table):
    """Turning about a fixed line; at angle 0 body coordinates are the parent's, the world's where none is named."""

    kind: Literal["hinge"] = Field(description="Turning about a fixed line.")
    point: Vector = Field(description="A point on the line, m.")
    axis: Direction = Field(description="Direction of the line, any length.")
    from_deg: Number = Field(description="First angle, degrees.")
    to_deg: Number = Field(description="Last angle, degrees.")


class SlideTable(Table):
    """Straight motion without turning; at travel 0 body coordinates are the parent's, the world's if it has none."""

    kind: Literal["slide"] = Field(description="Straight motion without turning.")
    direction: Direction = Field(description="Direction of travel, any length.")
    from_: Number = Field(alias="from", description="First travel, m.")
    to: Number = Field(description="Last travel, m.")


class PosesTable(Table):
    """A tabulated motion in the parent: positions by a cubic spline, rotations by a smooth one on the sphere."""

    kind: Literal["poses"] = Field(description="A table of poses.")
    file: Text = Field(
        description="CSV with the header t,x,y,z,qw,qx,qy,qz (s, m, unit quaternion), relative to this file."
    )
    file_sha256: Digest | None = Field(
        default=None,
        description="SHA-256 of the table; with it, the table may lie outside this file's folder.",
    )


MotionTable = Annotated[HingeTable | SlideTable | PosesTable, Field(discriminator="kind")]
MOTION_KINDS = ("hinge", "slide", "poses")
_MOTION: TypeAdapter[Any] = TypeAdapter(MotionTable)


class BodyTable(Table):
    """A rigid body; without a motion it is fixed to its parent, its coordinates those of the parent."""

    parent: Text = Field(
        default="world", description="Name of the body that carries it; its motion is relative to that one."
    )
    motion: MotionTable | None = Field(default=None, description="How the body moves: hinge, slide or poses.")


# --- reading -------------------------------------------------------------------------------------------


def motions_of(
    tree: Tree, places: Places, pending: Mapping[Path, bytes]
) -> tuple[dict[str, BodyMotion | None], list[Mistake]]:
    """Return the motions of all bodies whose tables are in order, and the mistakes in tables of poses."""
    motions: dict[str, BodyMotion | None] = {WORLD: None}
    mistakes: list[Mistake] = []
    for name in table(tree, "bodies"):
        body = tree["bodies"][name]
        if name == WORLD or not isinstance(body, Mapping):
            continue
        if "motion" not in body:
            motions[name] = None
            continue
        try:
            motion = _MOTION.validate_python(body["motion"])
        except ValidationError:
            continue  # named already when the whole file was structured
        try:
            motions[name] = _motion(motion, places, pending)
        except ProblemError as error:
            path = ("bodies", name, "motion", "file")
            mistakes.extend((path, line) for line in error.mistakes)
    return motions, mistakes


def _motion(motion: Any, places: Places, pending: Mapping[Path, bytes]) -> BodyMotion:
    if isinstance(motion, HingeTable):
        return Hinge(motion.point, motion.axis, math.radians(motion.from_deg), math.radians(motion.to_deg))
    if isinstance(motion, SlideTable):
        return Slide(motion.direction, motion.from_, motion.to)
    file = places.located(motion.file)
    if file in pending:
        return parse_poses(pending[file], file)
    why = places.fault(motion.file, "a table of poses", motion.file_sha256, MOST_TABLE_BYTES)
    if why:
        raise ProblemError(why)
    return parse_poses(file.read_bytes(), file)


# --- CSV tables ---------------------------------------------------------------------------------------


def parse_poses(content: bytes, file: Path) -> Poses:
    """Return the motion that a CSV table holds.

    A header ``t,x,y,z,qw,qx,qy,qz``, then rows of s, m and a unit quaternion; blank lines and what follows
    a ``#`` are skipped. Quaternions that are unit but for rounding (``QUATERNION_TOLERANCE``) are normalised,
    and their signs chosen so that neighbours lie on the same side.

    Args:
        content: the bytes of the file.
        file: where they come from, for messages and :attr:`Poses.file`.

    Raises:
        ProblemError: one line a mistake, ``arm.csv, line 4: found ..., expected ...``.
    """
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ProblemError(f"{file.name}, line {line}: found bytes that are not UTF-8, expected text") from None
    if len(lines) > MOST_LINES:
        raise ProblemError(f"{file.name}: found {len(lines):,} lines, expected at most {MOST_LINES:,}")
    numbered = [(i, line.partition("#")[0].strip()) for i, line in enumerate(lines, 1)]
    filled = [(i, [cell.strip() for cell in line.split(",")]) for i, line in numbered if line]
    if not filled:
        raise ProblemError(f"{file.name}, line 1: found nothing, expected the header {','.join(HEADER)}")
    number, header = filled[0]
    if tuple(cell.lower() for cell in header) != HEADER:
        found = shown(",".join(header))
        raise ProblemError(f"{file.name}, line {number}: found {found}, expected the header {','.join(HEADER)}")

    mistakes: list[str] = []
    rows: list[list[float]] = []
    at: list[int] = []  # line of each good row
    for i, cells in filled[1:]:
        wrong = _row_mistake(cells)
        if wrong:
            mistakes.append(f"{file.name}, line {i}: {wrong}")
        else:
            rows.append([float(cell) for cell in cells])
            at.append(i)
    mistakes.extend(f"{file.name}, line {at[i]}: {words}" for i, words in _time_mistakes(rows))
    if len(rows) < 2 and not mistakes:
        rows_found = f"{len(rows)} row" + ("" if len(rows) == 1 else "s")
        mistakes.append(f"{file.name}: found {rows_found}, expected at least two")
    if len(mistakes) > MOST_MISTAKES:
        left = len(mistakes) - MOST_MISTAKES
        mistakes[MOST_MISTAKES:] = [f"{file.name}: found {left} more mistakes like these, expected none"]
    if mistakes:
        raise ProblemError(mistakes)
    return _poses(np.array(rows), file)


def poses_text(poses: Poses) -> str:
    """Return the CSV table of ``poses``; every number reads back to the same bits."""
    rows = [
        ",".join(repr(float(number)) for number in (t, *position, *quaternion))
        for t, position, quaternion in zip(poses.times, poses.positions, poses.quaternions, strict=True)
    ]
    return "\n".join(["# s, m, unit quaternion (scalar first)", ",".join(HEADER), *rows, ""])


def _row_mistake(cells: list[str]) -> str:
    """Return what is wrong with one row on its own, or an empty text."""
    if len(cells) != len(HEADER):
        return f"found {len(cells)} values, expected {len(HEADER)} numbers ({','.join(HEADER)})"
    numbers = []
    for name, cell in zip(HEADER, cells, strict=True):
        try:
            numbers.append(float(cell))
        except ValueError:
            return f"found {shown(cell)} as {name}, expected a number"
        if not abs(numbers[-1]) <= LARGEST:
            return f"found {cell} as {name}, expected a finite number"
    length = math.hypot(*numbers[4:])
    if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
        return f"found a quaternion of length {length:.6g}, expected 1 to within {QUATERNION_TOLERANCE:g}"
    return ""


def _time_mistakes(rows: list[list[float]]) -> Iterator[tuple[int, str]]:
    """Yield the rows whose time does not fit the one before: not increasing, or after a gap."""
    times = [row[0] for row in rows]
    intervals = [b - a for a, b in itertools.pairwise(times)]
    median = float(np.median([d for d in intervals if d > 0] or [0.0]))
    for i, interval in enumerate(intervals, 1):
        if not interval > 0:
            yield i, f"found t = {times[i]:g} after {times[i - 1]:g}, expected increasing times"
        elif interval < SHORTEST:
            yield i, f"found t = {times[i]:g} after {times[i - 1]:g}, expected at least {SHORTEST:g} s between them"
        elif interval > GAP * median:
            words = f"expected no interval above {GAP:g} times the median, {median:g} s"
            yield i, f"found a gap from t = {times[i - 1]:g} to {times[i]:g}, {words}"


def _poses(rows: Array, file: Path) -> Poses:
    quaternions = rotations.unit(rows[:, 4:])
    turned = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    signs = np.concatenate([[1.0], np.cumprod(np.where(turned, -1.0, 1.0))])
    return Poses(
        times=tuple(rows[:, 0].tolist()),
        positions=tuple(map(tuple, rows[:, 1:4].tolist())),
        quaternions=tuple(map(tuple, (signs[:, None] * quaternions).tolist())),
        file=file,
    )

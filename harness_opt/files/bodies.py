"""The bodies of a problem file: their keys, what their motions are read to, and the CSV tables that these name."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, JsonValue, TypeAdapter, ValidationError

from harness_opt.errors import ProblemError
from harness_opt.files.places import MEGABYTE, Places
from harness_opt.files.values import (
    QUATERNION_TOLERANCE,
    AngleUnit,
    Digest,
    Direction,
    Flag,
    NotNegative,
    Number,
    Positive,
    Quaternion,
    ShapesOfLinks,
    Table,
    Text,
    TravelUnit,
    Vector,
)
from harness_opt.model.bodies import WORLD, BodyMotion, Hinge, Poses, Slide
from harness_opt.model.checks import LARGEST, KeyPath, Mistake, Tree, shown, table
from harness_opt.model.courses import SHORTEST, Move, Moves, ValueTable
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

HEADER = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
GAP = 10.0  # a time interval this many medians long is a gap: a spline would invent the motion in it
MOST_LINES = 100_000  # a thousand a second for more than a minute; more take long and tell nothing more
MOST_MISTAKES = 10  # a table with the wrong columns is wrong in every line; the first few tell it
PER_UNIT = {"rad": 1.0, "deg": math.radians(1.0), "m": 1.0, "mm": 1e-3}
MOST_TABLE_BYTES = 20 * MEGABYTE  # a hundred thousand rows of eight doubles


class HingeMoveTable(Table):
    """One move of a hinge, eased, at rest before and after."""

    to_deg: Number = Field(description="Where it ends, degrees.")
    seconds: Positive = Field(description="That it takes, s.")
    dwell: NotNegative = Field(default=0.0, description="How long it then stands still, s.")


class SlideMoveTable(Table):
    """One move along a slide, eased, at rest before and after."""

    to: Number = Field(description="Where it ends, m.")
    seconds: Positive = Field(description="That it takes, s.")
    dwell: NotNegative = Field(default=0.0, description="How long it then stands still, s.")


WAYS = {"hinge": ("from_deg", "to_deg"), "slide": ("from", "to")}  # first and last value
SHA256 = "SHA-256 of the table; with it, the table may lie outside this file's folder."
VALUES = (
    "CSV with the header t,value (s, and the value in unit), relative to this file; a cubic spline goes through it."
)
MOVES = "Moves one after the other, at rest between; beside them, only the first value is given."


def _goes(first: str, last: str) -> ConfigDict:
    """Return the JSON Schema of what a hinge or a slide goes by: first and last value, a table, or moves."""
    ways: list[JsonValue] = [[first, last], ["file"], ["moves"]]
    never: list[JsonValue] = [["file", first], ["file", last], ["file", "moves"], ["moves", last]]
    return ConfigDict(
        json_schema_extra={
            "anyOf": [{"required": way} for way in ways],
            "allOf": [{"not": {"required": both}} for both in never],
            "dependentRequired": {"unit": ["file"], "file_sha256": ["file"]},
        }
    )


class HingeTable(Table):
    """Turning about a fixed line; at angle 0 body coordinates are the parent's, the world's where none is named."""

    model_config = _goes(*WAYS["hinge"])

    kind: Literal["hinge"] = Field(description="Turning about a fixed line.")
    point: Vector = Field(description="A point on the line, m.")
    axis: Direction = Field(description="Direction of the line, any length.")
    from_deg: Number | None = Field(default=None, description="First angle, degrees; 0 beside moves.")
    to_deg: Number | None = Field(default=None, description="Last angle, degrees, to which it goes evenly.")
    file: Text | None = Field(default=None, description=VALUES)
    file_sha256: Digest | None = Field(default=None, description=SHA256)
    unit: AngleUnit | None = Field(default=None, description="Of the table's angles; rad where left out.")
    moves: list[HingeMoveTable] | None = Field(default=None, description=MOVES, min_length=1)


class SlideTable(Table):
    """Straight motion without turning; at travel 0 body coordinates are the parent's, the world's if it has none."""

    model_config = _goes(*WAYS["slide"])

    kind: Literal["slide"] = Field(description="Straight motion without turning.")
    direction: Direction = Field(description="Direction of travel, any length.")
    from_: Number | None = Field(default=None, alias="from", description="First travel, m; 0 beside moves.")
    to: Number | None = Field(default=None, description="Last travel, m, to which it goes evenly.")
    file: Text | None = Field(default=None, description=VALUES)
    file_sha256: Digest | None = Field(default=None, description=SHA256)
    unit: TravelUnit | None = Field(default=None, description="Of the table's travels; m where left out.")
    moves: list[SlideMoveTable] | None = Field(default=None, description=MOVES, min_length=1)


class PosesTable(Table):
    """A tabulated motion in the parent: positions by a cubic spline, rotations by a smooth one on the sphere."""

    kind: Literal["poses"] = Field(description="A table of poses.")
    file: Text = Field(
        description="CSV with the header t,x,y,z,qw,qx,qy,qz (s, m, unit quaternion), relative to this file."
    )
    file_sha256: Digest | None = Field(default=None, description=SHA256)


MotionTable = Annotated[HingeTable | SlideTable | PosesTable, Field(discriminator="kind")]
_MOTION: TypeAdapter[Any] = TypeAdapter(MotionTable)


class BodyTable(Table):
    """A rigid body; without a motion it is fixed to its parent."""

    parent: Text = Field(
        default="world", description="Name of the body that carries it; its motion is relative to that one."
    )
    position: Vector = Field(
        default=(0.0, 0.0, 0.0), description="Where its origin stands in the parent when its motion is at 0, m."
    )
    quaternion: Quaternion = Field(
        default=(1.0, 0.0, 0.0, 0.0), description="How it stands there, scalar first; left out, as the parent."
    )
    motion: MotionTable | None = Field(default=None, description="How the body moves: hinge, slide or poses.")
    free: Flag = Field(default=False, description="Hangs on its cables; position and quaternion are a first guess.")
    mass: NotNegative = Field(default=0.0, description="Of a free body, kg; its centre is the body's origin.")


class BaseTable(Table):
    """Where a robot's root stands."""

    body: Text = Field(
        default="world", description="Name of the body that carries it, such as a link of another robot."
    )
    position: Vector = Field(default=(0.0, 0.0, 0.0), description="In that body's coordinates, m.")
    quaternion: Quaternion = Field(default=(1.0, 0.0, 0.0, 0.0), description="In these, scalar first.")


class RobotTable(Table):
    """A robot by its URDF: each link is a body NAME.LINK, with its shapes as parts."""

    model_config = ConfigDict(
        json_schema_extra={"dependentRequired": {key: ["program"] for key in ("unit", "program_sha256")}}
    )

    urdf: Text = Field(
        description='URDF file, relative to this file; or "package:PACKAGE/..." of an installed package.'
    )
    base: BaseTable = Field(default=BaseTable(), description="Where its root stands.")
    program: Text | None = Field(
        default=None, description="CSV: t in s, then one column a joint by its name, rad or m."
    )
    program_sha256: Digest | None = Field(default=None, description=SHA256)
    unit: AngleUnit | None = Field(default=None, description="Of the program's angles; rad where left out.")
    meshes: ShapesOfLinks = Field(default="collision", description="Which shapes of its links are parts.")
    shell: Flag = Field(default=False, description="Whether meshes that are not closed will do.")
    leave_out: list[Text] = Field(default_factory=list, description="Parts, or links with all of theirs, by name.")


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
        path = ("bodies", name, "motion")
        wrong = list(_wrong_ways(path, body["motion"])) if isinstance(body["motion"], Mapping) else []
        mistakes += wrong
        try:
            motion = _MOTION.validate_python(body["motion"])
        except ValidationError:
            continue  # named already when the whole file was structured
        if wrong:
            continue
        try:
            motions[name] = _motion(motion, places, pending)
        except ProblemError as error:
            mistakes.extend(((*path, "file"), line) for line in error.mistakes)
    return motions, mistakes


def _wrong_ways(path: KeyPath, motion: Tree) -> Iterator[Mistake]:
    """Check that a hinge or a slide goes by first and last value, by a table, or by moves."""
    first, last = WAYS.get(str(motion.get("kind")), ("", ""))
    if not first:
        return
    if "file" in motion:
        for key in (first, last, "moves"):
            if key in motion:
                yield (*path, key), f"found file as well, expected file or {key}"
        return
    for key, words in (("unit", "a unit"), ("file_sha256", "a SHA-256")):
        if key in motion:
            yield (*path, key), f"found {words} without a file, expected it beside file only"
    if "moves" in motion:
        if last in motion:
            yield (*path, last), f"found moves as well, expected moves or {last}"
        return
    for key in (first, last):
        if key not in motion:
            yield (*path, key), "found nothing, expected a number"


def _motion(motion: Any, places: Places, pending: Mapping[Path, bytes]) -> BodyMotion:
    if isinstance(motion, PosesTable):
        return parse_poses(*_content(motion, "a table of poses", places, pending))
    follows: ValueTable | Moves | None = None
    if isinstance(motion, HingeTable):
        start, stop = math.radians(motion.from_deg or 0.0), math.radians(motion.to_deg or 0.0)
        ends = [math.radians(move.to_deg) for move in motion.moves or ()]
    else:
        start, stop = motion.from_ or 0.0, motion.to or 0.0
        ends = [move.to for move in motion.moves or ()]
    if motion.file is not None:
        unit = motion.unit or ("rad" if isinstance(motion, HingeTable) else "m")
        follows = parse_values(*_content(motion, "a table of values", places, pending), unit)
    elif motion.moves is not None:
        told = zip(ends, motion.moves, strict=True)
        follows = Moves(start, tuple(Move(end, move.seconds, move.dwell) for end, move in told))
    if isinstance(motion, HingeTable):
        return Hinge(motion.point, motion.axis, start, stop, follows)
    return Slide(motion.direction, start, stop, follows)


def _content(motion: Any, what: str, places: Places, pending: Mapping[Path, bytes]) -> tuple[bytes, Path]:
    """Return the bytes of the table that a motion names, and where they lie."""
    file = places.located(motion.file)
    if file in pending:
        return pending[file], file
    why = places.fault(motion.file, what, motion.file_sha256, MOST_TABLE_BYTES)
    if why:
        raise ProblemError(why)
    return file.read_bytes(), file


# --- CSV tables ---------------------------------------------------------------------------------------


def parse_poses(content: bytes, file: Path) -> Poses:
    """Return the motion that a CSV table of poses holds.

    A header ``t,x,y,z,qw,qx,qy,qz``, then rows of s, m and a unit quaternion. Quaternions that are unit but for
    rounding (``QUATERNION_TOLERANCE``) are normalised, and their signs chosen so that neighbours lie on the same side.

    Args:
        content: the bytes of the file.
        file: where they come from, for messages and :attr:`Poses.file`.

    Raises:
        ProblemError: one line a mistake, ``arm.csv, line 4: found ..., expected ...``.
    """
    wanted = ",".join(HEADER)
    _, rows = numbers_of(content, file, wanted, lambda names: names == HEADER, _unit_mistake)
    quaternions = rotations.unit(rows[:, 4:])
    turned = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    signs = np.concatenate([[1.0], np.cumprod(np.where(turned, -1.0, 1.0))])
    return Poses(
        times=tuple(rows[:, 0].tolist()),
        positions=tuple(map(tuple, rows[:, 1:4].tolist())),
        quaternions=tuple(map(tuple, (signs[:, None] * quaternions).tolist())),
        file=file,
    )


def parse_values(content: bytes, file: Path, unit: str) -> ValueTable:
    """Return what a CSV table of two columns holds: a header ``t,value``, or another name for the second; then rows.

    Args:
        content, file: as of :func:`parse_poses`.
        unit: of the values: "rad", "deg", "m" or "mm".

    Raises:
        ProblemError: as of :func:`parse_poses`.
    """
    _, rows = numbers_of(content, file, "t,value", lambda names: names[0] == "t" and len(names) == 2)
    entries = PER_UNIT[unit] * rows[:, 1]
    return ValueTable(tuple(rows[:, 0].tolist()), tuple(entries.tolist()), file, unit)


def numbers_of(
    content: bytes,
    file: Path,
    wanted: str,
    fits: Callable[[tuple[str, ...]], bool],
    also: Callable[[list[float]], str] = lambda _: "",
) -> tuple[tuple[str, ...], Array]:
    """Return the names of the columns of a CSV table, and its rows (n, columns), with a time in the first.

    Blank lines and what follows a ``#`` are skipped.

    Args:
        content: the bytes of the file.
        file: where they come from, for messages.
        wanted: an expected header, for messages.
        fits: whether names in lower case are those of such a table.
        also: what else is wrong about the numbers of a row, or an empty text.
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
        raise ProblemError(f"{file.name}, line 1: found nothing, expected the header {wanted}")
    number, names = filled[0][0], tuple(filled[0][1])
    if not fits(tuple(name.lower() for name in names)):
        raise ProblemError(f"{file.name}, line {number}: found {shown(','.join(names))}, expected the header {wanted}")
    mistakes: list[str] = []
    rows: list[list[float]] = []
    at: list[int] = []  # line of each good row
    for i, cells in filled[1:]:
        wrong = _row_mistake(names, cells) or also([float(cell) for cell in cells])
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
    return names, np.array(rows)


def _row_mistake(names: tuple[str, ...], cells: list[str]) -> str:
    """Return what is wrong with the cells of one row, or an empty text."""
    if len(cells) != len(names):
        return f"found {len(cells)} values, expected {len(names)} numbers ({','.join(names)})"
    for name, cell in zip(names, cells, strict=True):
        try:
            number = float(cell)
        except ValueError:
            return f"found {shown(cell)} as {name}, expected a number"
        if not abs(number) <= LARGEST:
            return f"found {cell} as {name}, expected a finite number"
    return ""


def _unit_mistake(numbers: list[float]) -> str:
    """Return what is wrong with the quaternion of a row of poses, or an empty text."""
    length = math.hypot(*numbers[4:])
    if abs(length - 1.0) <= QUATERNION_TOLERANCE:
        return ""
    return f"found a quaternion of length {length:.6g}, expected 1 to within {QUATERNION_TOLERANCE:g}"


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

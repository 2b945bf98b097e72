"""Files of measurements: TOML and tables of points, to :class:`~harness_opt.measured.measurements.Measurements`."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag

from harness_opt.errors import ProblemError
from harness_opt.files.beside import with_cables
from harness_opt.files.places import MEGABYTE, Places
from harness_opt.files.read import content_of, toml_tables
from harness_opt.files.schema import EndTable
from harness_opt.files.values import (
    Expected,
    MeshUnit,
    NotNegative,
    Positive,
    Table,
    Text,
    Vector,
    only_integer,
    schema_of,
    structured,
)
from harness_opt.measured.measurements import TORSION, Measurement, Measurements, Pose
from harness_opt.model.cable import Cable
from harness_opt.model.checks import dotted, one_of, shown
from harness_opt.model.ends import End
from harness_opt.numerics.rotations import Array

MOST_BYTES = MEGABYTE  # of a table of points: ten thousand of them, from any photograph
LEAST_POINTS = 5  # of a shape, below which it says next to nothing
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
COLUMNS = (("x", "z"), ("x", "y", "z"), ("s", "x", "z"), ("s", "x", "y", "z"))
SOUGHT = (
    "bending_stiffness", "torsional_stiffness", "rest_curvature.x", "rest_curvature.y", "rest_curvature.z",
)  # fmt: skip
Sought = Literal["bending_stiffness", "torsional_stiffness", "rest_curvature.x", "rest_curvature.y", "rest_curvature.z"]


class WiresTable(Table):
    """Wires of one kind, or a tube, in the section of a cable."""

    count: Annotated[int, Field(strict=True, gt=0), Expected("a whole number above 0")] = Field(
        default=1, description="Of the wires."
    )
    diameter: Positive = Field(description="Of one of them, m.")
    inner_diameter: NotNegative = Field(default=0.0, description="Of a tube, such as a sheath, m.")
    ring_diameter: NotNegative = Field(default=0.0, description="Of the circle that their centres stand on, m.")
    modulus: Positive = Field(description="Young's, Pa.")


class SampleTable(Table):
    """The cable that was measured: what is known of it."""

    from_: Text | None = Field(default=None, alias="from", description="Cable of a library: my_cables.toml#NAME.")
    diameter: Positive = Field(description="Outer diameter, m.")
    length: Positive | None = Field(default=None, description="Of what hangs between two holders, m.")
    mass_per_length: Positive | None = Field(default=None, description="kg/m; or density.")
    density: Positive | None = Field(default=None, description="kg/m3 of the full circle.")
    bending_stiffness: Positive | None = Field(default=None, description="N m2, known or to begin at.")
    torsional_stiffness: Positive | None = Field(default=None, description="N m2; three quarters of that if unknown.")
    rest_curvature: Vector = Field(default=(0.0, 0.0, 0.0), description="Of the unloaded cable, section frame, 1/m.")
    bend_radius_factors: dict[str, Positive] = Field(default_factory=dict, description="Bend limits by use, diameters.")
    wires: list[WiresTable] = Field(default_factory=list, description="Its construction: bounds of its stiffness.")


class _Held(Table):
    name: Text | None = Field(default=None, description="For people.")
    length: Positive | None = Field(default=None, description="Of the cable here, m; the sample's if left out.")
    start: EndTable | None = Field(default=None, description="What holds the cable at arc length 0.")
    end: EndTable | None = Field(default=None, description="What holds it at its full length.")


class LoopTable(_Held):
    """Points along the shape of a cable between two holders, as from a photograph."""

    kind: Literal["loop"] = Field(description="Points along a shape.")
    file: Text = Field(description="CSV with the header x,z or x,y,z, and s before these where arc lengths are known.")
    unit: MeshUnit | None = Field(default=None, description="Of the points; or scale.")
    scale: Positive | None = Field(default=None, description="m that one unit of the points is, of a photograph.")
    error: Positive | None = Field(default=None, description="Standard deviation of a coordinate, m.")


class SagTable(Table):
    """How far the tip of a piece hangs that is held level at its other end."""

    kind: Literal["sag"] = Field(description="Sag of a piece held level.")
    name: Text | None = Field(default=None, description="For people.")
    length: Positive = Field(description="That hangs out, m.")
    sag: Positive = Field(description="Of the tip below the holder, m.")
    error: Positive | None = Field(default=None, description="Its standard deviation, m.")


class ForceTable(_Held):
    """The force at one end of a cable between two holders."""

    kind: Literal["force"] = Field(description="Force at a clamp.")
    side: Annotated[Literal["start", "end"], Expected(one_of(("start", "end")))] = Field(
        default="start", description="Where it was measured."
    )
    force: Positive = Field(description="Its size, N.")
    error: Positive | None = Field(default=None, description="Its standard deviation, N.")


class SnapTable(_Held):
    """The twist of the end at which a loop leaves its plane."""

    kind: Literal["snap"] = Field(description="Twist at which a loop leaves its plane.")
    twist_deg: Positive = Field(description="By which the end was turned about the cable, degrees.")
    error: Positive | None = Field(default=None, description="Its standard deviation, degrees.")


def _kind(value: Any) -> str:
    return str(value.get("kind", "loop")) if isinstance(value, Mapping) else "loop"


MeasurementTable = Annotated[
    Annotated[LoopTable, Tag("loop")]
    | Annotated[SagTable, Tag("sag")]
    | Annotated[ForceTable, Tag("force")]
    | Annotated[SnapTable, Tag("snap")],
    Discriminator(_kind),
]


class MeasurementsTable(Table):
    """What was measured of a cable, and what is to be found."""

    schema_: Annotated[Literal[1], BeforeValidator(only_integer), Expected("1")] = Field(
        alias="schema", description="Version of this format."
    )
    title: Text = Field(default="", description="One line for people.")
    gravity: Vector = Field(default=(0.0, 0.0, -9.81), description="m/s2.")
    cable: SampleTable = Field(description="What is known of the cable.")
    find: list[Annotated[Sought, Expected(one_of(SOUGHT))]] = Field(
        default=["bending_stiffness"], description="What is to be found.", min_length=1
    )
    start: EndTable | None = Field(default=None, description="What holds the start where a measurement says nothing.")
    end: EndTable | None = Field(default=None, description="The same of the end.")
    measurements: list[MeasurementTable] = Field(description="What was measured.", min_length=1)


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of files of measurements."""
    return schema_of(MeasurementsTable, "Measurements of a cable for harness-opt")


def read_measurements(path: str | os.PathLike[str], folders: Iterable[str | os.PathLike[str]] = ()) -> Measurements:
    """Return what a TOML file says was measured; the tables of points that it names are read.

    Args:
        path: of the file.
        folders: from which it may read tables and libraries beside its own folder.

    Raises:
        ProblemError: one line a mistake.
    """
    file = Path(path)
    places = Places.around(file.parent, folders)
    raw = toml_tables(content_of(file, "a file of measurements"), file)
    if "cables" in raw and "measurements" not in raw:
        words = "found a problem file, expected measurements; a problem is simulated by"
        raise ProblemError(f"{file}: {words}: harness-opt simulate {file}")
    filled, wrong = with_cables({"cables": {"cable": raw.get("cable")}}, places, places.folder / file.name)
    if isinstance(raw.get("cable"), Mapping):
        raw = {**raw, "cable": filled["cables"]["cable"]}
    tables, _, mistakes = structured(raw, MeasurementsTable)
    lines = [f"{dotted(('cable', *path[2:]))}: {words}" for path, words in wrong]
    lines += [f"{dotted(path)}: {words}" for path, words in mistakes]
    if tables is not None and not lines:
        found, lines = _measurements(tables, places, file)
        if not lines and found is not None:
            return found
    raise ProblemError(f"{file}: {line}" for line in lines)


def _measurements(tables: MeasurementsTable, places: Places, file: Path) -> tuple[Measurements | None, list[str]]:
    """Return the measurements of a file whose keys are in order, or what else is wrong with it."""
    given, lines, measured = tables.cable, list[str](), list[Measurement]()
    if given.density is not None and given.mass_per_length is not None:
        lines.append("cable.density: found mass_per_length as well, expected one of the two")
    for number, one in enumerate(tables.measurements):
        key = f"measurements.{one.name or number}"
        try:
            measured.append(_measurement(one, key, tables, places))
        except ProblemError as error:
            lines += error.mistakes
    mass = given.mass_per_length or 0.0
    if given.density is not None:
        mass = given.density * 0.25 * math.pi * given.diameter**2
    if len(set(tables.find)) < len(tables.find):
        lines.append(f"find: found {shown(tables.find)}, expected each name once")
    if lines:
        return None, lines
    longest = max(one.pose.length for one in measured)
    weight = mass * float(np.linalg.norm(tables.gravity))
    # where nothing is known, a cable whose own weight bends it well: w L^3 / B of 30
    begin = given.bending_stiffness or (weight * longest**3 / 30.0 if weight else 1e-3)
    cable = Cable(
        length=longest,
        diameter=given.diameter,
        bending_stiffness=begin,
        torsional_stiffness=given.torsional_stiffness or TORSION * begin,
        mass_per_length=mass,
        rest_curvature=given.rest_curvature,
    )
    return Measurements(
        cable,
        tuple(tables.find),
        tables.gravity,
        tuple(measured),
        given.bending_stiffness is not None,
        given.torsional_stiffness is not None,
        construction_band(given.wires) if given.wires else None,
        tables.title,
        places.folder / file.name,
    ), []


def _measurement(
    one: LoopTable | SagTable | ForceTable | SnapTable, key: str, tables: MeasurementsTable, places: Places
) -> Measurement:
    """Return one measurement.

    Raises:
        ProblemError: what is missing, or cannot be.
    """
    name, none = one.name or "", np.zeros((0, 3))
    if isinstance(one, SagTable):
        if not one.sag < one.length:
            raise ProblemError(f"{key}.sag: found {one.sag:g}, expected less than the length, {one.length:g}")
        level = Pose(one.length, End((0.0, 0.0, 0.0), tangent=(1.0, 0.0, 0.0), roll_deg=0.0), End())
        error = one.error or 0.02 * one.sag
        return Measurement(
            name or f"sag of {one.length:g} m", "sag", level, one.sag, none, None, False, error, bool(one.error)
        )
    length = one.length or tables.cable.length
    if length is None:
        raise ProblemError(f"{key}.length: found nothing, here or in cable, expected a number above 0")
    start, end = one.start or tables.start, one.end or tables.end
    if isinstance(one, LoopTable):
        points, arcs, planar = _points(one, key, places)
        pose = Pose(length, *_ends(key, start, end, points), bow=_bow(points))
        _check_loop(key, one, pose, points, arcs)
        error = one.error or 2e-3 * length
        return Measurement(name or one.file, "loop", pose, 0.0, points, arcs, planar, error, bool(one.error))
    pose = Pose(length, *_ends(key, start, end, none))
    if isinstance(one, ForceTable):
        error = one.error or 0.05 * one.force
        words = name or f"force at the {one.side}"
        return Measurement(words, "force", pose, one.force, none, None, False, error, bool(one.error), one.side)
    error = math.radians(one.error or 0.02 * one.twist_deg)
    twist = math.radians(one.twist_deg)
    return Measurement(name or "snap", "snap", pose, twist, none, None, False, error, bool(one.error))


def _ends(key: str, start: EndTable | None, end: EndTable | None, points: Array) -> tuple[End, End]:
    """Return what holds a cable; positions that are not given are those of the first and the last point."""
    found = []
    for side, given, at in (("start", start, 0), ("end", end, -1)):
        if given is None:
            raise ProblemError(f"{key}.{side}: found nothing, here or for all, expected what holds the cable there")
        held = given.model_dump()
        if held["position"] is None and held["force"] is None and len(points):
            held["position"] = tuple(points[at].tolist())
        if held["position"] is None and side == "start":
            raise ProblemError(f"{key}.start.position: found nothing, expected [x, y, z], three numbers")
        try:
            found.append(End(**held))
        except ProblemError as error:
            raise ProblemError(f"{key}.{side}.{line}" for line in error.mistakes) from None
    return found[0], found[1]


def _bow(points: Array) -> tuple[float, float, float] | None:
    """Return the way from the middle between the ends of a shape to the middle of its points; None if straight."""
    way = points.mean(axis=0) - 0.5 * (points[0] + points[-1])
    return tuple(way.tolist()) if np.linalg.norm(way) > 0 else None


def _points(one: LoopTable, key: str, places: Places) -> tuple[Array, Array | None, bool]:
    """Return the points (n, 3) of a table, m, their arc lengths (n,) or None, and whether they lie in a plane."""
    if (one.unit is None) == (one.scale is None):
        words = "nothing" if one.unit is None else "scale as well"
        raise ProblemError(f"{key}.unit: found {words}, expected a unit, or a scale")
    scale = one.scale or METRES[str(one.unit)]
    why = places.fault(one.file, "a table of points", None, MOST_BYTES)
    if why:
        raise ProblemError(f"{key}.file: {why}")
    try:
        text = places.located(one.file).read_text(encoding="utf-8-sig")
        rows = [row for row in csv.reader(text.splitlines()) if row]
    except (OSError, ValueError, csv.Error) as error:
        raise ProblemError(
            f"{key}.file: found {shown(one.file)}, which can't be read ({error}), expected CSV"
        ) from None
    header = tuple(cell.strip() for cell in rows[0]) if rows else ()
    if header not in COLUMNS:
        wanted = " or ".join(",".join(columns) for columns in COLUMNS)
        raise ProblemError(f"{key}.file: found the header {shown(','.join(header))}, expected {wanted}")
    values = _numbers(rows[1:], len(header), f"{key}.file")
    if len(values) < LEAST_POINTS:
        raise ProblemError(f"{key}.file: found {len(values)} points, expected at least {LEAST_POINTS}")
    table = scale * values
    columns = {name: table[:, k] for k, name in enumerate(header)}
    y = columns.get("y", np.zeros(len(table)))
    return np.column_stack([columns["x"], y, columns["z"]]), columns.get("s"), "y" not in columns


def _numbers(rows: list[list[str]], width: int, key: str) -> Array:
    values = np.empty((len(rows), width))
    for number, row in enumerate(rows, 2):
        try:
            values[number - 2] = [float(cell) for cell in row]
        except ValueError:
            raise ProblemError(
                f"{key}: line {number}: found {shown(','.join(row))}, expected {width} numbers"
            ) from None
    if not np.all(np.isfinite(values)):
        raise ProblemError(f"{key}: found what is not finite, expected numbers")
    return values


def _check_loop(key: str, one: LoopTable, pose: Pose, points: Array, arcs: Array | None) -> None:
    """Check that points lie along a cable of that length, one after the other.

    Raises:
        ProblemError: they do not.
    """
    far_off = 20.0  # times the length: no measuring is that bad, a unit is
    longer = 1.02  # times the length: what scatter adds to the way from point to point
    chords = np.diff(points, axis=0)
    way = float(np.sum(np.linalg.norm(chords, axis=1)))
    told = f"{key}.file: found a way of {way:.4g} m from point to point"
    if not way > 0:
        raise ProblemError(f"{told}, expected points along the cable")
    if not 1.0 / far_off < way / pose.length < far_off:
        words = f"expected about the cable's length, {pose.length:g} m: is {one.unit or 'the scale'} their unit?"
        raise ProblemError(f"{told}, {words}")
    if arcs is not None and not (np.all(np.diff(arcs) > 0) and arcs[0] >= 0 and arcs[-1] <= longer * pose.length):
        raise ProblemError(f"{key}.file: found arc lengths that do not grow from 0 to {pose.length:g} m, expected so")
    sizes = np.maximum(np.linalg.norm(chords, axis=1), 1e-12 * way)
    back = np.einsum("nc,nc->n", chords[1:], chords[:-1]) < -0.5 * sizes[1:] * sizes[:-1]
    if np.count_nonzero(back) > 0.1 * len(points):
        raise ProblemError(f"{told} that goes to and fro, expected the points in their order along the cable")
    if way > longer * pose.length:
        words = "with the points in their order along it"
        raise ProblemError(f"{told}, expected at most the cable's length, {pose.length:g} m, {words}")


def construction_band(wires: Iterable[WiresTable]) -> tuple[float, float]:
    """Return the least and the most bending stiffness, N m2, of a bundle of ``wires``.

    The least is that of wires that slide on each other, the sum of their own E I; the most that of wires that stick,
    each with what it has by its distance from the middle (Costello, "Theory of Wire Rope", 1997, chapter 4): of n
    wires of area A on a circle of diameter D, n E A D^2 / 8.
    """
    slipping = sticking = 0.0
    for one in wires:
        own = one.count * one.modulus * math.pi * (one.diameter**4 - one.inner_diameter**4) / 64
        area = 0.25 * math.pi * (one.diameter**2 - one.inner_diameter**2)
        slipping += own
        sticking += own + one.count * one.modulus * area * one.ring_diameter**2 / 8
    return slipping, sticking

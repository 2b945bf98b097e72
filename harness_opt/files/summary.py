"""What ``summary.json`` holds, key by key: the types that the program is checked against, and their JSON Schema.

SI units, as in the problem file: twists in degrees per metre where a key says so. What is not finite is null.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field, TypeAdapter
from typing_extensions import TypedDict

from harness_opt.model.limits import KIND_OF_KEY, LimitId, LimitKind, Obstacle
from harness_opt.model.problem import SHARES, Moments, Travel
from harness_opt.model.results import Holds, LimitResult

Json = dict[str, Any]
Command = Literal["simulate", "redesign"]
Verdict = Literal["ok", "violated", "uncertain", "infeasible", "unsolved"]
Number = float | None  # None where it is not finite


def _said(words: str) -> Any:
    return Field(description=words)


class LimitEntry(TypedDict):
    """How one limit fared over the whole motion, in the words and the unit of the problem file."""

    id: Annotated[str, _said("Unique in the summary; ``active`` names limits by it")]
    name: Annotated[str, _said("As in ``[limits]``, such as ``twist_deg_per_m``")]
    cable: str
    part: Annotated[str | None, _said("Name of a part, ``cable:NAME`` of a cable; null for limits but clearance")]
    other_cable: Annotated[str | None, _said("Name of the cable that a clearance is measured to; itself counts")]
    clip: NotRequired[Annotated[str | None, _said("Name of the clip whose load is limited; null for other limits")]]
    limit: Number
    worst: Number
    margin: Annotated[Number, _said("At least 0 holds")]
    frame: Annotated[int, _said("Of the worst, or the nearest to it")]
    motion: Annotated[float, _said("Where along the motion the worst stands, 0 to 1")]
    arc_length: Annotated[float, _said("Where along the cable the worst stands, m")]
    holds: Annotated[Holds, _said('"no" where any point found violates it, "yes" where it is certain to hold')]
    certified: Annotated[bool, _said("Whether nothing between samples is worse by more than ``tolerance``")]
    tolerance: Number
    reason: Annotated[str, _said("Why it is not certified, where that was tried")]
    certified_along_arc: NotRequired[Annotated[bool, _said("The same in the solved frames alone; of clearances")]]


class PairEntry(TypedDict):
    """A clearance as it was measured, with a limit or without, m."""

    cable: str
    part: Annotated[str, _said("Name of a part, or ``cable:NAME``")]
    other_cable: str | None
    limit: Number
    smallest: Number
    lower_bound: Number
    frame: int
    motion: float
    arc_length: float
    certified_along_arc: bool
    excluded_near_clamps: Annotated[dict[str, float], _said("Lengths from ``start`` and ``end`` that do not count")]
    closed: Annotated[bool, _said("False where the part is a shell without an inside")]


class CycleEntry(TypedDict):
    """Cycles that rainflow counting found."""

    range: float
    mean: float
    count: float


class RangeEntry(TypedDict):
    """How far something ranges in a cycle of the motion, where it ranges most."""

    range: float
    arc_length: float
    cycles: list[CycleEntry]


class SheetEntry(TypedDict):
    """What cable makers state of one cable."""

    bend_radius: Number
    bend_diameters: Number
    twist_deg_per_m: float
    bend_range: Annotated[RangeEntry, _said("Of the curvature, 1/m")]
    twist_range_deg_per_m: RangeEntry
    sag: Number
    reach: Annotated[list[float], _said("Sides of the box along x, y, z that holds the cable at all moments, m")]


class ClipEntry(TypedDict):
    """What a clip does over the motion."""

    cable: str
    clip: str
    kind: Annotated[str, _said("``fixed``, ``swivel``, ``pivot``, ``sleeve`` or ``ring``")]
    body: str
    arc_length: Annotated[list[float], _said("At which the cable stands in it, m: in the first frame, least and most")]
    force: Annotated[Number, _said("Largest on the cable, N")]
    moment: Annotated[Number, _said("Largest on the cable, N m")]


class SnapEntry(TypedDict):
    """A jump of a cable to another shape."""

    cable: str
    frame: int
    motion: float
    passes_through_itself: Annotated[bool, _said("Whether it lost a turn on the way: not without contact")]
    span: Annotated[str, _said("Where cables have clips, the span that jumps; else empty")]


class ProblemEntry(TypedDict):
    """The problem file."""

    title: str
    file: str | None
    sha256: str | None


class EquilibriumEntry(TypedDict):
    """How exact the shapes are: largest scaled residual, and estimated error in lengths of the cable."""

    max_residual: Number
    estimated_error: Number


class VariableEntry(TypedDict):
    """A design variable, in the unit of its key."""

    before: float
    after: float | None
    lower: float
    upper: float


class RelaxationEntry(TypedDict):
    """A limit or bound that stands in the way, and the value of it that would do."""

    key: str
    kind: Annotated[str, _said("Of the limit, as ``name``; ``lower`` or ``upper`` of a bound")]
    part: Annotated[str | None, _said("Whose own clearance limit it is")]
    cable: Annotated[str | None, _said("Whose own bend radius it is")]
    value: float
    share: float
    estimate: Number
    enough: Annotated[float | None, _said("A value that does, verified; null where none was found")]
    variables: dict[str, float]


class PriceEntry(TypedDict):
    """What a limit or bound costs, to first order."""

    key: str
    kind: str
    part: str | None
    cable: str | None
    value: float
    saves: float
    of: Annotated[str, _said("``change``, ``length`` or ``margin``")]
    buys: dict[str, float]


class ClampEntry(TypedDict):
    """A clamp that a redesign moved or turned, in the coordinates of its body."""

    name: Annotated[str, _said("Such as ``lead.end``")]
    body: str
    position: Annotated[list[float] | None, _said("m")]
    direction: Annotated[list[float] | None, _said("Unit, along growing arc length")]
    quaternion: Annotated[list[float] | None, _said("Of the section, where the roll is given")]


class StepEntry(TypedDict):
    """An iteration of the search."""

    aim: str
    objective: Number
    margin: Number
    limit: Annotated[str | None, _said("``id`` of the tightest limit")]
    amount: Number
    trust: float
    step: float
    accepted: bool


class WithinEntry(TypedDict):
    """How a design fares within tolerances, by linearised margins; limits by ``id``."""

    share: float
    corner: float
    by_limit: dict[str, float]
    nominal: dict[str, float]
    allowances: dict[str, float]


class YieldEntry(TypedDict):
    """The share of simulated samples that hold all limits."""

    share: float
    samples: int
    error: float
    failures: int
    linear: float


class RobustEntry(TypedDict):
    """What a redesign within tolerances found."""

    hold: str
    asked: float
    holds: bool
    rounds: int
    before: WithinEntry | None
    after: WithinEntry | None
    yield_before: YieldEntry | None
    yield_after: YieldEntry | None


class TradeOffEntry(TypedDict):
    """The trade-off curve of two quantities; points have them by name."""

    first: str
    second: str
    stepped: str
    points: list[dict[str, Any]]


class RedesignEntry(TypedDict):
    """What the redesign did."""

    variables: dict[str, VariableEntry]
    iterations: int
    looked_at: Annotated[int, _said("Designs simulated")]
    violation: Annotated[Number, _said("The largest shortfall of a limit over its scale; 0 where all hold")]
    limits_before: Annotated[list[LimitEntry] | None, _said("null where no shape joins the drawn clamps")]
    too_short: NotRequired[Annotated[dict[str, float], _said("By how much cables were drawn too short, m")]]
    optimal: NotRequired[Annotated[bool, _said("Whether no small change promises a better design")]]
    active: Annotated[list[str], _said("What holds the design: limits by ``id``, and variables at a bound in words")]
    goal: NotRequired[str]
    coupled: NotRequired[dict[str, str]]
    moved_inside: NotRequired[dict[str, dict[str, float]]]
    bows: NotRequired[Annotated[dict[str, list[float]], _said("Cables bowed to another side than drawn, and to which")]]
    clamps: NotRequired[list[ClampEntry]]
    in_the_way: NotRequired[list[RelaxationEntry]]
    in_the_way_together: NotRequired[list[tuple[RelaxationEntry, RelaxationEntry]]]
    costs: NotRequired[list[PriceEntry]]
    history: NotRequired[list[StepEntry]]
    without: NotRequired[Annotated[list[str], _said("Optional clips that it does without, ``CABLE.CLIP``")]]
    robust: NotRequired[RobustEntry]
    pareto: NotRequired[TradeOffEntry]


class TravelEntry(TypedDict):
    """The way of a body that moves: evenly with the motion, or as a table or moves say."""

    body: str
    unit: Annotated[str, _said("``deg``, ``mm`` or ``s``")]
    start: float
    stop: float
    shares: NotRequired[Annotated[list[float], _said("Motion values, 0 to 1, between which it goes evenly")]]
    values: NotRequired[Annotated[list[float], _said("Where it is at each of these, in ``unit``")]]


class PathEntry(TypedDict):
    """What the motion is told in."""

    ways: list[TravelEntry]
    duration: Annotated[float, _said("s")]
    out_and_back: bool


class Summary(TypedDict):
    """A result of harness-opt: ``summary.json`` in its folder, and what ``--json`` prints."""

    schema: Annotated[int, _said("Version of this schema")]
    command: Command
    problem: ProblemEntry
    versions: dict[str, str]
    status: Verdict
    reason: Annotated[str, _said("Status of the solve, such as ``ok`` or ``time_limit``")]
    message: str
    frames: int
    path: PathEntry
    limits: list[LimitEntry]
    clearances: list[PairEntry]
    open_meshes: list[str]
    frames_solved_between: Annotated[dict[str, int], _said("For the certificates, by cable")]
    data_sheet: dict[str, SheetEntry]
    clips: NotRequired[list[ClipEntry]]
    snaps: list[SnapEntry]
    stable: Annotated[bool, _said("Whether every shape shown is a stable equilibrium")]
    equilibrium: EquilibriumEntry
    timing: Annotated[dict[str, float], _said("Seconds by phase, and in ``total``")]
    warnings: list[str]
    left_out: list[str]
    files: list[str]
    redesign: NotRequired[RedesignEntry]


def results_schema() -> Json:
    """Return the JSON Schema of ``summary.json``."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **TypeAdapter(Summary).json_schema()}


def path_entry(moments: Moments) -> PathEntry:
    """Return what the motion is told in, which :func:`moments_of` reads."""
    ways = [TravelEntry(body=way.body, unit=way.unit, start=way.start, stop=way.stop) for way in moments.ways]
    for entry, way in zip(ways, moments.ways, strict=True):
        if way.shares:
            entry["shares"], entry["values"] = list(way.shares), list(way.values)
    return PathEntry(ways=ways, duration=moments.duration, out_and_back=moments.out_and_back)


def moments_of(summary: Summary) -> Moments:
    """Return what tells the moments of a result's motion; per cent of one that an older version wrote."""
    path = summary.get("path")
    if path is None:
        return SHARES
    return Moments([Travel(**way) for way in path["ways"]], path["duration"], path["out_and_back"])


def limit_entry(row: LimitResult) -> LimitEntry:
    """Return a limit's row in the words and the unit of the problem file."""
    kind, unit = row.id.kind, row.id.kind.from_si
    part, other = obstacle_entry(row.id.obstacle)
    return LimitEntry(
        id=str(row.id),
        name=kind.key,
        cable=row.cable,
        part=part,
        other_cable=other,
        clip=row.id.clip,
        limit=unit * row.limit,
        worst=unit * row.worst,
        margin=unit * row.margin,
        frame=row.frame,
        motion=row.motion,
        arc_length=row.arc_length,
        certified=row.certified,
        holds=row.holds,
        tolerance=unit * row.tolerance,
        reason=row.reason,
    )


def limit_of(entry: LimitEntry) -> LimitId:
    """Return which limit an entry is of."""
    kind = KIND_OF_KEY[entry["name"]]
    if entry["other_cable"] is not None:
        return LimitId(kind, entry["cable"], Obstacle(entry["other_cable"], is_cable=True))
    part = None if entry["part"] is None else Obstacle(entry["part"])
    return LimitId(kind, entry["cable"], part, entry.get("clip"))


def obstacle_entry(obstacle: Obstacle | None) -> tuple[str | None, str | None]:
    """Return ``part`` and ``other_cable`` of an entry."""
    if obstacle is None:
        return None, None
    return obstacle.key, obstacle.name if obstacle.is_cable else None


def key_in_file_units(kind: LimitKind | str) -> tuple[str, float]:
    """Return the name of a kind of limit in files, and what an SI value is multiplied by there; bounds as they are."""
    return (kind.key, kind.from_si) if isinstance(kind, LimitKind) else (kind, 1.0)

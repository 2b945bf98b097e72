"""The tables of a problem file as pydantic models, and the JSON Schema drawn from them.

What needs two keys is checked in :mod:`~harness_opt.files.checks`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, ConfigDict, Field

from harness_opt.files.bodies import BodyTable, RobotTable
from harness_opt.files.tolerance_table import ToleranceTable
from harness_opt.files.values import (
    BendFactor,
    Bending,
    Bounds,
    Digest,
    Direction,
    Expected,
    Flag,
    MeshUnit,
    MotionValue,
    NotNegative,
    Number,
    Positive,
    Quaternion,
    RollWord,
    Scale,
    Seed,
    Share,
    Size,
    Table,
    Text,
    UpAxis,
    Vector,
    Whole,
    not_both,
    only_integer,
    required_unless,
    schema_of,
)
from harness_opt.model.checks import one_of
from harness_opt.model.design import Minimise
from harness_opt.model.ends import CLIP_KINDS, ClipKind


class EndTable(Table):
    """What holds one end of a cable: a position or a force, an orientation or a moment; neither is free."""

    model_config = ConfigDict(
        json_schema_extra={
            "allOf": [
                *not_both("position", "force"),
                *not_both("quaternion", "tangent", "moment"),
                *not_both("roll", "roll_deg"),
            ],
            "dependentRequired": {"roll": ["tangent"], "roll_deg": ["tangent"]},
        }
    )

    body: Text = Field(default="world", description='Name of the body that carries the clamp; "world" always exists.')
    position: Vector | None = Field(default=None, description="Of the centreline's end, in body coordinates, m.")
    force: Vector | None = Field(
        default=None, description="Dead load on the cable at this end, in world coordinates, N."
    )
    quaternion: Quaternion | None = Field(
        default=None,
        description="Section frame in body coordinates, scalar first; d3 points along growing arc length.",
    )
    tangent: Direction | None = Field(
        default=None, description="d3 in body coordinates, along growing arc length at both ends, any length."
    )
    roll_deg: Number | None = Field(
        default=None, description="Roll about the tangent by hand, from d1 = body x seen on the section, degrees."
    )
    roll: RollWord | None = Field(
        default=None, description="untwisted (if no roll is given): as fitted (fitted_at), plus turns; free: a swivel."
    )
    moment: Vector | None = Field(default=None, description="Dead moment on the cable at this end, world, N m.")
    turns: Number = Field(
        default=0, description="Any number an untwisted end is turned on by; else, at the end only, whole turns added."
    )
    holders: list[Text] | None = Field(
        default=None,
        description="Parts of the clamp's body that hold the cable, which it may be in until it has left them. "
        "Left out: those that contain the clamp's point or come nearer to it than the cable's radius; [] is none.",
    )
    let_off: NotNegative | None = Field(
        default=None,
        description="Arc over which a holder's limit does not count, m; left out: the radius plus the limit, at least "
        "two diameters.",
    )


class ClipTable(EndTable):
    """What holds a cable on its way, as an end is held, the cable going on beyond it."""

    name: Text = Field(description="Of the clip, none other of the cable's; not start, end or length.")
    at: Positive = Field(description="Arc length at which the cable is clipped, m.")
    kind: Annotated[ClipKind, Expected(one_of(CLIP_KINDS))] = Field(
        default="fixed",
        description="fixed: holds place and section; swivel: turns about its tangent; pivot: holds its place alone; "
        "sleeve: slides, tangent held; ring: slides, tangent free.",
    )
    optional: Flag = Field(default=False, description='Whether minimise = "clips" may do without it.')


class CableTable(Table):
    """A homogeneous, inextensible, unshearable, linearly elastic cable and what holds its ends."""

    model_config = ConfigDict(
        json_schema_extra=required_unless(
            "from", "diameter", "bending_stiffness", "torsional_stiffness", allOf=not_both("density", "mass_per_length")
        )
    )

    length: Positive = Field(description="Of the centreline, m.")
    diameter: Positive = Field(description="Outer diameter, m.")
    from_: Text | None = Field(default=None, alias="from", description="Cable of a library, my_cables.toml#NAME.")
    bend_radius: Positive | None = Field(default=None, description="This cable's own limit of the bend radius, m.")
    bend_radius_factors: dict[str, Positive] = Field(default_factory=dict, description="Bend limits by use, diameters.")
    bending_stiffness: Bending = Field(description="N m2; one number, or [kx, ky] about d1 and d2 of a flat section.")
    torsional_stiffness: Positive = Field(description="kz, about the tangent, N m2.")
    density: NotNegative | None = Field(default=None, description="kg/m3 of the full circle; or mass_per_length.")
    mass_per_length: NotNegative | None = Field(default=None, description="kg/m; or density; neither is weightless.")
    rest_curvature: Vector = Field(
        default=(0.0, 0.0, 0.0),
        description="Curvatures and twist of the unloaded cable in the section frame, 1/m.",
    )
    bow: Direction | None = Field(
        default=None,
        description="World direction to which the cable bows between its ends in the starting shape.",
    )
    fitted_at: MotionValue = Field(default=0.0, description="Motion value, 0 to 1, where an untwisted end is clamped.")
    start: EndTable = Field(description="What holds the cable at arc length 0.")
    end: EndTable = Field(description="What holds the cable at its full length.")
    clips: list[ClipTable] = Field(default_factory=list, description="What holds it between, along the cable.")


class BoxTable(Table):
    """A box centred on its origin."""

    size: Size = Field(description="Full extent along x, y, z, m.")


class SphereTable(Table):
    """A ball centred on its origin."""

    radius: Positive = Field(description="Half the diameter, m.")


class CylinderTable(Table):
    """A cylinder along z, centred on its origin."""

    radius: Positive = Field(description="Half the diameter, m.")
    length: Positive = Field(description="Full height, m.")


class CapsuleTable(Table):
    """A cylinder along z with half balls on both ends, centred on its origin."""

    radius: Positive = Field(description="Half the diameter, m.")
    length: Positive = Field(description="Of the cylinder alone, m.")


PART_SHAPES = ("mesh", "box", "cylinder", "sphere", "capsule")


class PartTable(Table):
    """A solid to stay clear of: one mesh or one primitive."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [{"required": [shape]} for shape in PART_SHAPES],
            "dependentRequired": {key: ["mesh"] for key in ("mesh_unit", "mesh_scale", "mesh_sha256", "shell", "up")},
            "if": {
                "required": ["mesh"],
                "properties": {"mesh": {"pattern": r"\.([sS][tT][lL]|[oO][bB][jJ]|[pP][lL][yY])$"}},
            },
            "then": {"required": ["mesh_unit"]},
        }
    )

    body: Text = Field(default="world", description='Name of the body it belongs to; "world" always exists.')
    mesh: Text | None = Field(default=None, description="STL, OBJ, PLY, GLB or glTF file, relative to this file.")
    mesh_unit: MeshUnit | None = Field(
        default=None,
        description="Unit of the mesh's coordinates; required for formats that carry none (STL, OBJ, PLY).",
    )
    mesh_scale: Scale | None = Field(
        default=None, description="By which it is multiplied; or [x, y, z], each of its axes; below 0 mirrors."
    )
    mesh_sha256: Digest | None = Field(
        default=None,
        description="SHA-256 of the mesh; with it, the mesh may lie outside this file's folder.",
    )
    shell: bool = Field(
        default=False,
        description="Whether a mesh that is not closed will do; a cable inside such a shell goes unnoticed.",
    )
    up: UpAxis | None = Field(
        default=None,
        description="The mesh's axis that points up; y is turned to z, (x, y, z) to (x, -z, y). Left out, it is y "
        "for GLB and glTF, as their specification says, and z for STL, OBJ and PLY, which say nothing.",
    )
    box: BoxTable | None = Field(default=None, description="A box instead of a mesh.")
    cylinder: CylinderTable | None = Field(default=None, description="A cylinder instead of a mesh.")
    sphere: SphereTable | None = Field(default=None, description="A ball instead of a mesh.")
    capsule: CapsuleTable | None = Field(default=None, description="A capsule instead of a mesh.")
    position: Vector = Field(default=(0.0, 0.0, 0.0), description="Of the shape's origin, in body coordinates, m.")
    quaternion: Quaternion = Field(
        default=(1.0, 0.0, 0.0, 0.0), description="Of the shape, in body coordinates, scalar first."
    )
    clearance: NotNegative | None = Field(default=None, description="This part's own clearance limit, m.")


class LimitsTable(Table):
    """What must hold at every moment; each is optional."""

    clearance: NotNegative | None = Field(
        default=None, description="Between the cable's surface and parts, other cables and itself, m."
    )
    bend_radius: Positive | None = Field(default=None, description="Smallest radius of the centreline, m.")
    bend_radius_factor: BendFactor | None = Field(default=None, description="The same in diameters, or by use.")
    twist_deg_per_m: Positive | None = Field(default=None, description="Largest twist per length, degrees/m.")
    clamp_force: Positive | None = Field(default=None, description="Largest force at a clamp, N.")
    clamp_moment: Positive | None = Field(default=None, description="Largest moment at a clamp, N m.")
    clip_force: Positive | None = Field(default=None, description="Largest force of a clip on the cable, N.")
    clip_moment: Positive | None = Field(default=None, description="Largest moment of a clip on the cable, N m.")
    travel: Positive | None = Field(default=None, description="How far a cable slides back and forth in a clip, m.")


class PathTable(Table):
    """The motion as a whole."""

    duration: Positive = Field(
        default=1.0, description="For playback, s; left out, that of the longest moves or table of values."
    )
    out_and_back: Flag = Field(
        default=False, description="Whether the bodies go through their motions until half-way and then back."
    )
    spatial_step: Positive | None = Field(
        default=None,
        description="Most that a clamp moves between two solved frames, m; a hundredth of the longest cable.",
    )


class DesignTable(Table):
    """What a redesign may change and what it prefers."""

    minimise: Annotated[Minimise, Expected(one_of(get_args(Minimise)))] = Field(
        default="change",
        description="Least change from this design, least length of all cables together, or the fewest of the clips "
        "that are optional.",
    )
    maximise: Annotated[Literal["margin"], Expected(one_of(("margin",)))] | None = Field(
        default=None, description="In place of minimise: the largest worst margin, each as a share of its limit."
    )
    snaps: Flag = Field(default=False, description="Whether cables may snap to other shapes on the way.")
    round_length: NotNegative = Field(
        default=1e-4, description="To multiples of this, m, moved lengths and positions are rounded; 0 is off."
    )
    round_deg: NotNegative = Field(default=0.1, description="The same of turns, degrees.")
    seed: Seed = Field(default=0, description="Of the designs that are looked at beside the descents.")
    weights: dict[str, NotNegative] = Field(
        default_factory=dict,
        description="Of the change of a variable, by name; 1 where left out, and changes count in the bounds' ranges.",
    )
    variables: dict[str, Bounds] = Field(
        default_factory=dict,
        description="Absolute [lower, upper] by name: CABLE.length (m), CABLE.start.position.x (m, body "
        "coordinates), CABLE.end.rotate_x_deg (degrees about d1, a tangent's projected x, from the pose "
        'given) and the like; or text that has it follow another variable: "= lead.start.position.x", '
        '"= 2 * lead.length - 0.01".',
    )


class RobustTable(Table):
    """What a redesign holds its limits against."""

    hold: Annotated[Literal["quantile", "corners"], Expected(one_of(("quantile", "corners")))] = Field(
        default="quantile",
        description="Limits hold for a share of what is built, or at all corners of the tolerances.",
    )
    share: Share = Field(default=0.99, description="Of what is built, between 0 and 1, for which all limits hold.")
    samples: Whole = Field(default=500, description="Of the Monte Carlo study that verifies it; 0 leaves it out.")
    seed: Seed = Field(default=0, description="Of these samples; the same seed gives the same.")
    tolerances: dict[str, ToleranceTable] = Field(
        default_factory=dict,
        description="By key of this file: cables.NAME.length (m), cables.NAME.stiffness_percent, "
        "cables.NAME.end.rotate_x_deg, parts.NAME.position.z and the like.",
    )


class ProblemTable(Table):
    """A problem file of harness-opt. SI units; degrees only in keys that end in _deg; world z is up."""

    schema_: Annotated[Literal[1], BeforeValidator(only_integer), Expected("1")] = Field(
        alias="schema", description="Version of this format."
    )
    title: Text = Field(default="", description="One line for people.")
    gravity: Vector = Field(default=(0.0, 0.0, 0.0), description="m/s2; leave out for weightless.")
    cables: dict[str, CableTable] = Field(description="The cables by name.", min_length=1)
    bodies: dict[str, BodyTable] = Field(default_factory=dict, description='The bodies by name, without "world".')
    robots: dict[str, RobotTable] = Field(default_factory=dict, description="Robots by name: bodies and parts by URDF.")
    motion: PathTable = Field(default=PathTable(), description="How finely the motion is followed and played back.")
    parts: dict[str, PartTable] = Field(default_factory=dict, description="The solids to stay clear of, by name.")
    limits: LimitsTable = Field(default=LimitsTable(), description="What must hold at every moment.")
    design: DesignTable = Field(default=DesignTable(), description="For redesign.")
    robust: RobustTable | None = Field(default=None, description="For a redesign that holds within tolerances.")


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the problem file, with units and words on every key."""
    return schema_of(ProblemTable, "Problem file of harness-opt")

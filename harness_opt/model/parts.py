"""Solid parts that cables stay clear of: meshes on disk and the four primitives, each in the pose of its body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from harness_opt.model.bodies import WORLD, Body
from harness_opt.model.checks import Quaternion, Vector, one_of, shown
from harness_opt.numerics import rotations

UNITLESS_MESHES = (".stl", ".obj", ".ply")  # formats that carry no unit
Y_UP = (".glb", ".gltf")  # formats in metres whose y axis points up: glTF 2.0, section 3.4
MESH_UNITS = ("m", "cm", "mm", "in")
UP_AXES = ("y", "z")
NOT_READ = (".stp", ".step", ".igs", ".iges", ".x_t", ".sldprt", ".sldasm", ".ipt", ".catpart", ".prt", ".3mf", ".dae")


@dataclass(frozen=True)
class MeshFile:
    """A triangle mesh on disk.

    Args:
        path: of the file; absolute in a problem that was read from one.
        unit: of its coordinates: "m", "cm", "mm", "in"; None where the format carries its own (GLB: metres).
        shell: whether a surface that is not closed will do: it has no inside, so a cable there goes unnoticed.
        up: its axis that points up, "y" or "z"; None for what its format says.
        scale: by which its coordinates are multiplied, after it was turned up, none 0; below 0 mirrors.
    """

    path: Path
    unit: str | None = None
    shell: bool = False
    up: Literal["y", "z"] | None = None
    scale: Vector = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", Path(self.path))

    @property
    def up_axis(self) -> Literal["y", "z"]:
        """Its axis that points up; a y is turned to z, which is up in bodies: (x, y, z) becomes (x, -z, y)."""
        return self.up or ("y" if self.path.suffix.lower() in Y_UP else "z")


def mesh_mistakes(name: str, unit: str | None) -> Iterator[tuple[str, str]]:
    """Yield what is wrong about the name of a mesh file and its unit: the key and the words."""
    suffix, known = Path(name).suffix.lower(), (*UNITLESS_MESHES, *Y_UP)
    if suffix in NOT_READ:
        yield "mesh", f"found {shown(name)}, a kind of CAD file that is not read: export STL or GLB"
    elif suffix not in known:
        yield "mesh", f"found {shown(name)}, expected a file ending in {one_of(known, suffix)}"
    elif suffix in UNITLESS_MESHES and unit is None:
        yield "mesh_unit", f"found nothing, expected {one_of(MESH_UNITS)}: {suffix} files carry no unit"
    if unit is not None and unit not in MESH_UNITS:
        yield "mesh_unit", f"found {shown(unit)}, expected {one_of(MESH_UNITS, unit)}"


@dataclass(frozen=True)
class Box:
    """A box centred on its origin; ``size`` is its full extent, m."""

    size: Vector


@dataclass(frozen=True)
class Sphere:
    """A ball centred on its origin; m."""

    radius: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, centred on its origin; ``length`` is its full height, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder along z with half balls on both ends; ``length`` is that of the cylinder alone, m."""

    radius: float
    length: float


Solid = Box | Sphere | Cylinder | Capsule


@dataclass(frozen=True)
class Part:
    """A solid to stay clear of.

    Args:
        shape: mesh file or primitive.
        body: name of the body it belongs to.
        position, quaternion: pose of the shape in the coordinates of the body.
        clearance: this part's own limit, m, or None for the general one.
    """

    shape: MeshFile | Solid
    body: str = WORLD
    position: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = rotations.IDENTITY
    clearance: float | None = None


@dataclass(frozen=True)
class Robot:
    """Where bodies and parts of a problem come from that a URDF describes: its links, ``NAME.LINK``.

    Args:
        urdf: its file, or "package:PACKAGE/..." for one of an installed Python package.
        base: where its root stands, and on which body.
        program: table of what its joints do; None where they stand still.
        unit: of the angles in that, "rad" or "deg".
        meshes: which shapes of its links are parts, "collision" or "visual".
        shell: whether meshes that are not closed will do.
        leave_out: parts, or links with all of theirs, that it goes without.
        bodies, parts: what it was made to.
        files: those of the URDF and the program, with the SHA-256 that they had.
        doubts: what is hardly meant, a line each: joints beyond their limits.
    """

    urdf: str | Path
    base: Body = field(default_factory=Body)
    program: Path | None = None
    unit: str = "rad"
    meshes: Literal["collision", "visual"] = "collision"
    shell: bool = False
    leave_out: tuple[str, ...] = ()
    bodies: Mapping[str, Body] = field(default_factory=dict)
    parts: Mapping[str, Part] = field(default_factory=dict)
    files: tuple[tuple[Path, str], ...] = ()
    doubts: tuple[str, ...] = ()

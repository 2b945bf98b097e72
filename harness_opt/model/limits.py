"""What a limit is: its kind, the cable it holds for, and the obstacle that a clearance is measured to.

A limit is known by these three values. Its words, its name in tables, its unit and its scale are made from them, here
and nowhere else, and never taken apart again.
"""

from __future__ import annotations

import enum
import json
import math
import re
from dataclasses import dataclass

BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")  # what TOML takes as a key without quotes


@dataclass(frozen=True)
class Unit:
    """How a quantity is shown.

    Args:
        name: of the unit.
        factor: how many of it are one unit of the problem file: SI, but degrees in keys that end in ``_deg``.
        digits: behind the point, of a value in a table.
        step: a change worth speaking of, in this unit.
    """

    name: str
    factor: float
    digits: int
    step: float = 1.0


MILLIMETRES = Unit("mm", 1e3, 2)
DEGREES = Unit("deg", 1.0, 2)


class LimitKind(enum.Enum):
    """What a limit holds; the value is its name in :class:`~harness_opt.model.design.Limits`."""

    CLEARANCE = "clearance"
    BEND_RADIUS = "bend_radius"
    TWIST = "twist"
    CLAMP_FORCE = "clamp_force"
    CLAMP_MOMENT = "clamp_moment"
    CLIP_FORCE = "clip_force"
    CLIP_MOMENT = "clip_moment"
    TRAVEL = "travel"

    @property
    def key(self) -> str:
        """Its name in ``[limits]`` of the problem file, and in results."""
        return "twist_deg_per_m" if self is LimitKind.TWIST else str(self.value)

    @property
    def from_si(self) -> float:
        """What an SI value is multiplied by to be in the unit of :attr:`key`."""
        return math.degrees(1.0) if self is LimitKind.TWIST else 1.0

    @property
    def unit(self) -> Unit:
        """In which it is shown."""
        return UNITS[self]

    @property
    def is_least(self) -> bool:
        """Whether it is the least that is allowed, or else the most."""
        return self in (LimitKind.CLEARANCE, LimitKind.BEND_RADIUS)

    @property
    def words(self) -> str:
        """What people call it: ``bend radius``."""
        return str(self.value).replace("_", " ")

    def scale(self, limit: float, radius: float) -> float:
        """Return what a margin is divided by to be comparable with others, SI.

        Args:
            limit: SI.
            radius: of the cable, m: a clearance of 0 is asked for as much as any other.
        """
        return limit + radius if self is LimitKind.CLEARANCE else limit


UNITS = {
    LimitKind.CLEARANCE: MILLIMETRES,
    LimitKind.BEND_RADIUS: MILLIMETRES,
    LimitKind.TWIST: Unit("deg/m", 1.0, 0, 10.0),
    LimitKind.CLAMP_FORCE: Unit("N", 1.0, 2, 0.1),
    LimitKind.CLAMP_MOMENT: Unit("N m", 1.0, 3, 0.01),
    LimitKind.CLIP_FORCE: Unit("N", 1.0, 2, 0.1),
    LimitKind.CLIP_MOMENT: Unit("N m", 1.0, 3, 0.01),
    LimitKind.TRAVEL: MILLIMETRES,
}
KIND_OF_KEY = {kind.key: kind for kind in LimitKind}
CLAMP_LOADS = (LimitKind.CLAMP_FORCE, LimitKind.CLAMP_MOMENT)  # at the two ends of a cable
CLIP_LOADS = (LimitKind.CLIP_FORCE, LimitKind.CLIP_MOMENT)  # of every clip on its way
CABLE_KINDS = (LimitKind.BEND_RADIUS, LimitKind.TWIST, *CLAMP_LOADS)  # limits of a cable alone
FORCES = (LimitKind.CLAMP_FORCE, LimitKind.CLIP_FORCE)


@dataclass(frozen=True)
class Obstacle:
    """What a clearance is measured to: a part, or a cable.

    Args:
        name: of the part or the cable.
        is_cable: whether it is a cable; parts and cables may have the same names.
    """

    name: str
    is_cable: bool = False

    @property
    def key(self) -> str:
        """Its name in files: that of the part, or ``cable:NAME``."""
        return f"cable:{self.name}" if self.is_cable else self.name

    def words(self, cable: str) -> str:
        """Return what it is to ``cable``: ``bracket``, ``cable loom`` or ``itself``."""
        if not self.is_cable:
            return spoken(self.name)
        return "itself" if self.name == cable else f"cable {spoken(self.name)}"


@dataclass(frozen=True)
class LimitId:
    """Which limit: its kind, the cable, and the obstacle of a clearance, or the clip.

    Args:
        kind: of the limit.
        cable: its name.
        obstacle: of a clearance; None for the other kinds.
        clip: name of the clip whose load is limited; None for the other kinds.
    """

    kind: LimitKind
    cable: str
    obstacle: Obstacle | None = None
    clip: str | None = None

    @property
    def words(self) -> str:
        """What people call it: ``clearance of lead to bracket``."""
        against = "" if self.obstacle is None else f" to {self.obstacle.words(self.cable)}"
        at = "" if self.clip is None else f" at {spoken(self.clip)}"
        return f"{self.kind.words} of {spoken(self.cable)}{against}{at}"

    def __str__(self) -> str:
        """Return the name in tables and results, unique in a problem: ``clearance.lead.bracket``."""
        names = [self.kind.key, quoted(self.cable)]
        if self.obstacle is not None:
            names.append(f"{'cable:' if self.obstacle.is_cable else ''}{quoted(self.obstacle.name)}")
        if self.clip is not None:
            names.append(quoted(self.clip))
        return ".".join(names)


def kind_of(limit_id: str) -> LimitKind:
    """Return the kind of the limit with this name in tables; the key that begins it holds no dot."""
    return KIND_OF_KEY[limit_id.partition(".")[0]]


def spoken(name: str) -> str:
    """Return ``name`` as a sentence has it: in quotes where it holds spaces, and would run into the other words."""
    return f'"{name}"' if " " in name else name


def quoted(name: str) -> str:
    """Return ``name`` as a TOML key: in quotes where it holds more than letters, digits, ``_`` and ``-``."""
    return name if BARE_KEY.fullmatch(name) else json.dumps(name, ensure_ascii=False)

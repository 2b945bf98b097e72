"""What a motion is told in: degrees of a hinge, millimetres of a slide, seconds of a table of poses.

A motion value runs from 0 to 1, which says little to whoever drew the scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from harness_opt.model.bodies import Hinge, Poses, Slide
from harness_opt.model.problem import Problem

MOST_TOLD = 2  # bodies that are told one by one; of more, the time of the motion is
DIGITS = {"deg": 1, "mm": 1, "s": 2}


@dataclass(frozen=True)
class Travel:
    """The way of one body, which goes evenly with the motion value.

    Args:
        body: its name; empty for the time of the whole motion.
        unit: "deg", "mm" or "s".
        start, stop: where it begins and ends, in that unit.
    """

    body: str
    unit: str
    start: float
    stop: float

    def at(self, share: float) -> str:
        """Return where it is at ``share`` of its way, 0 to 1, in words: ``55.0 deg``."""
        value = self.start + share * (self.stop - self.start)
        return f"{value:.{DIGITS[self.unit]}f} {self.unit}".replace("-0.0 ", "0.0 ")


def travels(problem: Problem) -> tuple[Travel, ...]:
    """Return the ways of the bodies that move."""
    found = []
    for name, body in problem.bodies.items():
        motion = body.motion
        if isinstance(motion, Hinge):
            found.append(Travel(name, "deg", math.degrees(motion.start), math.degrees(motion.stop)))
        elif isinstance(motion, Slide):
            found.append(Travel(name, "mm", 1e3 * motion.start, 1e3 * motion.stop))
        elif isinstance(motion, Poses):
            found.append(Travel(name, "s", motion.times[0], motion.times[-1]))
    return tuple(found)


@dataclass(frozen=True)
class Moments:
    """Tells moments of a motion.

    Args:
        ways: of the bodies that move.
        duration: of the motion, s.
        out_and_back: whether it goes there and back.
    """

    ways: Sequence[Travel]
    duration: float
    out_and_back: bool = False

    @staticmethod
    def of(problem: Problem) -> Moments:
        """Return what tells the moments of a problem's motion."""
        return Moments(travels(problem), problem.duration, problem.out_and_back)

    def short(self, motion: float) -> str:
        """Return a moment, 0 to 1, in one unit: ``55.0 deg``; nothing where nothing moves."""
        if not self.ways:
            return ""
        if len(self.ways) > 1:
            return Travel("", "s", 0.0, self.duration).at(motion)
        return self.ways[0].at(self._share(motion))

    def words(self, motion: float) -> str:
        """Return a moment, 0 to 1, in words: ``55.0 deg, 50.0 %``, with the bodies' names where two move."""
        told = self.short(motion)
        if 1 < len(self.ways) <= MOST_TOLD:
            told = ", ".join(f"{way.body} {way.at(self._share(motion))}" for way in self.ways)
        back = " on the way back" if self.out_and_back and motion > 0.5 else ""
        share = f"{100 * motion:.1f} %"
        return f"{told}{back}, {share}" if told else share

    def _share(self, motion: float) -> float:
        return 1.0 - abs(2.0 * motion - 1.0) if self.out_and_back else motion

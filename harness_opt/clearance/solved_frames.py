"""The frames of one cable over its motion: those of the simulation, and those solved between them to be certain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from harness_opt.model.problem import SHARES, Moments
from harness_opt.model.results import CableMotion, Motion, Quantities, cubic_errors
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

NODES = 4  # frames that a cubic goes through
SHORTEST = 2.0**-20  # of the motion, between two frames: below this a shape is said to jump

# cable and motion values (k,) to the shapes that were found, and for each value why there is none, or nothing
Solve = Callable[[str, Array], tuple[Quantities, tuple[str, ...]]]


class SolvedFrames:
    """The shapes of one cable in the frames of its motion, to which more can be added.

    Args:
        cable: its name.
        motion: (P,), of the frames, increasing.
        shapes: of the cable in them.
        solve: finds shapes between them.
        jumps: motion values inside the intervals in which the cable snaps.
        turns: motion values at which bodies turn round, so that nothing is smooth across them.
        moments: what motion values are told in.
        stretch: share of ``shapes.s`` that the cable is long at motion values (k,), (k,): 1 but of a span between clips
            that it slides through.
    """

    def __init__(
        self,
        cable: str,
        motion: Array,
        shapes: CableMotion,
        solve: Solve,
        *,
        jumps: Array,
        turns: Array,
        moments: Moments = SHARES,
        stretch: Callable[[Array], Array] | None = None,
    ):
        self.cable, self._solve, self.jumps, self.turns, self.moments = cable, solve, jumps, turns, moments
        self.s, self.times = shapes.s, motion
        self._stretch = stretch
        self.position, self.tangent = shapes.position, self._slopes(shapes.quaternion, motion)
        self.curvature = shapes.curvature
        self.force, self.moment = shapes.force[:, [0, -1]], shapes.moment[:, [0, -1]]  # at the two ends
        own = float(np.nan_to_num(np.max(shapes.estimated_error)))
        self.error = float(cubic_errors(shapes).max()) + own * shapes.s[-1]  # of the frames themselves, m
        self.given = motion
        self._lost: dict[float, str] = {}  # motion values at which no shape was found, and why

    @property
    def inserted(self) -> int:
        """How many frames were added."""
        return len(self.times) - len(self.given)

    @property
    def broken(self) -> NDArray[np.bool_]:
        """Between which frames nothing is known (P - 1,): the cable snaps there, or no shape was found."""
        broken = np.diff(self.times) < SHORTEST
        for values in (self.jumps, np.array(list(self._lost))):
            broken[self.interval(values)] = True
        return broken

    def interval(self, at: Array) -> Indices:
        """Return the intervals (k,) between frames that hold motion values ``at`` (k,)."""
        return np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(self.times) - 2)

    def insert(self, values: Array) -> None:
        """Solve frames at motion values (k,), but for those where there is one."""
        gap = np.min(np.abs(values[:, None] - self.times), axis=1, initial=math.inf)
        values = np.unique(values[gap > SHORTEST])
        if not len(values):
            return
        shapes, why = self._solve(self.cable, values)
        self._lost |= {float(value): reason for value, reason in zip(values, why, strict=True) if reason}
        found = np.array([not reason for reason in why], dtype=bool)
        slopes = self._slopes(shapes.quaternion, values[found])
        times = np.concatenate([self.times, values[found]])
        order = np.argsort(times, kind="stable")
        self.times = times[order]
        for name, more in (
            ("position", shapes.position),
            ("tangent", slopes),
            ("curvature", shapes.curvature),
            ("force", shapes.force[:, [0, -1]]),
            ("moment", shapes.moment[:, [0, -1]]),
        ):
            setattr(self, name, np.concatenate([getattr(self, name), more])[order])

    def _slopes(self, quaternion: Array, at: Array) -> Array:
        """Return the derivatives by ``s`` (k, N, 3) of centrelines with frames (k, N, 4) at motion values (k,)."""
        tangent = rotations.tangent(quaternion)
        return tangent if self._stretch is None else self._stretch(at)[:, None, None] * tangent

    def complete(self) -> None:
        """Solve as many frames as a cubic needs on every stretch without a break."""
        for _ in range(NODES):
            missing = [
                np.linspace(self.times[first], self.times[last], NODES)[1:-1]
                for first, last in self.stretches()
                if first < last < first + NODES - 1
            ]
            if not missing:
                return
            self.insert(np.concatenate(missing))

    def why_broken(self, interval: int) -> str:
        """Return why nothing is known within an interval: a sentence for the user."""
        low, high = self.times[interval], self.times[interval + 1]
        frame = int(np.clip(np.searchsorted(self.given, 0.5 * (low + high)) - 1, 0, len(self.given) - 2))
        told = " to ".join(dict.fromkeys(self.moments.words(float(at)) for at in (low, high)))
        where = f"between frames {frame} and {frame + 1} ({told})"
        if np.any((self.jumps > low) & (self.jumps < high)):
            return f"{self.cable} snaps {where}, and what it meets on the way is not known"
        if high - low < SHORTEST:
            return f"{self.cable} jumps {where}"
        lost = [why for at, why in self._lost.items() if low < at < high]
        return f"{self.cable} {where}: {'; '.join(dict.fromkeys(lost))}"

    def stretches(self) -> list[tuple[int, int]]:
        """Return the first and last frame of each run of frames across which the motion is smooth."""
        broken = self.broken
        kinks = np.flatnonzero(np.isin(self.times, self.turns))
        cuts = {0, len(self.times) - 1, *kinks}
        for k in np.flatnonzero(broken):
            cuts |= {int(k), int(k) + 1}
        edges = sorted(int(cut) for cut in cuts)
        return [(a, b) for a, b in itertools.pairwise(edges) if not (b == a + 1 and broken[a])]


def at_rest(given: Motion) -> dict[str, SolvedFrames]:
    """Return the first frame of each cable of a scene in which nothing moves."""
    none = np.zeros(0)

    def solve(cable: str, values: Array) -> tuple[Quantities, tuple[str, ...]]:
        return given.cables[cable].at_frames(np.zeros(len(values), dtype=np.int64)), ("",) * len(values)

    first = {name: shapes.frames(slice(1)) for name, shapes in given.cables.items()}
    return {
        name: SolvedFrames(name, given.motion[:1], one, solve, jumps=none, turns=none) for name, one in first.items()
    }

"""Stiffness and rest curvature of a cable by least squares through its equilibria.

Gauss-Newton with Levenberg's and Marquardt's damping on the weighted residuals of all measurements (More, "The
Levenberg-Marquardt algorithm", 1978); stiffnesses by their logarithms, so that they stay above zero. A point of a shape
misses the computed centreline by its distance across it: along it nothing was measured, unless its arc length was.

Intervals of 95 % are those of linear regression (Seber and Wild, "Nonlinear Regression", section 2.1): the inverse of
J^T J times the scatter, by Student's t where the scatter is found from the residuals. Points of one photograph err
together, by how the cable lay that day: of three measurements or more, the scatter between them counts where it is more
(sandwich estimate, Liang and Zeger, "Longitudinal data analysis using generalized linear models", 1986).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness_opt.errors import ProblemError, SolveError, Status
from harness_opt.measured.advice import advice, inverse_of
from harness_opt.measured.measurements import TORSION, Measurement, Measurements
from harness_opt.measured.measurements_file import read_measurements
from harness_opt.measured.pose import DENSE, Shaped, force_at, mean_distance, missed_by, shaped, tip
from harness_opt.measured.snap import snap_twist
from harness_opt.model.cable import Cable
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_thread

STEP = 1e-5  # of a parameter in its own scale, to either side: eleven digits of a difference are left
TOO_WIDE = math.log(3.0)  # a stiffness whose interval is three times as much or a third is not known
MOST_STEPS = 40  # of the search: from ten times the stiffness it takes about ten
CONVERGED = 1e-3  # standard deviations of the parameters, to which they are found: nobody will ever know better


@dataclass(frozen=True)
class Estimate:
    """One quantity that was sought.

    Args:
        name: as in ``find``.
        value: N m2, or 1/m.
        low, high: between these it lies with 95 % confidence; infinitely far where the measurements do not say.
        known: whether they say it to within a factor of three (of a curvature: to within that of a cable's length).
    """

    name: str
    value: float
    low: float
    high: float
    known: bool


@dataclass(frozen=True)
class Agreement:
    """How one measurement agrees with what was found.

    Args:
        name: of the measurement.
        unit: of the following: "m", "N" or "deg".
        measured: what was measured; of a loop 0.
        before, after: what it is with the cable that the search began at, and the one found; of a loop the mean
            distance of its points from the shape.
        share: of the length, that distance; None of other kinds.
        shape: of the cable found, (n, 3), m; empty where there is none.
        points: measured, (n, 3), m.
    """

    name: str
    unit: str
    measured: float
    before: float
    after: float
    share: float | None
    shape: Array
    points: Array


@dataclass(frozen=True)
class Identification:
    """What was found of a cable.

    Args:
        cable: found.
        given: measured, and where the search began.
        estimates: of what was sought.
        agreements: of the measurements.
        scatter: of the residuals, in the errors that were stated or taken.
        advice: what a further measurement would help most with, a sentence; empty where all is known well.
    """

    cable: Cable
    given: Measurements
    estimates: tuple[Estimate, ...]
    agreements: tuple[Agreement, ...]
    scatter: float
    advice: str

    @property
    def ok(self) -> bool:
        """Whether the measurements say all that was sought."""
        return all(estimate.known for estimate in self.estimates)

    def __repr__(self) -> str:
        """Return one line."""
        told = ", ".join(f"{e.name} {e.value:.4g} ({e.low:.4g} to {e.high:.4g})" for e in self.estimates)
        return f"<Identification: {told}>"


@one_thread
def identify(measurements: Measurements | str | Path) -> Identification:
    """Return what measured shapes, sags, forces and snaps say about a cable's stiffness.

    Args:
        measurements: or the path of their file.

    Raises:
        ProblemError: bad input; measurements that do not depend on anything sought.
        SolveError: no shape was found for a measurement.
    """
    given = measurements if isinstance(measurements, Measurements) else read_measurements(measurements)
    search = _Search(given)
    first = search.first()
    best = search.best(first)
    halves, scatter = search.intervals(best)
    estimates = tuple(search.estimate(best, k, float(half)) for k, half in enumerate(halves))
    agreements = tuple(_agreement(*three) for three in zip(given.measured, first.shapes, best.shapes, strict=True))
    slope = np.vstack(best.slopes)
    told = advice(given, search.cable(best.at), search.sides(best.at), best.shapes, slope.T @ slope, halves)
    return Identification(search.cable(best.at), given, estimates, agreements, scatter, told)


@dataclass(frozen=True, eq=False)
class _Look:
    """The measurements at parameters ``at`` (k,): shapes, weighted residuals and rates, each by measurement."""

    at: Array
    shapes: tuple[Shaped | float, ...]
    residuals: tuple[Array, ...]
    slopes: tuple[Array, ...]

    @property
    def cost(self) -> float:
        """Half the sum of the squares."""
        return 0.5 * sum(float(r @ r) for r in self.residuals)


class _Search:
    """Least squares on the parameters: logarithms of stiffnesses, and curvatures times the length."""

    def __init__(self, given: Measurements):
        self.given = given
        self.begin = np.array([self._parameter(name) for name in given.sought])
        self._slopes: dict[int, Array] = {}  # of the logarithms of snaps' twists

    def _parameter(self, name: str) -> float:
        cable = self.given.cable
        if name.startswith("rest_curvature"):
            return cable.rest_curvature["xyz".index(name[-1])] * cable.length
        return math.log(float(cable.bending_stiffness if name == "bending_stiffness" else cable.torsional_stiffness))  # type: ignore[arg-type]

    def cable(self, at: Array) -> Cable:
        """Return the cable with parameters ``at`` (k,)."""
        values = dict(zip(self.given.sought, at.tolist(), strict=True))
        curvature = list(self.given.cable.rest_curvature)
        for axis in "xyz":
            if f"rest_curvature.{axis}" in values:
                curvature["xyz".index(axis)] = values[f"rest_curvature.{axis}"] / self.given.cable.length
        bending = float(self.given.cable.bending_stiffness)  # type: ignore[arg-type]
        if "bending_stiffness" in values:
            bending = math.exp(values["bending_stiffness"])
        torsion = self.given.cable.torsional_stiffness if self.given.torsion_known else TORSION * bending
        if "torsional_stiffness" in values:
            torsion = math.exp(values["torsional_stiffness"])
        return dataclasses.replace(
            self.given.cable,
            bending_stiffness=bending,
            torsional_stiffness=torsion,
            rest_curvature=tuple(curvature),  # type: ignore[arg-type]
        )

    def sides(self, at: Array) -> list[tuple[Cable, Cable, float]]:
        """Return the cable with a little more and a little less of each parameter, and half the difference."""
        steps = STEP * np.eye(len(at))
        return [(self.cable(at + step), self.cable(at - step), STEP) for step in steps]

    def look(self, at: Array, near: _Look | None = None) -> _Look:
        """Return the measurements at parameters ``at`` (k,).

        Raises:
            SolveError: a shape was not found.
        """
        cable, sides = self.cable(at), self.sides(at)
        shapes, residuals, slopes = list[Shaped | float](), list[Array](), list[Array]()
        for k, one in enumerate(self.given.measured):
            if one.kind == "snap":
                twist = snap_twist(one.pose, cable, self.given.gravity, one.value)
                residual, slope = np.array([one.value - twist]), -self._snap_slope(k, one, at, twist)
                shapes.append(twist)
            else:
                before = near.shapes[k] if near is not None else None
                shape = shaped(one.pose, cable, self.given.gravity, before if isinstance(before, Shaped) else None)
                residual, slope = missed_by(one, shape, sides, self.given.gravity)
                shapes.append(shape)
            residuals.append(residual / one.error)
            slopes.append(slope / one.error)
        return _Look(at, tuple(shapes), tuple(residuals), tuple(slopes))

    def _snap_slope(self, number: int, one: Measurement, at: Array, found: float) -> Array:
        """Return how the twist of a snap changes with the parameters, (1, k): once, as a motion is followed for each.

        It is that of a fold, in proportion to the ratio of both stiffnesses, nearly: its logarithm changes evenly.
        """
        step = 0.05  # of a parameter: twists are known to a degree
        if number not in self._slopes:
            moved = [
                snap_twist(one.pose, self.cable(at + step * axis), self.given.gravity, one.value)
                for axis in np.eye(len(at))
            ]
            self._slopes[number] = (np.array([moved]) - found) / step / found
        return found * self._slopes[number]

    def best(self, here: _Look) -> _Look:
        """Return the parameters of least squares that a search ``here`` leads to.

        It has come there where Gauss-Newton's step is far within what is known at all: the length of that step in the
        standard deviations of the parameters (Bates and Watts, "Nonlinear Regression Analysis", section 2.2.3).

        Raises:
            ProblemError: nothing that was measured depends on anything sought.
            SolveError: it comes to none.
        """
        damping = 1e-3
        for _ in range(MOST_STEPS):
            slope, residual = np.vstack(here.slopes), np.concatenate(here.residuals)
            normal, downhill = slope.T @ slope, -slope.T @ residual
            size = np.diag(normal)
            if not np.any(size > 0):
                raise ProblemError(f"measurements: found none that depends on {' or '.join(self.given.sought)}")
            if math.sqrt(max(float(downhill @ inverse_of(normal) @ downhill), 0.0)) < CONVERGED:
                return here
            step = np.linalg.solve(normal + damping * np.diag(np.maximum(size, 1e-12 * size.max())), downhill)
            step = np.clip(step, -1.0, 1.0)  # no more than e times the stiffness at once
            try:
                there = self.look(here.at + step, here)
            except SolveError:
                damping *= 10.0
                continue
            better = there.cost <= here.cost
            here, damping = (there, max(0.1 * damping, 1e-12)) if better else (here, 10.0 * damping)
        raise SolveError("no stiffness was found that fits best: the search did not settle", Status.STALLED, None)

    def first(self) -> _Look:
        """Return where the search begins: as given, or the best of three stiffnesses where nothing was.

        Raises:
            SolveError: a shape was not found with any.
        """
        known = self.given.begin_known or "bending_stiffness" not in self.given.sought
        stiffer = np.array([float(name.endswith("stiffness")) for name in self.given.sought])
        found, why = list[_Look](), None
        for power in (0.0,) if known else (0.0, -1.5, 1.5):
            try:
                found.append(self.look(self.begin + power * stiffer))
            except SolveError as error:
                why = error
        if not found:
            raise why or SolveError("no shape was found", Status.NO_START, None)
        return min(found, key=lambda one: one.cost)

    # -- how sure ------------------------------------------------------------------------------------------

    def intervals(self, best: _Look) -> tuple[Array, float]:
        """Return half the widths (k,) of the intervals of 95 % of the parameters, and the scatter.

        That of a direction in which nothing was measured has no bound.
        """
        from scipy.special import stdtrit

        slope, residual = np.vstack(best.slopes), np.concatenate(best.residuals)
        free = len(residual) - len(best.at)
        scatter = math.sqrt(float(residual @ residual) / free) if free > 0 else 1.0
        stated = all(one.error_given for one in self.given.measured)
        spread = max(1.0, scatter) if stated or free <= 0 else scatter
        inverse = inverse_of(slope.T @ slope)
        quantile = float(stdtrit(free, 0.975)) if free > 0 and not stated else 1.959964
        halves = quantile * spread * np.sqrt(np.maximum(np.diag(inverse), 0.0))
        several = len(best.residuals)
        if several >= max(3, len(best.at) + 1):
            pulls = np.array([own.T @ missed for own, missed in zip(best.slopes, best.residuals, strict=True)])
            sandwich = several / (several - 1.0) * inverse @ pulls.T @ pulls @ inverse
            between = float(stdtrit(several - 1, 0.975)) * np.sqrt(np.maximum(np.diag(sandwich), 0.0))
            halves = np.maximum(halves, between)
        return halves, scatter

    def estimate(self, best: _Look, number: int, half: float) -> Estimate:
        """Return parameter ``number`` with its interval, ``half`` to either side."""
        name, at = self.given.sought[number], float(best.at[number])
        if name.startswith("rest_curvature"):
            length = self.given.cable.length
            return Estimate(name, at / length, (at - half) / length, (at + half) / length, half < 1.0)
        far = half > 700.0  # beyond any double
        low, high = (0.0, math.inf) if far else (math.exp(at - half), math.exp(at + half))
        return Estimate(name, math.exp(at), low, high, half < TOO_WIDE)


def _agreement(one: Measurement, before: Shaped | float, after: Shaped | float) -> Agreement:
    none = np.zeros((0, 3))
    if not isinstance(before, Shaped) or not isinstance(after, Shaped):
        measured, first, last = (math.degrees(float(twist)) for twist in (one.value, before, after))  # type: ignore[arg-type]
        return Agreement(one.name, "deg", measured, first, last, None, none, none)
    shape = after.at(np.linspace(0.0, one.pose.length, DENSE)).position
    if one.kind != "loop":
        read = tip if one.kind == "sag" else lambda there: force_at(there, one.side)
        unit = "m" if one.kind == "sag" else "N"
        return Agreement(one.name, unit, one.value, float(read(before)[0]), float(read(after)[0]), None, shape, none)
    first, last = (mean_distance(each, one) for each in (before, after))
    return Agreement(one.name, "m", 0.0, first, last, last / one.pose.length, shape, one.points)

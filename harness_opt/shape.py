"""Solved rods as plain arrays: sampling anywhere, energy, and how far the discrete solution is from the exact one.

The states at the nodes carry the full order of the collocation (2s); between them the rod's own equations are
expanded in a power series about the nearest node, so every sampled quantity has the accuracy of the nodes. Where no
series spans the element, both of its nodes are interpolated (:mod:`harness_opt.long_elements`).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from . import rod, rotations
from .long_elements import LongElements
from .quadrature import gauss
from .rod import Section
from .rotations import Array

SERIES_ORDER = 12  # the truncation at half an element is then far below the collocation's own error
# decay lengths of a tension, and rad of a twisting moment's waves, that an element may have: beyond, what rounding
# leaves at a node swamps its series
SPAN, WAVES = 20.0, 60.0
ENERGY_POINTS = 6  # Gauss points an element for energies


@dataclass(frozen=True)
class Samples:
    """Rod quantities at stations, dimensionless; shapes (..., N, 3) and (..., N, 4).

    Args:
        r, q: centreline, relative to the start, and section frames.
        force, moment: internal, world.
        omega: Darboux vector, section frame.
    """

    r: Array
    q: Array
    force: Array
    moment: Array
    omega: Array


@dataclass(frozen=True)
class Rod:
    """One or many solved shapes of one cable on one mesh, dimensionless; leading axes (...) count the shapes.

    Args:
        section, load: of the cable; load f (3,), world.
        mesh: nodes from 0 to 1, (n + 1,).
        q, r, force, moment: states at the nodes, (..., n + 1, 4) and (..., n + 1, 3), world, start at the origin.
    """

    section: Section
    load: Array
    mesh: Array
    q: Array
    r: Array
    force: Array
    moment: Array

    def series(self) -> rod.Series:
        """Return the power series about every node; that of one shape is kept, those of many would be much memory."""
        return self._series if self.q.ndim == 2 else self._expanded()

    @functools.cached_property
    def _series(self) -> rod.Series:
        return self._expanded()

    def _expanded(self) -> rod.Series:
        return rod.series(self.q, self.r, self.force, self.moment, self.section, self.load, SERIES_ORDER)

    @functools.cached_property
    def long(self) -> Array:
        """Whether an element is longer, in any of the shapes, than a power series spans, (n,)."""
        none = np.zeros_like(self.force)
        growing = rod.wave_numbers(self.force, none, self.section.stiffness) / SPAN
        waving = rod.wave_numbers(none, self.moment, self.section.stiffness) / WAVES
        most = np.maximum(growing, waving).reshape(-1, len(self.mesh)).max(axis=0)
        return np.asarray(np.maximum(most[1:], most[:-1]) * np.diff(self.mesh) > 1.0)

    def _long_elements(self, series: rod.Series) -> LongElements:
        """Return the elements that are :attr:`long`."""
        chosen = np.flatnonzero(self.long)
        ends = np.array([chosen, chosen + 1])

        def at(values: Array) -> Array:
            return np.moveaxis(values[..., ends, :], -3, 0)

        step = self.mesh[ends[1]] - self.mesh[ends[0]]
        return LongElements(step, at(self.r), at(self.q), at(series.omega[0]))

    def sample(self, s: Array, series: rod.Series | None = None) -> Samples:
        """Return all quantities at arc lengths ``s`` (N,) from 0 to 1."""
        s = np.asarray(s, dtype=float)
        series = self.series() if series is None else series
        middles = 0.5 * (self.mesh[1:] + self.mesh[:-1])
        node = np.searchsorted(middles, s)
        distance = np.broadcast_to(s - self.mesh[node], (*self.q.shape[:-2], len(s)))

        def at(coefficients: Array) -> Array:
            return rod.evaluate(coefficients[..., node, :], distance)

        force = self.force[..., :1, :] - s[:, None] * self.load
        if not np.any(self.long):
            q = rotations.normalise(at(series.q))
            return Samples(at(series.r), q, force, rotations.rotate(q, at(series.moment)), at(series.omega))
        with np.errstate(over="ignore", invalid="ignore"):  # of what is replaced
            q, r, omega = rotations.normalise(at(series.q)), at(series.r), at(series.omega)
        element = np.clip(np.searchsorted(self.mesh, s, side="right") - 1, 0, len(self.mesh) - 2)
        within = np.flatnonzero(self.long[element])
        among = np.searchsorted(np.flatnonzero(self.long), element[within])
        part = (s[within] - self.mesh[element[within]]) / np.diff(self.mesh)[element[within]]
        r[..., within, :], q[..., within, :], omega[..., within, :] = self._long_elements(series).sample(among, part)
        strain = omega - self.section.rest_curvature
        return Samples(r, q, force, rotations.rotate(q, strain * self.section.stiffness), omega)

    def defects(self, series: rod.Series | None = None) -> tuple[Array, Array, Array]:
        """Return how much the exact solutions through neighbouring nodes disagree at the middle of each element.

        This is the local truncation error of the collocation step, as states: quaternion (..., n, 4), moment in the
            world frame (..., n, 3) and position (..., n, 3), right minus left.
        """
        series = self.series() if series is None else series
        half = 0.5 * np.diff(self.mesh)
        step = np.broadcast_to(half, (*self.q.shape[:-2], len(half)))

        def sides(coefficients: Array) -> tuple[Array, Array]:
            return rod.evaluate(coefficients[..., :-1, :], step), rod.evaluate(coefficients[..., 1:, :], -step)

        (q0, q1), (r0, r1), (m0, m1) = sides(series.q), sides(series.r), sides(series.moment)
        dq, dm, dr = q1 - q0, rotations.rotate(q1, m1) - rotations.rotate(q0, m0), r1 - r0
        if np.any(self.long):
            dq[..., self.long, :], dr[..., self.long, :] = self._long_elements(series).defects()
            middle = self.force[..., 1:, :] + half[:, None] * self.load
            moments = np.diff(self.moment, axis=-2) + rotations.cross(np.diff(self.r, axis=-2), middle)
            dm[..., self.long, :] = moments[..., self.long, :]
        return dq, dm, dr

    def energy(self) -> Array:
        """Return elastic energy less the work of the distributed load from the start's level, (...), in B/L."""
        tableau = gauss(ENERGY_POINTS)
        steps = np.diff(self.mesh)
        s = (self.mesh[:-1, None] + steps[:, None] * tableau.nodes).ravel()
        weights = (steps[:, None] * tableau.weights).ravel()
        samples = self.sample(s)
        strain = samples.omega - self.section.rest_curvature
        elastic = 0.5 * np.sum(strain**2 * self.section.stiffness, axis=-1)
        return (elastic - samples.r @ self.load) @ weights

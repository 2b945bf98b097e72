"""Solved rods as plain arrays: sampling anywhere, energy, and how far the discrete solution is from the exact one.

The states at the nodes carry the full order of the collocation (2s); between them the rod's own equations are
expanded in a power series about the nearest node, so every sampled quantity has the accuracy of the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import rod, rotations
from .quadrature import gauss
from .rod import Section
from .rotations import Array

SERIES_ORDER = 12  # the truncation at half an element is then far below the collocation's own error
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
        """Return the power series about every node."""
        return rod.series(self.q, self.r, self.force, self.moment, self.section, self.load, SERIES_ORDER)

    def sample(self, s: Array, series: rod.Series | None = None) -> Samples:
        """Return all quantities at arc lengths ``s`` (N,) from 0 to 1."""
        s = np.asarray(s, dtype=float)
        series = self.series() if series is None else series
        middles = 0.5 * (self.mesh[1:] + self.mesh[:-1])
        node = np.searchsorted(middles, s)
        distance = np.broadcast_to(s - self.mesh[node], (*self.q.shape[:-2], len(s)))

        def at(coefficients: Array) -> Array:
            return rod.evaluate(coefficients[..., node, :], distance)

        q = rotations.normalise(at(series.q))
        omega = at(series.omega)
        force = self.force[..., :1, :] - s[:, None] * self.load
        moment = rotations.rotate(q, at(series.moment))
        return Samples(at(series.r), q, force, moment, omega)

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
        return q1 - q0, rotations.rotate(q1, m1) - rotations.rotate(q0, m0), r1 - r0

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

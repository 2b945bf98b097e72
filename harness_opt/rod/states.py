"""Solved rods as plain arrays: sampling anywhere, energy, and how far the discrete solution is from the exact one.

The states at the nodes carry the full order of the collocation (2s); between them the rod's own equations are
expanded in a power series about the nearest node, so every sampled quantity has the accuracy of the nodes. Where no
series spans the element, both of its nodes are interpolated (:mod:`harness_opt.rod.long_elements`).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness_opt.model.results import Quantities
from harness_opt.numerics import rotations
from harness_opt.numerics.quadrature import gauss
from harness_opt.numerics.rotations import Array
from harness_opt.rod import equations as rod
from harness_opt.rod.equations import Factors, Section, Units
from harness_opt.rod.long_elements import TERMS, LongElements, derivatives

SERIES_ORDER = 12  # the truncation at half an element is then far below the collocation's own error


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

    def in_si(self, s: Array, units: Units | Factors, origin: Array) -> Quantities:
        """Return the same at arc lengths ``s`` (N,), m, of a cable whose start stands at ``origin`` (..., 3), m."""
        return Quantities(
            s=s,
            position=origin[..., None, :] + units.length * self.r,
            quaternion=self.q,
            curvature=self.omega / units.length,
            force=units.force * self.force,
            moment=units.moment * self.moment,
        )


class Defects(NamedTuple):
    """By how much the elements of one or many shapes miss the rod's equations, and how far samples are from them.

    Args:
        dq, dm, dr: quaternions (..., n, 4), moments in the world frame and positions (..., n, 3) that are missed.
        turning, apart: in its middle, by what is sampled from either node, rad and L, (..., n).
        behind: the part of what is missed that shows at the element's end, (n,); the rest does at its start.
    """

    dq: Array
    dm: Array
    dr: Array
    turning: Array
    apart: Array
    behind: Array

    def of(self, k: int) -> Defects:
        """Return those of one of many shapes."""
        return Defects(self.dq[k], self.dm[k], self.dr[k], self.turning[k], self.apart[k], self.behind)


@dataclass(frozen=True, eq=False)
class Rod:
    """One or many solved shapes of one cable on one mesh, dimensionless; leading axes (...) count the shapes.

    Args:
        section, load: of the cable; load f (3,), world. Of many shapes of a span that changes its length, rest
            curvature and load are (P, 1, 3).
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
    def long(self) -> NDArray[np.bool_]:
        """Whether an element is longer, in any of the shapes, than a power series spans, (n,)."""
        # decay lengths of a tension, with rad of a twisting moment's waves, that an element may have: beyond, what
        # rounding leaves at a node swamps its series
        span = 15.0
        return np.asarray(self._growth_lengths > span)

    @functools.cached_property
    def _growth_lengths(self) -> Array:
        """How far fields may vary in each element, the most in any of the shapes: decay lengths and rad, (n,)."""
        waving = rod.twisted_waves(self.q, self.moment, self.section.stiffness)
        return self._decay_lengths + self._along(waving)

    @functools.cached_property
    def _decay_lengths(self) -> Array:
        """Of a tension, the most in any of the shapes, in each element (n,)."""
        return self._along(rod.wave_numbers(self.force, np.zeros_like(self.force), self.section.stiffness))

    def _along(self, rates: Array) -> Array:
        """Return the most that ``rates`` (..., n + 1) at the nodes come to in each element (n,)."""
        most = rates.reshape(-1, len(self.mesh)).max(axis=0)
        return np.asarray(np.maximum(most[1:], most[:-1]) * np.diff(self.mesh))

    def _long_elements(self, series: rod.Series) -> LongElements:
        """Return the elements that are :attr:`long`."""
        chosen = np.flatnonzero(self.long)
        ends = np.array([chosen, chosen + 1])

        def at(coefficients: Array) -> Array:
            return np.moveaxis(coefficients[:TERMS, ..., ends, :], -3, 0)

        step, order = np.diff(self.mesh)[chosen], derivatives(self._growth_lengths[chosen])
        return LongElements(step, order, at(series.r), at(series.q), at(series.omega))

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

    def defects(self, series: rod.Series | None = None) -> Defects:
        """Return by how much each element misses the rod's equations, and how far its samples are from them.

        The local truncation error of the collocation is by how much the node at an element's end misses the exact
        solution through the one before. Where a tension makes that grow faster than the collocation does, it is by how
        much the exact solutions through both nodes disagree in the middle, half of it at either end.
        """
        stiff_from = 6.0  # decay lengths, beyond which an element does not grow its misses as the exact solution does
        series = self.series() if series is None else series
        steps = np.diff(self.mesh)
        dq, dm, dr = self._misses(series, steps)
        half = np.broadcast_to(0.5 * steps, (*self.q.shape[:-2], len(steps)))
        (q0, q1), (r0, r1), (m0, m1) = (
            (rod.evaluate(of[..., :-1, :], half), rod.evaluate(of[..., 1:, :], -half))
            for of in (series.q, series.r, series.moment)
        )
        turning, apart = 2.0 * np.linalg.norm(q1 - q0, axis=-1), np.linalg.norm(r1 - r0, axis=-1)
        stiff = self._decay_lengths > stiff_from
        if np.any(stiff):
            jump = rotations.rotate(q1, m1) - rotations.rotate(q0, m0)
            for missed, there in ((dq, q1 - q0), (dm, jump), (dr, r1 - r0)):
                missed[..., stiff, :] = there[..., stiff, :]
        if np.any(self.long):
            long = self.long
            dq[..., long, :], dr[..., long, :], arm = self._long_elements(series).defects()
            middle = self.force[..., 1:, :] + 0.5 * steps[:, None] * self.load
            moments = np.diff(self.moment, axis=-2) + rotations.cross(np.diff(self.r, axis=-2), middle)
            dm[..., long, :] = moments[..., long, :] - rotations.cross(arm, self.load)
            turning[..., long] = 2.0 * np.linalg.norm(dq[..., long, :], axis=-1)
            apart[..., long] = np.linalg.norm(dr[..., long, :], axis=-1)
        return Defects(dq, dm, dr, turning, apart, np.where(stiff | self.long, 0.5, 1.0))

    def _misses(self, series: rod.Series, steps: Array) -> tuple[Array, Array, Array]:
        """Return by how much nodes miss the exact solutions through those before; these go there by a few series."""
        series_count = 3  # along an element: of two, their own truncation shows on coarse meshes
        step = np.broadcast_to(steps / series_count, (*self.q.shape[:-2], len(steps)))
        states = [of[..., :-1, :] for of in (series.q, series.r, series.moment)]
        force = self.force[..., :-1, :]
        for k in range(series_count):
            q, r, moment = (rod.evaluate(of, step) for of in states)
            q = rotations.normalise(q)
            force, moment = force - step[..., None] * self.load, rotations.rotate(q, moment)
            if k + 1 < series_count:
                on = rod.series(q, r, force, moment, self.section, self.load, SERIES_ORDER)
                states = [on.q, on.r, on.moment]
        return self.q[..., 1:, :] - q, self.moment[..., 1:, :] - moment, self.r[..., 1:, :] - r

    def energy(self) -> Array:
        """Return elastic energy less the work of the distributed load from the start's level, (...), in B/L."""
        energy_points = 6  # Gauss points an element for energies
        tableau = gauss(energy_points)
        steps = np.diff(self.mesh)
        s = (self.mesh[:-1, None] + steps[:, None] * tableau.nodes).ravel()
        weights = (steps[:, None] * tableau.weights).ravel()
        samples = self.sample(s)
        strain = samples.omega - self.section.rest_curvature
        elastic = 0.5 * np.sum(strain**2 * self.section.stiffness, axis=-1)
        energies: Array = (elastic - np.sum(samples.r * self.load, axis=-1)) @ weights
        return energies

    def some(self, which: slice) -> Rod:
        """Return some of many shapes along one axis."""
        section, load = self.section, self.load
        if load.ndim > 1:
            section, load = Section(section.stiffness, section.rest_curvature[which]), load[which]
        states = (getattr(self, name)[which] for name in ("q", "r", "force", "moment"))
        return Rod(section, load, self.mesh, *states)

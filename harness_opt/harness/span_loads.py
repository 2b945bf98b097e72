"""What one span does to what holds it: energy, loads at both ends, and how these change with the ends and the length.

With E the elastic energy less the work of the weight, F and M the internal force and moment (s+ side on s- side),

    dE = F(L) . dr(L) + M(L) . dphi(L) - F(0) . dr(0) - M(0) . dphi(0) - (H + f . r) dL,

dphi the small rotations of the ends, f the weight per length, r the place in the world, and

    H = F . d3 + M . omega - (omega - omega_rest) . K (omega - omega_rest) / 2

the configurational force, of which H + f . r is one constant along a span (Bigoni et al., J. Mech. Phys. Solids 61
(2013), for a sleeve). The second derivatives come from the factorised Jacobian of the solve by the implicit function
theorem, one back-substitution a column. SI units, world.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.equations import Units
from harness_opt.statics.solve import Solved

POSITION, ROTATION = (slice(0, 3), slice(6, 9)), (slice(3, 6), slice(9, 12))  # of start and end, in the order below
LENGTH = 12
SIZE = 13  # start's position and rotation, end's position and rotation, length


@dataclass(frozen=True)
class SpanLoads:
    """A solved span between ends in the world.

    Args:
        solved: the span.
        units: of its present length.
        origin: where its start stands, (3,), m.
    """

    solved: Solved
    units: Units
    origin: Array

    @functools.cached_property
    def energy(self) -> float:
        """Elastic energy less the work of the weight, and of the dead forces at ends that are free to move, J."""
        rod, units, boundary = self.solved.rod, self.units, self.solved.case.boundary
        start = self.origin / units.length
        whole = float(rod.energy()) - float(rod.load @ start)
        if not boundary.kind.start_position:
            whole -= float(boundary.start_force @ start)
        if not boundary.kind.end_position:
            whole -= float(boundary.end_force @ (start + rod.r[-1]))
        return units.moment * whole

    @functools.cached_property
    def gradient(self) -> Array:
        """Rates of the energy with the ends and the length, (SIZE,): N, N m, N, N m, N; 0 where an end is free."""
        rod, units = self.solved.rod, self.units
        found = np.zeros(SIZE)
        for side, node, sign in ((0, 0, -1.0), (1, -1, 1.0)):
            found[POSITION[side]] = sign * units.force * rod.force[node]
            found[ROTATION[side]] = sign * units.moment * rod.moment[node]
        found[self._unheld] = 0.0
        found[LENGTH] = -self._configurational
        return found

    @property
    def _unheld(self) -> list[int]:
        """The ends' places and rotations that nothing gives."""
        kind = self.solved.case.boundary.kind
        given = (kind.start_position, kind.start_orientation, kind.end_position, kind.end_orientation)
        return [3 * k + axis for k, known in enumerate(given) for axis in range(3) if not known]

    @property
    def _own_frame(self) -> tuple[int, Array, Array, Array]:
        """A node whose place is given, its tangent, and moment and rest curvature in its section frame, SI."""
        rod, units = self.solved.rod, self.units
        node = 0 if self.solved.case.boundary.kind.start_position else -1
        q = rotations.normalise(rod.q[node])
        moment = units.moment * rotations.rotate(rotations.conjugate(q), rod.moment[node])
        return node, rotations.tangent(q), moment, rod.section.rest_curvature / units.length

    @property
    def _stiffness(self) -> Array:
        """(kx, ky, kz), N m2."""
        return self.solved.rod.section.stiffness * self.units.moment * self.units.length

    @property
    def _configurational(self) -> float:
        """H + f . r, N."""
        rod, units = self.solved.rod, self.units
        node, tangent, moment, rest = self._own_frame
        force = units.force * (rod.force[node] @ tangent)
        bent = moment @ rest + 0.5 * moment @ (moment / self._stiffness)
        weight = units.force * rod.load @ (self.origin / units.length + rod.r[node])
        return float(force + bent + weight)

    @functools.cached_property
    def stiffness(self) -> Array:
        """Rates of :attr:`gradient` with the same, (SIZE, SIZE), symmetric but for what frames that turn leave."""
        bound, x, units = self.solved.bound, self.solved.solution.x, self.units
        boundary, case = bound.boundary, self.solved.case
        frames = [
            rotations.matrix(rotations.normalise(q)) for q in (boundary.start_quaternion, boundary.end_quaternion)
        ]
        columns = 10  # the end's place as seen from the start, both rotations, the length
        gap, turns, longer = np.zeros((3, columns)), np.zeros((2, 3, columns)), np.zeros(columns)
        gap[:, :3] = np.eye(3) / units.length
        turns[0][:, 3:6], turns[1][:, 6:9] = frames[0].T, frames[1].T
        longer[9] = 1.0 / units.length
        gap -= np.outer(boundary.gap, longer)
        load = np.outer(case.load, 3.0 * longer)
        loads = {
            f"{side}_{kind}": np.outer(getattr(boundary, f"{side}_{kind}"), power * longer)
            for side in ("start", "end")
            for kind, power in (("force", 2.0), ("moment", 1.0))
        }
        change = bound.rates(
            x, gap=gap, start_turn=turns[0], end_turn=turns[1],
            rest=np.outer(case.section.rest_curvature, longer), load=load, loads=loads,
        )  # fmt: skip
        dx = -self.solved.factor.solve(change)
        moments, rod = bound.moment_rates(dx), self.solved.rod
        rates = np.zeros((SIZE, columns))
        force_rates = []
        for side, node, sign in ((0, 0, -1.0), (1, -1, 1.0)):
            force = dx[-3:] - (load if node else 0.0) - 2.0 * np.outer(rod.force[node], longer)
            moment = moments[node] - np.outer(rod.moment[node], longer)
            rates[POSITION[side]], rates[ROTATION[side]] = sign * units.force * force, sign * units.moment * moment
            force_rates.append((units.force * force, units.moment * moment))
        rates[LENGTH] = -self._configurational_rates(dx, force_rates)
        # a start that moves on is an end that stays back, and all together is nothing but moved
        whole = np.zeros((SIZE, SIZE))
        whole[:, POSITION[1]], whole[:, POSITION[0]] = rates[:, :3], -rates[:, :3]
        whole[:, ROTATION[0]], whole[:, ROTATION[1]], whole[:, LENGTH] = rates[:, 3:6], rates[:, 6:9], rates[:, 9]
        weight = units.force * rod.load / units.length
        node = self._own_frame[0]
        whole[LENGTH, POSITION[node]] -= weight
        whole[self._unheld], whole[:, self._unheld] = 0.0, 0.0
        return whole

    def _configurational_rates(self, dx: Array, loads: list[tuple[Array, Array]]) -> Array:
        """Return the rates (k,) of H from those of the unknowns ``dx`` (m, k) and of the loads at both ends, SI."""
        node, tangent, moment, rest = self._own_frame
        q, dq = self.solved.rod.q[node], dx[self.solved.bound.transcription.quaternions[node]]
        turned = 2.0 * rotations.multiply(rotations.conjugate(q), dq.T)[:, 1:]  # own axes, (k, 3)
        force, moment_rate = loads[node]
        frame = rotations.matrix(rotations.normalise(q))
        own = (frame.T @ moment_rate).T + np.cross(moment, turned)
        tilted = (frame @ np.cross(turned, [0.0, 0.0, 1.0]).T).T
        here = self.units.force * self.solved.rod.force[node]
        found: Array = tangent @ force + tilted @ here + own @ (rest + moment / self._stiffness)
        return found

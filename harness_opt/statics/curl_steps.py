"""Moving the curls of a cable along it, to where its energy is least.

A curl moves along a taut cable almost for nothing, but not on fixed elements: these make small dents in the energy
that hold it, and steps that turn sections by less than a radian take it no further than part of its own length. So it
is moved with its elements. Frames stay with their nodes, and what is straight on either side grows or shrinks.
Newton's step in the curls' places a and the frames' small rotations phi together solves

    [H, A^T, B; A, 0, C; B^T, C^T, D] [phi; -change of multipliers; a] = -[gradient; constraint; f],

where B, C, D and f, what the mesh adds, are had by differences, and phi leaves moving curls to a.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from harness_opt.numerics.interface import Expansion
from harness_opt.numerics.rotations import Array
from harness_opt.rod.energy_chain import Chain

MOST_TURN = 0.3  # rad, most that a step may turn sections
LEAST_GAIN = 1e-7  # relative, of the energy: what gains less is left to the solve that comes after


@dataclass(frozen=True)
class MovedCurls:
    """A chain with its curls moved: the mesh has changed with the quaternions (m, 4) and the multipliers."""

    chain: Chain
    q: Array
    multipliers: Array


def has_curls(chain: Chain, q: Array) -> bool:
    """Return whether a shape has curls away from its ends."""
    return len(curl_shifts(chain, q)[0]) > 0


def move_curls(chain: Chain, q: Array, multipliers: Array, room: float, gain: float = LEAST_GAIN) -> MovedCurls | None:
    """Take one step with the curls of a chain, down its energy; None where there are none, or none gains from it.

    Args:
        chain, q, multipliers: a shape that is nearly at its minimum but for them.
        room: how little the constraints leave free.
        gain: relative, of the energy, that is worth a step.
    """
    shifts, width = curl_shifts(chain, q)
    return CurlStep(chain, q, multipliers, shifts, width).taken(room, gain) if len(shifts) else None


def curl_shifts(chain: Chain, q: Array) -> tuple[Array, float]:
    """Return how far the mesh moves with each free curl, (curls, n + 1), and the length of the shortest.

    That is 1 along the curl, 0 along all others and at the ends, and changes evenly between.
    """
    curl_turning = 3.0  # rad, turning of a stretch of such elements that makes it a curl
    bent_share = 0.05  # part of the sharpest bend from which on an element is bent
    mesh, omega = chain.mesh, chain.sample(q, chain.points)[1]
    bend = np.linalg.norm(omega[:, :2], axis=1).reshape(len(mesh) - 1, -1).mean(axis=1)
    bent = np.concatenate([[False], bend > bent_share * bend.max(), [False]])
    first, last = np.flatnonzero(bent[1:] & ~bent[:-1]), np.flatnonzero(bent[:-1] & ~bent[1:])
    turned = np.concatenate([[0.0], np.cumsum(bend * np.diff(mesh))])
    free = (first > 0) & (last < len(mesh) - 1) & (turned[last] - turned[first] > curl_turning)
    fences = np.unique(np.concatenate([[0, len(mesh) - 1], first, last]))
    shifts = [
        np.interp(mesh, mesh[fences], np.isin(fences, (i, j))) for i, j in zip(first[free], last[free], strict=True)
    ]
    return np.array(shifts), float(np.min((mesh[last] - mesh[first])[free], initial=1.0))


class CurlStep:
    """Newton's step from a chain with curls; arguments as of :func:`move_curls` and from :func:`curl_shifts`."""

    def __init__(self, chain: Chain, q: Array, multipliers: Array, shifts: Array, width: float):
        self.chain, self.q, self.multipliers, self.shifts, self.width = chain, q, multipliers, shifts, width
        self.here = chain.expand(q, multipliers)
        self.level = self._level(np.zeros(len(shifts)))
        self.force, self.coupling, self.stiffness = self._differences()

    def moved(self, by: Array) -> Chain:
        """Return the chain with its curls ``by`` (curls,) further on; its second derivatives don't matter."""
        return self.chain.on(self.chain.mesh + by @ self.shifts, exact=False)

    def _level(self, by: Array) -> float:
        """Return the energy, less the multipliers' work, with frames as they are."""
        energy, missed = self.moved(by).energy(self.q)
        return energy - float(self.multipliers @ missed)

    def _differences(self) -> tuple[Array, Array, Array]:
        """Return f (curls,), [B; C] (n + constraints, curls) and D (curls, curls): curls meet their neighbours only."""
        probe_share = 1e-3  # part of the shortest curl, over which differences are taken
        probes = probe_share * self.width * np.eye(len(self.shifts))
        ahead, behind = (np.array([self._level(sign * probe) for probe in probes]) for sign in (1.0, -1.0))
        both = np.array([self._level(probe + after) for probe, after in itertools.pairwise(probes)])
        size = probe_share * self.width
        beside = (both - ahead[:-1] - ahead[1:] + self.level) / size**2
        stiffness = np.diag((ahead + behind - 2.0 * self.level) / size**2) + np.diag(beside, 1) + np.diag(beside, -1)
        slopes = [self._slopes(probe) - self._slopes(-probe) for probe in probes]
        return (ahead - behind) / (2.0 * size), np.stack(slopes, axis=1) / (2.0 * size), stiffness

    def _slopes(self, by: Array) -> Array:
        there = self.moved(by).expand(self.q, self.multipliers)
        return np.concatenate([there.gradient, there.constraint])

    def _sliding(self) -> Array:
        """Return what measures how far the frames alone move each curl, (n + constraints, curls)."""
        chain, omega = self.chain, self.chain.sample(self.q, self.chain.nodes)[1]
        share = np.gradient(chain.nodes)[:, None] * omega
        on = [np.interp(chain.nodes, chain.mesh, shift) == 1.0 for shift in self.shifts]
        fields = [np.pad(chain.step(share * along[:, None]), (0, chain.constraints)) for along in on]
        return np.stack(fields, axis=1)

    def taken(self, room: float, gain: float) -> MovedCurls | None:
        """Take as much of the step as leads down; None where none does."""
        least_share = 1e-3  # part of the shortest curl: a shorter step is none
        most_halvings = 6  # of a step that leads up
        most_squeeze = 0.6  # part of its length that an element may lose in a step
        here, size = self.here, len(self.here.gradient)
        try:
            factors = spla.splu(_matrix(here), permc_spec="NATURAL")
        except RuntimeError:  # SuperLU: "Factor is exactly singular"
            return None
        sliding = self._sliding()
        alone, answer, kept = np.split(
            factors.solve(np.column_stack([-np.concatenate([here.gradient, here.constraint]), self.coupling, sliding])),
            [1, 1 + len(self.shifts)],
            axis=1,
        )
        try:
            alone, answer = (x - kept @ np.linalg.solve(sliding.T @ kept, sliding.T @ x) for x in (alone, answer))
        except np.linalg.LinAlgError:
            return None
        stiffness = self.stiffness - self.coupling.T @ answer
        if not (np.all(np.isfinite(stiffness)) and np.all(np.isfinite(alone))):
            return None
        by = _down(stiffness, -self.force - (self.coupling.T @ alone)[:, 0])
        step = alone[:, 0] - answer @ by
        if abs(self.force @ by) <= gain * (1.0 + abs(self.level)):
            return None
        steps = np.diff(self.chain.mesh)
        squeezed = float(np.max(-np.diff(by @ self.shifts) / steps))
        turned = float(np.max(np.abs(step[:size])))
        part = min(1.0, most_squeeze / max(squeezed, most_squeeze), MOST_TURN / max(turned, MOST_TURN))
        for _ in range(most_halvings):
            if part * np.max(np.abs(by)) <= least_share * self.width:
                break
            reached = self._reached(part * by, part * step, factors, (room, gain))
            if reached is not None:
                return reached
            part *= 0.5
        return None

    def _reached(self, by: Array, step: Array, factors: spla.SuperLU, least: tuple[float, float]) -> MovedCurls | None:
        """Return where a step leads, back on the constraints; None where that is not down."""
        # corrections onto the constraints; what of the room they aim at, and must reach
        most_corrections, aimed_miss, allowed_miss = 4, 1e-5, 1e-3
        chain, size, (room, gain) = self.moved(by), len(self.here.gradient), least
        q = chain.move(self.q, step[:size])
        for _ in range(most_corrections):
            missed = chain.energy(q)[1]
            if np.linalg.norm(missed) <= aimed_miss * room:
                break
            back = factors.solve(np.concatenate([np.zeros(size), -missed]))[:size]
            if not np.max(np.abs(back)) < MOST_TURN:
                break
            q = chain.move(q, back)
        energy, missed = chain.energy(q)
        fall = self.level - (energy - float(self.multipliers @ missed))
        if not (np.linalg.norm(missed) <= allowed_miss * room and fall > gain * (1.0 + abs(self.level))):
            return None
        return MovedCurls(self.chain.on(chain.mesh), q, self.multipliers - step[size:])


def _matrix(here: Expansion) -> sp.csc_array:
    frame_shift = 1e-3  # of the frames, in the metric of the chain: holds what nothing else does
    pattern = here.sparsity
    return sp.csc_array((here.bordered(frame_shift), pattern.row(), pattern.colind()), shape=pattern.shape)


def _down(stiffness: Array, force: Array) -> Array:
    """Return the places (curls,) to which ``force`` leads down, whatever the signs of the eigenvalues."""
    least_eigenvalue = 1e-6  # least eigenvalue for the curls' places, of the largest
    values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    values = np.maximum(np.abs(values), max(least_eigenvalue * float(np.max(np.abs(values))), np.finfo(float).tiny))
    return np.asarray(vectors @ ((vectors.T @ force) / values))

"""The rod's energy on a chain of elements, for its minimisation.

In an element the section frame is that of its first node turned by a rotation whose modified Rodrigues parameters
sigma = tan(angle / 4) axis are a polynomial in arc length through the element's nodes. They give

    omega = 4 [(1 - |sigma|^2) sigma' - 2 sigma x sigma' + 2 (sigma . sigma') sigma] / (1 + |sigma|^2)^2

(Schaub and Junkins, "Analytical Mechanics of Space Systems", section 3.5.3, with the body's own axes), and d3 without
trigonometry. Energy: int (omega - rest) . K (omega - rest) / 2 less the work of dead loads, by Gauss's rule. The
length is exact, and where both ends have positions, int d3 = gap is the one constraint; its multiplier is the force
at the end. A minimum is a stable equilibrium of the rod, to the order of the elements.

Energy, chord and first derivatives are those of the elements; second derivatives are the rod's own, with the small
rotations phi of the sections interpolated between those of the nodes, as in :mod:`harness_opt.rod.stability`:

    int e . K e + M . (e x phi) - F . (phi x (phi x d3)) ds,   e = phi' + omega x phi,   M = K (omega - rest).

They differ by the elements' own error, and are had at a tenth of the price. Of a taut cable, whose tension multiplies
that error, the elements' own are taken.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.interface import Expansion
from harness_opt.numerics.machine_code import Buffered, built, wanted
from harness_opt.numerics.quadrature import gauss
from harness_opt.numerics.rotations import Array
from harness_opt.rod import equations as rod
from harness_opt.rod.boundary import HELD, Boundary
from harness_opt.rod.element_pattern import DEGREE, UNKNOWNS, pattern
from harness_opt.rod.equations import Section

LOBATTO_NODES = np.array([0.0, 0.5 - np.sqrt(5.0) / 10.0, 0.5 + np.sqrt(5.0) / 10.0, 1.0])  # Lobatto's


_POLYNOMIALS = np.linalg.inv(np.vander(LOBATTO_NODES, increasing=True))  # those that are 1 at one node, by columns


def _lagrange(at: Array) -> tuple[Array, Array]:
    """Return the values and the derivatives (m, DEGREE + 1) at ``at`` (m,) of the polynomials that are 1 at a node."""
    powers = np.vander(at, DEGREE + 1, increasing=True)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, DEGREE + 1)
    return powers @ _POLYNOMIALS, slopes @ _POLYNOMIALS


@functools.cache
def _products() -> tuple[Array, Array]:
    """Return the weighted products at Gauss points that integrals of phi and phi' are made of.

    Of a value and a slope, and then of two values, at each, (2 DEGREE, (DEGREE + 1)^2); and the integrals of those of
    two slopes, (DEGREE + 1, DEGREE + 1).
    """
    tableau = gauss(DEGREE)
    values, slopes = _lagrange(tableau.nodes)

    def products(left: Array, right: Array) -> Array:
        return np.asarray(tableau.weights[:, None, None] * left[:, :, None] * right[:, None, :])

    mixed, plain = (products(values, right).reshape(DEGREE, -1) for right in (slopes, values))
    return np.stack([mixed, plain], axis=1).reshape(2 * DEGREE, -1), products(slopes, slopes).sum(axis=0)


def _product(p: ca.SX, q: ca.SX) -> ca.SX:
    return ca.vertcat(p[0] * q[0] - ca.dot(p[1:], q[1:]), p[0] * q[1:] + q[0] * p[1:] + ca.cross(p[1:], q[1:]))


def _local(sigmas: ca.SX, h: ca.SX, elastic: ca.SX, forces: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return an element's energy, its chord (3,) by Gauss points (3, DEGREE), and what :func:`_second` makes of each.

    All in the frame of its first node.

    Args:
        sigmas: of the nodes but the first, (3, DEGREE).
        h: its length.
        elastic: stiffness and rest curvature, (3, 2).
        forces: internal forces at the Gauss points, in that frame, (3, DEGREE).
    """
    tableau = gauss(DEGREE)
    values, slopes = _lagrange(tableau.nodes)
    at, rates = ca.mtimes(sigmas, values[:, 1:].T), ca.mtimes(sigmas, slopes[:, 1:].T) / h
    energy, pieces, seconds = ca.SX(0), [], []
    for j in range(DEGREE):
        sigma, rate, weight = at[:, j], rates[:, j], h * float(tableau.weights[j])
        square = ca.sumsqr(sigma)
        scale = 2.0 / (1.0 + square)
        omega = scale**2 * ((1.0 - square) * rate - 2.0 * ca.cross(sigma, rate) + 2.0 * ca.dot(sigma, rate) * sigma)
        frame = rod.frame(ca.vertcat(scale - 1.0, scale * sigma))
        piece, strain = weight * frame[:, 2], omega - elastic[:, 1]
        energy += 0.5 * weight * ca.dot(elastic[:, 0] * strain, strain) - ca.dot(forces[:, j], piece)
        pieces.append(piece)
        seconds.append(_second(elastic[:, 0], omega, strain, h * ca.mtimes(frame.T, forces[:, j]), h))
    return energy, ca.horzcat(*pieces), ca.vertcat(*seconds)


def _second(stiffness: ca.SX, omega: ca.SX, strain: ca.SX, force: ca.SX, h: ca.SX) -> ca.SX:
    """Return the matrices between phi and phi', and half of that between phi and phi, column by column, (18,).

    The latter, and the ``force`` (3,) in the section frame, are times the element's length ``h``.
    """
    spin, moment = ca.skew(omega), ca.skew(stiffness * strain)
    turned = ca.mtimes(spin.T, ca.diag(stiffness))
    twice = h * ca.mtimes(moment, spin)
    loads = force[2] * ca.SX.eye(3)
    loads[:, 2] -= 0.5 * force
    loads[2, :] -= 0.5 * force.T
    plain = h * ca.mtimes(turned, spin) + 0.5 * (twice + twice.T) + loads
    return ca.vertcat(ca.vec(turned + 0.5 * moment), ca.vec(0.5 * plain))


@functools.cache
def _element(exact: bool, machine: bool) -> tuple[ca.Function, ca.Function]:
    """Return two functions of one element.

    Arguments: nodes' quaternions (4 (DEGREE + 1),), of length 1, length, start, stiffness, rest curvature, force at the
    end of the cable, load. Results of the first: energy and chord; of the second: the chord, the gradient of the energy
    by small rotations of the nodes about their own axes, the chord's derivative by rows, and what :func:`_second`
    returns at the Gauss points; where ``exact``, the Hessian in its place. Both are machine code where ``machine``.

    A node turned by a small phi_j changes sigma_j by B_j phi_j, and by -B_j^T phi_0 where it is the first that turns,

        B = ((1 - |sigma|^2) I + 2 [sigma] + 2 sigma sigma^T) / 4

    (Schaub and Junkins, section 3.5.3).
    """
    q, h, s = ca.SX.sym("q", 4, DEGREE + 1), ca.SX.sym("h"), ca.SX.sym("s")
    stiffness, rest, force, load = (ca.SX.sym(name, 3) for name in ("stiffness", "rest", "force", "load"))
    elastic, first = ca.horzcat(stiffness, rest), rod.frame(q[:, 0])
    inverse = ca.vertcat(q[0, 0], -q[1:, 0])
    relative = [_product(inverse, q[:, j]) for j in range(1, DEGREE + 1)]
    forces = ca.horzcat(*(ca.mtimes(first.T, force + load * (1.0 - s - h * float(c))) for c in gauss(DEGREE).nodes))
    known = ca.horzcat(*(p[1:] / (1.0 + p[0]) for p in relative))
    sigmas, inner = ca.SX.sym("sigmas", 3, DEGREE), ca.SX.sym("inner", 3, DEGREE)
    energy, pieces, second = _local(sigmas, h, elastic, inner)
    chord = ca.sum2(pieces)
    slope, chords = ca.reshape(ca.gradient(energy, ca.vec(sigmas)), 3, DEGREE), ca.jacobian(chord, ca.vec(sigmas))
    turned = sum((ca.cross(inner[:, j], pieces[:, j]) for j in range(DEGREE)), ca.SX.zeros(3))
    gradient, moved, back, swept = [], [], turned, -ca.skew(chord)
    for j in range(DEGREE):
        sigma, part = sigmas[:, j], chords[:, 3 * j : 3 * j + 3]
        rate = 0.25 * ((1.0 - ca.sumsqr(sigma)) * ca.SX.eye(3) + 2.0 * ca.skew(sigma) + 2.0 * ca.mtimes(sigma, sigma.T))
        gradient.append(ca.mtimes(rate.T, slope[:, j]))
        moved.append(ca.mtimes(part, rate))
        back -= ca.mtimes(rate, slope[:, j])
        swept -= ca.mtimes(part, rate.T)
    by_turns = ca.mtimes(first, ca.horzcat(swept, *moved))
    arguments = [ca.vec(q), h, s, stiffness, rest, force, load]
    results = [energy, ca.mtimes(first, chord), ca.vertcat(back, *gradient), ca.vec(by_turns.T), second]
    results = ca.substitute(results, [ca.vec(sigmas), ca.vec(inner)], [ca.vec(known), ca.vec(forces)])
    level = ca.Function("energy", arguments, results[:2], {"cse": True})
    if exact:
        turns = ca.SX.sym("turns", 3, DEGREE + 1)
        nodes = [_product(q[:, j], ca.vertcat(1.0, 0.5 * turns[:, j])) for j in range(DEGREE + 1)]
        there = level(ca.vertcat(*(p / ca.norm_2(p) for p in nodes)), *arguments[1:])[0]
        hessian = ca.hessian(there, ca.vec(turns))[0]
        results[4] = ca.substitute(ca.vec(hessian), ca.vec(turns), ca.DM.zeros(UNKNOWNS))
    # a third of the operations are the same ones again, but a tenth where exact: hardly worth the search
    expansion = ca.Function("expansion", arguments, [ca.densify(x) for x in results[1:]], {"cse": not exact})
    return (built(level), built(expansion)) if machine else (level, expansion)


@dataclass(frozen=True)
class _Functions:
    """Functions of a whole chain: of its quaternions (m, 4) and the force at its end, flat, and its parameters.

    Args:
        energy: gives the energy and the vector between the ends, (4,).
        expansion: gives what that of the elements does, one result after the other, each an element at a time.
        sizes: of these results, per element.
    """

    energy: Buffered
    expansion: Buffered
    sizes: tuple[int, ...]


@functools.lru_cache(maxsize=32)
def _functions(elements: int, exact: bool, machine: bool) -> _Functions:
    energy, expansion = _element(exact, machine)
    x, p = ca.MX.sym("x", 4 * (DEGREE * elements + 1) + 3), ca.MX.sym("p", 2 * elements + 9)
    steps, starts, stiffness, rest, load = ca.vertsplit(p, [0, elements, *(2 * elements + np.arange(0, 10, 3))])
    own = 4 * DEGREE * np.arange(elements)[:, None] + np.arange(4 * (DEGREE + 1))
    q = ca.reshape(x[own.ravel().tolist()], own.shape[1], elements)
    shared = [3, 4, 5, 6]  # stiffness, rest curvature, force and load are one for all elements
    arguments = (q, steps.T, starts.T, stiffness, rest, x[-3:], load)
    sums = [ca.sum2(part) for part in energy.map("energies", "serial", elements, shared, [])(*arguments)]
    parts = expansion.map("expansions", "serial", elements, shared, [])(*arguments)
    return _Functions(
        Buffered(ca.Function("energy", [x, p], [ca.vertcat(*sums)])),
        Buffered(ca.Function("expansion", [x, p], [ca.vertcat(*(ca.vec(part) for part in parts))])),
        tuple(part.shape[0] for part in parts),
    )


class Chain:
    """The energy of one cable between two ends as a function of the quaternions of its nodes.

    Moments given at the ends are left out: dead moments have no energy.

    Args:
        section, load, boundary: the cable and its ends, dimensionless.
        mesh: the elements' ends from 0 to 1, (n + 1,).
        exact: whether second derivatives are the elements' own too.
    """

    def __init__(self, section: Section, load: Array, boundary: Boundary, mesh: Array, *, exact: bool = False):
        self.exact = exact
        self.section, self.load, self.boundary, self.mesh = section, load, boundary, mesh
        kind, steps, count = boundary.kind, np.diff(mesh), len(mesh) - 1
        self.closed = kind.start_position and kind.end_position
        self._pattern = pattern(count, kind.start_held, kind.end_held, self.closed)
        self._functions = _functions(count, exact, wanted())
        self._parameters = np.concatenate([steps, mesh[:-1], section.stiffness, section.rest_curvature, load])
        self.nodes = np.append((mesh[:-1, None] + steps[:, None] * LOBATTO_NODES[:-1]).ravel(), 1.0)
        self.points = (mesh[:-1, None] + steps[:, None] * gauss(DEGREE).nodes).ravel()
        share = np.gradient(self.nodes)
        share[[0, -1]] *= 0.5
        self._weights = np.repeat(share, 3)[self._pattern.free.ravel()] * (1.0 + float(np.max(section.stiffness)))
        self._loose_force = boundary.end_force if kind.start_position else -boundary.start_force - load

    def on(self, mesh: Array, *, exact: bool | None = None) -> Chain:
        """Return the same cable on another mesh; ``exact`` as it is where that is None."""
        return Chain(self.section, self.load, self.boundary, mesh, exact=self.exact if exact is None else exact)

    # -- what a descent asks for -------------------------------------------------------------------------------

    @functools.cached_property
    def _rigid(self) -> Array:
        """What the elements' Hessians have of phi' . K phi', (n, UNKNOWNS, UNKNOWNS)."""
        return np.asarray(np.kron(_products()[1], np.diag(self.section.stiffness)) / np.diff(self.mesh)[:, None, None])

    @property
    def constraints(self) -> int:
        """Number of equations that hold the shape: 3 where both ends have positions, else 0."""
        return 3 if self.closed else 0

    @property
    def sparsity(self) -> ca.Sparsity:
        """Of the bordered Hessian."""
        return self._pattern.sparsity

    @property
    def weights(self) -> Array:
        """Diagonal of the metric: arc length times the largest stiffness, an entry an unknown."""
        return self._weights

    @property
    def multipliers(self) -> Array:
        """Multipliers that nothing is known about yet, (constraints,)."""
        return np.zeros(self.constraints)

    def force(self, multipliers: Array) -> Array:
        """Return the internal force at the end of the cable, (3,): the multipliers, or what is given."""
        return multipliers if self.closed else np.asarray(self._loose_force)

    def energy(self, q: Array) -> tuple[float, Array]:
        """Return the energy, in B/L, of quaternions (m, 4), and what is missed of the constraints (constraints,)."""
        x = np.concatenate([q.ravel(), self.force(self.multipliers)])
        found = self._functions.energy(x, self._parameters)
        return float(found[0]), self._missed(found[1:])

    def _missed(self, chord: Array) -> Array:
        return chord - self.boundary.gap if self.closed else np.zeros(0)

    def expand(self, q: Array, multipliers: Array) -> Expansion:
        """Return the energy less the multipliers' work to second order about ``q`` (m, 4)."""
        p, count = self._pattern, len(self.mesh) - 1
        force = self.force(multipliers)
        found = self._functions.expansion(np.concatenate([q.ravel(), force]), self._parameters)
        ends = [0, *(count * np.cumsum(self._functions.sizes)).tolist()]
        chords, gradients, slopes, second = (found[i:j] for i, j in itertools.pairwise(ends))
        gradient = np.zeros((len(q), 3))
        np.add.at(gradient, p.nodes, gradients.reshape(count, DEGREE + 1, 3))
        blocks = second.reshape(count, UNKNOWNS, UNKNOWNS) if self.exact else self._blocks(second)
        entries = [blocks[p.blocks]]
        if p.chords is not None:
            border = slopes.reshape(count, 3, UNKNOWNS)[p.chords]
            entries += [border, border, np.zeros(3)]
        return Expansion(
            gradient[p.free], self._missed(chords.reshape(count, 3).sum(axis=0)), np.concatenate(entries),
            len(entries[0]), p.places, p.sparsity, self._weights,
        )  # fmt: skip

    def _blocks(self, second: Array) -> Array:
        """Return the elements' Hessians (n, UNKNOWNS, UNKNOWNS) from what :func:`_second` returns, for all elements."""
        count = len(self.mesh) - 1
        summed = np.swapaxes(second.reshape(count, 2 * DEGREE, 9), -1, -2) @ _products()[0]
        # of entries (column, row) of a matrix, and of the nodes left and right of it
        halves = summed.reshape(count, 3, 3, DEGREE + 1, DEGREE + 1).transpose(0, 3, 2, 4, 1)
        halves = halves.reshape(count, UNKNOWNS, UNKNOWNS)
        return np.asarray(self._rigid + halves + np.swapaxes(halves, -1, -2))

    def size(self, step: Array) -> float:
        """Return the largest turning of a node, rad, by ``step`` (n,)."""
        turned = np.zeros(self._pattern.free.shape)
        turned[self._pattern.free] = step
        return float(np.max(np.linalg.norm(turned, axis=1)))

    def move(self, q: Array, step: Array) -> Array:
        """Return ``q`` (m, 4) with its free nodes turned about their own axes by ``step`` (n,), rad."""
        half = np.zeros((len(q), 4))
        half[:, 0] = 1.0
        half[:, 1:][self._pattern.free] = 0.5 * step
        return rotations.normalise(rotations.multiply(q, half))

    def step(self, turned: Array) -> Array:
        """Return rotations (m, 3) of the nodes about their own axes, rad, as a step (n,) of those that are free."""
        return np.asarray(turned[self._pattern.free])

    def too_coarse(self, q: Array) -> bool:
        """Return whether an element is turned further than its polynomials can follow."""
        most_turn_next, most_turn_element = 1.0, 2.5  # rad, between neighbouring nodes, and between those of an element
        nodes = q[self._pattern.nodes]
        neighbours = np.sum(nodes[:, 1:] * nodes[:, :-1], axis=-1)
        ends = np.sum(nodes[:, 1:] * nodes[:, :1], axis=-1)
        return bool(np.min(neighbours) < np.cos(0.5 * most_turn_next) or np.min(ends) < np.cos(0.5 * most_turn_element))

    # -- in and out --------------------------------------------------------------------------------------------

    def sample(self, q: Array, s: Array) -> tuple[Array, Array]:
        """Return quaternions (N, 4) and Darboux vectors (N, 3) at ``s`` (N,) of the shape with nodes ``q`` (m, 4)."""
        element = np.clip(np.searchsorted(self.mesh, s, side="right") - 1, 0, len(self.mesh) - 2)
        step = np.diff(self.mesh)[element]
        values, slopes = _lagrange((s - self.mesh[element]) / step)
        nodes = q[self._pattern.nodes[element]]
        relative = rotations.multiply(rotations.conjugate(nodes[:, :1]), nodes)
        sigmas = relative[..., 1:] / (1.0 + relative[..., :1])
        sigma = np.einsum("mj,mjc->mc", values, sigmas)
        rate = np.einsum("mj,mjc->mc", slopes, sigmas) / step[:, None]
        square = np.sum(sigma * sigma, axis=1, keepdims=True)
        omega = (1.0 - square) * rate - 2.0 * rotations.cross(sigma, rate)
        omega += 2.0 * np.sum(sigma * rate, axis=1, keepdims=True) * sigma
        turned = np.concatenate([1.0 - square, 2.0 * sigma], axis=1) / (1.0 + square)
        return rotations.multiply(nodes[:, 0], turned), 4.0 * omega / (1.0 + square) ** 2

    def clamped(self, q: Array) -> Array:
        """Return ``q`` (m, 4) with the quaternions of clamped ends put in, of the sign that is nearer.

        A swivel keeps its roll.
        """
        q, boundary = q.copy(), self.boundary
        given = (
            (0, boundary.kind.start_held, boundary.start_quaternion),
            (-1, boundary.kind.end_held, boundary.end_quaternion),
        )
        for node, held, clamp in given:
            if 0 < held < HELD:
                roll = rotations.multiply(rotations.conjugate(clamp), q[node]) * (1.0, 0.0, 0.0, 1.0)
                q[node] = rotations.multiply(clamp, rotations.normalise(roll))
            elif held:
                q[node] = clamp * np.sign(clamp @ q[node] or 1.0)
        return q

"""The rod's energy on a chain of elements: what a cable goes down when it is let go.

In an element the section frame is that of its first node turned by a rotation whose modified Rodrigues parameters
sigma = tan(angle / 4) axis are a polynomial in arc length through the element's nodes. They give

    omega = 4 [(1 - |sigma|^2) sigma' - 2 sigma x sigma' + 2 (sigma . sigma') sigma] / (1 + |sigma|^2)^2

(Schaub and Junkins, "Analytical Mechanics of Space Systems", section 3.5.3, with the body's own axes), and d3 without
trigonometry. Energy: int (omega - rest) . K (omega - rest) / 2 less the work of dead loads, by Gauss's rule. The
length is exact, and where both ends have positions, int d3 = gap is the one constraint; its multiplier is the force
at the end. A minimum is a stable equilibrium of the rod, to the order of the elements.

Energy, chord and first derivatives are those of the elements; second derivatives are the rod's own, with the small
rotations phi of the sections interpolated between those of the nodes, as in :mod:`harness_opt.stability`:

    int e . K e + M . (e x phi) - F . (phi x (phi x d3)) ds,   e = phi' + omega x phi,   M = K (omega - rest).

They differ by the elements' own error, and are had at a tenth of the price. Of a taut cable, whose tension multiplies
that error, the elements' own are taken.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .. import rod, rotations
from ..boundary import Boundary
from ..element_pattern import DEGREE, UNKNOWNS, pattern
from ..machine_code import Buffered, built, wanted
from ..quadrature import gauss
from ..rod import Section
from ..rotations import Array
from ..solvers.interface import Expansion

NODES = np.array([0.0, 0.5 - np.sqrt(5.0) / 10.0, 0.5 + np.sqrt(5.0) / 10.0, 1.0])  # Lobatto's
NEIGHBOURS, WHOLE = 1.0, 2.5  # rad that neighbouring nodes, and those of an element, may be turned to each other


_POLYNOMIALS = np.linalg.inv(np.vander(NODES, increasing=True))  # those that are 1 at one node, by columns


def _lagrange(at: Array) -> tuple[Array, Array]:
    """Return the values and the derivatives (m, DEGREE + 1) at ``at`` (m,) of the polynomials that are 1 at a node."""
    powers = np.vander(at, DEGREE + 1, increasing=True)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, DEGREE + 1)
    return powers @ _POLYNOMIALS, slopes @ _POLYNOMIALS


@functools.cache
def _products() -> tuple[Array, Array, Array]:
    """Return the weighted products at Gauss points that integrals of phi, phi' and both are made of.

    Of a value and a slope, and of two values, (DEGREE, (DEGREE + 1)^2); and the integrals of those of two slopes,
    (DEGREE + 1, DEGREE + 1).
    """
    tableau = gauss(DEGREE)
    values, slopes = _lagrange(tableau.nodes)

    def products(left: Array, right: Array) -> Array:
        return np.asarray(tableau.weights[:, None, None] * left[:, :, None] * right[:, None, :])

    mixed, plain = (products(values, right).reshape(DEGREE, -1) for right in (slopes, values))
    return mixed, plain, products(slopes, slopes).sum(axis=0)


def _product(p: ca.SX, q: ca.SX) -> ca.SX:
    return ca.vertcat(p[0] * q[0] - ca.dot(p[1:], q[1:]), p[0] * q[1:] + q[0] * p[1:] + ca.cross(p[1:], q[1:]))


@functools.cache
def _element(exact: bool, machine: bool) -> tuple[ca.Function, ca.Function]:
    """Return two functions of one element.

    Arguments: nodes' quaternions (4 (DEGREE + 1),), length, start, stiffness, rest curvature, force at the end of the
    cable, load. Results of the first: energy and chord; of the second: the gradient of the energy by small rotations
    of the nodes about their own axes, the chord, its derivative by rows, and quaternions and Darboux vectors at the
    Gauss points; where ``exact``, the Hessian in place of the quaternions. Both are machine code where ``machine``.
    """
    tableau = gauss(DEGREE)
    values, slopes = _lagrange(tableau.nodes)
    q, turn = ca.SX.sym("q", 4, DEGREE + 1), ca.SX.sym("turn", 3, DEGREE + 1)
    h, s = ca.SX.sym("h"), ca.SX.sym("s")
    stiffness, rest, force, load = (ca.SX.sym(name, 3) for name in ("stiffness", "rest", "force", "load"))
    nodes = [_product(q[:, j], ca.vertcat(1.0, 0.5 * turn[:, j])) for j in range(DEGREE + 1)]
    inverse = ca.vertcat(nodes[0][0], -nodes[0][1:])
    relative = [_product(inverse, node) for node in nodes[1:]]
    # turned by first order only: the quaternions are not of length 1 then
    sigmas = ca.horzcat(ca.SX(3, 1), *(p[1:] / (ca.norm_2(p) + p[0]) for p in relative))
    energy, chord, frames, omegas = ca.SX(0), ca.SX(3, 1), [], []
    for j in range(DEGREE):
        sigma, rate = ca.mtimes(sigmas, values[j]), ca.mtimes(sigmas, slopes[j]) / h
        square = ca.sumsqr(sigma)
        omega = (1.0 - square) * rate - 2.0 * ca.cross(sigma, rate) + 2.0 * ca.dot(sigma, rate) * sigma
        omega *= 4.0 / (1.0 + square) ** 2
        here = _product(nodes[0], ca.vertcat(1.0 - square, 2.0 * sigma) / (1.0 + square))
        piece = h * float(tableau.weights[j]) * rod.frame(here)[:, 2] / ca.sumsqr(nodes[0])
        inner = force + load * (1.0 - s - h * float(tableau.nodes[j]))
        strain = omega - rest
        energy += 0.5 * h * float(tableau.weights[j]) * ca.dot(stiffness * strain, strain) - ca.dot(inner, piece)
        chord += piece
        frames.append(here)
        omegas.append(omega)
    turns = ca.vec(turn)
    hessian, gradient = ca.hessian(energy, turns)
    second = ca.vec(hessian) if exact else ca.vertcat(*frames)
    results = [
        ca.densify(ca.substitute(x, turns, ca.DM.zeros(UNKNOWNS)))
        for x in (energy, chord, gradient, ca.vec(ca.jacobian(chord, turns).T), second, ca.vertcat(*omegas))
    ]
    arguments = [ca.vec(q), h, s, stiffness, rest, force, load]
    functions = (
        ca.Function("energy", arguments, results[:2], {"cse": True}),
        # a third of the operations are the same ones again, but a tenth where exact: hardly worth the search
        ca.Function("expansion", arguments, results[1:], {"cse": not exact}),
    )
    return (built(functions[0]), built(functions[1])) if machine else functions


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
        self._pattern = pattern(count, kind.start_orientation, kind.end_orientation, self.closed)
        self._functions = _functions(count, exact, wanted())
        self._rest = section.rest_curvature
        self._parameters = np.concatenate([steps, mesh[:-1], section.stiffness, section.rest_curvature, load])
        self.nodes = np.append((mesh[:-1, None] + steps[:, None] * NODES[:-1]).ravel(), 1.0)
        self.points = (mesh[:-1, None] + steps[:, None] * gauss(DEGREE).nodes).ravel()
        share = np.gradient(self.nodes)
        share[[0, -1]] *= 0.5
        self._weights = np.repeat(share[self._pattern.free], 3) * (1.0 + float(np.max(section.stiffness)))
        self._loose_force = boundary.end_force if kind.start_position else -boundary.start_force - load

    # -- what a descent asks for -------------------------------------------------------------------------------

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
        chords, gradients, slopes, second, omegas = np.split(found, count * np.cumsum(self._functions.sizes)[:-1])
        gradient = np.zeros((len(q), 3))
        np.add.at(gradient, p.nodes, gradients.reshape(count, DEGREE + 1, 3))
        shape = (count, DEGREE)
        if self.exact:
            blocks = second.reshape(count, UNKNOWNS, UNKNOWNS)
        else:
            blocks = self._second(second.reshape(*shape, 4), omegas.reshape(*shape, 3), force)
        entries = [blocks[p.blocks]]
        if p.chords is not None:
            border = slopes.reshape(count, 3, UNKNOWNS)[p.chords]
            entries += [border, border, np.zeros(3)]
        return Expansion(
            gradient[p.free].ravel(), self._missed(chords.reshape(count, 3).sum(axis=0)), np.concatenate(entries),
            len(entries[0]), p.places, p.sparsity, self._weights,
        )  # fmt: skip

    def _second(self, q: Array, omega: Array, force: Array) -> Array:
        """Return the elements' Hessians (n, UNKNOWNS, UNKNOWNS).

        Args:
            q, omega: at the Gauss points, (n, DEGREE, 4 or 3).
            force: at the end of the cable, (3,).
        """
        stiffness, (mixed_products, plain_products, rigid) = self.section.stiffness, _products()
        steps, count = np.diff(self.mesh), len(q)
        beyond = (1.0 - self.points).reshape(count, DEGREE, 1)
        inner = rotations.rotate(rotations.conjugate(q), force + beyond * self.load)
        spin, moment = rotations.cross_matrix(omega), rotations.cross_matrix(stiffness * (omega - self._rest))
        turned = np.swapaxes(spin, -1, -2) * stiffness  # [omega]^T K
        d3 = np.array([0.0, 0.0, 1.0])
        across = inner[..., :, None] * d3
        loads = inner[..., 2, None, None] * np.eye(3) - 0.5 * (across + np.swapaxes(across, -1, -2))
        rate = turned + 0.5 * moment  # phi (.) phi'
        twice = moment @ spin
        plain = turned @ spin + 0.5 * (twice + np.swapaxes(twice, -1, -2)) + loads  # phi (.) phi

        def integrated(field: Array, products: Array) -> Array:
            summed = np.swapaxes(field.reshape(count, DEGREE, 9), -1, -2) @ products
            blocks = summed.reshape(count, 3, 3, DEGREE + 1, DEGREE + 1).transpose(0, 3, 1, 4, 2)
            return np.asarray(blocks.reshape(count, UNKNOWNS, UNKNOWNS))

        mixed = integrated(rate, mixed_products)
        hessian = np.kron(rigid, np.diag(stiffness)) / steps[:, None, None] + mixed + np.swapaxes(mixed, -1, -2)
        hessian += steps[:, None, None] * integrated(plain, plain_products)
        return np.asarray(hessian)

    def move(self, q: Array, step: Array) -> Array:
        """Return ``q`` (m, 4) with its free nodes turned about their own axes by ``step`` (n,), rad."""
        half = np.zeros((len(q), 4))
        half[:, 0] = 1.0
        half[self._pattern.free, 1:] = 0.5 * step.reshape(-1, 3)
        return rotations.normalise(rotations.multiply(q, half))

    def strained(self, q: Array) -> bool:
        """Return whether an element is turned further than its polynomials can follow."""
        nodes = q[self._pattern.nodes]
        neighbours = np.sum(nodes[:, 1:] * nodes[:, :-1], axis=-1)
        ends = np.sum(nodes[:, 1:] * nodes[:, :1], axis=-1)
        return bool(np.min(neighbours) < np.cos(0.5 * NEIGHBOURS) or np.min(ends) < np.cos(0.5 * WHOLE))

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

    def held(self, q: Array) -> Array:
        """Return ``q`` (m, 4) with the quaternions of clamped ends put in, of the sign that is nearer."""
        q, kind = q.copy(), self.boundary.kind
        if kind.start_orientation:
            q[0] = self.boundary.start_quaternion * np.sign(self.boundary.start_quaternion @ q[0] or 1.0)
        if kind.end_orientation:
            q[-1] = self.boundary.end_quaternion * np.sign(self.boundary.end_quaternion @ q[-1] or 1.0)
        return q

"""The second variation of a rod's energy on cubic elements; :mod:`harness_opt.rod.stability` takes its eigenvalues."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics import rotations
from harness_opt.numerics.quadrature import gauss
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Kind
from harness_opt.rod.element_pattern import DEGREE, UNKNOWNS
from harness_opt.rod.states import Rod

GAUSS_POINTS = 5  # Gauss points an element: exact for the products of polynomials, and for omega to high order


@dataclass(frozen=True, eq=False)
class SecondVariation:
    """Q by elements, of one or many shapes (leading axes ...), each with UNKNOWNS small rotations of its nodes.

    Args:
        blocks: of Q, (..., n, UNKNOWNS, UNKNOWNS), with the skew part of dead moments.
        ends: by how much the end moves, (..., n, 3, UNKNOWNS).
        masses: of int phi . phi, (n, UNKNOWNS, UNKNOWNS).
        kind: what is given at the ends.
    """

    blocks: Array
    ends: Array
    masses: Array
    kind: Kind

    @property
    def closed(self) -> bool:
        """Whether the end must not be moved."""
        return self.kind.start_position and self.kind.end_position

    @property
    def size(self) -> int:
        """Number of small rotations that are free, about one axis each."""
        return 3 * (DEGREE * len(self.masses) + 1) - self.kind.start_held - self.kind.end_held

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which of the small rotations of all nodes are free."""
        free = np.ones((DEGREE * len(self.masses) + 1, 3), dtype=bool)
        free[0, : self.kind.start_held], free[-1, : self.kind.end_held] = False, False
        return free.ravel()

    @property
    def conservative(self) -> bool:
        """Whether Q is symmetric but for rounding."""
        asymmetry = 1e-9  # relative asymmetry of an operator that is symmetric
        skew = self.blocks - np.swapaxes(self.blocks, -1, -2)
        return float(np.max(np.abs(skew), initial=0.0)) <= asymmetry * float(np.max(np.abs(self.blocks), initial=0.0))

    @property
    def symmetric(self) -> SecondVariation:
        """The symmetric part."""
        blocks = 0.5 * (self.blocks + np.swapaxes(self.blocks, -1, -2))
        return SecondVariation(blocks, self.ends, self.masses, self.kind)

    def __getitem__(self, which: int) -> SecondVariation:
        """Return that of one of many shapes."""
        return SecondVariation(self.blocks[which], self.ends[which], self.masses, self.kind)

    def dense(self) -> tuple[Array, Array, Array]:
        """Return Q (..., D, D), how the end moves (..., 3, D) and the mass matrix (D, D), D = ``size``."""
        lead, count = self.blocks.shape[:-3], len(self.masses)
        size = 3 * (DEGREE * count + 1)
        matrix, moves, mass = np.zeros((*lead, size, size)), np.zeros((*lead, 3, size)), np.zeros((size, size))
        for e in range(count):
            span = slice(3 * DEGREE * e, 3 * DEGREE * e + UNKNOWNS)
            matrix[..., span, span] += self.blocks[..., e, :, :]
            moves[..., span] += self.ends[..., e, :, :]
            mass[span, span] += self.masses[e]
        kept = np.flatnonzero(self.free)
        return matrix[..., kept[:, None], kept], moves[..., kept], mass[kept[:, None], kept]


@functools.lru_cache(maxsize=64)
def _shape_functions() -> tuple[Array, Array]:
    """Return values and slopes (GAUSS_POINTS, DEGREE + 1) of the Lagrange polynomials on equispaced element nodes."""
    nodes = np.linspace(0.0, 1.0, DEGREE + 1)
    coefficients = np.linalg.inv(np.vander(nodes, increasing=True))
    powers = np.vander(gauss(GAUSS_POINTS).nodes, DEGREE + 1, increasing=True)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, DEGREE + 1)
    return powers @ coefficients, slopes @ coefficients


def second_variation(rod: Rod, mesh: Array, kind: Kind) -> SecondVariation:
    """Return Q of one or many shapes between ends of ``kind``, with phi on the elements of ``mesh`` (n + 1,)."""
    tableau = gauss(GAUSS_POINTS)
    steps = np.diff(mesh)
    count = len(steps)
    s = (mesh[:-1, None] + steps[:, None] * tableau.nodes).ravel()
    samples = rod.sample(s)
    lead = samples.q.shape[:-2]
    split = (*lead, count, GAUSS_POINTS, 3)
    inverse = rotations.conjugate(samples.q)
    omega = samples.omega.reshape(split)
    moment = rotations.rotate(inverse, samples.moment).reshape(split)
    force = rotations.rotate(inverse, samples.force).reshape(split)
    frame = rotations.matrix(samples.q).reshape(*split, 3)
    stiffness = np.diag(rod.section.stiffness)
    w, m = rotations.cross_matrix(omega), rotations.cross_matrix(moment)
    # M . (e x phi) = phi . (M x e); F . (phi x (phi x d3)) = (F . phi)(phi . d3) - (F . d3)(phi . phi)
    d3 = np.array([0.0, 0.0, 1.0])
    geometric = force[..., 2, None, None] * np.eye(3) - 0.5 * (
        force[..., :, None] * d3 + d3[:, None] * force[..., None, :]
    )
    rate = np.swapaxes(w, -1, -2) @ stiffness + 0.5 * m  # phi^T (.) phi'
    plain = np.swapaxes(w, -1, -2) @ stiffness @ w + 0.5 * (m @ w + np.swapaxes(m @ w, -1, -2)) + geometric
    value, slope = _shape_functions()
    rigid = np.einsum("e,g,ga,gb,ij->eaibj", 1.0 / steps, tableau.weights, slope, slope, stiffness)
    coupling = _integrated(rate, value, slope)
    blocks = rigid + coupling + np.einsum("...eaibj->...ebjai", coupling)
    blocks = blocks + steps[:, None, None, None, None] * _integrated(plain, value, value)
    lever = frame @ -rotations.cross_matrix(d3)  # R (phi x d3) = -R [d3] phi
    ends = np.einsum("e,ga,...egci->...ecai", steps, tableau.weights[:, None] * value, lever)
    masses = np.einsum("e,g,ga,gb,ij->eaibj", steps, tableau.weights, value, value, np.eye(3))
    local = (count, UNKNOWNS, UNKNOWNS)
    blocks, masses = blocks.reshape(*lead, *local), masses.reshape(local)
    turns = (
        (0, slice(0, 3), kind.start_orientation, 0.5),
        (-1, slice(UNKNOWNS - 3, UNKNOWNS), kind.end_orientation, -0.5),
    )
    for end, span, clamped, sign in turns:
        if not clamped:  # what a dead moment adds
            moment = rotations.rotate(rotations.conjugate(rod.q[..., end, :]), rod.moment[..., end, :])
            blocks[..., end, span, span] += sign * rotations.cross_matrix(moment)
    return SecondVariation(blocks, ends.reshape(*lead, count, 3, UNKNOWNS), masses, kind)


def _integrated(field: Array, left: Array, right: Array) -> Array:
    """Return int left_a field_ij right_b over each element of unit length, (..., e, a, i, b, j).

    Args:
        field: (..., e, GAUSS_POINTS, 3, 3).
        left, right: functions at the points, (GAUSS_POINTS, DEGREE + 1).
    """
    products = (gauss(GAUSS_POINTS).weights[:, None, None] * left[:, :, None] * right[:, None, :]).reshape(
        GAUSS_POINTS, -1
    )
    lead = field.shape[:-3]
    summed = np.swapaxes(field.reshape(*lead, GAUSS_POINTS, 9), -1, -2) @ products
    integrals: Array = np.einsum("...ijab->...aibj", summed.reshape(*lead, 3, 3, DEGREE + 1, DEGREE + 1))
    return integrals

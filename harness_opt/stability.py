"""Is an equilibrium stable? The second variation of the energy, on the variations that the ends allow.

Turning the sections by a small field phi (section frame) changes the energy, with the force F as multiplier of the
end's position, to second order by

    Q = 1/2 int  e . K e  +  M . (e x phi)  -  F . (phi x (phi x d3))  ds,      e = phi' + omega x phi,

all in the section frame, K = diag(kx, ky, kz); phi vanishes where the orientation is given, and int phi x d3 ds
(world) vanishes where both positions are. The shape is stable where Q > 0 for all such phi. (Derived from R
exp(phi) to second order; compare Kumar and Healey, "A generalized computational approach to stability of static
equilibria of nonlinearly elastic rods in the presence of constraints", CMAME 199, 2010.)

A moment at an end that may turn is taken as dead (fixed in the world). It does no conservative work in space: to the
symmetric operator of Q comes a skew part of half the moment at that end, phi -> -m x phi / 2 (the spin of
R exp(phi) is phi' - phi x phi' / 2 + ...). Stable is then the cable that creeps back through a viscous medium: all
eigenvalues have real parts above zero (Ziegler, "Principles of Structural Stability", chapter 5; a shaft under dead
torque has complex ones).

phi is discretised by cubic elements, so the lowest eigenvalue of Q against int phi . phi is an upper bound that
converges with the sixth power of the element.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from . import rod as rod_module
from . import rotations
from .boundary import Kind
from .quadrature import gauss
from .rotations import Array
from .shape import Rod

DEGREE = 3  # of the polynomials of phi on an element
POINTS = 5  # Gauss points an element: exact for the products of polynomials, and for omega to high order
# A neutral family (a shape that may turn freely) has a lowest eigenvalue of zero up to the discretisation; this
# much below zero, relative to the largest load on the rod, still counts as zero.
NEUTRAL = 1e-5
RANK = 1e-9  # singular values below this fraction of the largest count as zero
PHASE = 2.0  # rad, most that a mode is let to vary by over one element
MOST_PIECES, MOST_ELEMENTS = 4, 128  # that an element is cut into, and in all
ENOUGH = 64  # elements, of which a finer mesh keeps as many as there are phases, or turnings of the shape
TURNING = 0.5  # rad an element then
MOST_ENTRIES = 8_000_000  # of the matrices looked at together: 64 MB, and some times that in between
ROUNDING = 1e-9  # relative asymmetry of an operator that is symmetric
SPRING = 1e4  # against moving the end, in the largest entries of Q's matrix


@dataclass(frozen=True)
class Stability:
    """The second variation of one or many shapes (leading axes ...).

    Args:
        margin: lowest eigenvalue (real part), dimensionless (B/L per rad^2); below zero is unstable, zero is neutral.
        index: number of unstable directions.
    """

    margin: Array
    index: Array

    @property
    def stable(self) -> Array:
        """Whether no direction is unstable, (...)."""
        return self.index == 0


@functools.lru_cache(maxsize=64)
def _shape_functions() -> tuple[Array, Array]:
    """Return values and slopes (POINTS, DEGREE + 1) of the Lagrange polynomials on equispaced element nodes."""
    nodes = np.linspace(0.0, 1.0, DEGREE + 1)
    coefficients = np.linalg.inv(np.vander(nodes, increasing=True))
    powers = np.vander(gauss(POINTS).nodes, DEGREE + 1, increasing=True)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, DEGREE + 1)
    return powers @ coefficients, slopes @ coefficients


def _assemble(rod: Rod, mesh: Array) -> tuple[Array, Array, Array]:
    """Return Q (..., D, D), the position constraint (..., 3, D) and the mass matrix (D, D), D = 3 (3 n + 1).

    phi is on the elements of ``mesh`` (n + 1,).
    """
    tableau = gauss(POINTS)
    steps = np.diff(mesh)
    count = len(steps)
    s = (mesh[:-1, None] + steps[:, None] * tableau.nodes).ravel()
    samples = rod.sample(s)
    lead = samples.q.shape[:-2]
    split = (*lead, count, POINTS, 3)
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
    size, local = 3 * (DEGREE * count + 1), 3 * (DEGREE + 1)
    matrix, constraint, mass = np.zeros((*lead, size, size)), np.zeros((*lead, 3, size)), np.zeros((size, size))
    for e in range(count):
        span = slice(3 * DEGREE * e, 3 * DEGREE * e + local)
        matrix[..., span, span] += blocks[..., e, :, :, :, :].reshape(*lead, local, local)
        constraint[..., span] += ends[..., e, :, :, :].reshape(*lead, 3, local)
        mass[span, span] += masses[e].reshape(local, local)
    return matrix, constraint, mass


def _integrated(field: Array, left: Array, right: Array) -> Array:
    """Return int left_a field_ij right_b over each element of unit length, (..., e, a, i, b, j).

    Args:
        field: (..., e, POINTS, 3, 3).
        left, right: functions at the points, (POINTS, DEGREE + 1).
    """
    products = (gauss(POINTS).weights[:, None, None] * left[:, :, None] * right[:, None, :]).reshape(POINTS, -1)
    lead = field.shape[:-3]
    summed = np.swapaxes(field.reshape(*lead, POINTS, 9), -1, -2) @ products
    return np.einsum("...ijab->...aibj", summed.reshape(*lead, 3, 3, DEGREE + 1, DEGREE + 1))


def _resolving(rod: Rod) -> Array:
    """Return a mesh (n + 1,) that resolves how phi may vary along ``rod``, and hardly more than that.

    The modes vary as :func:`harness_opt.rod.wave_numbers` says, whatever the shape itself needs.
    """
    lead = tuple(range(rod.q.ndim - 2))
    wave = rod_module.wave_numbers(rod.force, rod.moment, rod.section.stiffness).max(axis=lead)
    steps = np.diff(rod.mesh)
    phase = steps * np.maximum(wave[1:], wave[:-1])
    pieces = np.clip(np.ceil(phase / PHASE), 1, max(1, min(MOST_PIECES, MOST_ELEMENTS // len(steps)))).astype(int)
    if np.any(pieces > 1):
        old = np.concatenate([[0], np.cumsum(pieces)])
        return np.interp(np.arange(old[-1] + 1), old, rod.mesh)
    if len(steps) <= ENOUGH:
        return rod.mesh
    cosines = np.clip(np.abs(np.sum(rod.q[..., 1:, :] * rod.q[..., :-1, :], axis=-1)), 0.0, 1.0)
    turned = 2.0 * np.arccos(cosines).max(axis=lead)
    needed = np.concatenate([[0.0], np.cumsum(np.maximum(phase / PHASE, turned / TURNING))])
    count = max(ENOUGH, int(np.ceil(needed[-1])))
    if count >= len(steps):
        return rod.mesh
    needed += needed[-1] * rod.mesh  # no element is longer than two of a uniform mesh
    return np.interp(np.linspace(0.0, needed[-1], count + 1), needed, rod.mesh)


def _parts(rod: Rod, mesh: Array) -> Iterator[Rod]:
    """Yield ``rod``, one shape or many along one axis, a few at a time: a large matrix each is much memory."""
    size = 3 * (DEGREE * (len(mesh) - 1) + 1)
    few = max(1, MOST_ENTRIES // size**2)
    if rod.q.ndim == 2 or len(rod.q) <= few:
        yield rod
        return
    for first in range(0, len(rod.q), few):
        some = (getattr(rod, name)[first : first + few] for name in ("q", "r", "force", "moment"))
        yield Rod(rod.section, rod.load, rod.mesh, *some)


def _allowed(rod: Rod, mesh: Array, kind: Kind) -> tuple[Array, Array, Array, Array]:
    """Return what :func:`_assemble` does without the fields that the clamps forbid, and the load scale (...)."""
    matrix, constraint, mass = _assemble(rod, mesh)
    size = mass.shape[0]
    for node, held, sign in ((0, kind.start_orientation, 0.5), (-1, kind.end_orientation, -0.5)):
        if not held:
            span = slice(0, 3) if node == 0 else slice(size - 3, size)
            moment = rotations.rotate(rotations.conjugate(rod.q[..., node, :]), rod.moment[..., node, :])
            matrix[..., span, span] += sign * rotations.cross_matrix(moment)
    kept = slice(3 if kind.start_orientation else 0, size - (3 if kind.end_orientation else 0))
    scale = 1.0 + np.max(np.linalg.norm(rod.force, axis=-1), axis=-1)
    return matrix[..., kept, kept], constraint[..., kept], mass[kept, kept], scale


def _reduced(rod: Rod, mesh: Array, kind: Kind) -> tuple[Array, Array, Array]:
    """Return Q's matrix on fields orthonormal in the mass, the basis of these fields, and the load scale.

    Fields that would move the end are given an eigenvalue far above all others rather than being left out: how many
    there are depends on the shape (two for a straight one, three for all others).
    """
    matrix, constraint, mass, scale = _allowed(rod, mesh, kind)
    # with phi = L^-T u, mass = L L^T, the eigenvalues against the mass are ordinary ones
    whiten = np.linalg.inv(np.linalg.cholesky(mass))
    matrix = whiten @ matrix @ whiten.T
    if kind.start_position and kind.end_position:
        moving = constraint @ whiten.T
        projector = np.linalg.pinv(moving, rcond=RANK) @ moving
        still = np.eye(matrix.shape[-1]) - projector
        far = 10.0 * np.max(np.abs(matrix), axis=(-1, -2))[..., None, None]
        matrix = still @ matrix @ still + far * projector
    return matrix, whiten.T, scale


def stability(rod: Rod, kind: Kind) -> Stability:
    """Return the stability of ``rod`` between ends of ``kind``."""
    margins, indices, mesh = [], [], _resolving(rod)
    for part in _parts(rod, mesh):
        matrix, _, scale = _reduced(part, mesh, kind)
        symmetric = _conservative(matrix)
        values = np.linalg.eigvalsh(matrix) if symmetric else np.sort(np.linalg.eigvals(matrix).real, axis=-1)
        margins.append(np.asarray(values[..., 0], dtype=float))
        indices.append(np.sum(values < -NEUTRAL * scale[..., None], axis=-1))
    if rod.q.ndim == 2:
        return Stability(margins[0], indices[0])
    return Stability(np.concatenate(margins), np.concatenate(indices))


def surely_stable(rod: Rod, kind: Kind) -> bool:
    """Return whether all shapes of ``rod`` are stable; False may also mean that it takes eigenvalues to tell.

    Q plus a stiff spring against moving the end is positive definite only if Q is so on the fields that leave the end
    where it is: a Cholesky factor instead of eigenvalues, at a tenth of the time. With a dead moment that holds for the
    symmetric part, and what it says of that is true of the real parts of all eigenvalues.
    """
    mesh = _resolving(rod)
    return all(_surely_stable(part, mesh, kind) for part in _parts(rod, mesh))


def _surely_stable(rod: Rod, mesh: Array, kind: Kind) -> bool:
    matrix, constraint, mass, scale = _allowed(rod, mesh, kind)
    matrix = 0.5 * (matrix + np.swapaxes(matrix, -1, -2)) + (NEUTRAL * scale)[..., None, None] * mass
    if kind.start_position and kind.end_position:
        matrix = matrix + SPRING * np.max(np.abs(matrix)) * np.swapaxes(constraint, -1, -2) @ constraint
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:  # not positive definite
        return False
    return True


def _conservative(matrix: Array) -> bool:
    """Return whether the operators (..., D, D) are symmetric but for rounding."""
    skew = matrix - np.swapaxes(matrix, -1, -2)
    return float(np.max(np.abs(skew), initial=0.0)) <= ROUNDING * float(np.max(np.abs(matrix), initial=0.0))


def lowest_mode(rod: Rod, kind: Kind) -> Array:
    """Return the field phi (n + 1, 3) of the lowest eigenvalue of one shape, at the nodes of its mesh.

    It is in the section frame, and its longest vector has length 1.
    """
    mesh = _resolving(rod)
    matrix, basis, _ = _reduced(rod, mesh, kind)
    if _conservative(matrix):
        vector = np.linalg.eigh(matrix)[1][:, 0]
    else:
        values, vectors = np.linalg.eig(matrix)
        vector = vectors[:, np.argmin(values.real)].real
    field = np.zeros(3 * (DEGREE * (len(mesh) - 1) + 1))
    first = 3 if kind.start_orientation else 0
    field[first : first + len(basis)] = basis @ vector
    at_nodes = np.stack([np.interp(rod.mesh, mesh, one) for one in field.reshape(-1, 3)[::DEGREE].T], axis=1)
    return at_nodes / np.max(np.linalg.norm(at_nodes, axis=1))

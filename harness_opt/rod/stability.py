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
from numpy.typing import NDArray

from harness_opt.numerics.rotations import Array
from harness_opt.rod import equations as rod_module
from harness_opt.rod.boundary import Kind
from harness_opt.rod.element_pattern import DEGREE
from harness_opt.rod.lowest_eigenvalue import Pencil
from harness_opt.rod.second_variation import SecondVariation, second_variation
from harness_opt.rod.states import Rod

# A neutral family (a shape that may turn freely) has a lowest eigenvalue of zero up to the discretisation; this
# much below zero, relative to the largest load on the rod, still counts as zero.
NEUTRAL = 1e-5
MOST_ENTRIES = 8_000_000  # of the matrices looked at together: 64 MB, and some times that in between
SPARSE_FROM = 120  # rows, from which on many shapes too are looked at one by one, with sparse matrices


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
    def stable(self) -> NDArray[np.bool_]:
        """Whether no direction is unstable, (...)."""
        return np.asarray(self.index == 0)


def _resolving(rod: Rod) -> Array:
    """Return a mesh (n + 1,) that resolves how phi may vary along ``rod``, and hardly more than that.

    The modes vary as :func:`harness_opt.rod.equations.wave_numbers` says, whatever the shape itself needs.
    """
    least_elements = 64  # elements, of which a finer mesh keeps as many as there are phases, or turnings of the shape
    most_phase = 2.0  # rad, most that a mode is let to vary by over one element
    most_turning = 0.5  # rad an element then
    most_pieces, most_elements = 4, 128  # that an element is cut into, and in all
    lead = tuple(range(rod.q.ndim - 2))
    wave = rod_module.wave_numbers(rod.force, rod.moment, rod.section.stiffness).max(axis=lead)
    steps = np.diff(rod.mesh)
    phase = steps * np.maximum(wave[1:], wave[:-1])
    pieces = np.clip(np.ceil(phase / most_phase), 1, max(1, min(most_pieces, most_elements // len(steps)))).astype(int)
    if np.any(pieces > 1):
        old = np.concatenate([[0], np.cumsum(pieces)])
        return np.interp(np.arange(old[-1] + 1), old, rod.mesh)
    if len(steps) <= least_elements:
        return rod.mesh
    cosines = np.clip(np.abs(np.sum(rod.q[..., 1:, :] * rod.q[..., :-1, :], axis=-1)), 0.0, 1.0)
    turned = 2.0 * np.arccos(cosines).max(axis=lead)
    needed = np.concatenate([[0.0], np.cumsum(np.maximum(phase / most_phase, turned / most_turning))])
    count = max(least_elements, int(np.ceil(needed[-1])))
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
        yield rod.some(slice(first, first + few))


def _scale(rod: Rod) -> Array:
    """Return the size of the loads (...), to which eigenvalues are compared."""
    return np.asarray(1.0 + np.max(np.linalg.norm(rod.force, axis=-1), axis=-1))


def _reduced(variation: SecondVariation) -> tuple[Array, Array]:
    """Return Q's matrix on fields orthonormal in the mass, and the basis of these fields.

    Fields that would move the end are given an eigenvalue far above all others rather than being left out: how many
    there are depends on the shape (two for a straight one, three for all others).
    """
    rank_tolerance = 1e-9  # singular values below this fraction of the largest count as zero
    matrix, moves, mass = variation.dense()
    # with phi = L^-T u, mass = L L^T, the eigenvalues against the mass are ordinary ones
    whiten = np.linalg.inv(np.linalg.cholesky(mass))
    matrix = whiten @ matrix @ whiten.T
    if variation.closed:
        _, sizes, moving = np.linalg.svd(moves @ whiten.T, full_matrices=False)
        moving *= (sizes > rank_tolerance * sizes[..., :1])[
            ..., None
        ]  # orthonormal, but for what is no direction at all
        turned, far = np.swapaxes(moving, -1, -2), 10.0 * np.max(np.abs(matrix), axis=(-1, -2))[..., None, None]
        across = matrix @ turned
        both = across @ moving
        inner = moving @ across + far * np.eye(moving.shape[-2])
        matrix = matrix - both - np.swapaxes(both, -1, -2) + turned @ inner @ moving
    return matrix, whiten.T


def stability(rod: Rod, kind: Kind) -> Stability:
    """Return the stability of ``rod`` between ends of ``kind``; that of one shape is kept for whoever asks next."""
    if rod.q.ndim == 2:
        return _of_one(rod, kind)
    mesh = _resolving(rod)
    found = [_judged(part, mesh, kind) for part in _parts(rod, mesh)]
    return Stability(*(np.concatenate([getattr(one, name) for one in found]) for name in ("margin", "index")))


@functools.lru_cache(maxsize=8)
def _of_one(rod: Rod, kind: Kind) -> Stability:
    return _judged(rod, _resolving(rod), kind)


def _judged(rod: Rod, mesh: Array, kind: Kind) -> Stability:
    variation, scale = second_variation(rod, mesh, kind), _scale(rod)
    if variation.conservative and (not scale.ndim or variation.size > SPARSE_FROM):
        return _by_counting(variation, NEUTRAL * scale)
    matrix = _reduced(variation)[0]
    eigenvalues = np.linalg.eigvalsh if variation.conservative else np.linalg.eigvals
    values = np.sort(eigenvalues(matrix).real, axis=-1)
    margin, index = values[..., 0], np.sum(values < -NEUTRAL * scale[..., None], axis=-1)
    return Stability(np.asarray(margin, dtype=float), np.asarray(index))


def _by_counting(variation: SecondVariation, units: Array) -> Stability:
    """Return the stability of one or many shapes, each by itself; ``units`` (...) is what counts as zero of each."""
    if not units.ndim:
        margin, _, index = Pencil(variation).lowest(float(units))
        return Stability(np.asarray(margin), np.asarray(index))
    found = [_by_counting(variation[k], units[k]) for k in range(len(units))]
    return Stability(np.array([one.margin for one in found]), np.array([one.index for one in found]))


def doubt(error: Array | float) -> Array:
    """Return the margin, in the size of the loads, that a shape with an estimated ``error`` (in L) may be wrong by."""
    # what margins are off, in the same size, for each unit of the centreline's estimated error in L: up to 9 on the
    # frames of the paper's rig
    sensitive = 10.0
    return np.asarray(NEUTRAL + sensitive * np.asarray(error))


def doubtful(rod: Rod, found: Stability, error: Array | float) -> NDArray[np.bool_]:
    """Return whether the margins ``found`` of ``rod`` may owe their sign to errors (...) of the shapes, in L, (...)."""
    return np.asarray(~(np.abs(found.margin) > doubt(error) * _scale(rod)))


def surely_stable(rod: Rod, kind: Kind, above: Array | float = -NEUTRAL) -> bool:
    """Return whether all shapes of ``rod`` are stable; False may also mean that it takes eigenvalues to tell.

    Q plus a stiff spring against moving the end is positive definite only if Q is so on the fields that leave the end
    where it is: a Cholesky factor instead of eigenvalues, at a tenth of the time. With a dead moment that holds for the
    symmetric part, and what it says of that is true of the real parts of all eigenvalues.

    Args:
        rod, kind: as above.
        above: what the margin is to be more than, in the size of the loads, (...).
    """
    mesh = _resolving(rod)
    least, first = np.broadcast_to(above, rod.q.shape[:-2]) * _scale(rod), 0
    for part in _parts(rod, mesh):
        count = len(part.q)
        if not _surely_stable(part, mesh, kind, least if rod.q.ndim == 2 else least[first : first + count]):
            return False
        first += count
    return True


def _surely_stable(rod: Rod, mesh: Array, kind: Kind, least: Array) -> bool:
    spring = 1e4  # against moving the end, in the largest entries of Q's matrix
    variation = second_variation(rod, mesh, kind).symmetric
    if variation.size > SPARSE_FROM:
        shapes = [variation] if not least.ndim else [variation[k] for k in range(len(least))]
        return not any(Pencil(one).below(value) for one, value in zip(shapes, least.ravel().tolist(), strict=True))
    matrix, moves, mass = variation.dense()
    matrix = matrix - least[..., None, None] * mass
    if variation.closed:
        matrix = matrix + spring * np.max(np.abs(matrix)) * np.swapaxes(moves, -1, -2) @ moves
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:  # not positive definite
        return False
    return True


def lowest_mode(rod: Rod, kind: Kind) -> Array:
    """Return the field phi (n + 1, 3) of the lowest eigenvalue of one shape, at the nodes of its mesh.

    It is in the section frame, and its longest vector has length 1.
    """
    mesh = _resolving(rod)
    variation = second_variation(rod, mesh, kind)
    if variation.conservative:
        found = Pencil(variation).lowest(NEUTRAL * float(_scale(rod)))[1]
    else:
        matrix, basis = _reduced(variation)
        values, vectors = np.linalg.eig(matrix)
        found = basis @ vectors[:, np.argmin(values.real)].real
    field = np.zeros(3 * (DEGREE * (len(mesh) - 1) + 1))
    field[variation.free] = found
    at_nodes = np.stack([np.interp(rod.mesh, mesh, one) for one in field.reshape(-1, 3)[::DEGREE].T], axis=1)
    scaled: Array = at_nodes / np.max(np.linalg.norm(at_nodes, axis=1))
    return scaled

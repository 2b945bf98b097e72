"""The clamped elastica in closed form, and cables of unit length and stiffness."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import optimize, special

import harness_opt as ho
from harness_opt.numerics import rotations

ALONG_X = tuple(rotations.from_tangent((1, 0, 0)).tolist())


def unit_cable(kz: float = 3.0, **changes: object) -> ho.Cable:
    """Return a cable of length 1 m and bending stiffness 1 N m2."""
    given = {"length": 1.0, "diameter": 0.01, "bending_stiffness": 1.0, "torsional_stiffness": kz}
    return ho.Cable(**(given | changes))


class Elastica(NamedTuple):
    """The one-arch elastica between two clamps along its chord, L = B = 1.

    Angle to the chord: sin(theta / 2) = k sn(lam s), lam = 4 K(k).
    """

    k: float
    lam: float

    @classmethod
    def between(cls, distance: float) -> Elastica:
        """Return the one whose ends are ``distance`` apart: 2 E(k) / K(k) - 1."""

        def excess(k: float) -> float:
            return 2 * special.ellipe(k * k) / special.ellipk(k * k) - 1 - distance

        k = optimize.brentq(excess, 1e-6, 1 - 1e-9, xtol=1e-16, rtol=1e-15)
        return cls(k, 4 * special.ellipk(k * k))

    def plane(self, s: np.ndarray) -> np.ndarray:
        """Return places along the chord and across it (N, 2)."""
        u = self.lam * np.asarray(s)
        _, cn, _, amplitude = special.ellipj(u, self.k**2)
        along = (2 * special.ellipeinc(amplitude, self.k**2) - u) / self.lam
        return np.stack([along, 2 * self.k / self.lam * (1 - cn)], axis=-1)


def elastica_error(position: np.ndarray, s: np.ndarray, distance: float, bow: np.ndarray) -> float:
    """Return the largest distance of ``position`` (N, 3) from the elastica along x that bows to ``bow``."""
    plane = Elastica.between(distance).plane(s)
    exact = plane[:, :1] * np.array([1.0, 0, 0]) + plane[:, 1:] * bow
    return float(np.max(np.linalg.norm(position - exact, axis=1)))

"""Stiff and extreme cables between two clamps: a grid about an ordinary one, and random ones from all ranges."""

from __future__ import annotations

import dataclasses

import numpy as np

import harness_opt as ho
from harness_opt.numerics import rotations

Array = np.ndarray
G = 9.81  # m/s2
SEED = 20240611
CLAMPS = ("random", "coincident", "opposed", "crossed", "coaxial")


@dataclasses.dataclass(frozen=True)
class Case:
    """One cable between two clamps.

    Args:
        name: what it is called in the table.
        kz_kx, kx_ky: stiffness ratios; B = sqrt(kx ky).
        weight: w L^3 / B.
        distance: of the ends, in L.
        turns: whole turns of twist added.
        length: L, m.
        clamps: how the clamps stand to each other, one of CLAMPS.
        bending: B / L^2, N: what makes the dimensionless numbers SI.
        origin: of the start, in L, (3,).
        gap: direction from the start to the end, (3,).
        start, end: quaternions of the clamps.
    """

    name: str
    kz_kx: float
    kx_ky: float
    weight: float
    distance: float
    turns: int
    length: float
    clamps: str
    bending: float
    origin: tuple[float, ...]
    gap: tuple[float, ...]
    start: tuple[float, ...]
    end: tuple[float, ...]

    def posed(self) -> tuple[ho.Cable, ho.End, ho.End, tuple[float, float, float]]:
        """Return cable, ends and gravity, as ``equilibrium`` takes them."""
        bending = self.bending * self.length**2
        kx, ky = bending * self.kx_ky**0.5, bending / self.kx_ky**0.5
        mass = self.weight * bending / self.length**3 / G
        cable = ho.Cable(self.length, 0.01 * self.length, (kx, ky), kx * self.kz_kx, mass)
        begin = self.length * np.array(self.origin)
        there = begin + self.length * self.distance * np.array(self.gap)
        return (
            cable,
            ho.End(tuple(begin), self.start),
            ho.End(tuple(there), self.end, turns=self.turns),
            (0.0, 0.0, -G if self.weight else 0.0),
        )


def _frames(clamps: str, gap: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the quaternions of two clamps that stand to each other as ``clamps`` says."""
    first = rotations.normalise(rng.normal(size=4))
    rolled = rotations.from_rotation_vector([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    if clamps == "random":
        return first, rotations.normalise(rng.normal(size=4))
    if clamps == "coincident":
        return first, first
    if clamps == "coaxial":
        return rotations.from_tangent(gap), rotations.multiply(rotations.from_tangent(gap), rolled)
    angle = np.pi if clamps == "opposed" else 0.5 * np.pi
    around = rng.uniform(-np.pi, np.pi)
    turned = rotations.from_rotation_vector(angle * np.array([np.cos(around), np.sin(around), 0.0]))
    return first, rotations.multiply(rotations.multiply(first, turned), rolled)


def random_case(rng: np.random.Generator, name: str = "random") -> Case:
    """Draw a case from all ranges at once.

    Ratios, weights and lengths are log-uniform (one weight in six is zero); end distances are log-uniform near 0, near
    L, or uniform, a third each. Every such pose can be reached: the ends are never L apart.
    """

    def decades(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(low, high))

    near = rng.integers(3)
    distance = (decades(-6, np.log10(0.5)), 1.0 - decades(-6, np.log10(0.5)), float(rng.uniform(0.05, 0.95)))[near]
    clamps = CLAMPS[rng.integers(len(CLAMPS))]
    gap = rotations.normalise(rng.normal(size=3))
    start, end = _frames(clamps, gap, rng)
    return Case(
        name,
        kz_kx=decades(-3, 3),
        kx_ky=decades(0, 3),
        weight=0.0 if rng.integers(6) == 0 else decades(-2, 6),
        distance=distance,
        turns=int(rng.integers(-10, 11)),
        length=decades(-3, 3),
        clamps=clamps,
        bending=decades(-3, 3),
        origin=tuple(rng.uniform(-1.0, 1.0, size=3).tolist()),
        gap=tuple(gap.tolist()),
        start=tuple(start.tolist()),
        end=tuple(end.tolist()),
    )


def numbered_case(seed: int, number: int) -> Case:
    """Return the random case ``number`` of ``seed``: the same whatever was drawn before it."""
    return random_case(np.random.default_rng([seed, number]), f"{seed}/{number}")


BASE = Case(
    "base", 0.7, 1.0, 0.0, 0.5, 0, 1.0, "crossed", 1.0, (0.0, 0.0, 0.0), (0.0, 0.6, 0.8), (1.0, 0.0, 0.0, 0.0),
    tuple(rotations.from_rotation_vector([0.5 * np.pi, 0.0, 0.0]).tolist()),
)  # fmt: skip
DISTANCES = (1e-6, 1e-4, 1e-2, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999, 1 - 1e-4, 1 - 1e-5, 1 - 1e-6)
AXES: dict[str, tuple[float, ...]] = {
    "kz_kx": tuple(10.0 ** np.arange(-3, 4)),
    "kx_ky": (1.0, 10.0, 100.0, 1000.0),
    "weight": (0.0, *(10.0 ** np.arange(0, 7))),
    "distance": DISTANCES,
    "turns": tuple(range(11)),
    "length": (1e-3, 1e-1, 1e1, 1e3),
}
PAIRS = (("kz_kx", "weight"), ("distance", "turns"))


def varied(**changes: float) -> Case:
    """Return the ordinary case with other numbers, named by these."""
    name = ", ".join(f"{key} = {value:.7g}" for key, value in changes.items())
    return dataclasses.replace(BASE, name=name, **changes)


def grid(*, coarse: bool) -> list[Case]:
    """Return the base case with each axis swept, the ways its clamps can stand, and both pairs of axes together."""
    axes = {key: values[:: 4 if coarse else 1] for key, values in AXES.items()}
    cases = [varied(**{key: value}) for key, values in axes.items() for value in values]
    for clamps in CLAMPS:
        gap = np.array(BASE.gap)
        start, end = (tuple(q.tolist()) for q in _frames(clamps, gap, np.random.default_rng(SEED)))
        cases.append(dataclasses.replace(BASE, name=f"clamps {clamps}", clamps=clamps, start=start, end=end))
    for first, second in PAIRS:
        cases += [varied(**{first: a, second: b}) for a in axes[first] for b in axes[second]]
    return list({case.name: case for case in cases}.values())

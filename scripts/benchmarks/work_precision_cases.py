"""The cases of ``work_precision.py``: cables of length and bending stiffness 1, and the shapes they are known to have.

Closed forms where there are any; else the shapes tabulated in ``tests/reference``, from ``solve_bvp`` at 1e-10; else
None, and the study solves them itself, tightly and by another method.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import optimize, special

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.rod import boundary

Array = np.ndarray
REFERENCE = Path(__file__).resolve().parents[2] / "tests" / "reference"
G = 9.81  # m/s2
TABULATED = 10  # places of S from one that the references tabulate to the next
S = np.linspace(0.0, 1.0, 100 * TABULATED + 1)  # where shapes are compared: between the references' places too
ALONG_X = tuple(rotations.from_tangent((1, 0, 0)).tolist())


@dataclasses.dataclass(frozen=True)
class Benchmark:
    """One case, and an easier one from which a motion leads to it.

    Args:
        name: for tables and files.
        cable, start, end, weight: what to solve; ``weight`` is w L^3 / B, along -z.
        easier: what the motion's first frame has in place of ``end`` and ``weight``.
        bow: of the starting curve, (3,); also of the easier case.
        truth: positions at S (1001, 3), or None.
        tabulated: positions at every TABULATED-th place of S that a reference gives, or None.
        turnable: whether the cable may turn freely about its chord, so that shapes are the same up to such a turn.
    """

    name: str
    cable: ho.Cable
    start: ho.End
    end: ho.End
    weight: float
    easier: tuple[ho.End, float]
    bow: tuple[float, float, float]
    truth: Array | None
    turnable: bool = False
    tabulated: Array | None = None

    def error(self, position: Array, truth: Array) -> float:
        """Return the largest distance of two centrelines (N, 3), in lengths of the cable."""
        if self.turnable:
            position, truth = (np.stack([r[:, 0], np.hypot(r[:, 1], r[:, 2])], axis=1) for r in (position, truth))
        return float(np.max(np.linalg.norm(position - truth, axis=1)))

    def heavy(self, weight: float) -> ho.Cable:
        """Return the cable with a weight w L^3 / B."""
        return dataclasses.replace(self.cable, mass_per_length=weight / G)

    def posed(self) -> boundary.Case:
        """Return the case without dimensions."""
        return boundary.case(self.heavy(self.weight), self.start, self.end, np.array([0.0, 0.0, -G]))

    def easy(self) -> boundary.Case:
        """Return the easier case without dimensions."""
        end, weight = self.easier
        return boundary.case(self.heavy(weight), self.start, end, np.array([0.0, 0.0, -G]))


def _cable(kz: float, **changes: object) -> ho.Cable:
    given = {"length": 1.0, "diameter": 0.01, "bending_stiffness": 1.0, "torsional_stiffness": kz}
    return ho.Cable(**(given | changes))


def elastica(distance: float) -> Benchmark:
    """Love, "A Treatise on the Mathematical Theory of Elasticity", section 263: four quarter waves of modulus k."""
    k = optimize.brentq(
        lambda k: 2 * special.ellipe(k * k) / special.ellipk(k * k) - 1 - distance, 1e-6, 1 - 1e-9, xtol=1e-16
    )
    rate = 4 * special.ellipk(k * k)
    _, cn, _, amplitude = special.ellipj(rate * S, k * k)
    along = (2 * special.ellipeinc(amplitude, k * k) - rate * S) / rate
    truth = np.stack([along, 0 * S, 2 * k / rate * (1 - cn)], axis=1)
    start, end = ho.End((0, 0, 0), ALONG_X), ho.End((distance, 0, 0), ALONG_X)
    wider = ho.End((min(distance + 0.2, 0.97), 0, 0), ALONG_X)
    return Benchmark(f"elastica {distance}", _cable(3.0), start, end, 0.0, (wider, 0.0), (0, 0, 1), truth, True)


def _cantilever(load: float) -> Benchmark:
    """A dead force across the tip; with beta = theta + pi/2, beta'' = -P sin beta: the pendulum's equation."""

    def first(k: float) -> float:
        return float(special.ellipkinc(np.arcsin(1 / (k * np.sqrt(2))), k * k))

    k = optimize.brentq(
        lambda k: special.ellipk(k * k) - first(k) - np.sqrt(load), np.sqrt(0.5) * (1 + 1e-12), 1 - 1e-12, xtol=1e-16
    )

    def parts(u: Array) -> tuple[Array, Array]:
        _, cn, _, amplitude = special.ellipj(u, k * k)
        return cn, 2 * special.ellipeinc(amplitude, k * k) - u

    (cn0, rise0), (cn, rise) = parts(np.array(first(k))), parts(first(k) + np.sqrt(load) * S)
    truth = np.stack([2 * k * (cn0 - cn), 0 * S, rise - rise0], axis=1) / np.sqrt(load)
    start, end = ho.End((0, 0, 0), ALONG_X), ho.End(force=(0, 0, -load))
    return Benchmark(
        f"cantilever P = {load:g}", _cable(3.0), start, end, 0.0, (ho.End(force=(0, 0, -0.5 * load)), 0.0), (0, 0, -1),
        truth,
    )  # fmt: skip


def _wrench(name: str, omega: tuple[float, float, float]) -> Benchmark:
    """A constant Darboux vector: R(s) = R0 exp(omega s), held by a wrench along the helix's axis."""
    rate, kz = float(np.linalg.norm(omega)), 0.7
    axis, e3, s = np.array(omega) / rate, np.array([0, 0, 1.0]), S[:, None]
    along = axis * (axis @ e3)
    local = along * s + (e3 - along) * np.sin(rate * s) / rate + np.cross(axis, e3) * (1 - np.cos(rate * s)) / rate
    frames = rotations.multiply(np.array(ALONG_X), rotations.from_rotation_vector(s * np.array(omega)))
    moment = np.array([1.0, 1.0, kz]) * omega
    turning = np.cross(omega, moment)
    force = -turning[1] / omega[0] * np.array(omega) if omega[0] else np.zeros(3)
    loads = [rotations.rotate(frames[-1], v) for v in (force, moment)]
    end, half = (ho.End(force=tuple(f * loads[0]), moment=tuple(f * loads[1])) for f in (1.0, 0.8))
    truth = rotations.rotate(np.array(ALONG_X), local)
    return Benchmark(name, _cable(kz), ho.End((0, 0, 0), ALONG_X), end, 0.0, (half, 0.0), (0, 0, 1), truth)


def _tabulated(name: str, file: str, path: Callable[[ho.End, ho.End], ho.End], bow: tuple[float, float, float],
               weight: float | None = None, lighter: float | None = None) -> Benchmark:  # fmt: skip
    """Return the case of a reference file, or one like it under another ``weight``, which no file tabulates."""
    given = json.loads((REFERENCE / "cases.json").read_text(encoding="utf-8"))[file]
    table = np.genfromtxt(REFERENCE / f"{file}.csv", delimiter=",", names=True)
    tabulated = np.stack([table[c] for c in "xyz"], axis=1) if weight is None else None
    start, end = (
        ho.End(tuple(pose["position"]), tuple(rotations.normalise(pose["quaternion"]).tolist()))
        for pose in (given["start"], given["end"])
    )
    weight = given["weight_per_length"] if weight is None else weight
    easier = (path(start, end), weight if lighter is None else lighter)
    cable = _cable(given["torsional_stiffness"])
    return Benchmark(name, cable, start, end, weight, easier, bow, None, tabulated=tabulated)


def _spread(start: ho.End, end: ho.End) -> ho.End:
    """Return the end a twentieth of the way from (0.9, 0, 0), parallel to the start: there it might turn freely."""
    wide = boundary.boundary(start, ho.End((0.9, 0, 0), start.quaternion), boundary.Units(1.0, 1.0, 1.0))
    near = wide.blend(boundary.boundary(start, end, boundary.Units(1.0, 1.0, 1.0)), 0.05)
    return ho.End(tuple(near.gap.tolist()), tuple(near.end_quaternion.tolist()))


def _closer(_start: ho.End, end: ho.End) -> ho.End:
    return ho.End((0.6, 0, 0), end.quaternion)  # from wider than 0.87 the cable snaps on the way


def _same(_start: ho.End, end: ho.End) -> ho.End:
    return end


def benchmarks() -> list[Benchmark]:
    """Return all cases."""
    return [
        *(elastica(distance) for distance in (0.9, 0.6, 0.3)),
        _cantilever(5.0),
        _wrench("half circle", (0.0, np.pi, 0.0)),
        _wrench("helix", (4.0, 0.0, 3.0)),
        _tabulated("3-D", "clamped_3d", _spread, (0, 1, 0)),
        _tabulated("3-D, weight 30", "clamped_3d_weight_30", _spread, (0, 1, 0)),
        _tabulated("stiff rig", "twist_rig_080_180deg", _closer, (0, 0, 1)),
        _tabulated("heavy, weight 1e4", "clamped_3d", _same, (0, 0, -1), 1e4, 5e3),
    ]

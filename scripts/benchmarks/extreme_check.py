"""Is a shape what it says it is? A check written from the rod's equations, which knows nothing of the solvers."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

import harness_opt as ho
from harness_opt.errors import Status
from harness_opt.numerics import rotations

Array = np.ndarray
PANELS = 32  # stretches that the balances are first written on
DEEPEST = 30  # halvings of a stretch that does not balance: a jump stays, an error of quadrature goes
MOST_PANELS = 20_000  # halved at once: where more do not balance, nothing does
POSITION = 1e-7  # in L: end pose, and positions against the integral of the tangents
FRAME = 1e-6  # rad: end pose, and frames against the integral of the curvature
LOAD = 1e-6  # of the largest force, or moment: balances and the constitutive law
ESTIMATED = 4.0  # estimated errors are right to this factor: work_precision.py
RESIDUAL = 1e-10  # times sqrt(1 + load + force), dimensionless


def verify(
    cable: ho.Cable,
    start: ho.End,
    end: ho.End,
    gravity: Iterable[float],
    shape: ho.Shape,
    residual: float | None = RESIDUAL,
) -> list[str]:
    """Return what is wrong with a clamped shape: nothing where it is an equilibrium, or says honestly that it is none.

    ``residual`` is what the solver's own may be, or None: overdetermined equations keep one.

    Written from (1), (2), (7) of Liu et al. as integrals over stretches of the cable, from ``shape.at`` alone:
    r = int d3, q = int q (0, omega) / 2, F = -int f, M = -int d3 x F, and M = K (omega - omega_rest).
    """
    if shape.ok != (shape.status is Status.OK):
        return [f"ok is {shape.ok} and status {shape.status.name}"]
    if not shape.ok:
        return ["a refused shape is called stable"] if shape.stable else []
    wrong = []

    def expect(name: str, found: float, most: float) -> None:
        if not found <= most:  # not a number is wrong too
            wrong.append(f"{name}: {found:.2g}, expected at most {most:.2g}")

    length, bending = cable.length, float(np.sqrt(cable.stiffness[0] * cable.stiffness[1]))
    load = cable.mass_per_length * np.asarray(tuple(gravity))
    ends = shape.at(np.array([0.0, length]))
    for k, clamp in enumerate((start, end)):
        expect(f"place of end {k}", np.linalg.norm(ends.position[k] - clamp.position) / length, POSITION)
        turned = rotations.multiply(rotations.conjugate(clamp.quaternion), ends.quaternion[k])
        expect(f"frame of end {k}", 2.0 * np.linalg.norm(turned[1:]), FRAME)
    largest = {
        "force": float(np.max(np.linalg.norm(shape.force, axis=1))) + bending / length**2,
        "moment": float(np.max(np.linalg.norm(shape.moment, axis=1))) + bending / length,
    }
    # in a taut cable d3 x F is the small difference of large numbers: what rounding of F leaves, or an error of the
    # centreline as large as the shape says its own may be
    lever = max(1e-12, ESTIMATED * shape.estimated_error) * length
    limits = np.array(
        [POSITION * length, FRAME, LOAD * largest["force"], LOAD * largest["moment"] + lever * largest["force"]]
    )
    names = ("length and place", "frames", "balance of forces", "balance of moments")
    for name, found, most in zip(names, _balances(cable, load, shape, limits), limits, strict=True):
        expect(name, found, most)
    s = np.linspace(0.0, length, 1001)
    at = shape.at(s)
    expect("unit quaternions", np.max(np.abs(np.linalg.norm(at.quaternion, axis=1) - 1.0)), 1e-9)
    strain = at.curvature - cable.rest_curvature
    moment = rotations.rotate(at.quaternion, strain * cable.stiffness)
    expect("constitutive law", np.max(np.linalg.norm(moment - at.moment, axis=1)), LOAD * largest["moment"])
    scale = (np.linalg.norm(load) * length + largest["force"]) * length**2 / bending
    if residual is not None:
        expect("residual", shape.residual, residual * np.sqrt(1.0 + scale))
    if shape.stable and shape.stability_margin < -1e-5 * (1.0 + scale):
        wrong.append(f"stable with a margin of {shape.stability_margin:.2g}")
    return wrong


def _balances(cable: ho.Cable, load: Array, shape: ho.Shape, limits: Array) -> Array:
    """Return the largest running sums of what does not balance: place, m; frame, rad; force, N; moment, N m."""
    edges = np.linspace(0.0, cable.length, PANELS + 1)
    panels, done = np.stack([edges[:-1], edges[1:]], axis=1), []
    for depth in range(DEEPEST + 1):
        defects = _panel_defects(load, shape, panels)
        sizes = np.stack([np.linalg.norm(d, axis=1) for d in defects], axis=1)
        # a stretch may keep its share of the limits; the last level keeps everything
        good = np.all(sizes <= 0.1 * limits / PANELS, axis=1) | (depth == DEEPEST or len(panels) > MOST_PANELS)
        done.append((panels[good, 0], [d[good] for d in defects]))
        middle = panels[~good].mean(axis=1)
        panels = np.concatenate(
            [np.stack([panels[~good, 0], middle], axis=1), np.stack([middle, panels[~good, 1]], axis=1)]
        )
        if not len(panels):
            break
    order = np.argsort(np.concatenate([first for first, _ in done]))
    sums = [np.cumsum(np.concatenate([d[i] for _, d in done])[order], axis=0) for i in range(4)]
    return np.array([np.max(np.linalg.norm(total, axis=1)) for total in sums])


def _panel_defects(load: Array, shape: ho.Shape, panels: Array) -> list[Array]:
    """Return what does not balance on each stretch (n, 2): places (n, 3), frames (n, 4), forces, moments (n, 3)."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    width = panels[:, 1] - panels[:, 0]
    at = shape.at((panels[:, :1] + width[:, None] * np.concatenate([[0.0], nodes, [1.0]])).ravel())

    def table(values: Array) -> Array:
        return values.reshape(len(panels), len(nodes) + 2, -1)

    def balance(values: Array, rates: Array) -> Array:
        change = table(values)[:, -1] - table(values)[:, 0]
        return change - width[:, None] * np.einsum("g,ngc->nc", weights, table(rates)[:, 1:-1])

    tangent = rotations.tangent(at.quaternion)
    spin = 0.5 * rotations.multiply(at.quaternion, np.pad(at.curvature, ((0, 0), (1, 0))))
    return [
        balance(at.position, tangent),
        2.0 * balance(at.quaternion, spin),
        balance(at.force, np.broadcast_to(-load, at.force.shape)),
        balance(at.moment, -np.cross(tangent, at.force)),
    ]

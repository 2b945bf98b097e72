"""How accurate is the paper's own method, where does it break, and what does it cost beside ours for the same poses?

    python scripts/benchmarks/paper_method.py -o results/paper_method
    python scripts/benchmarks/paper_method.py --quick

First the clamped elastica at an end distance of 0.6 L, which is known exactly: error against the number of points N,
with and without the closure of the length (25); ``elastica.csv`` and, where matplotlib is installed, ``elastica.png``.
Then the paper's rig (``problems/twist_rig``): for poses along its motion, started from the shape one spatial step
before, the differential quadrature by its own Levenberg-Marquardt (26) and by ours, and the collocation; iterations,
largest weighted residual, and distance to the shape of the collocation refined to 1e-9 L; ``rig.csv``. Failures stay.
Ours is one plain solve here; a simulation predicts each shape and halves the steps that are too long.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import mpmath
import numpy as np

import harness_opt as ho
from harness_opt.motion.path import place_frames
from harness_opt.motion.sweep import sweep
from harness_opt.statics.mesh import refine
from harness_opt.statics.paper_pose import Quadrature, solve_by_quadrature
from harness_opt.statics.solve import resample, solve_on

RIG = Path(__file__).resolve().parents[2] / "problems" / "twist_rig" / "twist_rig.toml"
CABLE = "cable"
DISTANCE = 0.6  # of the elastica's ends, in lengths of the cable
POINTS, QUICK_POINTS = (11, 15, 21, 25, 31, 35, 41, 51, 61, 81, 101), (15, 21, 31, 41)
RIG_POINTS, QUICK_RIG_POINTS = (31, 61), (31,)
EVERY, QUICK_EVERY = 6, 26  # of the rig's frames are solved
METHODS = ("paper", "levenberg-marquardt")  # Levenberg-Marquardt as (26) prints it, and with gain control
TOLERANCE = 1e-5  # in lengths of the cable: what a shape by differential quadrature is accepted at
REFERENCE = 1e-9
ALONG_X = (0.5**0.5, 0.0, 0.5**0.5, 0.0)


def elastica(s: np.ndarray) -> np.ndarray:
    """Return the clamped elastica of length 1 at ``s`` (m,), in the plane of x and z; (m, 3).

    Love, "A Treatise on the Mathematical Theory of Elasticity", section 263: four quarter waves of the inflexional
    elastica of modulus k, x = 2 E(am u) - u and z = 2 k (1 - cn u) over F = (4 K)^2, with 2 E / K - 1 the distance.
    """
    k = mpmath.findroot(lambda k: 2 * mpmath.ellipe(k**2) / mpmath.ellipk(k**2) - 1 - DISTANCE, 0.6)
    quarter = mpmath.ellipk(k**2)
    rows = []
    for at in s:
        u = 4 * quarter * mpmath.mpf(float(at))
        phi = mpmath.asin(mpmath.ellipfun("sn", u, m=k**2))
        whole = mpmath.floor(u / (2 * quarter) + mpmath.mpf(1) / 2)  # half waves passed: the amplitude goes on growing
        amplitude = mpmath.pi * whole + (-1) ** int(whole) * phi
        x = (2 * mpmath.ellipe(amplitude, k**2) - u) / (4 * quarter)
        rows.append((float(x), 0.0, float(2 * k * (1 - mpmath.ellipfun("cn", u, m=k**2)) / (4 * quarter))))
    return np.array(rows)


def elastica_rows(points: Iterable[int]) -> list[dict[str, Any]]:
    """Return a row for each number of points, with and without the closure."""
    cable = ho.Cable(1.0, 0.01, 1.0, 3.0)
    start, end = ho.End((0, 0, 0), ALONG_X), ho.End((DISTANCE, 0, 0), ALONG_X)
    truth = elastica(np.linspace(0.0, 1.0, 101))
    rows = []
    for count in points:
        for closure in (False, True):
            begin = time.perf_counter()
            shape = ho.equilibrium(
                cable, start, end, bow=(0, 0, 1), transcription="dqm", points=count, closure=closure, throw=False,
                solver="levenberg-marquardt", tolerance=1e-3,
            )  # fmt: skip
            seconds = time.perf_counter() - begin
            error = float(np.max(np.linalg.norm(shape.position - truth, axis=1)))
            rows.append(
                {"points": count, "closure": closure, "error": error, "residual": shape.residual,
                 "iterations": shape.iterations, "seconds": seconds, "status": shape.status.name.lower()}
            )  # fmt: skip
    return rows


def rig_rows(points: Iterable[int], every: int) -> list[dict[str, Any]]:
    """Return a row for every method and pose of the rig."""
    problem = ho.read_problem(RIG)
    motion = place_frames(problem)
    swept = sweep(problem, CABLE, motion)
    snaps = {frame for frame, _ in swept.snaps}
    rows = []
    for k in range(1, len(swept.frames), every):
        if k in snaps:  # from the shape before, no method comes here: the cable has to be let go
            continue
        before, target = swept.frames[k - 1], swept.frames[k].case
        truth, _, _ = refine(swept.frames[k], REFERENCE, "gauss-newton")
        distance = float(np.linalg.norm(target.boundary.gap))
        begin = time.perf_counter()
        ours = solve_on(target, before.bound.mesh, resample(before.rod, before.bound.mesh), "gauss-newton")
        seconds = time.perf_counter() - begin
        head = {"frame": k, "distance": round(distance, 4)}
        rows.append(
            head | {"method": "collocation", "points": len(ours.rod.mesh), "solver": "gauss-newton",
                    "status": ours.solution.status.name.lower(), "iterations": ours.solution.iterations,
                    "residual": ours.solution.residual, "distance_to_reference": gap(ours.rod, truth.rod),
                    "seconds": seconds}
        )  # fmt: skip
        for count in points:
            for solver in METHODS:
                begin = time.perf_counter()
                answer = solve_by_quadrature(target, before.rod, Quadrature(count, False, solver, TOLERANCE))
                seconds = time.perf_counter() - begin
                rows.append(
                    head | {"method": "dqm", "points": count, "solver": solver,
                            "status": answer.status.name.lower(), "iterations": answer.iterations,
                            "residual": answer.residual, "distance_to_reference": gap(answer.rod, truth.rod),
                            "seconds": seconds}
                )  # fmt: skip
    return rows


def gap(rod: Any, truth: Any) -> float:
    """Return the largest distance of two centrelines at the nodes of the first, in lengths of the cable."""
    return float(np.max(np.linalg.norm(rod.r - truth.sample(rod.mesh).r, axis=1)))


def print_table(rows: list[dict[str, Any]]) -> None:
    """Print ``rows`` in columns."""
    cells = [list(rows[0])] + [[shown(value) for value in row.values()] for row in rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(cells[0]))]
    for row in cells:
        print("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))


def shown(value: Any) -> str:
    """Return a value as the tables have it."""
    return f"{value:.2g}" if isinstance(value, float) else str(value)


def write(file: Path, rows: list[Mapping[str, Any]]) -> None:
    """Write ``rows`` as CSV."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def draw(file: Path, rows: list[dict[str, Any]]) -> None:
    """Draw error against number of points; needs matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        print(f"{file.name} left out: matplotlib is not installed (the extra 'studies').")
        return
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    for closure, label, mark in ((False, "without (25)", "o-"), (True, "with the closure (25)", "s--")):
        kept = [row for row in rows if row["closure"] is closure]
        axes.semilogy([row["points"] for row in kept], [row["error"] for row in kept], mark, label=label)
    axes.set_xlabel("number of points N")
    axes.set_ylabel("largest error of the centreline / L")
    axes.set_title(f"Differential quadrature, clamped elastica at {DISTANCE} L")
    axes.grid(visible=True, alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=150)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/paper_method"))
    parser.add_argument("--quick", action="store_true", help="fewer points and poses")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    rows = elastica_rows(QUICK_POINTS if options.quick else POINTS)
    print_table(rows)
    write(options.output / "elastica.csv", rows)
    draw(options.output / "elastica.png", rows)
    rows = rig_rows(*((QUICK_RIG_POINTS, QUICK_EVERY) if options.quick else (RIG_POINTS, EVERY)))
    print()
    print_table(rows)
    write(options.output / "rig.csv", rows)


if __name__ == "__main__":
    main()

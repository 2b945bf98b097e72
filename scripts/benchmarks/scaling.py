"""How does the time grow with elements, frames, triangles, cables and design variables, and what does leaving out save?

    python scripts/benchmarks/scaling.py -o results/scaling
    python scripts/benchmarks/scaling.py --quick

First part: times against one size at a time, and the exponent of the power law fitted to all but the smallest sizes;
``scaling.csv`` and, where matplotlib is installed, ``scaling.png``. Second part, ``left_out.csv``: for each thing that
a scene may not need, the time with it and without it, for a scene that does not need it. Medians of processor time on
one thread: what else the machine does does not count.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from threadpoolctl import threadpool_limits
from work_precision import Way
from work_precision_cases import benchmarks

import harness_opt as ho
from harness_opt.clearance.measure import measure
from harness_opt.model import design_variables
from harness_opt.motion.shape_rates import shape_rates
from harness_opt.motion.sweep import sweep
from harness_opt.parts.scene import load_scene
from harness_opt.statics.continuation import step
from harness_opt.statics.solve import Solved

Array = np.ndarray
Row = dict[str, Any]
LARGE = 3  # sizes that an exponent is fitted to: below them, what does not grow prevails
GRAVITY = (0.0, 0.0, -9.81)
LEAD = "lead"
LOOK = "quick look"  # of a sweep: no stability, no accuracy


def seconds(action: Callable[[], object], repeats: int) -> float:
    """Return the median time of ``action``, s, after one run that builds what is built once."""
    action()
    times = []
    for _ in range(repeats):
        clock = _processor_time()
        action()
        times.append(_processor_time() - clock)
    return statistics.median(times)


def _processor_time() -> float:
    """Return the processor time of this process and of those it has waited for, s."""
    return time.process_time() + sum(os.times()[2:4])


def scene(*, cables: int = 1, weight: bool = True, stiffness: float | tuple[float, float] = 2.1e-3) -> ho.Problem:
    """Return a cable, or several side by side, between the world and an arm that turns by 60 degrees.

    The ends stand 30 mm aside of each other: in one plane, this cable would leave it half-way.
    """
    cable = ho.Cable(0.3, 6e-3, stiffness, 1.6e-3, 0.15 if weight else 0.0)
    up, across = ((0.5**0.5, 0.0, 0.5**0.5, 0.0), (1.0, 0.0, 0.0, 0.0))
    runs = {
        LEAD + str(k) * (k > 0): ho.CableRun(
            cable, ho.End((0.0, 0.02 * k, 0.1), across), ho.End((0.16, 0.03 + 0.02 * k, 0.12), up, body="arm")
        )
        for k in range(cables)
    }
    arm = ho.Body(ho.Hinge((0.05, 0.0, 0.104), (0.0, -1.0, 0.0), 0.0, np.pi / 3))
    return ho.Problem(runs, {"arm": arm}, gravity=GRAVITY if weight else (0.0, 0.0, 0.0))


def with_ball(problem: ho.Problem, triangles: int, folder: Path) -> tuple[ho.Problem, int]:
    """Return the problem with a ball near the cable as a mesh of at least so many triangles, and how many it has."""
    level = next(k for k in range(9) if 20 * 4**k >= triangles)
    ball = trimesh.creation.icosphere(subdivisions=level, radius=20.0)
    file = folder / f"ball_{level}.stl"
    ball.export(file)
    part = ho.Part(ho.MeshFile(file, "mm"), position=(0.09, 0.055, 0.2))
    limits = dataclasses.replace(problem.limits, clearance=None)
    return dataclasses.replace(problem, parts={"ball": dataclasses.replace(part, clearance=0.002)}, limits=limits), len(
        ball.faces
    )


# --- sizes ------------------------------------------------------------------------------------------------


def elements(sizes: list[int], repeats: int) -> Mapping[int, float]:
    """Return the time of a warm frame of the 3-D case with weight."""
    way = Way(next(b for b in benchmarks() if b.name == "3-D, weight 30"), 50)

    def walk(begin: Solved) -> None:
        here, before = begin, None
        for case in way.cases[1:]:
            found = step(case, here, before, 1.0, "gauss-newton")
            if found is None:
                raise RuntimeError("a step was too long")
            here, before = found, here

    return {n: seconds(lambda n=n: walk(way.on(n)), repeats) / 50 for n in sizes}


def frames(sizes: list[int], repeats: int) -> Mapping[int, float]:
    """Return the time of a whole simulation, stability and accuracy checked."""
    problem = scene()
    return {n: seconds(lambda n=n: ho.simulate(problem, frames=np.linspace(0, 1, n)), repeats) for n in sizes}


def triangles(sizes: list[int], repeats: int) -> Mapping[int, float]:
    """Return the time of the certified clearance of one frame out of 100 to a mesh."""
    motion = ho.simulate(scene(), frames=np.linspace(0, 1, 100))
    times = {}
    with tempfile.TemporaryDirectory() as folder:
        for size in sizes:
            problem, count = with_ball(scene(), size, Path(folder))
            geometry = load_scene(problem)

            def query(problem: ho.Problem = problem, geometry: Any = geometry) -> None:
                found = measure(problem, geometry, motion.motion, motion.cables)
                if not found.pairs[0].certified_along_arc:
                    raise RuntimeError("not certified")

            times[count] = seconds(query, repeats) / 100
    return times


def cables(sizes: list[int], repeats: int) -> Mapping[int, float]:
    """Return the time of a simulation of so many cables over 50 frames."""
    return {n: seconds(lambda n=n: ho.simulate(scene(cables=n), frames=np.linspace(0, 1, 50)), repeats) for n in sizes}


def variables(sizes: list[int], repeats: int) -> Mapping[int, float]:
    """Return the time of all derivatives of 50 solved frames by so many design variables."""
    ends = [f"lead.{end}.{part}" for end in ("start", "end") for part in
            ("position.x", "position.y", "position.z", "rotate_x_deg", "rotate_y_deg", "rotate_z_deg")]  # fmt: skip
    motion, times = np.linspace(0, 1, 50), {}
    swept = sweep(scene(), LEAD, motion, rigour="stable")
    for n in sizes:
        chosen = tuple(ho.Variable(name, -1.0, 1.0) for name in ends[:n])
        problem = dataclasses.replace(scene(), design=ho.Design(variables=chosen))
        clamps = design_variables.clamp_rates(problem, LEAD, design_variables.values(problem), motion)
        times[n] = seconds(lambda clamps=clamps: shape_rates(swept, clamps, np.linspace(0, 1, 101)), repeats)
    return times


STUDIES: dict[str, tuple[Callable[[list[int], int], Mapping[int, float]], list[int], list[int]]] = {
    "elements": (elements, [4, 8, 16, 32, 64, 128], [4, 8, 16]),
    "frames": (frames, [25, 50, 100, 200, 400, 800], [25, 50, 100]),
    "triangles": (triangles, [1000, 5000, 20000, 80000, 300000], [1000, 20000]),
    "cables": (cables, [1, 2, 4, 8], [1, 2]),
    "design variables": (variables, [1, 2, 4, 8, 12], [1, 4]),
}


def exponent(times: Mapping[int, float]) -> float:
    """Return the exponent of the power law through the largest sizes."""
    sizes, values = (np.log(list(v)[-LARGE:]) for v in (times.keys(), times.values()))
    return float(np.polyfit(sizes, values, 1)[0])


# --- what is left out -------------------------------------------------------------------------------------


def ablation(repeats: int) -> list[Row]:
    """Return a row for each thing that a scene may not need: ms of its own with it, and without it."""
    motion, heavy = np.linspace(0.0, 1.0, 100), scene()
    solved = ho.simulate(heavy, frames=motion)
    simulated = 1e3 * seconds(lambda: ho.simulate(heavy, frames=motion), repeats)
    near = dataclasses.replace(heavy, limits=dataclasses.replace(heavy.limits, clearance=0.002))

    def measured(problem: ho.Problem, *, certified: bool = True) -> float:
        geometry, given = load_scene(problem), dataclasses.replace(solved, problem=problem)
        if certified:
            return 1e3 * seconds(lambda: ho.clearances(given, geometry), repeats)
        return 1e3 * seconds(lambda: measure(problem, geometry, motion, solved.cables), repeats)

    def checked(problem: ho.Problem) -> float:
        return 1e3 * seconds(lambda: ho.clearances(ho.simulate(problem, frames=motion)), repeats)

    with tempfile.TemporaryDirectory() as folder:
        still = with_ball(heavy, 20_000, Path(folder))[0]
        carried = dataclasses.replace(still, parts={"ball": dataclasses.replace(still.parts["ball"], body="arm")})
        frames_alone = measured(still, certified=False)
        to_still, to_carried = (simulated + measured(problem) for problem in (still, carried))
    two = dataclasses.replace(scene(cables=2), limits=near.limits)
    of = "100 frames simulated"
    rows = [
        ("a mesh (20,000 triangles), in the frames", simulated + frames_alone, simulated, of),
        ("certified between the frames too", to_still, simulated + frames_alone, of),
        ("the mesh moves", to_carried, to_still, of),
        ("clearance to itself, certified", simulated + measured(near), simulated, of),
        ("a second cable, and the clearance between both", checked(two), checked(near), of),
        *_of_the_shapes(motion, repeats),
    ]
    found = [{"what": what, "with": with_it, "without": without, "of": why} for what, with_it, without, why in rows]
    return [*found, *processes(repeats)]


def _of_the_shapes(motion: Array, repeats: int) -> list[tuple[str, float, float, str]]:
    """Return the rows of what solving the shapes may leave out."""
    light, heavy = scene(weight=False), scene()
    tiny = dataclasses.replace(light, gravity=(0.0, 0.0, -1e-9), cables={
        name: dataclasses.replace(run, cable=dataclasses.replace(run.cable, mass_per_length=1e-9))
        for name, run in light.cables.items()
    })  # fmt: skip
    flat = scene(stiffness=(2.1e-3, 2.1e-3 * (1 + 1e-9)))

    def timed(problem: ho.Problem, rigour: str) -> float:
        return 1e3 * seconds(lambda: sweep(problem, LEAD, motion, rigour=rigour), repeats)

    full, stable, look = (timed(heavy, rigour) for rigour in ("full", "stable", LOOK))
    return [
        ("weight", timed(tiny, LOOK), timed(light, LOOK), "100 frames solved"),
        ("unequal bending stiffness", timed(flat, LOOK), look, "100 frames solved"),
        ("accuracy and stability checked", stable, look, "100 frames; never left out of a result"),
        ("stability margins", full, stable, "100 frames; left out by redesign"),
    ]


def processes(repeats: int) -> list[Row]:
    """Return what imports cost that a run may not need, as whole processes."""

    def run(code: str) -> float:
        return 1e3 * seconds(lambda: subprocess.run([sys.executable, "-c", code], check=True), repeats)

    rooms = "import harness_opt.motion.simulate, harness_opt.report.summary"
    solver = run(rooms)
    return [
        {"what": name, "with": run(f"{rooms}, {room}"), "without": solver, "of": "a process's imports"}
        for name, room in (
            ("distances to meshes (coal)", "coal"), ("meshes as text, OBJ, PLY (trimesh)", "trimesh"),
            ("pictures (pyvista)", "pyvista"),
        )
    ]  # fmt: skip


def planar_share(repeats: int) -> str:
    """Return what a planar reduction could save at most: all that solving the shapes takes."""
    motion = np.linspace(0.0, 1.0, 100)
    solving = seconds(lambda: sweep(scene(), LEAD, motion, rigour=LOOK), repeats)
    whole = seconds(lambda: ho.simulate(scene(), frames=motion), repeats)
    return (
        f"Third dimension: solving 100 shapes takes {1e3 * solving:.0f} of {1e3 * whole:.0f} ms of their simulation, "
        "which is all that a planar reduction could save a part of."
    )


# --- output -----------------------------------------------------------------------------------------------


def write(file: Path, rows: list[Row]) -> None:
    """Write ``rows`` as CSV."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, list(rows[0]))
        table.writeheader()
        table.writerows(rows)


def draw(file: Path, found: Mapping[str, Mapping[int, float]]) -> None:
    """Draw times against sizes; needs matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        print(f"{file.name} left out: matplotlib is not installed (the extra 'studies').")
        return
    figure = Figure(figsize=(11.0, 2.6), layout="constrained")
    for axes, (name, times) in zip(figure.subplots(1, len(found)), found.items(), strict=True):
        axes.loglog(list(times), [1e3 * t for t in times.values()], "o-")
        axes.set_xlabel(name)
        axes.set_title(f"exponent {exponent(times):.2f}", fontsize=9)
        axes.grid(visible=True, alpha=0.3)
    figure.axes[0].set_ylabel("ms")
    figure.savefig(file, dpi=130)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/scaling"))
    parser.add_argument("--quick", action="store_true", help="fewer sizes and repeats")
    parser.add_argument("--left-out", action="store_true", help="the second part alone")
    options = parser.parse_args()
    repeats = 2 if options.quick else 5
    options.output.mkdir(parents=True, exist_ok=True)
    found: dict[str, Mapping[int, float]] = {}
    with threadpool_limits(1):
        for name, (study, sizes, few) in ({} if options.left_out else STUDIES).items():
            found[name] = study(few if options.quick else sizes, repeats)
            values = ", ".join(f"{size}: {1e3 * t:.3g}" for size, t in found[name].items())
            print(f"{name}: exponent {exponent(found[name]):.2f} (ms at {values})", flush=True)
        rows = ablation(repeats)
        print("| not needed | with | without | of |\n|---|---|---|---|")
        for row in rows:
            print(f"| {row['what']} | {row['with']:.0f} ms | {row['without']:.0f} ms | {row['of']} |")
        print(planar_share(repeats))
    sizes = [{"size": name, "count": n, "seconds": t} for name, times in found.items() for n, t in times.items()]
    write(options.output / "left_out.csv", rows)
    if sizes:
        write(options.output / "scaling.csv", sizes)
        draw(options.output / "scaling.png", found)


if __name__ == "__main__":
    main()

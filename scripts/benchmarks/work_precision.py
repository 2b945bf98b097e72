"""How large an error does how much time buy, for every transcription, solver and resolution, and for the peers?

    python scripts/benchmarks/work_precision.py -o results/work_precision
    python scripts/benchmarks/work_precision.py --quick

Each case of ``work_precision_cases.py`` is solved cold, from its clamps alone to a certified shape, and warm, as the
last of 100 frames that lead to it from an easier case: there the solve alone is timed, with every shape predicted from
those before. ``solve_bvp`` (``bvp_peer.py``) goes the same way from the same first shape, and so do the last frames of
Exudyn, PyElastica and MuJoCo's cable, whichever are installed (the extra ``peers``; ``*_peer.py`` say how they are set
up). The error is the largest distance of the centreline from the exact one, or from a reference that another method
solved. Times are medians of processor time on one thread: what else the machine does does not count; of those peers
the wall's time is there too. Rows "compiled" are those of :func:`harness_opt.compiled`. Failures stay as rows, and so
does what takes longer than a minute; finer ones of its kind are left out then.

``rows.csv`` has all of it; a figure a case shows error against time; the tables that end the output are the README's.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import dataclasses
import importlib
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from bvp_peer import Peer
from threadpoolctl import threadpool_limits
from time_limit import OutOfTimeError, time_limit
from work_precision_cases import TABULATED, Benchmark, G, S, benchmarks
from work_precision_report import COMPILED, OURS, draw, misjudged, peer_table, table

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.numerics.interface import Options
from harness_opt.rod.boundary import Case
from harness_opt.rod.differential_quadrature import Dqm
from harness_opt.statics.continuation import follow, step
from harness_opt.statics.mesh import refine
from harness_opt.statics.solve import SOLVER_OF, Solved, error_estimate, resample, solve_on

Array = np.ndarray
Row = dict[str, Any]
GAUSS_NEWTON = "gauss-newton"
SOLVER_NAMES = (GAUSS_NEWTON, "levenberg-marquardt", "ipopt")
FRAMES = 100  # that a motion is cut into
SOME, FEW = 30, 10  # of them that solve_bvp, and that slower solvers are timed on: the last ones
AGREE = 1e-9  # L, of references and tables
SHARP = 1e-11  # L: below, references and rounding are what is measured
RANDOM_CASES, SEED = 200, 20240611
LONG = 1.0  # s, after which nothing is repeated
TOO_LONG = 60.0  # s by the wall's clock, after which a row of ours is given up
LONG_OTHERS = 8.0  # s, after which a peer is given no finer resolution
OTHERS = ("exudyn_peer", "elastica_peer", "mujoco_peer")  # modules of peers that need the extra
OTHERS_FRAMES = {"exudyn_peer": FEW}  # that a peer goes through; others, whose frames take seconds, through LAST
LAST = 2


@dataclasses.dataclass(frozen=True)
class Extent:
    """How much of the study is run.

    Args:
        cases: names; empty for all.
        frames: of the motion's last, that are timed.
        elements, points: resolutions of the collocation and of the differential quadrature.
        meshes: (nodes, tolerance) of ``solve_bvp``.
        tolerances: of cold starts.
        repeats: of each timing.
        random: number of random cold cases.
        slow: whether solvers other than Gauss-Newton start cold too.
        solvers, transcriptions: names.
        others: modules of peers, beside ``solve_bvp``.
    """

    cases: tuple[str, ...] = ()
    frames: int = FRAMES
    elements: tuple[int, ...] = (3, 4, 5, 6, 8, 12, 16, 24, 32, 48, 64, 96)
    points: tuple[int, ...] = (11, 15, 21, 31, 41)
    meshes: tuple[tuple[int, float], ...] = (
        (7, 1e-1), (9, 1e-2), (13, 1e-2), (13, 1e-3), (17, 1e-3), (17, 1e-4), (25, 1e-4), (25, 1e-5), (33, 1e-5),
        (33, 1e-6), (49, 1e-6), (65, 1e-7), (97, 1e-8),
    )  # fmt: skip
    tolerances: tuple[float, ...] = (1e-3, 1e-5, 1e-7, 1e-9)
    repeats: int = 5
    random: int = RANDOM_CASES
    slow: bool = True
    solvers: tuple[str, ...] = SOLVER_NAMES
    transcriptions: tuple[str, ...] = ("collocation", "dqm")
    others: tuple[str, ...] = OTHERS


QUICK = Extent(
    cases=("elastica 0.6", "cantilever P = 5", "3-D, weight 30"), frames=20, elements=(4, 6, 8, 12), points=(21,),
    meshes=((9, 1e-2), (17, 1e-3), (33, 1e-6)), tolerances=(1e-5, 1e-9), repeats=2, random=20, slow=False, others=(),
)  # fmt: skip


# --- the way to a case ------------------------------------------------------------------------------------


class Way:
    """The motion that leads from the easier case, solved on one mesh, to the case itself.

    Args:
        benchmark: the case.
        frames: timed ones, the last of FRAMES.
    """

    def __init__(self, benchmark: Benchmark, frames: int):
        end, weight = benchmark.easier
        gravity = (0.0, 0.0, -G)
        first = ho.equilibrium(
            benchmark.heavy(weight), benchmark.start, end, gravity, bow=benchmark.bow, tolerance=1e-6
        )
        easy = benchmark.easy().signed_like(first.rod.q[0], first.rod.q[-1])
        hard = benchmark.posed().signed_like(easy.boundary.start_quaternion, easy.boundary.end_quaternion)
        begin, reached = 1.0 - frames / FRAMES, 0.0
        here = solve_on(easy, first.rod.mesh, resample(first.rod, first.rod.mesh), GAUSS_NEWTON)
        if begin > 0.0:
            here, reached = follow(lambda t: easy.blend(hard, t), here, 0.0, begin, GAUSS_NEWTON)
        if reached != begin:
            raise RuntimeError(f"{benchmark.name}: the way to it is lost at {reached:.3f}")
        self.begin = refine(here, 1e-8, GAUSS_NEWTON)[0]
        self.cases = [easy.blend(hard, t) for t in np.linspace(begin, 1.0, frames + 1)]
        self.benchmark = benchmark
        self.truth = benchmark.truth if benchmark.truth is not None else self._reference()

    def near(self, left: int) -> Solved:
        """Return the frame with ``left`` more to come, on the mesh of the first."""
        here, _ = follow(self._path, self.begin, 0.0, 1.0 - left / (len(self.cases) - 1), GAUSS_NEWTON)
        return here

    def on(self, elements: int, left: int | None = None) -> Solved:
        """Return the first frame, or that with ``left`` more to come, on a mesh of ``elements``."""
        mesh, here = np.linspace(0.0, 1.0, elements + 1), self.begin if left is None else self.near(left)
        return solve_on(here.case, mesh, resample(here.rod, mesh), GAUSS_NEWTON)

    def last(self) -> Solved:
        """Return the case solved on the mesh of the first frame."""
        here, _ = follow(self._path, self.begin, 0.0, 1.0, GAUSS_NEWTON)
        return refine(here, 1e-9, GAUSS_NEWTON)[0]

    def _path(self, t: float) -> Case:
        return self.cases[0].blend(self.cases[-1], t)

    def _reference(self) -> Array:
        """Return the shape by ``solve_bvp`` to the tightest tolerance it holds, from ours; what is tabulated agrees."""
        rod = self.last().rod
        mesh = np.unique(np.concatenate([rod.mesh, np.linspace(0.0, 1.0, 801)]))
        at = rod.sample(mesh)
        found = Peer(self.cases[-1]).solve(mesh, np.concatenate([at.q.T, at.moment.T, at.r.T]), at.force[0], 1e-9)
        truth, known = found.sol(S)[7:].T, self.benchmark.tabulated
        if known is not None and not self.benchmark.error(truth[::TABULATED], known) < AGREE:
            raise RuntimeError(f"{self.benchmark.name}: another shape than the reference")
        return truth


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a solve ended: positions at S or None, a word, and the error it estimates itself, in L."""

    position: Array | None
    status: str = "ok"
    estimate: float = np.nan


def row(
    way: Way, method: str, resolution: float, start: str, seconds: list[float], outcome: Outcome,
    wall: list[float] | None = None,
) -> Row:  # fmt: skip
    """Return one row of the study; times are in s, those of the ``wall`` only where they were taken."""
    known = outcome.position is not None
    return {
        "case": way.benchmark.name,
        "method": method,
        "resolution": resolution,
        "start": start,
        "milliseconds": 1e3 * statistics.median(seconds) if seconds else np.nan,
        "wall_milliseconds": 1e3 * statistics.median(wall) if wall else np.nan,
        "error": way.benchmark.error(outcome.position, way.truth) if known else np.nan,
        "estimated_error": outcome.estimate,
        "status": outcome.status,
    }


# --- a limit for each row -----------------------------------------------------------------------------


def limited(
    way: Way, method: str, resolution: float, start: str, work: Callable[[list[float]], Outcome]
) -> tuple[Row, bool]:
    """Return the row of ``work``, which adds its times to a list, and whether it was given up for taking too long."""
    seconds: list[float] = []
    try:
        with time_limit(TOO_LONG):
            outcome = work(seconds)
    except OutOfTimeError:
        return row(way, method, resolution, start, [], Outcome(None, f"longer than {TOO_LONG:g} s")), True
    return row(way, method, resolution, start, seconds, outcome), False


# --- ours -------------------------------------------------------------------------------------------------


def warm_collocation(way: Way, extent: Extent) -> Iterator[Row]:
    """Follow the motion on meshes of so many elements by each solver; time a frame."""
    for solver in extent.solvers:
        for elements in extent.elements:

            def work(seconds: list[float], solver: str = solver, elements: int = elements) -> Outcome:
                return _followed(way, extent, solver, elements, seconds)

            done, given_up = limited(way, f"collocation, {solver}", elements, "warm", work)
            yield done
            if given_up or done["error"] < SHARP:  # finer meshes take longer yet, or show nothing more
                break


def _followed(way: Way, extent: Extent, solver: str, elements: int, seconds: list[float]) -> Outcome:
    """Follow the motion on a mesh of ``elements``, a few of its frames where the solver is slow."""
    fast = solver == GAUSS_NEWTON
    repeats, left = (extent.repeats, extent.frames) if fast else (1, FEW)
    begin = way.on(elements, None if fast else left)
    if not begin.ok:
        return Outcome(None, "no first shape")
    for _ in range(repeats):
        here, before = begin, None
        for case in way.cases[-left:]:
            clock = time.process_time()
            found = step(case, here, before, 1.0, solver)
            seconds.append(time.process_time() - clock)
            if found is None:
                return Outcome(None, "step too long")
            here, before = found, here
    return Outcome(here.rod.sample(S).r, estimate=error_estimate(here)[0])


def warm_quadrature(way: Way, extent: Extent) -> Iterator[Row]:
    """Solve the last frame by the paper's transcription from the exact shape of the one before."""
    before = way.near(1).rod
    for solver in (*SOLVER_NAMES, "paper"):
        for points in extent.points:

            def work(seconds: list[float], solver: str = solver, points: int = points) -> Outcome:
                method = Dqm(way.cases[-1], points, False)
                at = before.sample(method.rule.nodes)
                clock = time.process_time()
                options = Options(iterations=200, stationary=True)
                solution = SOLVER_OF[solver](method.least_squares(), method.pack(at.q, at.force), options)
                seconds.append(time.process_time() - clock)
                position = method.centreline(solution.x, S) if solution.status.ok else None
                return Outcome(position, "ok" if solution.status.ok else solution.status.name.lower())

            done, given_up = limited(way, f"dqm, {solver}", points, "warm", work)
            yield done
            if given_up or done["milliseconds"] > 1e3 * LONG:  # the next one takes longer yet
                break


def cold(way: Way, extent: Extent) -> Iterator[Row]:
    """Find the case's shape from its clamps alone, certified: stable or not is known, its error estimated."""
    for transcription in extent.transcriptions:
        for solver in extent.solvers:
            if solver != GAUSS_NEWTON and not extent.slow:
                continue
            for tolerance in extent.tolerances:
                if transcription == "dqm" and tolerance < 1e-5:  # more points than it can have
                    continue
                options = {"transcription": transcription, "solver": solver, "tolerance": tolerance}

                def work(seconds: list[float], options: dict[str, Any] = options) -> Outcome:
                    return _cold(way, extent.repeats, options, seconds)

                done, given_up = limited(way, f"{transcription}, {solver}", tolerance, "cold", work)
                yield done
                if given_up:
                    break


def _cold(way: Way, repeats: int, options: dict[str, Any], seconds: list[float]) -> Outcome:
    b = way.benchmark
    for _ in range(repeats):
        if sum(seconds) > LONG:
            break
        clock = time.process_time()
        shape = ho.equilibrium(b.heavy(b.weight), b.start, b.end, (0, 0, -G), bow=b.bow, throw=False, **options)
        seconds.append(time.process_time() - clock)
    position = shape.rod.sample(S).r if shape.ok else None
    return Outcome(position, "ok" if shape.ok else shape.status.name.lower(), shape.estimated_error)


# --- the peer ---------------------------------------------------------------------------------------------


def warm_bvp(way: Way, extent: Extent) -> Iterator[Row]:
    """Follow the motion by ``solve_bvp`` with a secant guess, from the exact shape of a frame."""
    left = min(SOME, extent.frames)
    begin = way.near(left).rod
    for nodes, tolerance in extent.meshes:
        mesh, seconds, status = np.linspace(0.0, 1.0, nodes), [], "ok"
        at = begin.sample(mesh)
        here, before = (np.concatenate([at.q.T, at.moment.T, at.r.T]), at.force[0]), None
        found = None
        for case in way.cases[-left:]:
            guess = here if before is None else tuple(2 * a - b for a, b in zip(here, before, strict=True))
            clock = time.process_time()
            found = Peer(case).solve(mesh, *guess, tolerance)
            seconds.append(time.process_time() - clock)
            if found.status != 0:
                status = found.message
                break
            here, before = (found.sol(mesh), found.p), here
        position = found.sol(S)[7:].T if status == "ok" else None
        yield row(way, "solve_bvp", tolerance, f"warm {nodes} nodes", seconds, Outcome(position, status))


def cold_bvp(way: Way, extent: Extent) -> Iterator[Row]:
    """Solve the case by ``solve_bvp`` from the curve that our own cold start begins with."""
    from harness_opt.statics.starting_curve import starting_curve

    case = way.cases[-1]
    for tolerance in extent.tolerances:
        r, q = starting_curve(case.boundary, 33, 0, np.array(way.benchmark.bow, dtype=float))
        signed = case.signed_like(q[0], q[-1])
        guess = np.concatenate([q.T, np.zeros((3, 33)), r.T])
        clock = time.process_time()
        found = Peer(signed).solve(np.linspace(0.0, 1.0, 33), guess, np.zeros(3), tolerance)
        seconds = time.process_time() - clock
        position = found.sol(S)[7:].T if found.status == 0 else None
        status = "ok" if found.status == 0 else found.message
        yield row(way, "solve_bvp", tolerance, "cold", [seconds], Outcome(position, status))


def warm_others(way: Way, extent: Extent) -> Iterator[Row]:
    """Go through the last frames of the motion with every other peer that is installed."""
    for module in extent.others:
        try:
            peer = importlib.import_module(module)
        except ImportError as error:
            print(f"Left out: {module} ({error}; the extra 'peers')")
            continue
        left = OTHERS_FRAMES.get(module, LAST)
        begin = way.near(left).rod
        for resolution in peer.RESOLUTIONS:
            seconds, wall, status = [], [], "ok"
            motion = peer.Peer(begin, way.cases[-left - 1], resolution)
            for case in way.cases[-left:]:
                clock, wall_clock = time.process_time(), time.perf_counter()
                status = motion.frame(case)
                seconds.append(time.process_time() - clock)
                wall.append(time.perf_counter() - wall_clock)
                if status != "ok":
                    break
            position = motion.position() if status == "ok" else None
            yield row(way, peer.NAME, resolution, "warm", seconds, Outcome(position, status), wall)
            if sum(seconds) > LONG_OTHERS:  # the next one takes longer yet
                break


def compiled(way: Way, extent: Extent) -> Iterator[Row]:
    """Do what Gauss-Newton does by collocation again, by machine code, where there is a C compiler."""
    fewer = dataclasses.replace(extent, solvers=(GAUSS_NEWTON,), transcriptions=("collocation",))
    try:
        with ho.compiled():
            for part in (warm_collocation, cold):
                yield from (found | {"method": COMPILED} for found in part(way, fewer))
    except ho.CompilerError as error:
        print(f"Left out: machine code ({error})")


# --- random clamps ----------------------------------------------------------------------------------------


def random_cold(count: int) -> Row:
    """Return the median time from random clamps alone to a certified shape at 1e-6 of the length."""
    rng, seconds, solved = np.random.default_rng(SEED), [], 0
    for k in range(count + 1):
        gap = rotations.normalise(rng.normal(size=3)) * rng.uniform(0.05, 0.95)
        q = rotations.normalise(rng.normal(size=(2, 4)))
        weight = 0.0 if k % 2 else float(10 ** rng.uniform(0, 3))
        cable = ho.Cable(1.0, 0.01, 1.0, float(10 ** rng.uniform(-1.3, 1.3)), weight / G)
        clock = time.process_time()
        shape = ho.equilibrium(
            cable, ho.End((0, 0, 0), tuple(q[0])), ho.End(tuple(gap), tuple(q[1])), (0, 0, -G), tolerance=1e-6,
            throw=False,
        )  # fmt: skip
        if k:  # the first one builds the functions
            seconds.append(time.process_time() - clock)
            solved += shape.ok and shape.stable
    return {
        "case": "random clamps", "method": OURS, "resolution": 1e-6, "start": "cold",
        "milliseconds": 1e3 * statistics.median(seconds), "wall_milliseconds": np.nan, "error": np.nan,
        "estimated_error": np.nan,
        "status": f"{solved} of {count} stable and certified; slowest tenth above "
        f"{1e3 * np.quantile(seconds, 0.9):.0f} ms",
    }  # fmt: skip


# --- all of it -------------------------------------------------------------------------------------------


def main() -> int:
    """Run the study; return 1 where an estimated error is far too small."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/work_precision"))
    parser.add_argument("--quick", action="store_true", help="three cases, fewer resolutions; under two minutes")
    parser.add_argument("--case", action="append", default=[], help="only this one; may be given again")
    options = parser.parse_args()
    extent = QUICK if options.quick else Extent()
    names = tuple(options.case) or extent.cases
    options.output.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    parts: list[Callable[[Way, Extent], Iterator[Row]]] = [
        warm_collocation, warm_quadrature, cold, compiled, warm_bvp, cold_bvp, warm_others,
    ]  # fmt: skip
    with threadpool_limits(1):
        for benchmark in benchmarks():
            if names and benchmark.name not in names:
                continue
            way = Way(benchmark, extent.frames)
            for part in parts:
                for found in part(way, extent):
                    rows.append(found)
                    print("  ".join(f"{v:.2g}" if isinstance(v, float) else str(v) for v in found.values()), flush=True)
        rows.append(random_cold(extent.random))
        with contextlib.suppress(ho.CompilerError), ho.compiled():
            rows.append(random_cold(extent.random) | {"method": COMPILED})
    with (options.output / "rows.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    draw(options.output, rows)
    print("\n" + table(rows))
    if extent.others:
        print("\n" + peer_table(rows))
    for found in rows:
        if found["case"] == "random clamps":
            print(f"\n{found['case']}, {found['method']}: {found['milliseconds']:.1f} ms, {found['status']}")
    low, high = misjudged(rows)
    for words, wrong in (("small", low), ("large", high)):
        for r in wrong:
            print(f"Estimate too {words}: {r['case']}, {r['method']}, {r['resolution']:g}, {r['start']}: "
                  f"{r['estimated_error']:.1e} for {r['error']:.1e}")  # fmt: skip
    return 1 if low else 0


if __name__ == "__main__":
    raise SystemExit(main())

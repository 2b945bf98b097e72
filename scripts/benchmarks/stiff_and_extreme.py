"""Which stiff and extreme cables does a cold start find a certified, stable shape for, by which method, how well?

    python scripts/benchmarks/stiff_and_extreme.py -o results/extreme --jobs 2
    python scripts/benchmarks/stiff_and_extreme.py --quick
    python scripts/benchmarks/stiff_and_extreme.py --seed 1 --case 17

Two parts. A grid sweeps each axis over its whole range about one ordinary cable (kz/kx, kx/ky, weight, end distance,
turns, length, clamps) and two pairs of axes together, by every transcription and solver. Random cases draw from all
ranges at once, by collocation and Gauss-Newton (``extreme_cases.py``). Every shape called ``ok`` is checked by
``extreme_check.py``, which knows the rod's equations and nothing of the solvers. Times are processor times. Failures
stay as rows of ``grid.csv`` and ``random.csv``; a table of shares and medians goes to the terminal, and heat maps to
the folder where matplotlib is installed.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import math
import multiprocessing
import signal
import sys
import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path

import numpy as np
from extreme_cases import AXES, BASE, PAIRS, SEED, Case, grid, numbered_case, varied
from extreme_check import RESIDUAL, verify

import harness_opt as ho
from harness_opt.errors import Status
from harness_opt.rod.boundary import CLAMPED
from harness_opt.rod.stability import stability

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

Array = np.ndarray
LIMIT = 60.0  # s of the processor, of one case; what takes longer is killed and stays as the row "timeout"
TRANSCRIPTIONS = ("collocation", "dqm")
SOLVERS = ("gauss-newton", "levenberg-marquardt", "ipopt")
METHODS = tuple((transcription, solver) for transcription in TRANSCRIPTIONS for solver in SOLVERS)


# --- one row --------------------------------------------------------------------------------------------

REFINED = (1e-12, 1e-11)  # tolerances of the solve that an error is measured against: the first that is reached
TIMEOUT, CRASHED = "timeout", "crashed"
CONTACT = "contact"  # every shape found had lost turns by going through itself


@dataclasses.dataclass(frozen=True)
class Row:
    """How one case ended by one method; ``error`` is the distance to a refined solve, in L."""

    case: Case
    transcription: str
    solver: str
    status: str
    seconds: float
    iterations: int = 0
    residual: float = np.nan
    estimated_error: float = np.nan
    error: float = np.nan
    stable: bool = False
    margin: float = np.nan
    index: int = -1
    complaints: str = ""

    @property
    def outcome(self) -> str:
        """One of OUTCOMES."""
        if self.status in (TIMEOUT, CRASHED):
            return self.status
        if self.status == Status.NOT_WITHOUT_CONTACT.name:
            return CONTACT
        if self.status != Status.OK.name:
            return "refused"
        if self.complaints:
            return "rejected"
        return "stable" if self.stable else "unstable"


OUTCOMES = ("stable", "unstable", CONTACT, "refused", TIMEOUT, "rejected", CRASHED)


def solve(case: Case, transcription: str, solver: str, *, compare: bool = True) -> Row:
    """Solve one case by one method, check the shape, and measure it against a refined solve where ``compare``."""
    cable, start, end, gravity = case.posed()
    begin = time.process_time()
    try:
        shape = ho.equilibrium(
            cable, start, end, gravity, transcription=transcription, solver=solver, throw=False
        )  # fmt: skip
    except Exception as error:  # a crash is a result of this study, and the worst one
        message = f"{type(error).__name__}: {error}".splitlines()[0]
        return Row(case, transcription, solver, CRASHED, time.process_time() - begin, complaints=message)
    seconds = time.process_time() - begin
    residual = None if transcription == "dqm" else RESIDUAL
    complaints = "; ".join(verify(cable, start, end, gravity, shape, residual))
    return Row(
        case,
        transcription,
        solver,
        shape.status.name,
        seconds,
        shape.iterations,
        shape.residual,
        shape.estimated_error,
        _error(case, shape) if shape.ok and compare else np.nan,
        shape.stable,
        shape.stability_margin,
        int(stability(shape.rod, CLAMPED).index) if shape.ok else -1,
        complaints,
    )


def _error(case: Case, shape: ho.Shape) -> float:
    """Return the distance, in L, to the shape that a much tighter tolerance leads to; nan where it leads to none."""
    cable, start, end, gravity = case.posed()
    for tolerance in REFINED:
        finer = ho.equilibrium(cable, start, end, gravity, tolerance=tolerance, guess=shape, throw=False)
        if finer.ok:
            s = np.linspace(0.0, cable.length, 401)
            apart = shape.at(s).position - finer.at(s).position
            return float(np.max(np.linalg.norm(apart, axis=1))) / cable.length
    return np.nan


# --- many rows ------------------------------------------------------------------------------------------

Job = tuple[Case, str, str]


def _serve(pipe: Connection, limit: float, compare: bool) -> None:
    """Solve what comes through ``pipe`` until it closes; the system ends what takes longer than ``limit``."""
    solve(BASE, *METHODS[0])  # functions are built before anything is timed
    pipe.send(None)
    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        if resource is not None:
            most = math.ceil(time.process_time() + limit)
            resource.setrlimit(resource.RLIMIT_CPU, (most, resource.getrlimit(resource.RLIMIT_CPU)[1]))
        pipe.send(solve(*job, compare=compare))


class _Worker:
    """A process that solves one job at a time, and can be killed: IPOPT can't be interrupted from within."""

    def __init__(self, limit: float, compare: bool) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there, limit, compare), daemon=True)
        self.process.start()
        there.close()
        self.job: Job | None = None
        self.since, self.ready = time.perf_counter(), False

    def take(self, job: Job) -> None:
        """Start on ``job``."""
        self.job, self.since = job, time.perf_counter()
        self.pipe.send(job)

    def lost(self) -> Row:
        """Return the row of the job that the process died of."""
        self.process.join()
        if self.job is None:
            raise RuntimeError("a process of this study ended before it could solve anything")
        out_of_time = resource is not None and self.process.exitcode == -signal.SIGXCPU
        return Row(*self.job, TIMEOUT if out_of_time else CRASHED, time.perf_counter() - self.since)

    def end(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def run(jobs: Iterable[Job], processes: int, limit: float = LIMIT, *, compare: bool = True) -> Iterator[Row]:
    """Solve ``jobs`` in ``processes`` and yield their rows as they come; one that takes the processor longer than
    ``limit`` s is killed (not on Windows). ``compare`` is as in :func:`solve`.
    """
    queue, workers = deque(jobs), [_Worker(limit, compare) for _ in range(processes)]
    try:
        while queue or any(worker.job for worker in workers):
            ready = wait([worker.pipe for worker in workers if worker.job or not worker.ready])
            for k, worker in enumerate(workers):
                if worker.pipe not in ready:
                    continue
                try:
                    row = worker.pipe.recv()
                except EOFError:  # the process died
                    row = worker.lost()
                    worker.end()
                    workers[k] = _Worker(limit, compare)
                else:
                    worker.ready, worker.job = True, None
                if row is not None:
                    yield row
            for worker in workers:
                if worker.ready and worker.job is None and queue:
                    worker.take(queue.popleft())
    finally:
        for worker in workers:
            worker.end()


# --- tables and pictures --------------------------------------------------------------------------------


def written(rows: Iterable[Row], path: Path) -> Iterator[Row]:
    """Yield every row, failures too, once it stands in the file."""
    described = ("name", "kz_kx", "kx_ky", "weight", "distance", "turns", "length", "clamps")
    own = [field.name for field in dataclasses.fields(Row) if field.name != "case"]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow([*described, "outcome", *own])
        for row in rows:
            table.writerow(
                [*(getattr(row.case, key) for key in described), row.outcome, *(getattr(row, key) for key in own)]
            )
            file.flush()
            yield row


def summary(rows: list[Row]) -> str:
    """Return shares of outcomes and medians by transcription and solver, as a table."""

    def median(values: list[float]) -> float:
        finite = [value for value in values if np.isfinite(value)]
        return float(np.median(finite)) if finite else np.nan

    heads = (*OUTCOMES, "s", "most s", "iterations", "residual", "error")
    lines = [f"{'transcription':14}{'solver':21}{'rows':>5}" + "".join(f"{head:>12}" for head in heads)]
    for method in METHODS:
        chosen = [row for row in rows if (row.transcription, row.solver) == method]
        if not chosen:
            continue
        counts = Counter(row.outcome for row in chosen)
        solved = [row for row in chosen if row.status == Status.OK.name]
        figures = (
            median([row.seconds for row in chosen]),
            max(row.seconds for row in chosen),
            median([row.iterations for row in solved]),
            median([row.residual for row in solved]),
            median([row.error for row in solved]),
        )
        shares = "".join(f"{100.0 * counts[outcome] / len(chosen):>10.1f} %" for outcome in OUTCOMES)
        lines.append(
            f"{method[0]:14}{method[1]:21}{len(chosen):>5}{shares}" + "".join(f"{figure:>12.2g}" for figure in figures)
        )
    return "\n".join(lines)


def draw(rows: list[Row], folder: Path) -> list[Path]:
    """Draw one heat map of outcomes and seconds for each pair of axes; returns the files, none without matplotlib."""
    try:
        import matplotlib as mpl
    except ImportError:
        print("No heat maps: matplotlib is not installed (the extra 'studies').")
        return []
    mpl.use("Agg")
    from matplotlib import pyplot
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    shades = ("#4c9f70", "#e3c567", "#6f9fd8", "#d9d9d9", "#9a9a9a", "#c0392b", "#6c3483")
    colours = ListedColormap(shades)
    legend = [Patch(color=shade, label=outcome) for shade, outcome in zip(shades, OUTCOMES, strict=True)]
    found = {(row.case.name, row.transcription, row.solver): row for row in rows}
    paths = []
    for first, second in PAIRS:
        figure, plots = pyplot.subplots(2, 3, figsize=(18, 10), layout="constrained")
        for plot, method in zip(plots.ravel(), METHODS, strict=True):
            names = [[(varied(**{first: a, second: b}).name, *method) for a in AXES[first]] for b in AXES[second]]
            states = [[OUTCOMES.index(found[n].outcome) if n in found else np.nan for n in line] for line in names]
            plot.imshow(np.array(states, dtype=float), colours, vmin=-0.5, vmax=5.5, origin="lower", aspect="auto")
            for j, line in enumerate(names):
                for i, name in enumerate(line):
                    if name in found:
                        plot.text(i, j, f"{found[name].seconds:.2g}", ha="center", va="center", fontsize=7)
            plot.set_xticks(range(len(AXES[first])), [_tick(value) for value in AXES[first]], rotation=60)
            plot.set_yticks(range(len(AXES[second])), [_tick(value) for value in AXES[second]])
            plot.set(title=", ".join(method), xlabel=first, ylabel=second)
        figure.suptitle("how it ended, and the processor's seconds")
        figure.legend(handles=legend, loc="outside lower center", ncols=len(legend))
        paths.append(folder / f"{first}_{second}.png")
        figure.savefig(paths[-1], dpi=110)
        pyplot.close(figure)
    return paths


def _tick(value: float) -> str:
    return f"1 - {1 - value:.0e}" if 0.99 < value < 1 else f"{value:g}"


def _one(seed: int, number: int) -> None:
    """Solve and print one random case."""
    case = numbered_case(seed, number)
    row = solve(case, *METHODS[0])
    for key, value in (*dataclasses.asdict(case).items(), *dataclasses.asdict(row).items()):
        if key != "case":
            print(f"{key:16}{value}")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="folder", metavar="DIR", type=Path, default=Path("results/stiff_and_extreme"))
    parser.add_argument("--quick", action="store_true", help="a coarse grid by one method and 12 random cases")
    parser.add_argument("--part", choices=("grid", "random"), help="only one of the two")
    parser.add_argument("--random", type=int, metavar="N", help="how many random cases (default 2000, or 12)")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--case", type=int, metavar="K", help="only random case K, in words")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes")
    parser.add_argument(
        "--limit", type=float, metavar="S", help=f"most processor time for one case, s (default {LIMIT:g}, or 10)"
    )
    return parser.parse_args()


def main() -> None:
    """Run the study."""
    options = _options()
    if options.case is not None:
        _one(options.seed, options.case)
        return
    count = options.random if options.random is not None else (12 if options.quick else 2000)
    limit = options.limit or (10.0 if options.quick else LIMIT)
    methods = METHODS[:1] if options.quick else METHODS
    cases = [numbered_case(options.seed, k) for k in range(count)]
    studies = {
        "grid": [(case, *method) for case in grid(coarse=options.quick) for method in methods],
        "random": [(case, *METHODS[0]) for case in cases],
    }
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, jobs in studies.items():
        if options.part not in (None, name):
            continue
        rows: list[Row] = []
        for row in written(run(jobs, options.jobs, limit), options.folder / f"{name}.csv"):
            rows.append(row)
            if sys.stdout.isatty():
                print(f"\r{name}: {len(rows)} of {len(jobs)}", end="", flush=True)
        print(f"\r{name}: {len(rows)} of {len(jobs)}")
        print(summary(rows))
        if name == "grid":
            for path in draw(rows, options.folder):
                print(path)


if __name__ == "__main__":
    main()

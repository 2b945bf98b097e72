"""Which stiff and extreme cables does a cold start find a certified, stable shape for, by which method, how well?

    python scripts/stiff_and_extreme.py -o results/extreme --jobs 2
    python scripts/stiff_and_extreme.py --quick
    python scripts/stiff_and_extreme.py --seed 1 --case 17

Two parts. A grid sweeps each axis over its whole range about one ordinary cable (kz/kx, kx/ky, weight, end distance,
turns, length, clamps) and two pairs of axes together, by every transcription and solver. Random cases draw from all
ranges at once, by collocation and Gauss-Newton. Every shape called ``ok`` is checked by :func:`verify`, which knows the
rod equations and nothing of the solvers. Failures stay as rows of ``grid.csv`` and ``random.csv``; a table of shares
and medians goes to the terminal, and heat maps to the folder where matplotlib is installed.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import multiprocessing
import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path

import numpy as np

import harness_opt as ho
from harness_opt import rotations
from harness_opt.boundary import Kind
from harness_opt.errors import Status
from harness_opt.stability import stability

Array = np.ndarray
G = 9.81  # m/s2
SEED = 20240611
LIMIT = 60.0  # s, of one case; what takes longer is killed and stays as the row "timeout"
TRANSCRIPTIONS = ("collocation", "dqm")
SOLVERS = ("gauss-newton", "levenberg-marquardt", "ipopt")
METHODS = tuple((transcription, solver) for transcription in TRANSCRIPTIONS for solver in SOLVERS)
CLAMPED = Kind(True, True, True, True)
CLAMPS = ("random", "coincident", "opposed", "crossed", "coaxial")


# --- cases ----------------------------------------------------------------------------------------------


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


# --- an independent check -------------------------------------------------------------------------------

PANELS = 32  # stretches that the balances are first written on
DEEPEST = 30  # halvings of a stretch that does not balance: a jump stays, an error of quadrature goes
MOST_PANELS = 20_000  # halved at once: where more do not balance, nothing does
POSITION = 1e-7  # in L: end pose, and positions against the integral of the tangents
FRAME = 1e-6  # rad: end pose, and frames against the integral of the curvature
LOAD = 1e-6  # of the largest force, or moment: balances and the constitutive law
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
    lever = max(1e-12, shape.estimated_error) * length
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


# --- one row --------------------------------------------------------------------------------------------

REFINED = (1e-12, 1e-11)  # tolerances of the solve that an error is measured against: the first that is reached
TIMEOUT, CRASHED = "timeout", "crashed"


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
        if self.status != Status.OK.name:
            return "refused"
        if self.complaints:
            return "rejected"
        return "stable" if self.stable else "unstable"


OUTCOMES = ("stable", "unstable", "refused", TIMEOUT, "rejected", CRASHED)


def solve(case: Case, transcription: str, solver: str, *, compare: bool = True) -> Row:
    """Solve one case by one method, check the shape, and measure it against a refined solve where ``compare``."""
    cable, start, end, gravity = case.posed()
    begin = time.perf_counter()
    try:
        shape = ho.equilibrium(
            cable, start, end, gravity, transcription=transcription, solver=solver, throw=False
        )  # fmt: skip
    except Exception as error:  # a crash is a result of this study, and the worst one
        message = f"{type(error).__name__}: {error}".splitlines()[0]
        return Row(case, transcription, solver, CRASHED, time.perf_counter() - begin, complaints=message)
    seconds = time.perf_counter() - begin
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


def _serve(pipe: Connection, compare: bool) -> None:
    """Solve what comes through ``pipe`` until it closes."""
    solve(BASE, *METHODS[0])  # functions are built before anything is timed
    pipe.send(None)
    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        pipe.send(solve(*job, compare=compare))


class _Worker:
    """A process that solves one job at a time, and can be killed: IPOPT can't be interrupted from within."""

    def __init__(self, compare: bool) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there, compare), daemon=True)
        self.process.start()
        there.close()
        self.job: Job | None = None
        self.since, self.ready = time.perf_counter(), False

    def take(self, job: Job) -> None:
        """Start on ``job``."""
        self.job, self.since = job, time.perf_counter()
        self.pipe.send(job)

    def kill(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def run(jobs: Iterable[Job], processes: int, limit: float = LIMIT, *, compare: bool = True) -> Iterator[Row]:
    """Solve ``jobs`` in ``processes`` and yield their rows as they come; one that takes longer than ``limit`` s is
    killed. ``compare`` is as in :func:`solve`.
    """
    queue, workers = deque(jobs), [_Worker(compare) for _ in range(processes)]
    try:
        while queue or any(worker.job for worker in workers):
            ready = wait([worker.pipe for worker in workers], timeout=0.5)
            for k, worker in enumerate(workers):
                if worker.pipe in ready:
                    try:
                        row = worker.pipe.recv()
                    except EOFError:  # the process died
                        row = _lost(worker, CRASHED)
                        workers[k] = _Worker(compare)
                    else:
                        worker.ready, worker.job = True, None
                elif worker.job and time.perf_counter() - worker.since > limit:
                    row = _lost(worker, TIMEOUT)
                    workers[k] = _Worker(compare)
                else:
                    continue
                if row is not None:
                    yield row
            for worker in workers:
                if worker.ready and worker.job is None and queue:
                    worker.take(queue.popleft())
    finally:
        for worker in workers:
            worker.kill()


def _lost(worker: _Worker, status: str) -> Row:
    worker.kill()
    if worker.job is None:
        raise RuntimeError("a process of this study ended before it could solve anything")
    return Row(*worker.job, status, time.perf_counter() - worker.since)


# --- grid -----------------------------------------------------------------------------------------------

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


def _varied(**changes: float) -> Case:
    name = ", ".join(f"{key} = {value:.7g}" for key, value in changes.items())
    return dataclasses.replace(BASE, name=name, **changes)


def grid(*, coarse: bool) -> list[Case]:
    """Return the base case with each axis swept, the ways its clamps can stand, and both pairs of axes together."""
    axes = {key: values[:: 4 if coarse else 1] for key, values in AXES.items()}
    cases = [_varied(**{key: value}) for key, values in axes.items() for value in values]
    for clamps in CLAMPS:
        gap = np.array(BASE.gap)
        start, end = (tuple(q.tolist()) for q in _frames(clamps, gap, np.random.default_rng(SEED)))
        cases.append(dataclasses.replace(BASE, name=f"clamps {clamps}", clamps=clamps, start=start, end=end))
    for first, second in PAIRS:
        cases += [_varied(**{first: a, second: b}) for a in axes[first] for b in axes[second]]
    return list({case.name: case for case in cases}.values())


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

    colours = ListedColormap(["#4c9f70", "#e3c567", "#d9d9d9", "#9a9a9a", "#c0392b", "#6c3483"])
    found = {(row.case.name, row.transcription, row.solver): row for row in rows}
    paths = []
    for first, second in PAIRS:
        figure, plots = pyplot.subplots(2, 3, figsize=(18, 10), layout="constrained")
        for plot, method in zip(plots.ravel(), METHODS, strict=True):
            names = [[(_varied(**{first: a, second: b}).name, *method) for a in AXES[first]] for b in AXES[second]]
            states = [[OUTCOMES.index(found[n].outcome) if n in found else np.nan for n in line] for line in names]
            plot.imshow(np.array(states, dtype=float), colours, vmin=-0.5, vmax=5.5, origin="lower", aspect="auto")
            for j, line in enumerate(names):
                for i, name in enumerate(line):
                    if name in found:
                        plot.text(i, j, f"{found[name].seconds:.2g}", ha="center", va="center", fontsize=7)
            plot.set_xticks(range(len(AXES[first])), [_tick(value) for value in AXES[first]], rotation=60)
            plot.set_yticks(range(len(AXES[second])), [_tick(value) for value in AXES[second]])
            plot.set(title=", ".join(method), xlabel=first, ylabel=second)
        figure.suptitle("seconds; " + ", ".join(f"{k}: {outcome}" for k, outcome in enumerate(OUTCOMES)))
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
        "--limit", type=float, metavar="S", help=f"most time for one case, s (default {LIMIT:g}, or 10)"
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
            print(f"\r{name}: {len(rows)} of {len(jobs)}", end="", flush=True)
        print()
        print(summary(rows))
        if name == "grid":
            for path in draw(rows, options.folder):
                print(path)


if __name__ == "__main__":
    main()

"""What does a user get, in how much time: whole public calls beside other programs.

    python scripts/benchmarks/as_a_user.py -o results/as_a_user
    python scripts/benchmarks/as_a_user.py --quick

Five cases of ``work_precision_cases.py``, each the last of 100 frames. Ours is ``harness_opt.simulate``, all of it: the
first shape from the clamps alone, every frame with its error estimated and its stability judged; and beside that, for
what it explains, the solve alone on the mesh that came out. ``solve_bvp`` (``bvp_peer.py``) and Exudyn
(``exudyn_peer.py``, where the extra ``peers`` is installed) get the first shape for nothing and solve all other frames,
in all their set-ups. Neither judges stability. Then one shape from its clamps alone, by ``harness_opt.equilibrium`` and
by ``solve_bvp``.

Times are of the processor on one thread, for a frame in the mean, and medians of rounds in which all set-ups take
turns that no other of the same program beats in both time and error. Errors are the largest of the frames in CHECKED,
against closed forms or shapes that ``solve_bvp`` finds on some thousand nodes, which agree with the known one of the
last frame. Failures stay as rows.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import dataclasses
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from bvp_peer import Peer
from scipy.interpolate import CubicSpline
from threadpoolctl import threadpool_limits
from time_limit import OutOfTimeError, time_limit
from work_precision_cases import TABULATED, Benchmark, G, S, benchmarks, elastica

import harness_opt as ho
from harness_opt.motion.cases import CableCases
from harness_opt.motion.sweep import sweep
from harness_opt.rod.boundary import Case
from harness_opt.rod.states import Rod
from harness_opt.statics.continuation import step
from harness_opt.statics.starting_curve import starting_curve

Array = np.ndarray
NAMES = ("elastica 0.6", "cantilever P = 5", "3-D, weight 30", "stiff rig", "heavy, weight 1e4")
LEAD, FRAMES = "lead", 100
MOTION = np.linspace(0.0, 1.0, FRAMES)
CHECKED = (1, 12, 25, 37, 50, 62, 75, 87, FRAMES - 1)  # frames whose errors are looked at
ROUNDS = 3
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
# of ``solve_bvp``: nodes and tolerances, of a new mesh for each frame
MESHES = ((5, 1e-1), (7, 1e-1), (9, 1e-2), (13, 1e-2), (17, 1e-3), (25, 1e-4), (33, 1e-5))
BEGUN_WITH = (5, 13)  # nodes of the first frame, where each has the mesh of the one before: the faster way
CARRIED = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # tolerances then
COLD_NODES = 33
TOO_LONG = 120.0  # s, for a whole motion or a shape
AGREE = 2e-9  # L, of references and what is known
TARGETS = (1e-3, 1e-5, 1e-7, 1e-9)  # errors, in L, that the table shows the least time for
USUAL = 1e-7  # tolerance of a simulation, where none is given
OURS, COMPILED, ALONE, COLD = "simulate", "simulate, compiled", "solve alone", "equilibrium"
BVP, BVP_COLD, EXUDYN = "solve_bvp", "solve_bvp from clamps", "Exudyn"


@dataclasses.dataclass
class Row:
    """One set-up on one case: seconds a frame in each round, and the error, in L, or why there is none."""

    case: str
    method: str
    resolution: float
    seconds: list[float] = dataclasses.field(default_factory=list)
    error: float = np.nan
    status: str = "ok"

    @property
    def program(self) -> str:
        """The method, all set-ups of ``solve_bvp`` on a motion as one."""
        return self.method.partition(",")[0] if self.method.startswith(f"{BVP},") else self.method

    @property
    def milliseconds(self) -> float:
        """A frame, in the median of the rounds; not a number where it failed."""
        return 1e3 * statistics.median(self.seconds) if self.seconds and self.status == "ok" else np.nan


Work = Callable[[Row], None]


# --- what is solved ---------------------------------------------------------------------------------------


def problem(b: Benchmark) -> ho.Problem:
    """Return the motion that leads to the case, as a user describes it: one clamp moves, the weight is what it is."""
    if b.end.position is None:  # under a dead load: the clamp turns
        arm, start, end = ho.Hinge((0, 0, 0), (0, 1, 0), -0.7, 0.0), dataclasses.replace(b.start, body="arm"), b.end
    else:
        before = b.easier[0]
        if before == b.end:  # only lighter: it comes from a tenth nearer
            before = dataclasses.replace(b.end, position=tuple(0.9 * x for x in b.end.position))
        arm = ho.Poses((0.0, 1.0), (before.position, b.end.position), (before.quaternion, b.end.quaternion))
        start, end = b.start, ho.End((0, 0, 0), (1, 0, 0, 0), body="arm")
    run = ho.CableRun(b.heavy(b.weight), start, end, bow=b.bow)
    return ho.Problem({LEAD: run}, {"arm": ho.Body(arm)}, gravity=(0, 0, -G))


class Truth:
    """The shapes of the frames in CHECKED: the closed form of an elastica, else by ``solve_bvp`` from ours.

    Raises:
        RuntimeError: the last one is not the shape that is known, or one is not found.
    """

    def __init__(self, b: Benchmark, given: ho.Problem):
        self.benchmark, cases = b, CableCases(given, LEAD, "gauss-newton")
        frames = sweep(given, LEAD, MOTION, tolerance=1e-9).frames
        self.first, near = frames[0], frames[0].case
        self.cases: list[Case] = [near := cases.posed(ends, near) for ends in given.ends(LEAD, MOTION)]
        if b.turnable:  # which makes the equations of ``solve_bvp`` singular
            self._exact = {k: _closed_form(self.cases[k]) for k in CHECKED}
        else:
            self._exact = {k: _solved(frames[k].rod, self.cases[k]) for k in CHECKED}
        known = b.truth if b.truth is not None else b.tabulated
        at = S if b.truth is not None else S[::TABULATED]
        if known is not None and not b.error(self._exact[FRAMES - 1](at), known) < AGREE:
            raise RuntimeError(f"{b.name}: another shape than the known one")

    def error(self, k: int, at: Array, position: Array) -> float:
        """Return the largest distance of ``position`` (N, 3), at ``at`` (N,), from frame ``k``, in L."""
        return self.benchmark.error(position, self._exact[k](at))


def _closed_form(case: Case) -> Callable[[Array], Array]:
    known: Callable[[Array], Array] = CubicSpline(S, elastica(float(np.linalg.norm(case.boundary.gap))).truth)
    return known


def _solved(rod: Rod, case: Case) -> Callable[[Array], Array]:
    mesh = np.unique(np.concatenate([rod.mesh, np.linspace(0.0, 1.0, 801)]))
    for tolerance in (1e-9, 1e-8, 1e-7):  # of the equations; shapes of the last are within 1e-10 of those of the first
        found = Peer(case).solve(mesh, *_guess(rod, mesh), tolerance)
        if found.status == 0:
            return lambda at: found.sol(at)[7:].T
    raise RuntimeError(f"no reference: {found.message}")


def _guess(rod: Rod, mesh: Array) -> tuple[Array, Array]:
    at = rod.sample(mesh)
    return np.concatenate([at.q.T, at.moment.T, at.r.T]), at.force[0]


# --- the methods: each adds seconds a frame to its row, and the error -------------------------------------


def simulated(row: Row, truth: Truth, given: ho.Problem) -> None:
    """Call ``harness_opt.simulate``."""
    clock = time.process_time()
    motion = ho.simulate(given, frames=MOTION, tolerance=row.resolution, throw=False)
    row.seconds.append((time.process_time() - clock) / FRAMES)
    if not motion.ok:
        row.status = motion.status.name.lower()
        return
    shapes = motion.cables[LEAD]
    row.error = max(truth.error(k, shapes.s, shapes.position[k] - shapes.position[k, 0]) for k in CHECKED)


def followed(row: Row, truth: Truth, given: ho.Problem) -> None:
    """Solve the frames one after another on the mesh that a simulation ends with, and nothing else."""
    first = sweep(given, LEAD, MOTION, tolerance=row.resolution).frames[0]
    here, before, found = first, None, []
    clock = time.process_time()
    for case in truth.cases[1:]:
        solved = step(case, here, before, 1.0, "gauss-newton")
        if solved is None:
            row.status = "step too long"
            return
        here, before = solved, here
        found.append(solved)
    row.seconds.append((time.process_time() - clock) / len(found))
    row.error = max(truth.error(k, S, found[k - 1].rod.sample(S).r) for k in CHECKED)


def by_bvp(row: Row, truth: Truth, nodes: int, *, carried: bool = False) -> None:
    """Follow by ``solve_bvp`` with a secant guess, from ``nodes`` every time, or from the mesh of the frame before."""
    mesh, errors, seconds = np.linspace(0.0, 1.0, nodes), [], 0.0
    trail: list[Callable[[Array], tuple[Array, Array]]] = [lambda mesh: _guess(truth.first.rod, mesh)]
    for k, case in enumerate(truth.cases[1:], 1):
        clock = time.process_time()
        here, *before = (at(mesh) for at in reversed(trail[-2:]))
        guess = tuple(2 * a - b for a, b in zip(here, before[0], strict=True)) if before else here
        found = Peer(case).solve(mesh, *guess, row.resolution)
        seconds += time.process_time() - clock
        if found.status != 0:
            row.status = found.message
            return
        trail.append(lambda mesh, found=found: (found.sol(mesh), found.p))
        mesh = found.x if carried else mesh
        errors.append(truth.error(k, S, found.sol(S)[7:].T) if k in CHECKED else 0.0)
    row.seconds.append(seconds / len(errors))
    row.error = max(errors)


def by_exudyn(row: Row, truth: Truth) -> None:
    """Follow by Exudyn's static solver."""
    import exudyn_peer

    motion, seconds, errors = exudyn_peer.Peer(truth.first.rod, truth.cases[0], int(row.resolution)), 0.0, []
    for k, case in enumerate(truth.cases[1:], 1):
        clock = time.process_time()
        row.status = motion.frame(case)
        seconds += time.process_time() - clock
        if row.status != "ok":
            return
        errors.append(truth.error(k, S, motion.position()) if k in CHECKED else 0.0)
    row.seconds.append(seconds / len(errors))
    row.error = max(errors)


def found_cold(row: Row, truth: Truth) -> None:
    """Find the last frame's shape from its clamps alone by ``harness_opt.equilibrium``."""
    b = truth.benchmark
    clock = time.process_time()
    shape = ho.equilibrium(
        b.heavy(b.weight), b.start, b.end, (0, 0, -G), bow=b.bow, throw=False, tolerance=row.resolution
    )
    row.seconds.append(time.process_time() - clock)
    row.status = "ok" if shape.ok else shape.status.name.lower()
    if shape.ok:
        row.error = truth.error(FRAMES - 1, shape.s, shape.position - shape.position[0])


def bvp_cold(row: Row, truth: Truth) -> None:
    """Find it by ``solve_bvp`` from the curve that our own cold start begins with."""
    case = truth.cases[-1]
    clock = time.process_time()
    r, q = starting_curve(case.boundary, COLD_NODES, 0, np.array(truth.benchmark.bow, dtype=float))
    guess = np.concatenate([q.T, np.zeros((3, COLD_NODES)), r.T])
    mesh = np.linspace(0.0, 1.0, COLD_NODES)
    found = Peer(case.signed_like(q[0], q[-1])).solve(mesh, guess, np.zeros(3), row.resolution)
    row.seconds.append(time.process_time() - clock)
    row.status = "ok" if found.status == 0 else found.message
    if row.status == "ok":
        row.error = truth.error(FRAMES - 1, S, found.sol(S)[7:].T)


def setups(truth: Truth, given: ho.Problem) -> Iterator[tuple[Row, Work]]:
    """Yield a row for every set-up, and what adds a round to it."""
    name = truth.benchmark.name
    for tolerance in TOLERANCES:
        yield Row(name, OURS, tolerance), lambda row: simulated(row, truth, given)
    yield Row(name, COMPILED, USUAL), lambda row: _compiled(row, truth, given)
    yield Row(name, ALONE, USUAL), lambda row: followed(row, truth, given)
    for nodes, tolerance in MESHES:
        yield Row(name, f"{BVP}, {nodes} nodes", tolerance), lambda row, n=nodes: by_bvp(row, truth, n)
    for nodes in BEGUN_WITH:
        for tolerance in CARRIED:
            method = f"{BVP}, mesh carried from {nodes} nodes"
            yield Row(name, method, tolerance), lambda row, n=nodes: by_bvp(row, truth, n, carried=True)
    with contextlib.suppress(ImportError):
        import exudyn_peer

        for elements in exudyn_peer.RESOLUTIONS:
            yield Row(name, EXUDYN, elements), lambda row: by_exudyn(row, truth)
    for tolerance in (1e-5, 1e-9):
        yield Row(name, COLD, tolerance), lambda row: found_cold(row, truth)
    for tolerance in (1e-3, 1e-5, 1e-7, 1e-9):
        yield Row(name, BVP_COLD, tolerance), lambda row: bvp_cold(row, truth)


def _compiled(row: Row, truth: Truth, given: ho.Problem) -> None:
    try:
        with ho.compiled():
            simulated(row, truth, given)
    except ho.CompilerError as error:
        row.status = str(error)


# --- rounds -----------------------------------------------------------------------------------------------


def study(b: Benchmark, rounds: int) -> list[Row]:
    """Return the rows of one case: all set-ups tried once, then those worth it timed in turns."""
    given = problem(b)
    truth = Truth(b, given)
    pairs = list(setups(truth, given))
    for row, work in pairs:
        _limited(row, work)
        print(f"{row.case}  {row.method}  {row.resolution:g}  {row.milliseconds:.2f} ms  {row.error:.1e}  "
              f"{row.status}", flush=True)  # fmt: skip
    rows = [row for row, _ in pairs]
    chosen = [(row, work) for row, work in pairs if row.status == "ok" and not _beaten(row, rows)]
    for row, _ in chosen:
        row.seconds.clear()  # the first round builds what is built once
    for _ in range(rounds):
        for row, work in chosen:
            _limited(row, work)
    return rows


def _limited(row: Row, work: Work) -> None:
    try:
        with time_limit(TOO_LONG):
            work(row)
    except OutOfTimeError:
        row.status = f"longer than {TOO_LONG:g} s"


def _beaten(row: Row, rows: list[Row]) -> bool:
    """Return whether another set-up of the same program is clearly faster and no less accurate."""
    clearly = 0.8  # times as long: one round is rough
    rivals = [other for other in rows if other.program == row.program and other.status == "ok"]
    return any(other.error <= row.error and other.milliseconds < clearly * row.milliseconds for other in rivals)


# --- output -----------------------------------------------------------------------------------------------


def cheapest(rows: list[Row], case: str, program: str, error: float) -> Row | None:
    """Return the fastest row of a program with at most ``error``, in L; None where it has none."""
    kept = [row for row in rows if row.case == case and row.program == program and row.error <= error]
    return min(kept, key=lambda row: row.milliseconds, default=None)


def _cell(row: Row | None) -> str:
    return "-" if row is None else f"{row.milliseconds:.2g} ms ({row.error:.0e} L)"


def table(rows: list[Row]) -> str:
    """Return the table of the motions: milliseconds a frame, and the error reached."""
    lines = ["| case | `simulate` | by machine code | of it, the solve alone | "
             + " | ".join(f"`solve_bvp`, {error:g} L" for error in TARGETS)
             + " | Exudyn, its best |", "|" + "---|" * (5 + len(TARGETS))]  # fmt: skip
    for case in dict.fromkeys(row.case for row in rows):
        ours, fast, alone = (
            next((row for row in rows if (row.case, row.method, row.resolution) == (case, method, USUAL)), None)
            for method in (OURS, COMPILED, ALONE)
        )
        exudyn = min((row for row in rows if row.case == case and row.program == EXUDYN and row.status == "ok"),
                     key=lambda row: row.error, default=None)  # fmt: skip
        cells = [ours, fast, alone, *(cheapest(rows, case, BVP, error) for error in TARGETS), exudyn]
        lines.append(f"| {case} | " + " | ".join(map(_cell, cells)) + " |")
    return "\n".join(lines)


def cold_table(rows: list[Row]) -> str:
    """Return the table of single shapes from their clamps alone."""
    lines = ["| case | `equilibrium`, 1e-5 | `equilibrium`, 1e-9 | `solve_bvp`, 1e-5 L | `solve_bvp`, 1e-8 L |",
             "|" + "---|" * 5]  # fmt: skip
    for case in dict.fromkeys(row.case for row in rows):
        ours = [row for row in rows if row.case == case and row.method == COLD]
        theirs = [cheapest(rows, case, BVP_COLD, error) for error in (1e-5, 1e-8)]
        lines.append(f"| {case} | " + " | ".join(map(_cell, [*ours, *theirs])) + " |")
    return "\n".join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/as_a_user"))
    parser.add_argument("--quick", action="store_true", help="one round, one case")
    parser.add_argument("--case", action="append", default=[], help="only this one; may be given again")
    options = parser.parse_args()
    rounds = 1 if options.quick else ROUNDS
    names = tuple(options.case) or (NAMES[:1] if options.quick else NAMES)
    options.output.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    with threadpool_limits(1):
        for b in benchmarks():
            if b.name in names:
                rows += study(b, rounds)
    with (options.output / "rows.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["case", "method", "resolution", "milliseconds", "error", "status"])
        for row in rows:
            writer.writerow([row.case, row.method, row.resolution, row.milliseconds, row.error, row.status])
    print("\n" + table(rows) + "\n\n" + cold_table(rows))


if __name__ == "__main__":
    main()

"""Solving near a known shape: one accurate solve, and following a path of cases with step control.

A shape is carried from case to case by extrapolation of the last ones and the solver's corrections, which begin with
the Jacobian factorised for the last shape. A step is taken only where the corrected shape stays near the predicted one
and the end keeps its sign, that is its number of whole turns; otherwise it is halved. Deuflhard, "Newton Methods for
Nonlinear Problems", chapter 5.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .boundary import Case
from .errors import Status
from .extrapolation import Trail
from .rotations import Array
from .shape import Defects, Rod
from .solvers import gauss_newton, ipopt, levenberg_marquardt, paper, valley
from .solvers.interface import Options, Solution, Solver, largest
from .solvers.linear import CONDITION_LIMIT, Factor, factorise
from .transcriptions.collocation import BoundCollocation, collocation, pack, stations

SOLVERS: dict[str, Solver] = {
    "gauss-newton": gauss_newton.solve,
    "levenberg-marquardt": levenberg_marquardt.solve,
    "ipopt": ipopt.solve,
    "paper": paper.solve,
}
SAFEGUARDED = "gauss-newton"  # the solver that a walk along a valley comes after
SHARP = 1e-3  # part of the residual asked for that counts as solved along a valley: what is left goes far there
FLOOR = 1e-2  # residual of the scaled equations that is left on the floor of a valley at most
STAGES = 5  # Gauss points an element: order 10 at the nodes
ELEMENTS = (
    8,
    12,
    16,
    24,
    32,
    48,
    64,
    96,
    128,
    192,
    256,
)  # meshes on offer; a function is built once for each
LAST_RESORT = (384, 512)  # elements of the one shape that those do not do for
RESIDUAL = 1e-11  # of the scaled equations
PATH_RESIDUAL = 1e-10  # the same on a path: 2e-10 L off a solve to the last digit, over the reference cases' motions
ROUNDING = 1e-15  # relative: of a force along an element, which should not turn it, a few units in the last place do
STEP_ITERATIONS = 12  # a corrector that needs more has lost its predictor
NEAR = 0.35  # largest turning between the predicted and the corrected shape of a step, rad
SMALLEST_STEP = 2.0**-12  # of a path step
# Estimated errors, in L: at which a path is refined on the way, as near folds more leads past them; and at which it is
# given up, as more leads to shapes that the cable does not have. Along flat valleys no mesh may do for the first.
COARSE, ROUGH = 1e-5, 1e-3
RESOLVED = 1e-6  # estimated error, in L, that it is refined to then
ENOUGH = 128  # elements up to which it is refined for the first
BLAMELESS = 1e-9  # largest local error, in L, of a mesh that is not to blame for an estimated error: a flat valley is
MOST_STEPS = 300  # tried on one path, taken or not: a path that needs more is given up
WORTHWHILE = 0.5  # part of the error that dealing the finest mesh out anew must leave at most, to be done again
POLISHED, POLISHES = 0.5, 4  # part of the residual that a last correction is to leave, and how many there are
SETTLED, SETTLINGS = 0.3, 12  # part of the residual that a walk along a valley is to leave, and how often
TURNED = 1e-2  # L a rad: what an error of the frames counts
CALM = 3  # corrector iterations up to which the next step may double


@dataclass(frozen=True)
class Solved:
    """A solved discretisation with what is needed to go on from it.

    Args:
        case: what was solved.
        bound: its equations.
        solution: the solver's answer.
        trail: the solves that led here by :func:`step`, this one first; None where it was found otherwise.
    """

    case: Case
    bound: BoundCollocation
    solution: Solution
    trail: Trail | None = None

    @property
    def ok(self) -> bool:
        """Whether the solver converged."""
        return self.solution.status.ok

    @functools.cached_property
    def rod(self) -> Rod:
        """The states at the nodes."""
        return _rod(self.case, self.bound, self.solution.x)

    @functools.cached_property
    def factor(self) -> Factor:
        """The factorised Jacobian at the solution."""
        return factorise(self.bound.linearise(self.solution.x)[1])

    @functools.cached_property
    def estimate(self) -> tuple[float, Array]:
        """What :func:`error_estimate` returns."""
        with np.errstate(over="ignore", invalid="ignore"):
            defects = self.rod.defects()
        return error_from_defects(self, defects)

    @property
    def lasting(self) -> Factor | None:
        """A factorised Jacobian that serves for cases nearby too; None where there is none.

        Where the last one of the solver does not, the one at the solution may: of a shape that may turn freely it
        leaves that turn out.
        """
        last = self.solution.factor
        if last is None or last.benign:
            return last
        return self.factor if self.factor.benign else None

    @property
    def turned(self) -> bool:
        """Whether the end came out with the opposite sign: an odd number of whole turns away from the one asked for."""
        boundary = self.case.boundary
        last = self.bound.last_quaternion(self.solution.x)
        return boundary.kind.end_orientation and float(last @ boundary.end_quaternion) < 0.0


def _load_scale(load: Array, force: Array) -> float:
    return 1.0 + math.sqrt(load @ load) + math.sqrt(force @ force)


def solve_on(
    case: Case,
    mesh: Array,
    x: Array,
    solver: str,
    iterations: int = 60,
    near: Solved | None = None,
    residual: float = RESIDUAL,
) -> Solved:
    """Solve ``case`` on ``mesh`` (n + 1,) from the unknowns ``x`` of that mesh; the status says how it ended.

    Where Gauss-Newton comes down to the floor of a valley, and not quite to the solution, it is walked along
    (:mod:`.solvers.valley`).

    Args:
        case, mesh, x: as above.
        solver: name.
        iterations: limit.
        near: solve of a like case nearby, whose factorised Jacobian may serve.
        residual: largest entry of the scaled equations that counts as solved.
    """
    bound = collocation(len(mesh) - 1, STAGES, bool(case.load.any())).bind(case.section, case.load, case.boundary, mesh)
    # rounding grows with the loads that the moment equations carry, and turns long soft elements
    scale = _load_scale(case.load, x[-3:])
    turned = ROUNDING * scale * float((mesh[1:] - mesh[:-1]).max()) ** 2 / float(case.section.stiffness.min())
    tolerance = residual * math.sqrt(scale) + turned
    factor = near.lasting if near is not None and near.solution.x.shape == x.shape else None
    problem, options = bound.least_squares(), Options(tolerance, iterations, factor=factor)
    solution = SOLVERS[solver](problem, x, options)
    factor = solution.factor
    flat = factor is None or (not factor.singular and factor.condition > CONDITION_LIMIT)
    sharp = dataclasses.replace(options, tolerance=SHARP * residual * math.sqrt(scale) + turned)
    loose = solution.residual > (sharp.tolerance if flat else tolerance)
    if solver == SAFEGUARDED and loose and solution.residual <= FLOOR * math.sqrt(scale):
        kind = case.boundary.kind
        held = kind.start_position and kind.end_position and kind.start_orientation and kind.end_orientation
        energy = (lambda x: _energy(case, bound, x)) if held else None
        steps = valley.STEPS if near is None else valley.FEW
        # where it did not converge, it may have strayed far, or be on the floor already
        for begun in (solution.x,) if solution.status.ok else (x, solution.x):
            walked = valley.solve(problem, begun, sharp, energy, steps=steps)
            if walked.residual <= min(tolerance, solution.residual):
                solution = dataclasses.replace(walked, status=Status.OK)
                break
    return Solved(case, bound, solution)


def _energy(case: Case, bound: BoundCollocation, x: Array) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        return float(_rod(case, bound, x).energy())


def _rod(case: Case, bound: BoundCollocation, x: Array) -> Rod:
    states = bound.unpack(x)
    return Rod(case.section, case.load, states.mesh, states.q, states.r, states.force, states.moment)


def resample(rod: Rod, mesh: Array) -> Array:
    """Return the unknowns (..., m) on ``mesh`` that describe the shapes of ``rod``, one or many."""
    samples = rod.sample(stations(mesh, STAGES))
    return pack(samples.q, samples.moment, samples.force[..., 0, :], STAGES)


def error_estimate(solved: Solved) -> tuple[float, Array]:
    """Return the estimated error of the centreline, in L, and each element's own contribution (n,).

    Or a hundredth of the largest local turning error, in rad, where that is more: in clamp layers thinner than any
    error of the centreline.

    The local errors of the elements (:meth:`Rod.defects`) are fed back through the linearised equations, so the
    estimate is of the global error and needs no second solve. What the solver left of the equations counts too, and
    how far apart the two shapes are that both ends of an element give for its middle.
    """
    return solved.estimate


def error_from_defects(solved: Solved, defects: Defects) -> tuple[float, Array]:
    """Return what :func:`error_estimate` does, from the shape's defects already at hand."""
    dq, dm, dr, turning, apart, behind = defects
    mesh = solved.bound.mesh
    n, s = len(mesh) - 1, STAGES
    local = apart + np.linalg.norm(dr, axis=-1) + np.maximum(np.diff(mesh), TURNED) * np.linalg.norm(dq, axis=-1)
    local = np.where(np.isfinite(local), local, np.inf)
    if not (np.all(np.isfinite(dm)) and np.max(local) < 1.0):
        return np.inf, local
    residual = np.zeros(solved.bound.transcription.size)
    blocks = residual[4 : 4 + n * (4 * s + 7)].reshape(n, 4 * s + 7)
    turns, moments = blocks[:, 4 * s : 4 * s + 4], blocks[:, 4 * s + 4 :]
    kind = solved.case.boundary.kind
    before = 1.0 - behind[:, None]
    turns += behind[:, None] * dq
    moments += behind[:, None] * dm
    turns[:-1] += (before * dq)[1:]
    moments[:-1] += (before * dm)[1:]
    if kind.start_orientation:
        residual[:4] = before[0] * dq[0]
    else:
        residual[1:4] = before[0] * dm[0]
    if kind.start_position and kind.end_position:
        residual[4 + n * (4 * s + 7) :][:3] = -dr.sum(axis=0)
    # that of the last iteration is good enough, but where a shape may turn freely: off it, that turn looks determined
    factor = solved.lasting or solved.solution.factor or solved.factor
    x = solved.solution.x
    # where the shape may turn freely, what is left of the equations turns it
    left = solved.bound.residual(x) if factor.benign else np.zeros_like(x)
    dx = factor.solve(np.stack([residual, left], axis=1))
    moved = solved.bound.node_rates(x, dx)
    # the centreline's own local errors add to those that come from the frames
    moved[1:, :, 0] += np.cumsum(dr, axis=0)
    turned = TURNED * max(2.0 * float(np.max(np.linalg.norm(dq, axis=-1))), float(turning.max()))
    # nodes, and what is sampled between them, are off by different things
    return max(float(np.linalg.norm(moved, axis=1).max(axis=0).sum() + apart.max()), turned), local


def settled(solved: Solved) -> Solved:
    """Return a solve walked on along its valley until rounding hides the rest; the same where it has none.

    Where one direction is all but flat, a residual small enough for any other shape still leaves far to go there.
    """
    if solved.factor.condition < CONDITION_LIMIT:
        return solved
    problem, best = solved.bound.least_squares(), solved.solution
    for _ in range(SETTLINGS):
        walked = valley.solve(problem, best.x, Options(SETTLED * best.residual, 0))
        if not walked.status.ok:
            break
        best = walked
    found = Solved(solved.case, solved.bound, best)
    return solved if best is solved.solution or found.turned else found


def polished(solved: Solved) -> Solved:
    """Return a solve corrected until rounding is left, with the Jacobian that it ended with.

    What counts as solved grows with the loads, and long elements show what is left: their curvatures are the small
    differences of large moments.
    """
    best = solved.solution
    if best.factor is not None and not best.factor.singular:
        best = _corrected(solved.bound, best, best.factor)
    if best is solved.solution and best.residual > RESIDUAL and not solved.factor.singular:
        best = _corrected(solved.bound, best, solved.factor)
    return solved if best is solved.solution else dataclasses.replace(solved, solution=best)


def _corrected(bound: BoundCollocation, best: Solution, factor: Factor) -> Solution:
    """Return ``best`` after corrections with one Jacobian, as long as they leave less."""
    for _ in range(POLISHES):
        x = best.x - factor.solve(bound.residual(best.x))
        left = largest(bound.residual(x))
        if not left < POLISHED * best.residual:
            break
        best = dataclasses.replace(best, x=x, residual=left)
    return best


def refined_mesh(mesh: Array, local: Array, elements: int) -> Array:
    """Return a mesh of ``elements`` on which the local errors (n,) would be equal (equidistribution).

    The error of an element falls with the power 2 STAGES + 1 of its length; the density is smoothed over neighbours
    so that lengths change gradually. Ascher, Mattheij, Russell, "Numerical Solution of BVPs for ODEs", section 9.2.
    """
    steps = np.diff(mesh)
    finite = local[np.isfinite(local)]
    ceiling = max(float(finite.max(initial=0.0)), 1e-30)
    monitor = np.clip(np.where(np.isfinite(local), local, 10.0 * ceiling), 1e-12 * ceiling, None)
    density = monitor ** (1.0 / (2 * STAGES + 1)) / steps
    padded = np.concatenate([density[:1], density, density[-1:]])
    density = np.maximum(density, 0.5 * np.maximum(padded[:-2], padded[2:]))
    density = density + 0.1 * np.sum(density * steps)  # no stretch is left without elements
    run = np.concatenate([[0.0], np.cumsum(density * steps)])
    return np.interp(np.linspace(0.0, run[-1], elements + 1), run, mesh)


def finer_mesh(mesh: Array, local: Array, excess: float, before: float, most: int = ELEMENTS[-1]) -> Array | None:
    """Return the mesh on offer on which the error would be ``excess`` times smaller, or one of twice the elements.

    Args:
        mesh, local: nodes (n + 1,) and local errors (n,).
        excess: error over tolerance.
        before: the same on the mesh before.
        most: elements.

    Returns:
        The finest of these, dealt out anew, where there is no finer one; None where that gains nothing any more.
    """
    n = len(mesh) - 1
    if n >= most and not excess < WORTHWHILE * before:
        return None
    most = max(n, most)
    wanted = n * min(2.0, 1.15 * excess ** (0.5 / STAGES))
    finer = next((m for m in (*ELEMENTS, *LAST_RESORT) if most >= m > n and m >= wanted), most)
    return refined_mesh(mesh, local, finer)


def elements_for(elements: int, error: float, local: Array) -> int:
    """Return up to how many elements a shape on a path is to be refined; 0 where its mesh is good enough for one.

    Args:
        elements: that it has.
        error, local: what :func:`error_estimate` returns.
    """
    if error <= COARSE or np.max(local) <= BLAMELESS:
        return 0
    if error > ROUGH:
        return ELEMENTS[-1]
    return ENOUGH if elements < ENOUGH else 0


def refine(solved: Solved, tolerance: float, solver: str, most: int = ELEMENTS[-1]) -> tuple[Solved, float, Status]:
    """Refine the mesh of a solved case until its estimated error is at most ``tolerance`` (in L).

    Args:
        solved, tolerance: as above.
        solver: name.
        most: elements.

    Returns:
        The best solve, its estimated error, and OK, INACCURATE or the solver's own failure.
    """
    error, local = error_estimate(solved)
    if error > tolerance or np.any(solved.rod.long):  # what is good enough stays, with all that is known of it
        solved = polished(solved)
        error, local = error_estimate(solved)
    best, before = (solved, error), np.inf
    while error > tolerance:
        mesh = finer_mesh(solved.rod.mesh, local, error / tolerance, before, most)
        if mesh is None:
            return *best, Status.INACCURATE
        before = error / tolerance
        x = resample(solved.rod, mesh)
        if not np.all(np.isfinite(x)):
            return *best, Status.INACCURATE
        again = solve_on(solved.case, mesh, x, solver)
        if not again.ok or again.turned:
            return *best, again.solution.status if not again.ok else Status.WRONG_TURNS
        solved = polished(again)
        error, local = error_estimate(solved)
        best = min(best, (solved, error), key=lambda found: found[1])
    return solved, error, Status.OK


def _trail(here: Solved, before: Solved | None) -> Trail:
    """Return the points to extrapolate from: all that led ``here``, where ``before`` is the last of them.

    Two where the shape may turn freely, or it is not known whether: no solve corrects what a higher degree would make
    of the rounding in that direction.
    """
    x, factor = here.solution.x, here.solution.factor
    if before is None or not np.array_equal(before.bound.mesh, here.bound.mesh):
        return Trail((x,))
    trail, regular = here.trail, factor is not None and factor.benign and not factor.singular
    if trail is not None and len(trail.points) > 1 and trail.points[1] is before.solution.x and regular:
        return trail
    return Trail((x, before.solution.x), (1.0,), 1)


def turning(a: Array, b: Array) -> float:
    """Return the largest turning, rad, between quaternions (n, 4) of two shapes at the same places."""
    apart, across = (np.einsum("ni,ni->n", x, x) for x in (a - b, a + b))
    return 2.0 * math.sqrt(float(np.minimum(apart, across).max()))


def step(case: Case, here: Solved, before: Solved | None, ratio: float, solver: str) -> Solved | None:
    """Go from ``here`` to the near ``case`` in one step; None where the step is too long to be trusted.

    Args:
        case: where to.
        here, before: the last two solves; ``before`` may be None.
        ratio: this step's length over the last one's, for the predictor.
        solver: name.
    """
    trail = _trail(here, before)
    length = ratio * trail.steps[0] if trail.steps else 1.0
    predictions = trail.predictions(length)
    guess = predictions[trail.degree]
    residual = RESIDUAL if before is None else PATH_RESIDUAL
    solved = solve_on(case, here.bound.mesh, guess, solver, STEP_ITERATIONS, here, residual)
    if not solved.ok or solved.turned:
        return None
    x, quaternions = solved.solution.x, solved.bound.quaternions
    if turning(quaternions(guess), quaternions(x)) > NEAR:
        return None
    return dataclasses.replace(solved, trail=trail.extended(x, length, predictions))


def follow(
    path: Callable[[float], Case],
    start: Solved,
    first: float,
    last: float,
    solver: str,
    smallest: float | None = None,
) -> tuple[Solved, float]:
    """Follow ``path`` from parameter ``first``, where ``start`` was solved, towards ``last``.

    Args:
        path: parameter to case.
        start, first, last: as above.
        solver: name.
        smallest: step at which it is given up, in parts of the whole; None takes SMALLEST_STEP.

    Returns:
        The last solve and its parameter: ``last`` where the path could be followed to its end.
    """
    here, before, at = start, None, first
    shortest = abs(last - first) * (SMALLEST_STEP if smallest is None else smallest)
    length, previous = last - first, 1.0
    for _ in range(MOST_STEPS):
        if at == last:
            break
        target = last if abs(last - at) <= abs(length) * (1.0 + 1e-9) else at + length
        solved = step(path(target), here, before, (target - at) / previous if before else 0.0, solver)
        if solved is None:
            length *= 0.5
            if abs(length) < shortest:
                break
            continue
        previous = target - at
        here, before, at = solved, here, target
        most = elements_for(len(here.bound.mesh) - 1, *error_estimate(here))
        if most:
            here, error, _ = refine(here, RESOLVED, solver, most)
            before = None
            if not error <= ROUGH:
                break
        if solved.solution.iterations <= CALM:
            length *= 2.0
    return here, at

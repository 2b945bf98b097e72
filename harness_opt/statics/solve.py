"""One accurate solve near a known shape, and its error, estimated from the shape alone."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.errors import Status
from harness_opt.numerics import gauss_newton, ipopt, levenberg_marquardt, near_null, rotations
from harness_opt.numerics import paper_levenberg_marquardt as paper
from harness_opt.numerics.extrapolation import Trail
from harness_opt.numerics.interface import Options, Solution, Solver, largest
from harness_opt.numerics.linear import CONDITION_LIMIT, Factor, factorise
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import CLAMPED, HELD, Case, relative_matrix
from harness_opt.rod.collocation import BoundCollocation, collocation, pack, stations
from harness_opt.rod.equations import Section
from harness_opt.rod.states import Defects, Rod

SOLVER_OF: dict[str, Solver] = {  # by name, one for each of rod.methods.SOLVERS
    "gauss-newton": gauss_newton.solve,
    "levenberg-marquardt": levenberg_marquardt.solve,
    "ipopt": ipopt.solve,
    "paper": paper.solve,
}
NEAR_NULL_AFTER = "gauss-newton"  # the solver after which the near-null direction is followed
STAGES = 5  # Gauss points an element: order 10 at the nodes
RESIDUAL = 1e-11  # of the scaled equations


@dataclass(frozen=True)
class Solved:
    """A solved discretisation with what is needed to go on from it.

    Args:
        case: what was solved.
        bound: its equations.
        solution: the solver's answer.
        trail: the solves that led here by :func:`~harness_opt.statics.continuation.step`, this one first; None where
            it was found otherwise.
        passed: whether the cable went through itself on the way here: turns are lost that its ends were given.
    """

    case: Case
    bound: BoundCollocation
    solution: Solution
    trail: Trail | None = None
    passed: bool = False

    @property
    def ok(self) -> bool:
        """Whether the solver converged."""
        return self.solution.status.ok

    @functools.cached_property
    def rod(self) -> Rod:
        """The states at the nodes."""
        return self.bound.rod(self.solution.x)

    @functools.cached_property
    def factor(self) -> Factor:
        """The factorised Jacobian at the solution."""
        return factorise(self.bound.linearise(self.solution.x)[1])

    def kept_factors(self) -> list[Factor]:
        """Return the factorised Jacobians that this keeps in memory: the solver's last, and that of :attr:`factor`."""
        found = (self.solution.factor, vars(self).get("factor"))
        return [factor for factor in found if factor is not None]

    @functools.cached_property
    def estimate(self) -> tuple[float, Array]:
        """What :func:`error_estimate` returns."""
        with np.errstate(over="ignore", invalid="ignore"):
            defects = self.rod.defects()
        return error_from_defects(self, defects)

    @property
    def is_estimated(self) -> bool:
        """Whether :attr:`estimate` is known already."""
        return "estimate" in vars(self)

    def estimate_from(self, defects: Defects) -> None:
        """Find :attr:`estimate` from the shape's defects, found together with those of others."""
        vars(self)["estimate"] = error_from_defects(self, defects)

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
        return boundary.kind.end_held == HELD and float(last @ boundary.end_quaternion) < 0.0


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

    Where Gauss-Newton comes to the near-null curve, and not quite to the solution, that curve is followed
    (:mod:`harness_opt.numerics.near_null`).

    Args:
        case, mesh, x: as above.
        solver: name.
        iterations: limit.
        near: solve of a like case nearby, whose factorised Jacobian may serve.
        residual: largest entry of the scaled equations that counts as solved.
    """
    force_rounding = 1e-15  # relative, of a force along an element, which should not turn it: a few last digits
    nearly_solved = 1e3  # times the residual asked for: left by what has come to that curve, and not strayed
    most_on_curve = 1e-2  # residual of the scaled equations that is left on the near-null curve at most
    sharp_share = 1e-3  # of the residual asked for: along a near-null direction what is left goes far
    bound = collocation(len(mesh) - 1, STAGES, bool(case.load.any())).bind(case.section, case.load, case.boundary, mesh)
    # rounding grows with the loads that the moment equations carry, and turns long soft elements
    scale = _load_scale(case.load, x[-3:])
    turned = force_rounding * scale * float((mesh[1:] - mesh[:-1]).max()) ** 2 / float(case.section.stiffness.min())
    tolerance = residual * math.sqrt(scale) + turned
    factor = near.lasting if near is not None and near.solution.x.shape == x.shape else None
    problem, options = bound.least_squares(), Options(tolerance, iterations, factor=factor)
    solution = SOLVER_OF[solver](problem, x, options)
    factor = solution.factor
    flat = factor is None or (not factor.singular and factor.condition > CONDITION_LIMIT)
    sharp = dataclasses.replace(options, tolerance=sharp_share * residual * math.sqrt(scale) + turned)
    loose = solution.residual > (sharp.tolerance if flat else tolerance)
    if solver == NEAR_NULL_AFTER and loose and solution.residual <= most_on_curve * math.sqrt(scale):
        energy = (lambda x: _energy(bound, x)) if case.boundary.kind == CLAMPED else None
        steps = near_null.STEPS if near is None else near_null.FEW
        # where it did not converge, it may have strayed far, or be on the curve already
        starts = [solution.x] if solution.status.ok else [x]
        if near is None and tolerance < solution.residual <= nearly_solved * tolerance:
            starts.append(solution.x)
        for begun in starts:
            followed = near_null.solve(problem, begun, sharp, energy, steps=steps)
            if followed.residual <= min(tolerance, solution.residual):
                solution = dataclasses.replace(followed, status=Status.OK)
                break
    return Solved(case, bound, solution)


def _energy(bound: BoundCollocation, x: Array) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        return float(bound.rod(x).energy())


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
    turning_weight = 1e-2  # L a rad: what an error of the frames counts
    dq, dm, dr, turning, apart, behind = defects
    mesh = solved.bound.mesh
    n, s = len(mesh) - 1, STAGES
    local = (
        apart + np.linalg.norm(dr, axis=-1) + np.maximum(np.diff(mesh), turning_weight) * np.linalg.norm(dq, axis=-1)
    )
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
    if kind.start_swivels:
        clamp = solved.case.boundary.start_quaternion
        residual[1:3] = before[0] * (relative_matrix(clamp)[:2] @ dq[0])
        residual[3] = before[0, 0] * (rotations.tangent(clamp) @ dm[0])
    elif kind.start_orientation:
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
    turned = turning_weight * max(2.0 * float(np.max(np.linalg.norm(dq, axis=-1))), float(turning.max()))
    # nodes, and what is sampled between them, are off by different things
    return max(float(np.linalg.norm(moved, axis=1).max(axis=0).sum() + apart.max()), turned), local


def solve_along_near_null(solved: Solved) -> Solved:
    """Return a solve carried on along its near-null direction until rounding hides the rest; unchanged without one.

    Where one direction is all but flat, a residual small enough for any other shape still leaves far to go there.
    """
    # part of the residual that following the near-null curve is to leave, and how often
    part_left, most_repeats = 0.3, 12
    if solved.factor.condition < CONDITION_LIMIT:
        return solved
    problem, best = solved.bound.least_squares(), solved.solution
    for _ in range(most_repeats):
        followed = near_null.solve(problem, best.x, Options(part_left * best.residual, 0))
        if not followed.status.ok:
            break
        best = followed
    found = Solved(solved.case, solved.bound, best)
    return solved if best is solved.solution or found.turned else found


def correct_to_rounding(solved: Solved) -> Solved:
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
    # part of the residual that a last correction is to leave, and how many there are
    most_left, most_corrections = 0.5, 4
    for _ in range(most_corrections):
        x = best.x - factor.solve(bound.residual(best.x))
        left = largest(bound.residual(x))
        if not left < most_left * best.residual:
            break
        best = dataclasses.replace(best, x=x, residual=left)
    return best


def batch(frames: Sequence[Solved]) -> Rod:
    """Return the shapes of ``frames``, which share cable and mesh, as one Rod with a leading axis.

    Of a span that changes its length, what is without dimensions does too: rest curvature and load have the axis then.
    """
    rods = [frame.rod for frame in frames]
    stacked = {name: np.stack([getattr(r, name) for r in rods]) for name in ("q", "r", "force", "moment")}
    section, load = rods[0].section, rods[0].load
    rest = [rod.section.rest_curvature for rod in rods]
    if any(not np.array_equal(load, rod.load) for rod in rods) or any(not np.array_equal(rest[0], one) for one in rest):
        section, load = (
            Section(section.stiffness, np.stack(rest)[:, None]),
            np.stack([rod.load for rod in rods])[:, None],
        )
    return Rod(section, load, rods[0].mesh, **stacked)


def estimates(frames: Sequence[Solved]) -> list[tuple[float, Array]]:
    """Return the :attr:`Solved.estimate` of ``frames``, which share cable and mesh: those not known yet together."""
    unknown = [frame for frame in frames if not frame.is_estimated]
    if unknown:
        with np.errstate(over="ignore", invalid="ignore"):
            defects = batch(unknown).defects()
        for k, frame in enumerate(unknown):
            frame.estimate_from(defects.of(k))
    return [frame.estimate for frame in frames]

"""One pose: from two ends to an accurate, stable shape, or an honest failure."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import SolveError, Status
from harness_opt.model import checks
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.ends import End
from harness_opt.model.results import STATIONS, Quantities
from harness_opt.numerics.interface import Solution
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_thread
from harness_opt.rod import equations as rod_module
from harness_opt.rod.boundary import Kind
from harness_opt.rod.equations import Section, Units
from harness_opt.rod.methods import check_method
from harness_opt.rod.stability import stability
from harness_opt.rod.states import Rod
from harness_opt.statics.fitting import PosedRun, posed_run
from harness_opt.statics.mesh import LAST_RESORT, refine
from harness_opt.statics.paper_pose import START_SOLVER, Quadrature, solve_by_quadrature
from harness_opt.statics.solve import Solved, resample, solve_on

SHAPE_TOLERANCE = 1e-9  # of the centreline, in lengths of the cable, for a single shape


@dataclass(frozen=True)
class Shape(Quantities):
    """One equilibrium in SI units, as plain arrays: the quantities at N stations, and how they were found.

    Args:
        status: how the solve ended.
        stable: whether no small motion that the ends allow lowers the energy; of a shape that is not ``ok``, False.
        stability_margin: lowest eigenvalue of the second variation, dimensionless; 0 is neutral.
        energy: elastic energy less the work of gravity from the level of the start, J.
        residual: largest scaled residual of the discretised equations.
        estimated_error: of the centreline, in lengths of the cable.
        iterations: of the solver, in all.
        rod: the solved states without dimensions, for sampling and for going on from here.
    """

    status: Status
    stable: bool
    stability_margin: float
    energy: float
    residual: float
    estimated_error: float
    iterations: int
    rod: Rod
    _units: Units
    _origin: Array

    def __repr__(self) -> str:
        """Return one line."""
        told = (
            f"{'stable' if self.stable else 'unstable'}, energy {self.energy:.4g} J" if self.ok else self.status.value
        )
        return f"<Shape: {1e3 * float(self.s[-1]):.6g} mm at {len(self.s)} stations; {told}>"

    @property
    def ok(self) -> bool:
        """True only for a converged shape of certified accuracy."""
        return self.status.ok

    def at(self, s: ArrayLike) -> Quantities:
        """Return the same quantities at arc lengths ``s`` (m,) or a number, in m, to the accuracy of the solve.

        Raises:
            ValueError: an arc length off the cable.
        """
        wanted = np.atleast_1d(np.asarray(s, dtype=float))
        if wanted.size and (wanted.min() < 0 or wanted.max() > self._units.length * (1 + 1e-12)):
            raise ValueError(f"arc length off the cable: expected 0 to {self._units.length} m, found {s!r}")
        answer = self.rod.sample(wanted / self._units.length).in_si(wanted, self._units, self._origin)
        if np.ndim(s) == 0:
            answer = Quantities(*(getattr(answer, field.name)[0] for field in dataclasses.fields(answer)))
        return answer


@dataclass(frozen=True)
class _Outcome:
    """A solve by either transcription: its rod, status, largest residual, error in L, and iterations."""

    rod: Rod
    status: Status
    residual: float
    error: float
    iterations: int


@one_thread
def equilibrium(  # noqa: PLR0913
    cable: Cable,
    start: End,
    end: End,
    gravity: ArrayLike = (0.0, 0.0, 0.0),
    *,
    transcription: str = "collocation",
    points: int | None = None,
    closure: bool = False,
    solver: str = "gauss-newton",
    tolerance: float = SHAPE_TOLERANCE,
    stations: int = STATIONS,
    bow: ArrayLike | None = None,
    guess: Shape | None = None,
    throw: bool = True,
) -> Shape:
    """Return the shape of a cable between two ends in world coordinates.

    Args:
        cable: the cable.
        start, end: what holds its ends, in world coordinates; an untwisted end is fitted right here, and ``end.turns``
            adds turns of twist to the starting shape.
        gravity: m/s2, (3,).
        transcription: "collocation", or "dqm": the paper's own differential quadrature, from ``guess`` or the same
            first shape, and certified by the collocation.
        points: of "dqm", 5 to 200; None takes as many as the tolerance needs.
        closure: of "dqm": whether the length closure (25) is among its equations.
        solver: "gauss-newton", "levenberg-marquardt", "ipopt", or "paper": eq. (26) as printed, without safeguards.
        tolerance: of the centreline, in lengths of the cable; the mesh is refined until the estimate is below.
        stations: number of equally spaced stations returned; :meth:`Shape.at` gives any other.
        bow: direction to which the starting shape bows where its length leaves the choice; gravity's if None.
        guess: a shape to start from (of a like cable, between like ends), in place of the cold start.
        throw: raise on failure, or return the failed shape.

    Raises:
        ProblemError: ends that no shape can join, unknown names, numbers that are not finite.
        SolveError: no shape was found (only where ``throw``).
    """
    check_method(transcription, solver)
    tolerance = checks.positive("tolerance", tolerance)
    options = Quadrature(points, closure, solver, tolerance)
    run = CableRun(cable, start, end, None if bow is None else checks.direction("bow", bow))
    begin = guess.rod if guess is not None and guess.ok else None
    sought = _Sought(posed_run(run, np.asarray(checks.numbers("gravity", gravity, 3)), solver, begin), guess, stations)
    dqm = transcription == "dqm"
    shape = _by_quadrature(sought, options) if dqm else _by_collocation(sought, tolerance, solver)
    if throw and not shape.ok:
        raise SolveError(f"no shape was found: {shape.status.value}", shape.status, shape)
    return shape


@dataclass(frozen=True)
class _Sought:
    """What :func:`equilibrium` is asked for, checked."""

    pose: PosedRun
    guess: Shape | None
    stations: int

    @property
    def cable(self) -> Cable:
        """The cable."""
        return self.pose.run.cable


def _by_collocation(sought: _Sought, tolerance: float, solver: str) -> Shape:
    """Solve from the guess or from nothing, refine, and return the shape, or a failed one."""
    guess, solved = sought.guess, None
    if guess is None:
        solved = sought.pose.cold_start(solver)
    elif guess.ok:
        mesh = guess.rod.mesh
        solved = solve_on(sought.pose.case, mesh, resample(guess.rod, mesh), solver)
    if solved is None or not solved.ok:
        return _failed(sought.cable, sought.stations, None if solved is None else solved.solution)
    if solved.passed:
        return _failed(sought.cable, sought.stations, _without_contact(solved))
    return refined_shape(sought.cable, sought.pose.ends, solved, tolerance, solver, sought.stations)


def refined_shape(
    cable: Cable, ends: tuple[End, End], solved: Solved, tolerance: float, solver: str, stations: int
) -> Shape:
    """Refine the mesh of a solved case to ``tolerance``; return its shape; arguments as of :func:`equilibrium`."""
    solved, error, status = refine(solved, tolerance, solver, LAST_RESORT[-1])
    outcome = _Outcome(solved.rod, status, solved.solution.residual, error, solved.solution.iterations)
    return _shape(cable, *ends, solved.case.boundary.kind, outcome, stations)


def _by_quadrature(sought: _Sought, options: Quadrature) -> Shape:
    """Solve by the paper's transcription from the guess, or from a cold start's shape; return it, or a failed one."""
    guess, posed = sought.guess, sought.pose.case
    begin = guess.rod if guess is not None and guess.ok else None
    if guess is None:
        solved = sought.pose.cold_start(START_SOLVER)
        if solved is not None and solved.passed:
            return _failed(sought.cable, sought.stations, _without_contact(solved))
        if solved is not None and solved.ok:
            posed, begin = solved.case, solved.rod
    if begin is None:
        return _failed(sought.cable, sought.stations, None)
    answer = solve_by_quadrature(posed, begin, options)
    outcome = _Outcome(answer.rod, answer.status, answer.residual, answer.error, answer.iterations)
    return _shape(sought.cable, *sought.pose.ends, posed.boundary.kind, outcome, sought.stations)


def _without_contact(solved: Solved) -> Solution:
    return dataclasses.replace(solved.solution, status=Status.NOT_WITHOUT_CONTACT)


def _shape(cable: Cable, start: End, end: End, kind: Kind, outcome: _Outcome, stations: int) -> Shape:
    """Return a solved rod in SI units."""
    units, rod = rod_module.scale(cable)[1], outcome.rod
    answer = stability(rod, kind)
    if start.position is not None:
        origin = np.asarray(start.position)
    else:
        origin = np.asarray(end.position) - units.length * rod.r[-1]
    s = np.linspace(0.0, cable.length, stations)
    return Shape(
        **vars(rod.sample(s / units.length).in_si(s, units, origin)),
        status=outcome.status,
        stable=outcome.status.ok and bool(answer.stable),
        stability_margin=float(answer.margin),
        energy=float(rod.energy()) * units.moment,
        residual=outcome.residual,
        estimated_error=outcome.error,
        iterations=outcome.iterations,
        rod=rod,
        _units=units,
        _origin=origin,
    )


def _failed(cable: Cable, stations: int, solution: Solution | None) -> Shape:
    """Return a shape that carries how it ended, None for no start, and no numbers."""
    s, units = np.linspace(0.0, cable.length, stations), rod_module.scale(cable)[1]
    status, residual, iterations = Status.NO_START, np.inf, 0
    if solution is not None:
        status, residual, iterations = solution.status, solution.residual, solution.iterations
    unknown = np.full((len(s), 3), np.nan)
    nothing = Rod(Section(np.ones(3), np.zeros(3)), np.zeros(3), np.zeros(0), *(np.zeros((0, k)) for k in (4, 3, 3, 3)))
    return Shape(
        s=s,
        position=unknown,
        quaternion=np.full((len(s), 4), np.nan),
        curvature=unknown,
        force=unknown,
        moment=unknown,
        status=status,
        stable=False,
        stability_margin=np.nan,
        energy=np.nan,
        residual=residual,
        estimated_error=np.inf,
        iterations=iterations,
        rod=nothing,
        _units=units,
        _origin=np.zeros(3),
    )

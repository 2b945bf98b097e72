"""One pose: from two ends to an accurate, stable shape, or an honest failure.

Cold: a length-true curve is relaxed to a minimum of its energy on a coarse chain, then solved accurately; where that fails,
an easier case is solved first and followed to the one asked for. Warm: the solve starts from a shape given.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from . import rod as rod_module
from . import rotations
from .boundary import Case, case
from .continuation import ELEMENTS, SOLVERS, STAGES, Solved, error_estimate, follow, refine, resample, solve_on
from .errors import ProblemError, SolveError, Status
from .problem import Cable, End
from .rod import Section, Units
from .rotations import Array
from .shape import Rod
from .stability import lowest_mode, stability
from .starting_curve import starting_curve
from .transcriptions import chain
from .transcriptions.collocation import pack
from .transcriptions.collocation import stations as collocation_stations

TOLERANCE = 1e-9  # of the centreline, in lengths of the cable, for a single shape
STATIONS = 101
NUDGES = (0.05, 0.2, 0.6)  # rad, largest turning of a section, to leave a saddle of the energy or a minimum just lost
RESOLVED = 0.02  # estimated error, in L, above which a solve on a coarse mesh is not taken for a shape of the cable
DESCENTS = 4  # descents from one unstable shape before it is returned as unstable


@dataclass(frozen=True)
class Shape:
    """One equilibrium in SI units, as plain arrays.

    Args:
        s: arc lengths of the stations, m, (N,).
        position, quaternion, curvature, force, moment: there, (N, 3) or (N, 4); see ``motion.npz``.
        status: how the solve ended.
        stable: whether no small motion that the ends allow lowers the energy.
        stability_margin: lowest eigenvalue of the second variation, dimensionless; 0 is neutral.
        energy: elastic energy less the work of gravity from the level of the start, J.
        residual: largest scaled residual of the discretised equations.
        estimated_error: of the centreline, in lengths of the cable.
        iterations: of the solver, in all.
    """

    s: Array
    position: Array
    quaternion: Array
    curvature: Array
    force: Array
    moment: Array
    status: Status
    stable: bool
    stability_margin: float
    energy: float
    residual: float
    estimated_error: float
    iterations: int
    _rod: Rod
    _units: Units
    _origin: Array

    @property
    def ok(self) -> bool:
        """True only for a converged shape of certified accuracy."""
        return self.status.ok

    def at(self, s: ArrayLike) -> ShapeAt:
        """Return the same quantities at arc lengths ``s`` (m,) or a number, in m, to the accuracy of the solve.

        Raises:
            ValueError: an arc length off the cable.
        """
        wanted = np.atleast_1d(np.asarray(s, dtype=float))
        if wanted.size and (wanted.min() < 0 or wanted.max() > self._units.length * (1 + 1e-12)):
            raise ValueError(f"arc length off the cable: expected 0 to {self._units.length} m, found {s}")
        answer = _sampled(self._rod, self._units, self._origin, wanted)
        if np.ndim(s) == 0:
            answer = ShapeAt(*(getattr(answer, field.name)[0] for field in dataclasses.fields(answer)))
        return answer


@dataclass(frozen=True)
class ShapeAt:
    """Quantities of a shape at chosen arc lengths; fields as in :class:`Shape`."""

    s: Array
    position: Array
    quaternion: Array
    curvature: Array
    force: Array
    moment: Array


def _sampled(rod: Rod, units: Units, origin: Array, s: Array) -> ShapeAt:
    samples = rod.sample(s / units.length)
    return ShapeAt(
        s,
        origin + units.length * samples.r,
        samples.q,
        samples.omega / units.length,
        units.force * samples.force,
        units.moment * samples.moment,
    )


def _from_chain(case: Case, state: chain.ChainState, mesh: Array) -> Array:
    """Return the unknowns on ``mesh`` that describe a chain."""
    s, nodes = collocation_stations(mesh, STAGES), np.linspace(0.0, 1.0, len(state.q))
    q = rotations.normalise(np.stack([np.interp(s, nodes, state.q[:, i]) for i in range(4)], axis=1))
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    strain = np.stack([np.interp(s, middles, state.omega[:, i]) for i in range(3)], axis=1) - case.section.rest_curvature
    return pack(q, rotations.rotate(q, case.section.stiffness * strain), state.force, STAGES)


def _relaxed(case: Case, q: Array, r: Array, solver: str) -> Solved | None:
    """Relax a shape on the chain and solve it; None where either fails."""
    state = chain.relax(case.section, case.load, case.boundary, q, r)
    if state is None:
        return None
    still = dataclasses.replace(case.boundary, start_moment=np.zeros(3), end_moment=np.zeros(3))
    without_moments = dataclasses.replace(case, boundary=still)
    first = ELEMENTS[0]
    for elements, method in ((first, solver), (2 * first, solver), (2 * first, "levenberg-marquardt"), (4 * first, solver)):
        mesh = np.linspace(0.0, 1.0, elements + 1)
        solved = solve_on(without_moments, mesh, _from_chain(without_moments, state, mesh), method)
        if solved.ok and not solved.turned and error_estimate(solved)[0] < RESOLVED:
            break
    else:
        return None
    if np.any(case.boundary.start_moment) or np.any(case.boundary.end_moment):
        solved, reached = follow(lambda t: without_moments.blend(case, t), solved, 0.0, 1.0, solver)
        if reached < 1.0:
            return None
    return solved


def let_go(case: Case, rod: Rod, solver: str) -> Solved | None:
    """Let the cable go from ``rod`` to where its energy is least nearby; None where it lands nowhere.

    ``case`` may differ from what ``rod`` was solved for: after a fold the old shape does not exist any more. The shape is
    nudged along its weakest direction, harder where the coarse chain still holds a minimum that the cable itself
    has lost.
    """
    direction = lowest_mode(rod, case.boundary.kind)
    for nudge in NUDGES:
        for sign in (1.0, -1.0):
            landed = _descend(case, rod, sign * nudge * direction, solver)
            if landed is not None:
                return landed
    return None


def _descend(case: Case, rod: Rod, field: Array, solver: str) -> Solved | None:
    """Relax ``rod`` turned by ``field`` (n + 1, 3), in its section frames at the nodes, rad; None where that fails."""
    nodes = np.linspace(0.0, 1.0, chain.SEGMENTS + 1)
    samples = rod.sample(nodes)
    field = np.stack([np.interp(nodes, rod.mesh, field[:, i]) for i in range(3)], axis=1)
    q = rotations.multiply(samples.q, rotations.from_rotation_vector(field))
    return _relaxed(case, q, samples.r, solver)


def stabilise(solved: Solved, solver: str) -> Solved:
    """Descend from an unstable shape until a stable one is reached; returns ``solved`` itself where none is found."""
    kind, here = solved.case.boundary.kind, solved
    for _ in range(DESCENTS):
        if bool(stability(here.rod, kind).stable):
            return here
        lower = let_go(solved.case, here.rod, solver)
        if lower is None:
            return solved
        here = lower
    return here if bool(stability(here.rod, kind).stable) else solved


def _easier(case: Case) -> list[Case]:
    """Return cases that a chain relaxes without trouble, the nearest to ``case`` first."""
    heavy = float(np.linalg.norm(case.load))
    light = case.load if heavy <= 300.0 else case.load * (100.0 / heavy)
    stiffness = np.clip(case.section.stiffness, 0.1, 10.0)
    slack = dataclasses.replace(case.boundary, gap=0.9 * case.boundary.gap)
    return [
        Case(case.section, light, case.boundary),
        Case(case.section, light, slack),
        Case(Section(stiffness, case.section.rest_curvature), light, slack),
        Case(Section(stiffness, case.section.rest_curvature), np.zeros(3) * light, slack),
    ]


def cold_start(case: Case, turns: int, bow: Array | None, solver: str) -> Solved | None:
    """Find a shape for ``case`` from its ends alone; None where nothing worked."""
    if bow is None and np.any(case.load):
        bow = case.load
    r, q = starting_curve(case.boundary, chain.SEGMENTS + 1, turns, bow)
    boundary = case.boundary
    if boundary.kind.end_orientation:  # the curve decides which of the two signs stands for the turns asked for
        sign = 1.0 if q[-1] @ boundary.end_quaternion >= 0 else -1.0
        boundary = dataclasses.replace(boundary, end_quaternion=sign * boundary.end_quaternion)
    case = dataclasses.replace(case, boundary=boundary)
    found = _relaxed(case, q, r, solver)
    for easier in _easier(case) if found is None else ():
        begin = _relaxed(easier, q, r, solver)
        if begin is None:
            continue
        end, reached = follow(lambda t, a=easier: a.blend(case, t), begin, 0.0, 1.0, solver)  # type: ignore[misc]
        if reached == 1.0:
            found = end
            break
    return None if found is None else stabilise(found, solver)


def check_method(transcription: str, solver: str) -> None:
    """Raise ProblemError where a transcription or solver of that name does not exist."""
    if transcription != "collocation":
        raise ProblemError(f"transcription: found {transcription!r}, expected 'collocation'")
    if solver not in SOLVERS:
        raise ProblemError(f"solver: found {solver!r}, expected one of {', '.join(map(repr, SOLVERS))}")


def equilibrium(
    cable: Cable,
    start: End,
    end: End,
    gravity: ArrayLike = (0.0, 0.0, 0.0),
    *,
    transcription: str = "collocation",
    solver: str = "gauss-newton",
    tolerance: float = TOLERANCE,
    stations: int = STATIONS,
    bow: ArrayLike | None = None,
    guess: Shape | None = None,
    throw: bool = True,
) -> Shape:
    """Return the shape of a cable between two ends in world coordinates.

    Args:
        cable: the cable.
        start, end: what holds its ends; ``end.turns`` adds whole turns of twist to the starting shape.
        gravity: m/s2, (3,).
        transcription: "collocation".
        solver: "gauss-newton", "levenberg-marquardt" or "ipopt".
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
    acceleration = np.asarray(gravity, dtype=float)
    if acceleration.shape != (3,) or not np.all(np.isfinite(acceleration)):
        raise ProblemError(f"gravity: found {gravity!r}, expected 3 finite numbers")
    posed = case(cable, start, end, acceleration)
    if guess is not None:
        mesh = guess._rod.mesh
        solved: Solved | None = solve_on(posed, mesh, resample(guess._rod, mesh), solver)
    else:
        direction = None if bow is None else np.asarray(bow, dtype=float)
        solved = cold_start(posed, end.turns, direction, solver)
    shape = _shape(cable, start, end, solved, tolerance, stations, solver)
    if throw and not shape.ok:
        raise SolveError(f"no shape was found: {shape.status.value}", shape.status, shape)
    return shape


def _shape(
    cable: Cable, start: End, end: End, solved: Solved | None, tolerance: float, stations: int, solver: str
) -> Shape:
    _, units = rod_module.scale(cable)
    s = np.linspace(0.0, cable.length, stations)
    if solved is None:
        return _failed(s, units, Status.NO_START, np.inf, 0)
    if not solved.ok:
        return _failed(s, units, solved.solution.status, solved.solution.residual, solved.solution.iterations)
    solved, error, status = refine(solved, tolerance, solver)
    rod = solved.rod
    answer = stability(rod, solved.case.boundary.kind)
    if start.position is not None:
        origin = np.asarray(start.position)
    else:
        origin = np.asarray(end.position) - units.length * rod.r[-1]
    at = _sampled(rod, units, origin, s)
    return Shape(
        s,
        at.position,
        at.quaternion,
        at.curvature,
        at.force,
        at.moment,
        status,
        bool(answer.stable),
        float(answer.margin),
        float(rod.energy()) * units.moment,
        solved.solution.residual,
        error,
        solved.solution.iterations,
        rod,
        units,
        origin,
    )


def _failed(s: Array, units: Units, status: Status, residual: float, iterations: int) -> Shape:
    """Return a shape that carries a status and no numbers."""
    vector, quaternion = np.full((len(s), 3), np.nan), np.full((len(s), 4), np.nan)
    nothing = Rod(Section(np.ones(3), np.zeros(3)), np.zeros(3), np.zeros(0), *(np.zeros((0, k)) for k in (4, 3, 3, 3)))
    return Shape(
        s, vector, quaternion, vector, vector, vector, status, False, np.nan, np.nan, residual, np.inf, iterations,
        nothing, units, np.zeros(3),
    )  # fmt: skip

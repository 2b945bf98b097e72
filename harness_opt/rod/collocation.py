"""The rod by Gauss collocation on elements: a sparse nonlinear least-squares problem posed in CasADi.

Unknowns are the quaternion and the moment at every node, the quaternion at every Gauss point (stage) of every
element, and the one constant of the force. Moments and positions at the stages are quadratures of these, so arc
length is exact and eq. (25) of Liu et al. is not needed; Gauss's method conserves |q|, so neither is eq. (10).
Frames are those of q / |q| all the same: in a taut cable what a step leaves of |q|^2 - 1 at the stages would be no
small part of the slack.

One element is written symbolically and differentiated once; the mesh is a map of it, and everything that a user can
change (stiffness, weight, mesh, clamps) is a parameter, so nothing is built twice for one kind of cable.
"""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from harness_opt.numerics import rotations
from harness_opt.numerics.interface import Equations, LeastSquares
from harness_opt.numerics.machine_code import Buffered, wanted
from harness_opt.numerics.quadrature import gauss
from harness_opt.numerics.rotations import Array
from harness_opt.rod import collocation_element as element
from harness_opt.rod.boundary import (
    END_ENTRIES,
    START_ENTRIES,
    Boundary,
    Kind,
    relative_matrix,
    swivel_rates,
)
from harness_opt.rod.collocation_element import (
    CLOSURE,
    FORCE,
    NODE,
    PARAMETERS,
    Symbols,
)
from harness_opt.rod.equations import Section
from harness_opt.rod.states import Rod

Indices = NDArray[np.integer[Any]]

START = 4  # equations of the start


class Collocation:
    """The transcription for one number of elements, of stages, and with or without a load; see the module.

    Args:
        elements: n.
        stages: Gauss points an element; the order at the nodes is twice that.
        loaded: False leaves the load integrals out.
        machine: whether the functions are machine code.
    """

    def __init__(self, elements: int, stages: int, loaded: bool, machine: bool):
        self.elements, self.stages, self.loaded, self._machine = elements, stages, loaded, machine
        functions = element.functions(stages, loaded, machine)
        self.element_pattern = functions.jacobian.sparsity_out(0)
        block = NODE + 4 * stages
        self.size = block * elements + NODE + FORCE
        force = np.tile(np.arange(self.size - FORCE, self.size)[:, None], elements)
        self.gather = np.concatenate([np.arange(block + NODE)[:, None] + block * np.arange(elements), force])
        self.quaternions = block * np.arange(elements + 1)[:, None] + np.arange(4)  # of the nodes, among the unknowns
        self.parameters = 2 * elements + sum(PARAMETERS)
        self.entries = self._of_all(functions.jacobian)
        self._residuals: dict[Kind, Buffered] = {}

    def side_by_side(self, function: ca.Function, x: Symbols, p: Symbols) -> Symbols:
        """Return a function of one element for all of them, column by column, at unknowns and parameters of all."""
        steps, starts, stiffness, rest, load = element.split(p, self.elements)[:5]
        z = ca.reshape(x[self.gather.T.ravel().tolist()], *self.gather.shape)
        shared = [3, 4, 5]  # stiffness, rest curvature and load are one for all elements
        every = function.map("every", "serial", self.elements, shared, [])
        return every(z, steps.T, starts.T, stiffness, rest, load)

    def _of_all(self, function: ca.Function) -> Buffered:
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", self.parameters)
        return Buffered(ca.Function("of_all", [x, p], [self.side_by_side(function, x, p)]))

    @functools.cached_property
    def parameter_rates(self) -> tuple[Buffered, ca.Sparsity]:
        """The elements' derivatives by rest curvature and load, one after the other, and their pattern in each."""
        function = element.rates(self.stages, self.loaded, self._machine)
        return self._of_all(function), function.sparsity_out(0)

    def residual(self, kind: Kind) -> Buffered:
        """Return R(x, p) for ends of a kind."""
        if kind not in self._residuals:
            self._residuals[kind] = self._residual(kind)
        return self._residuals[kind]

    def _residual(self, kind: Kind) -> Buffered:
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", self.parameters)
        table = self.side_by_side(element.functions(self.stages, self.loaded, self._machine).equations, x, p)
        return Buffered(ca.Function("residual", [x, p], [element.assembled(x, p, table, kind)]))

    def bind(self, section: Section, load: Array, boundary: Boundary, mesh: Array) -> BoundCollocation:
        """Return the equations of a dimensionless cable under ``load`` (3,) between two ends on ``mesh`` (n + 1,)."""
        return BoundCollocation(self, section, np.asarray(load, dtype=float), boundary, mesh)


_built = functools.lru_cache(maxsize=32)(Collocation)


def collocation(elements: int, stages: int, loaded: bool) -> Collocation:
    """Return the transcription, built once per process; arguments as of :class:`Collocation`."""
    return _built(elements, stages, loaded, wanted())


@functools.lru_cache(maxsize=128)
def _pattern(elements: int, stages: int, loaded: bool, kind: Kind) -> tuple[Indices, Indices, Indices]:
    """Return (permutation, indices, indptr): from element entries and boundary entries to the CSC Jacobian."""
    transcription = collocation(elements, stages, loaded)
    rows_e, columns_e = (np.array(x) for x in transcription.element_pattern.get_triplet())
    count = 4 * stages + NODE
    closure = START + elements * count
    rows, columns = [], []
    for e in range(elements):
        inner = rows_e < count
        rows.append(np.where(inner, START + e * count + rows_e, closure + rows_e - count))
        columns.append(transcription.gather[columns_e, e])
    if not (kind.start_position and kind.end_position):  # no closure: the chords stay out of the equations
        rows = [np.where(r >= closure, -1, r) for r in rows]
    node, force = (NODE + 4 * stages) * elements, transcription.size - FORCE
    end = closure + CLOSURE
    rows.append(np.array(START_ENTRIES[kind.start_held][0]))
    columns.append(np.array(START_ENTRIES[kind.start_held][1]))
    if not (kind.start_position and kind.end_position):
        rows.append(closure + np.arange(3))
        columns.append(force + np.arange(3))
    rows.append(end + np.array(END_ENTRIES[kind.end_held][0]))
    columns.append(node + np.array(END_ENTRIES[kind.end_held][1]))
    row, column = np.concatenate(rows), np.concatenate(columns)
    used = np.flatnonzero(row >= 0)
    order = used[np.lexsort((row[used], column[used]))]
    indptr = np.searchsorted(column[order], np.arange(transcription.size + 1))
    return order, row[order].astype(np.int32), indptr.astype(np.int32)


@functools.lru_cache(maxsize=32)
def _equations(elements: int, stages: int, loaded: bool, kind: Kind) -> Equations:
    """Return R(x, p) in scalar symbols; p as in :func:`split`."""
    t = _built(elements, stages, loaded, False)  # symbols don't go through machine code
    x, p = ca.SX.sym("x", t.size), ca.SX.sym("p", t.parameters)
    table = t.side_by_side(element.functions(stages, loaded, False).equations, x, p)
    return Equations(x, p, element.assembled(x, p, table, kind))


def stations(mesh: Array, stages: int) -> Array:
    """Return the arc lengths of all quaternions in x: each node, then its element's stages; (n (stages + 1) + 1,)."""
    inner = mesh[:-1, None] + np.diff(mesh)[:, None] * np.concatenate([[0.0], gauss(stages).nodes])
    return np.concatenate([inner.ravel(), mesh[-1:]])


def pack(q: Array, moment: Array, force: Array, stages: int) -> Array:
    """Return x (..., m) from quaternions (..., S, 4) and moments (..., S, 3) at the S :func:`stations`, and the force
    at 0 (..., 3)."""
    lead = q.shape[:-2]
    inner = q[..., :-1, :].reshape(*lead, -1, stages + 1, 4)
    blocks = np.concatenate(
        [
            inner[..., 0, :],
            moment[..., :-1, :].reshape(*lead, -1, stages + 1, 3)[..., 0, :],
            inner[..., 1:, :].reshape(*inner.shape[:-2], 4 * stages),
        ],
        axis=-1,
    )
    return np.concatenate([blocks.reshape(*lead, -1), q[..., -1, :], moment[..., -1, :], force], axis=-1)


class BoundCollocation:
    """The equations of one cable between two ends: residual, Jacobian, parameter rates, and the way in and out.

    Args:
        transcription: the kind of equations.
        section, load, boundary: the cable and its ends, dimensionless.
        mesh: nodes from 0 to 1, (n + 1,).
    """

    def __init__(self, transcription: Collocation, section: Section, load: Array, boundary: Boundary, mesh: Array):
        self.transcription, self.boundary, self.mesh = transcription, boundary, mesh
        self.section, self.load = section, load
        n, s, kind = transcription.elements, transcription.stages, boundary.kind
        self._residual, self._pattern = transcription.residual(kind), _pattern(n, s, transcription.loaded, kind)
        self._node = (NODE + 4 * s) * n
        self._relative = relative_matrix(boundary.end_quaternion)
        self._values = np.concatenate(
            (
                mesh[1:] - mesh[:-1], mesh[:-1], section.stiffness, section.rest_curvature, load, boundary.gap,
                boundary.start_quaternion, self._relative.ravel("F"), boundary.start_force, boundary.end_force,
                boundary.start_moment, boundary.end_moment,
            )
        )  # fmt: skip

    # -- residual and derivatives ------------------------------------------------------------------------------

    def residual(self, x: Array) -> Array:
        """Return R(x) (m,), m = n."""
        return self._residual(x, self._values).copy()

    def linearise(self, x: Array) -> tuple[Array, sp.csc_array]:
        """Return R(x) and its Jacobian."""
        t, kind = self.transcription, self.boundary.kind
        entries = t.entries(x, self._values)
        boundary_entries = self._start_entries(x)
        if not (kind.start_position and kind.end_position):
            boundary_entries.append(np.ones(3))
        if kind.end_swivels:
            boundary_entries += [self._relative[:2].ravel(), rotations.tangent(self.boundary.end_quaternion)]
        else:
            boundary_entries.append(self._relative.ravel() if kind.end_orientation else np.ones(3))
        order, indices, indptr = self._pattern
        data = np.concatenate([entries, *boundary_entries])[order]
        return self.residual(x), sp.csc_array((data, indices, indptr), shape=(t.size, t.size))

    def _start_entries(self, x: Array) -> list[Array]:
        """Return the entries of the Jacobian that belong to the start's equations."""
        clamp, kind = self.boundary.start_quaternion, self.boundary.kind
        if kind.start_swivels:
            return [2 * x[:4], relative_matrix(clamp)[:2].ravel(), rotations.tangent(clamp)]
        return [np.ones(4)] if kind.start_orientation else [2 * x[:4], np.ones(3)]

    def parametric(self) -> tuple[Equations, Array]:
        """Return the equations of this kind in symbols, and the values of their parameters."""
        t = self.transcription
        return _equations(t.elements, t.stages, t.loaded, self.boundary.kind), self._values

    def symbolic(self) -> tuple[ca.SX, ca.SX]:
        """Return (x, R(x)) as CasADi expressions, for solvers that differentiate themselves."""
        equations, values = self.parametric()
        return equations.unknowns, ca.substitute(equations.residual, equations.parameters, ca.DM(values))

    def least_squares(self) -> LeastSquares:
        """Return the problem as a solver takes it."""
        return LeastSquares(self.residual, self.linearise, self.symbolic, self.parametric)

    # -- in and out --------------------------------------------------------------------------------------------

    def quaternions(self, x: Array) -> Array:
        """Return the quaternions at the nodes (n + 1, 4)."""
        q: Array = x[self.transcription.quaternions]
        return q

    def last_quaternion(self, x: Array) -> Array:
        """Return the quaternion at the end of the cable, (4,)."""
        return x[self._node : self._node + 4]

    def rod(self, x: Array) -> Rod:
        """Return the states at the nodes; the centreline is the integral (17) by the elements' own quadrature."""
        n, s = self.transcription.elements, self.transcription.stages
        blocks = x[: self._node].reshape(n, NODE + 4 * s)
        steps = np.diff(self.mesh)
        tangents = rotations.tangent(rotations.normalise(blocks[:, 7:].reshape(n, s, 4)))
        chords = steps[:, None] * np.einsum("j,ejc->ec", gauss(s).weights, tangents)
        q = self.quaternions(x)
        moment = np.vstack([blocks[:, 4:7], x[self._node + 4 : self._node + 7]])
        r = np.vstack([np.zeros(3), np.cumsum(chords, axis=0)])
        force = x[-3:] - self.mesh[:, None] * self.load
        return Rod(self.section, self.load, self.mesh, q, r, force, moment)

    # -- sensitivities -----------------------------------------------------------------------------------------

    def rates(
        self,
        x: Array,
        *,
        gap: Array,
        start_turn: Array,
        end_turn: Array,
        rest: Array,
        load: Array,
        loads: dict[str, Array] | None = None,
    ) -> Array:
        """Return dR (m, k) for k simultaneous changes of the parameters, at fixed x.

        Args:
            gap: change of the end's position relative to the start, (3, k).
            start_turn, end_turn: small rotations of the clamps about their own axes, (3, k), rad.
            rest, load: changes of the dimensionless rest curvature and load, (3, k).
            loads: changes of applied loads by their names in :class:`Boundary`, (3, k) each.
        """
        t, b = self.transcription, self.boundary
        count, k = 4 * t.stages + NODE, gap.shape[1]
        out = np.zeros((t.size, k))
        if np.any(rest) or np.any(load):
            function, pattern = t.parameter_rates
            entries = function(x, self._values)
            rows, columns = (np.array(v) for v in pattern.get_triplet())
            table = np.zeros((t.elements, *pattern.shape))
            table[:, rows, columns] = entries.reshape(t.elements, -1)
            changed = table @ np.vstack([rest, load])
            out[START : START + t.elements * count] = changed[:, :count].reshape(-1, k)
        closure, end = START + t.elements * count, START + t.elements * count + CLOSURE
        applied = {name: np.zeros((3, k)) for name in ("start_force", "end_force", "start_moment", "end_moment")}
        applied.update(loads or {})
        if b.kind.start_swivels:
            out[1:4] = swivel_rates(b.start_quaternion, start_turn, x[:NODE])
        elif b.kind.start_orientation:
            turned = rotations.multiply(b.start_quaternion, np.pad(start_turn.T, ((0, 0), (1, 0))))
            out[:4] = -0.5 * turned.T
        else:
            out[1:4] = applied["start_moment"]
        if b.kind.start_position and b.kind.end_position:
            out[closure : closure + 3] = -gap
        elif b.kind.start_position:
            out[closure : closure + 3] = -load - applied["end_force"]
        else:
            out[closure : closure + 3] = applied["start_force"]
        if b.kind.end_swivels:
            out[end:] = swivel_rates(b.end_quaternion, end_turn, x[self._node : self._node + NODE])
        elif b.kind.end_orientation:
            relative = rotations.multiply(rotations.conjugate(b.end_quaternion), x[self._node : self._node + 4])
            out[end:] = -0.5 * rotations.multiply(np.pad(end_turn.T, ((0, 0), (1, 0))), relative).T[1:]
        else:
            out[end:] = -applied["end_moment"]
        return out

    def moment_rates(self, dx: Array) -> Array:
        """Return the moments' rates at the nodes (n + 1, 3, k) from those of the unknowns ``dx`` (m, k)."""
        n, k = self.transcription.elements, dx.shape[1]
        blocks = dx[: self._node].reshape(n, -1, k)
        return np.concatenate([blocks[:, 4:NODE], dx[None, self._node + 4 : self._node + NODE]])

    def node_rates(self, x: Array, dx: Array) -> Array:
        """Return the rates of positions at the nodes, from the start of the cable, (n + 1, 3, k); as below."""
        n, s, k = self.transcription.elements, self.transcription.stages, dx.shape[1]
        stage_q, stage_dq = (of[: self._node].reshape(n, NODE + 4 * s, -1)[:, NODE:] for of in (x, dx))
        rates = _tangent_rates(stage_q.reshape(n, s, 4), stage_dq.reshape(n, s, 4, k))
        chords = np.diff(self.mesh)[:, None] * (gauss(s).weights @ rates.reshape(n, s, 3 * k))
        return np.concatenate([np.zeros((1, 3, k)), np.cumsum(chords, axis=0).reshape(n, 3, k)])

    def centreline_rates(self, x: Array, dx: Array) -> tuple[Array, Array, Any]:
        """Return (positions (S, 3), their rates (S, 3, k), quaternions' rates (S, 4, k)) at :func:`stations`.

        Args:
            x: unknowns.
            dx: their rates, (n, k).

        Positions are relative to the start of the cable.
        """
        n, s, k = self.transcription.elements, self.transcription.stages, dx.shape[1]
        block = NODE + 4 * s
        steps = np.diff(self.mesh)
        stage_q = x[: self._node].reshape(n, block)[:, 7:].reshape(n, s, 4)
        stage_dq = dx[: self._node].reshape(n, block, k)[:, 7:].reshape(n, s, 4, k)
        tangents = rotations.tangent(rotations.normalise(stage_q))
        rates = _tangent_rates(stage_q, stage_dq)
        matrix = gauss(s).running
        inner = steps[:, None, None] * np.einsum("ij,ejc->eic", matrix, tangents)
        inner_rates = steps[:, None, None, None] * np.einsum("ij,ejck->eick", matrix, rates)
        return (
            _accumulate(inner),
            _accumulate(inner_rates),
            np.concatenate(
                [
                    np.concatenate([dx[: self._node].reshape(n, block, k)[:, None, :4], stage_dq], axis=1).reshape(
                        -1, 4, k
                    ),
                    dx[None, self._node : self._node + 4],
                ]
            ),
        )


# What each part of a quaternion contributes to the derivatives of d3 by its parts, (4, 12).
_BY_QUATERNION = 2.0 * np.array(
    [
        [[0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0]],
        [[0, 0, 0, 1], [-1, 0, 0, 0], [0, -1, 0, 0]],
        [[1, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]],
        [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    ],
    dtype=float,
).reshape(4, 12)


def _tangent_rates(q: Array, dq: Array) -> Array:
    """Return d(d3) (..., 3, k) for quaternions (..., 4), normalised, and their rates (..., 4, k)."""
    square = np.sum(q * q, axis=-1)[..., None, None]
    across = dq - q[..., None] * (q[..., None, :] @ dq) / square
    rates: Array = (q @ _BY_QUATERNION).reshape(*q.shape[:-1], 3, 4) @ across / square
    return rates


def _accumulate(inner: Array) -> Array:
    """Turn integrals from each element's start (n, s + 1, ...) into integrals from 0 at every station."""
    ends = np.concatenate([np.zeros((1, *inner.shape[2:])), np.cumsum(inner[:, -1], axis=0)])
    stages = ends[:-1, None] + inner[:, :-1]
    nodes_and_stages = np.concatenate([ends[:-1, None], stages], axis=1)
    return np.concatenate([nodes_and_stages.reshape(-1, *inner.shape[2:]), ends[-1:]])

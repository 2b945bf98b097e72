"""SciPy's ``solve_bvp`` on the rod, set up as well as we know how: the peer of ``work_precision.py``.

Unknowns q, M and r with the constant force as three parameters: ten equations in place of thirteen; analytic
Jacobians of equations and end conditions, vectorised over the mesh. Warm starts extrapolate the last two solutions.
Clamped ends and ends under a dead force and moment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp

from harness_opt.rod.boundary import Case

Array = np.ndarray


def _products() -> Array:
    """Return T (3, 3, 4, 4), symmetric in the last two: R_ij(q) = q T_ij q."""
    a, b, c, d = np.eye(4)

    def o(u: Array, v: Array) -> Array:
        return 0.5 * (np.outer(u, v) + np.outer(v, u))

    return np.array(
        [
            [o(a, a) + o(b, b) - o(c, c) - o(d, d), 2 * (o(b, c) - o(a, d)), 2 * (o(b, d) + o(a, c))],
            [2 * (o(b, c) + o(a, d)), o(a, a) - o(b, b) + o(c, c) - o(d, d), 2 * (o(c, d) - o(a, b))],
            [2 * (o(b, d) - o(a, c)), 2 * (o(c, d) + o(a, b)), o(a, a) - o(b, b) - o(c, c) + o(d, d)],
        ]
    )


SLOPES = 2 * _products().reshape(36, 4)  # (i, j, a) x b: R's derivative by q is linear in q


@dataclass(frozen=True)
class Peer:
    """The boundary value problem of one case."""

    case: Case

    def _frames(self, q: Array) -> tuple[Array, Array]:
        """Return R (3, 3, m) and dR/dq (3, 3, 4, m)."""
        slopes = (SLOPES @ q).reshape(3, 3, 4, -1)
        return 0.5 * np.einsum("ijam,am->ijm", slopes, q), slopes

    def rates(self, s: Array, y: Array, p: Array) -> Array:
        """Return y' (10, m) of y = (q, M, r)."""
        q, moment = y[:4], y[4:7]
        frame, _ = self._frames(q)
        section = self.case.section
        w = np.einsum("jim,jm->im", frame, moment) / section.stiffness[:, None] + section.rest_curvature[:, None]
        force, t = p[:, None] - self.case.load[:, None] * s, frame[:, 2]
        out = np.empty_like(y)
        out[0] = -0.5 * (q[1] * w[0] + q[2] * w[1] + q[3] * w[2])
        out[1] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1])
        out[2] = 0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2])
        out[3] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0])
        out[4] = t[2] * force[1] - t[1] * force[2]
        out[5] = t[0] * force[2] - t[2] * force[0]
        out[6] = t[1] * force[0] - t[0] * force[1]
        out[7:] = t
        return out

    def jacobian(self, s: Array, y: Array, p: Array) -> tuple[Array, Array]:
        """Return dy'/dy (10, 10, m) and dy'/dp (10, 3, m)."""
        q, moment = y[:4], y[4:7]
        frame, slopes = self._frames(q)
        section = self.case.section
        k = section.stiffness[:, None]
        w = np.einsum("jim,jm->im", frame, moment) / k + section.rest_curvature[:, None]
        by_q = np.einsum("jiam,jm->iam", slopes, moment) / k[:, None]
        by_moment = np.swapaxes(frame, 0, 1) / k[:, None]
        zero = np.zeros_like(q[0])
        left = 0.5 * np.array(  # q' = left w
            [[-q[1], -q[2], -q[3]], [q[0], -q[3], q[2]], [q[3], q[0], -q[1]], [-q[2], q[1], q[0]]]
        )
        turn = 0.5 * np.array(  # q' = turn q
            [[zero, -w[0], -w[1], -w[2]], [w[0], zero, w[2], -w[1]], [w[1], -w[2], zero, w[0]],
             [w[2], w[1], -w[0], zero]]
        )  # fmt: skip
        out, by_force = np.zeros((10, 10, len(s))), np.zeros((10, 3, len(s)))
        out[:4, :4] = turn + np.einsum("aim,ibm->abm", left, by_q)
        out[:4, 4:7] = np.einsum("aim,ijm->ajm", left, by_moment)
        force, t, dt = p[:, None] - self.case.load[:, None] * s, frame[:, 2], slopes[:, 2]
        for i, j, k3 in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # -(t x F)_i = t_k F_j - t_j F_k
            out[4 + i, :4] = dt[k3] * force[j] - dt[j] * force[k3]
            by_force[4 + i, j], by_force[4 + i, k3] = t[k3], -t[j]
        out[7:, :4] = dt
        return out, by_force

    def _relative(self) -> Array:
        a, b, c, d = self.case.boundary.end_quaternion
        return np.array([[-b, a, d, -c], [-c, -d, a, b], [-d, c, -b, a]])

    def ends(self, first: Array, last: Array, p: Array) -> Array:
        """Return the 13 end conditions."""
        b = self.case.boundary
        if b.kind.end_position:
            beyond = np.concatenate([last[7:] - b.gap, self._relative() @ last[:4]])
        else:
            beyond = np.concatenate([p - self.case.load - b.end_force, last[4:7] - b.end_moment])
        return np.concatenate([first[:4] - b.start_quaternion, first[7:], beyond])

    def ends_jacobian(self, _first: Array, _last: Array, _p: Array) -> tuple[Array, Array, Array]:
        """Return its derivatives by both ends (13, 10) and by the parameters (13, 3)."""
        start, end, by_force = np.zeros((13, 10)), np.zeros((13, 10)), np.zeros((13, 3))
        start[:4, :4], start[4:7, 7:] = np.eye(4), np.eye(3)
        if self.case.boundary.kind.end_position:
            end[7:10, 7:], end[10:, :4] = np.eye(3), self._relative()
        else:
            by_force[7:10], end[10:, 4:7] = np.eye(3), np.eye(3)
        return start, end, by_force

    def solve(self, s: Array, y: Array, p: Array, tolerance: float) -> object:
        """Return what ``solve_bvp`` finds from y (10, m) at s (m,) and the force p (3,)."""
        return solve_bvp(
            self.rates, self.ends, s, y, p=p, fun_jac=self.jacobian, bc_jac=self.ends_jacobian, tol=tolerance,
            max_nodes=4000,
        )  # fmt: skip

"""PyElastica on the rod, for ``work_precision.py``: damped dynamics until a frame has come to rest.

Set up for the least error in the least time: clamps lie in the middle of the first and the last element (held at its
node, an element turns with the clamp half its length too far on, a first-order error); stretching and shearing stiff
enough to leave no more error than the elements do; a radius that makes the fastest turning as fast as the fastest
stretching, which together limit the step; damping near that of the slowest bending. No load but of constant direction.
"""

from __future__ import annotations

import time
from typing import Any

import elastica
import numpy as np
from elastica.boundary_conditions import ConstraintBase
from elastica.external_forces import NoForces
from scipy.interpolate import CubicSpline
from work_precision_cases import S

from harness_opt.numerics import rotations
from harness_opt.rod.boundary import Case
from harness_opt.rod.states import Rod

Array = np.ndarray
NAME = "PyElastica"
RESOLUTIONS = (25, 50, 100)  # elements
AXIAL = 20.0  # stretching stiffness per square of the elements, B / L^2: both errors then fall alike
DAMPING = 20.0  # of a cable of mass 1: sqrt(B / L^3) is the unit of rates
COURANT = 0.3  # step in times that a wave takes along an element
CHECKED, SETTLED = 500, 1e-4  # steps after which speeds are looked at; L times the unit of rates
LIMIT = 10.0  # s of processor time a frame


class _Simulator(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping):
    """The modules that are needed."""


class _Clamps(ConstraintBase):
    """Holds the first element, and the last where it is clamped."""

    def __init__(self, *, held: dict[int, tuple[Array, Array]], **kwargs: Any):
        super().__init__(**kwargs)
        self.held = held

    def constrain_values(self, system: Any, time: float) -> None:
        for end, (nodes, directors) in self.held.items():
            system.position_collection[:, slice(0, 2) if end == 0 else slice(-2, None)] = nodes
            system.director_collection[..., end] = directors

    def constrain_rates(self, system: Any, time: float) -> None:
        for end in self.held:
            system.velocity_collection[:, slice(0, 2) if end == 0 else slice(-2, None)] = 0.0
            system.omega_collection[..., end] = 0.0


class _Loads(NoForces):
    """The weight, and a dead force and moment at the end."""

    def __init__(self, *, loads: dict[str, Array], **kwargs: Any):
        super().__init__(**kwargs)
        self.loads = loads

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        system.external_forces += self.loads["nodes"]

    def apply_torques(self, system: Any, time: float = 0.0) -> None:
        system.external_torques[..., -1] += system.director_collection[..., -1] @ self.loads["moment"]


class Peer:
    """A motion under way.

    Args:
        rod, case: the first frame, solved.
        resolution: elements.
    """

    def __init__(self, rod: Rod, case: Case, resolution: int):
        clamped, stiffness = case.boundary.kind.end_position, case.section.stiffness
        self.length = 1.0 / (resolution - (1.0 if clamped else 0.5))
        s = self.length * (np.arange(resolution + 1) - 0.5)
        self.nodes = s
        axial = AXIAL * resolution**2
        radius = 2.0 / np.sqrt(axial)
        second = np.pi * radius**4 / 4.0
        self.rod = elastica.CosseratRod.straight_rod(
            resolution, np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), self.length * resolution,
            radius, 1.0 / (np.pi * radius**2), youngs_modulus=1.0 / second, shear_modulus=stiffness[2] / (2.0 * second),
        )  # fmt: skip
        self.rod.shear_matrix[...] = axial * np.eye(3)[..., None]
        self.rod.bend_matrix[...] = np.diag(stiffness)[..., None]
        # at rest inertia says nothing; a thin rod's own would make sections turn fastest of all
        inertia = self.length**3 / 4.0
        self.rod.mass_second_moment_of_inertia[...] = inertia * np.eye(3)[..., None]
        self.rod.inv_mass_second_moment_of_inertia[...] = np.eye(3)[..., None] / inertia
        self.held: dict[int, tuple[Array, Array]] = {}
        self.loads = {"nodes": np.zeros((3, resolution + 1)), "moment": np.zeros(3)}
        self.clamped = clamped
        inside = rod.sample(np.clip(s, 0.0, 1.0))
        beyond = (s - np.clip(s, 0.0, 1.0))[:, None]
        middles = rod.sample(np.clip(0.5 * (s[1:] + s[:-1]), 0.0, 1.0))
        self._place(case)
        simulator = _Simulator()
        simulator.append(self.rod)
        self.step = COURANT * self.length / np.sqrt(max(axial, 4.0 * stiffness[2] / self.length**2))
        simulator.constrain(self.rod).using(_Clamps, held=self.held)
        simulator.add_forcing_to(self.rod).using(_Loads, loads=self.loads)
        simulator.dampen(self.rod).using(
            elastica.AnalyticalLinearDamper, uniform_damping_constant=DAMPING, time_step=self.step
        )
        simulator.finalize()
        self.rod.position_collection[...] = (inside.r + beyond * rotations.tangent(inside.q)).T
        self.rod.director_collection[...] = np.moveaxis(np.swapaxes(rotations.matrix(middles.q), 1, 2), 0, -1)
        self.simulator, self.stepper = simulator, elastica.PositionVerlet()

    def _place(self, case: Case) -> None:
        b = case.boundary
        poses = {0: (np.zeros(3), b.start_quaternion)}
        if self.clamped:
            poses[-1] = (b.gap, b.end_quaternion)
        for end, (position, q) in poses.items():
            half = 0.5 * self.length * rotations.tangent(q)
            self.held[end] = (np.stack([position - half, position + half], axis=1), rotations.matrix(q).T)
        self.loads["nodes"][...] = self.length * case.load[:, None]
        self.loads["nodes"][:, -1] *= 0.5
        if not self.clamped:
            self.loads["nodes"][:, -1] += b.end_force
            self.loads["moment"][...] = b.end_moment

    def frame(self, case: Case) -> str:
        """Go to the next frame; return "ok", or what went wrong."""
        self._place(case)
        clock, at = time.process_time(), np.float64(0.0)
        while time.process_time() - clock < LIMIT:
            for _ in range(CHECKED):
                at = self.stepper.step(self.simulator, at, self.step)
            speed = float(np.max(np.abs(self.rod.velocity_collection)))
            if not np.isfinite(speed):
                return "diverged"
            if speed < SETTLED:
                return "ok"
        return "not at rest in time"

    def position(self) -> Array:
        """Return positions at S."""
        return CubicSpline(self.nodes, self.rod.position_collection.T)(S)

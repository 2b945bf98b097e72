"""Exudyn's geometrically exact beam on the rod, for ``work_precision.py``: static Newton solves from frame to frame.

Set up as well as we know how: nodes with Euler parameters (its static solver takes no others in space); a first guess
whose elements are not stretched, since Newton's method there has no line search; stretching and shearing stiff enough
to leave no more error than the elements do, as far as Newton's method bears it.
"""

from __future__ import annotations

import exudyn
import numpy as np
from exudyn import itemInterface as items
from scipy.interpolate import CubicSpline
from work_precision_cases import S

from harness_opt.numerics import rotations
from harness_opt.rod.boundary import Case
from harness_opt.rod.states import Rod

Array = np.ndarray
NAME = "Exudyn"
RESOLUTIONS = (16, 32, 64, 128)  # elements
AXIAL = 100.0  # stretching stiffness per square of the elements, B / L^2: both errors then fall alike
MOST_AXIAL = 4e5  # above, Newton's method fails
ATTEMPTS = (1.0, 0.3, 1.0)  # parts of it, with which the first frame is tried in turn
ALONG = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # its x axis is d3, y and z are d1 and d2


class Peer:
    """A motion under way.

    Args:
        rod, case: the first frame, solved.
        resolution: elements.
    """

    def __init__(self, rod: Rod, case: Case, resolution: int):
        self.container = exudyn.SystemContainer()
        self.system, self.elements = self.container.AddSystem(), resolution
        s = np.linspace(0.0, 1.0, resolution + 1)
        at = rod.sample(s)
        middles = rotations.normalise(at.q[1:] + at.q[:-1])
        r = np.concatenate([np.zeros((1, 3)), np.cumsum(rotations.tangent(middles) / resolution, axis=0)])
        r += s[:, None] * (at.r[-1] - r[-1])
        q = rotations.multiply(at.q, rotations.from_matrix(ALONG))
        kind = case.boundary.kind
        self.nodes = [
            self.system.AddNode(
                items.NodeRigidBodyEP(
                    referenceCoordinates=[x, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
                    initialCoordinates=[*(p - (x, 0.0, 0.0)), *(e - rotations.IDENTITY)],
                )
            )
            for x, p, e in zip(s, r, q, strict=True)
        ]
        axial = min(AXIAL * resolution**2, MOST_AXIAL) * max(
            1.0, float(np.max(np.linalg.norm(at.force, axis=1))) / 100.0
        )
        beams = [
            self.system.AddObject(
                items.ObjectBeamGeometricallyExact(
                    nodeNumbers=list(pair),
                    length=1.0 / resolution,
                    sectionData=_section(case.section.stiffness, axial),
                )
            )
            for pair in zip(self.nodes[:-1], self.nodes[1:], strict=True)
        ]
        marks = [self.system.AddMarker(items.MarkerNodeRigid(nodeNumber=node)) for node in self.nodes]
        held = [marks[0], marks[-1]] if kind.end_position else [marks[0]]
        self.clamps = [self._clamped(mark) for mark in held]
        self.loads = [self.system.AddLoad(items.LoadForceVector(markerNumber=mark)) for mark in marks]
        self.torque = self.system.AddLoad(items.LoadTorqueVector(markerNumber=marks[-1]))
        self._place(case)
        self.system.Assemble()
        self.settings = _settings()
        for part in ATTEMPTS:
            for beam in beams:
                self.system.SetObjectParameter(beam, "sectionData", _section(case.section.stiffness, part * axial))
            found = self._solved(case)
            if part == 1.0 and found == "ok":
                break
        self.status = found

    def _clamped(self, mark: int) -> int:
        """Join a node to a body that never moves by itself; return the body."""
        body = self.system.AddObject(items.ObjectGround())
        ground = self.system.AddMarker(items.MarkerBodyRigid(bodyNumber=body))
        self.system.AddObject(items.GenericJoint(markerNumbers=[ground, mark], constrainedAxes=[1] * 6))
        return body

    def _place(self, case: Case) -> None:
        b = case.boundary
        poses = ((np.zeros(3), b.start_quaternion), (b.gap, b.end_quaternion))
        for body, (position, q) in zip(self.clamps, poses, strict=False):
            self.system.SetObjectParameter(body, "referencePosition", position.tolist())
            self.system.SetObjectParameter(body, "referenceRotation", rotations.matrix(q) @ ALONG)
        loads = np.tile(case.load / self.elements, (len(self.nodes), 1))
        loads[[0, -1]] *= 0.5
        if not b.kind.end_position:
            loads[-1] += b.end_force
            self.system.SetLoadParameter(self.torque, "loadVector", b.end_moment.tolist())
        for load, vector in zip(self.loads, loads, strict=True):
            self.system.SetLoadParameter(load, "loadVector", vector.tolist())

    def frame(self, case: Case) -> str:
        """Go to the next frame; return "ok", or what went wrong."""
        return self._solved(case) if self.status == "ok" else f"first frame: {self.status}"

    def _solved(self, case: Case) -> str:
        self._place(case)
        try:
            done = self.system.SolveStatic(self.settings, updateInitialValues=True)
        except exudyn.ExudynError as error:
            return str(error)
        return "ok" if done else "not solved"

    def position(self) -> Array:
        """Return positions at S."""
        wanted = exudyn.OutputVariableType.Position
        at = np.array([self.system.GetNodeOutput(node, wanted) for node in self.nodes])
        return CubicSpline(np.linspace(0.0, 1.0, len(at)), at)(S)


def _section(stiffness: Array, axial: float) -> exudyn.BeamSection:
    section = exudyn.BeamSection()
    kx, ky, kz = stiffness
    section.stiffnessMatrix = np.diag([axial, axial, axial, kz, kx, ky])
    return section


def _settings() -> exudyn.SimulationSettings:
    settings = exudyn.SimulationSettings()
    static = settings.staticSolver
    static.numberOfLoadSteps, static.adaptiveStep, static.verboseMode = 1, False, 0
    static.newton.relativeTolerance, static.newton.absoluteTolerance = 1e-8, 1e-6
    static.newton.maxIterations = 40
    settings.solution.file.write = False
    settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
    return settings

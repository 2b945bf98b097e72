"""MuJoCo's cable on the rod, for ``work_precision.py``: damped dynamics until a frame has come to rest.

Set up for the least error in the least time: the first link is part of the world and lies with its middle in the
clamp, the last one is welded there to a body that follows the clamp (held at its end, a link turns with the clamp
half its length too far on, a first-order error); stiff welds; a step as long as the links' own turning bears, and
damping near that of the slowest bending. Stiffness is explicit there, so the step goes with the square of a link.
"""

from __future__ import annotations

import time

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from work_precision_cases import S

from harness_opt.numerics import rotations
from harness_opt.rod.boundary import Case
from harness_opt.rod.states import Rod

Array = np.ndarray
NAME = "MuJoCo cable"
RESOLUTIONS = (20, 40)  # links
RADIUS = 1e-3  # L: of links that touch nothing
DAMPING = 20.0  # of a cable of mass 1: sqrt(B / L^3) is the unit of rates
COURANT = 0.3  # step in times of a link's own turning, sqrt(mass moment over stiffness of a joint)
CHECKED, SETTLED = 500, 1e-4  # steps after which speeds are looked at; L times the unit of rates
LIMIT = 10.0  # s of processor time a frame


class Peer:
    """A motion under way.

    Args:
        rod, case: the first frame, solved.
        resolution: links.
    """

    def __init__(self, rod: Rod, case: Case, resolution: int):
        self.clamped, self.count = case.boundary.kind.end_position, resolution
        self.length = 1.0 / (resolution - (1.0 if self.clamped else 0.5))
        self.joints = self.length * (np.arange(resolution + 1) - 0.5)
        stiffness = case.section.stiffness
        turning = np.sqrt(self.length**2 / 12.0 * self.length**2 / max(1.0, float(stiffness[2])))
        self.model = mujoco.MjModel.from_xml_string(self._text(case, COURANT * turning))
        self.data = mujoco.MjData(self.model)
        mujoco.set_mju_user_warning(lambda _text: None)  # else it writes a file where it stands
        q = rod.sample(np.clip(0.5 * (self.joints[1:] + self.joints[:-1]), 0.0, 1.0)).q
        q = rotations.multiply(q, ALONG)
        joints = rotations.multiply(rotations.conjugate(q[:-1]), q[1:])
        self.data.qpos[:] = joints.ravel()
        self._place(case)

    def _text(self, case: Case, step: float) -> str:
        """Return the model: links along their x axis, each from its joint on."""
        kx, _, kz = case.section.stiffness
        second = np.pi * RADIUS**4 / 4.0
        half, b = 0.5 * self.length, case.boundary
        first = rotations.multiply(b.start_quaternion, ALONG)
        begin = -half * rotations.tangent(b.start_quaternion)
        inertia = self.length**3 / 12.0
        link = (
            f'<inertial pos="{half} 0 0" mass="{self.length}" diaginertia="{inertia} {inertia} {inertia}"/>'
            f'<geom type="capsule" fromto="0 0 0 {self.length} 0 0" size="{RADIUS}" contype="0" conaffinity="0"/>'
            '<plugin instance="cable"/>'
        )
        text, close = "", ""
        for k in range(self.count):
            place = f'pos="{_words(begin)}" quat="{_words(first)}"' if k == 0 else f'pos="{self.length} 0 0"'
            joint = "" if k == 0 else f'<joint type="ball" damping="{DAMPING * inertia}"/>'
            text += f'<body name="link{k}" {place}>{joint}{link}'
            close += "</body>"
        weld = (
            f'<equality><weld body1="clamp" body2="link{self.count - 1}" relpose="{-half} 0 0 1 0 0 0" '
            f'solref="{2.0 * step} 1" solimp="0.9999 0.9999 1e-6"/></equality>'
        )
        return f"""<mujoco><option timestep="{step}" integrator="implicitfast" gravity="0 0 0" solver="Newton"/>
            <extension><plugin plugin="mujoco.elasticity.cable"><instance name="cable">
            <config key="twist" value="{kz / (2.0 * second)}"/><config key="bend" value="{kx / second}"/>
            <config key="flat" value="true"/></instance></plugin></extension>
            <worldbody><body name="clamp" mocap="true"/>{text}{close}</worldbody>{weld if self.clamped else ""}
            </mujoco>"""

    def _place(self, case: Case) -> None:
        b = case.boundary
        self.data.mocap_pos[0], self.data.mocap_quat[0] = b.gap, rotations.multiply(b.end_quaternion, ALONG)
        self.load = self.length * np.tile(case.load, (self.count, 1))
        self.end_load, self.end_moment = np.zeros(3), np.zeros(3)
        if not self.clamped:
            self.end_load, self.end_moment = b.end_force, b.end_moment

    def frame(self, case: Case) -> str:
        """Go to the next frame; return "ok", or what went wrong."""
        self._place(case)
        clock = time.process_time()
        while time.process_time() - clock < LIMIT:
            for _ in range(CHECKED):
                self._push()
                mujoco.mj_step(self.model, self.data)
            speed = self.length * float(np.max(np.abs(self.data.qvel))) * self.count
            if not np.isfinite(speed) or self.data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
                return "diverged"
            if speed < SETTLED:
                return "ok"
        return "not at rest in time"

    def _push(self) -> None:
        """Apply weight, end load and a drag of the air to all links."""
        applied = self.data.xfrc_applied[2:]
        applied[:, :3] = self.load
        half = 0.5 * self.length * self.data.xmat[-1].reshape(3, 3)[:, 0]
        applied[-1, :3] += self.end_load
        applied[-1, 3:] = self.end_moment + np.cross(half, self.end_load)
        applied[:, :3] -= DAMPING * self.length * self.data.cvel[2:, 3:]

    def position(self) -> Array:
        """Return positions at S."""
        axis = self.data.xmat[2:].reshape(-1, 3, 3)[:, :, 0]
        r = np.concatenate([self.data.xpos[2:], self.data.xpos[-1:] + self.length * axis[-1:]])
        return CubicSpline(self.joints, r)(S)


# its links lie along x: that is d3, y and z are d1 and d2
ALONG = rotations.from_matrix(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))


def _words(values: Array) -> str:
    return " ".join(map(repr, map(float, values)))

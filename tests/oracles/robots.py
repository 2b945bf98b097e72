"""A small robot with every kind of joint and shape, a problem on it, and the same poses by Pinocchio and yourdfpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from harness_opt.numerics import rotations

URDF = """\
<?xml version="1.0"?>
<robot name="crane">
  <link name="foot">
    <collision><geometry><box size="0.2 0.2 0.02"/></geometry></collision>
  </link>
  <link name="mast">
    <!-- two shapes -->
    <collision><origin xyz="0 0 0.1" rpy="0 0 0.3"/><geometry><mesh filename="meshes/wedge.stl" scale="0.001 0.001 -0.001"/></geometry></collision>
    <collision><origin xyz="0 0 0.25"/><geometry><cylinder radius="0.01" length="0.1"/></geometry></collision>
    <visual><geometry><sphere radius="0.03"/></geometry></visual>
  </link>
  <link name="boom"><collision><geometry><sphere radius="0.015"/></geometry></collision></link>
  <link name="hook"/>
  <link name="claw"><collision><geometry><box size="0.02 0.02 0.02"/></geometry></collision></link>
  <joint name="turn" type="revolute">
    <parent link="foot"/><child link="mast"/>
    <origin xyz="0.01 0 0.02" rpy="0.2 -0.1 0.7"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>
  </joint>
  <joint name="reach" type="prismatic">
    <parent link="mast"/><child link="boom"/>
    <origin xyz="0 0.02 0.3" rpy="0 0.4 0"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.2" effort="1" velocity="1"/>
  </joint>
  <joint name="swing" type="continuous">
    <parent link="boom"/><child link="hook"/>
    <origin xyz="0.1 0 0"/><axis xyz="0 0 1"/><mimic joint="turn" multiplier="-2" offset="0.3"/>
  </joint>
  <joint name="weld" type="fixed">
    <parent link="hook"/><child link="claw"/><origin xyz="0 0 -0.05" rpy="1.5707963267948966 0 0"/>
  </joint>
</robot>
"""  # noqa: E501
PROGRAM = "t,turn,reach\n0,-60,0.0\n1,-20,0.05\n2,10,0.12\n3,50,0.15\n"
PROBLEM = """\
schema = 1
[cables.lead]
length = 0.5
diameter = 0.004
bending_stiffness = 1e-3
torsional_stiffness = 7e-4
start = { position = [0.2, 0, 0], tangent = [0, 0, 1] }
end = { body = "crane.claw", position = [0, 0, 0.02], tangent = [0, 0, -1] }
[robots.crane]
urdf = "crane.urdf"
program = "program.csv"
unit = "deg"
[motion]
spatial_step = 0.03
[limits]
clearance = 0.001
"""


def put_crane(folder: Path, problem: str = PROBLEM, urdf: str = URDF, program: str = PROGRAM) -> Path:
    """Write the small robot, its program, its mesh and a problem into ``folder``, and return the problem's file."""
    (folder / "meshes").mkdir(exist_ok=True, parents=True)
    trimesh.creation.box((20, 30, 40)).export(folder / "meshes" / "wedge.stl")
    (folder / "crane.urdf").write_text(urdf)
    (folder / "program.csv").write_text(program)
    (folder / "crane.toml").write_text(problem)
    return folder / "crane.toml"


def by_yourdfpy(file: Path, joints: dict[str, float]) -> dict[str, np.ndarray]:
    """Return the matrices (4, 4) of all links in the root."""
    from yourdfpy import URDF as Reader

    robot = Reader.load(str(file), load_meshes=False)
    robot.update_cfg(joints)
    return {name: robot.get_transform(name) for name in robot.link_map}


def by_pinocchio(file: Path, joints: dict[str, float]) -> dict[str, np.ndarray]:
    """Return the matrices (4, 4) of all links in the root."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(file), mimic=True)
    data, q = model.createData(), pinocchio.neutral(model)
    for name, value in joints.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 2:  # a continuous one, by cosine and sine
            q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
        else:
            q[joint.idx_q] = value
    pinocchio.framesForwardKinematics(model, data, q)
    kind = pinocchio.FrameType.BODY
    return {frame.name: data.oMf[i].homogeneous for i, frame in enumerate(model.frames) if frame.type == kind}


def matrices(pose: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return poses (P, 3), (P, 4) as matrices (P, 4, 4)."""
    found = np.tile(np.eye(4), (len(pose[0]), 1, 1))
    found[:, :3, 3], found[:, :3, :3] = pose[0], rotations.matrix(pose[1])
    return found

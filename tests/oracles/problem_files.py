"""A problem file in all its parts, and ways to spoil it, for the tests that read and write such files."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from harness_opt.errors import ProblemError
from harness_opt.files.read import read_problem
from harness_opt.model.bodies import Poses
from harness_opt.model.problem import Problem

CONTRACT = """\
schema = 1
title = "Lift arm, original design"
gravity = [0, 0, -9.81]                  # m/s2; leave out for weightless

[cables.lead]
length = 0.42                            # m
diameter = 6.2e-3
bending_stiffness = 2.1e-3               # N m2, or [kx, ky] for a flat section
torsional_stiffness = 1.6e-3             # N m2
density = 5571                           # kg/m3, or mass_per_length
# rest_curvature = [0, 0, 0]             # 1/m, as made
start = { body = "world", position = [0, 0.055, 0.12], tangent = [0, 0, 1], roll_deg = 0 }
end   = { body = "arm", position = [0.03, 0, 0.018], quaternion = [1, 0, 0, 0], turns = 0 }

[bodies.arm.motion]
kind = "hinge"
point = [0, 0, 0.1]
axis = [0, 1, 0]
from_deg = 0
to_deg = 110

[motion]
duration = 2.0
spatial_step = 0.004

[parts.housing]
body = "world"
mesh = "meshes/housing.stl"
mesh_unit = "mm"
clearance = 0.006

[limits]
clearance = 0.004
bend_radius = 0.031
twist_deg_per_m = 360
clamp_force = 20
clamp_moment = 0.5

[design]
minimise = "change"
[design.variables]
"lead.length" = [0.40, 0.60]
"lead.start.position.z" = [0.10, 0.14]
"lead.end.rotate_x_deg" = [-20, 20]
"""

MINIMAL = """\
schema = 1
[cables.lead]
length = 1
diameter = 0.01
bending_stiffness = [2, 3]
torsional_stiffness = 1
start = { position = [0, 0, 0], tangent = [2, 0, 0], roll_deg = 90 }
end = { force = [0, 0, -1], moment = [0, 1, 0] }
"""

HINGE = CONTRACT[CONTRACT.index('kind = "hinge"') : CONTRACT.index("\n[motion]")]
START = '{ body = "world", position = [0, 0.055, 0.12], tangent = [0, 0, 1], roll_deg = 0 }'

MESH = 'mesh = "meshes/housing.stl"\nmesh_unit = "mm"'
HEADER = "t,x,y,z,qw,qx,qy,qz\n"
ROWS = ["0,0,0,0,1,0,0,0", "1,0,0,0.01,1,0,0,0", "2,0,0,0.02,0.7071,0.7071,0,0", "3,0,0,0.03,0,-1,0,0"]


def written(folder: Path, text: str | bytes) -> Path:
    """Return the problem file with ``text`` in ``folder``."""
    file = folder / "lift.toml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


def mistakes(file: Path) -> list[str]:
    """Return the lines that reading ``file`` fails with, less its name."""
    with pytest.raises(ProblemError) as caught:
        read_problem(file)
    assert all("\n" not in line and line.startswith(f"{file}: ") for line in caught.value.mistakes)
    return [line.removeprefix(f"{file}: ") for line in caught.value.mistakes]


def changed(*pairs: tuple[str, str]) -> str:
    """Return the example with the first of each pair, found once in it, replaced by the second."""
    text = CONTRACT
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def naming(mesh: str) -> str:
    """Return the example with another name of its mesh."""
    return changed(("meshes/housing.stl", mesh))


def same(a: Problem, b: Problem) -> bool:
    """Whether two problems are equal but for where they were read."""
    return dataclasses.replace(a, file=None, sha256=None) == dataclasses.replace(b, file=None, sha256=None)


def with_poses(folder: Path, table: str | bytes) -> Path:
    """Return the example with its arm driven by ``table``."""
    (folder / "arm.csv").write_bytes(table if isinstance(table, bytes) else table.encode())
    return written(folder, changed((HINGE, 'kind = "poses"\nfile = "arm.csv"\n')))


def poses_of(problem: Problem) -> Poses:
    """Return what drives the arm, by a table."""
    motion = problem.bodies["arm"].motion
    assert isinstance(motion, Poses)
    return motion

"""A small problem file, one that is violated, one that nothing redeems, and ways to run the program on them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import types
from pathlib import Path

FLAP = """\
schema = 1
title = "A flap"
gravity = [0, 0, -9.81]

[cables.lead]
length = 0.3
diameter = 0.005
bending_stiffness = 2e-3
torsional_stiffness = 1.5e-3
mass_per_length = 0.05
start = { position = [0, 0, 0], tangent = [0, 0, 1] }
end = { body = "flap", position = [0.15, 0.02, 0], tangent = [0, 0, -1], roll_deg = 180 }

[bodies.flap.motion]
kind = "hinge"
point = [0.2, 0, 0]
axis = [0, 1, 0]
from_deg = 0
to_deg = 20

[motion]
spatial_step = 0.01

[parts.ball]
sphere = { radius = 0.02 }
position = [0.08, 0, 0]

[limits]
clearance = 0.004
bend_radius = 0.01

[design.variables]
"lead.length" = [0.25, 0.45]
"""
HIT = FLAP.replace("position = [0.08, 0, 0]", "position = [0.08, 0.01, 0.092]")
WALLED = HIT.replace("[0.25, 0.45]", "[0.295, 0.305]")
PLAIN = ("--no-pictures",)


def put(text: str, name: str = "flap.toml") -> str:
    Path(name).write_text(text)
    return name


def strict(text: str) -> dict:
    def refuse(name: str) -> None:
        raise AssertionError(name)

    return json.loads(text, parse_constant=refuse)


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the program as a user does."""
    return subprocess.run(
        [sys.executable, "-m", "harness_opt", *arguments],
        cwd=cwd, env=environment(), capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}


def stand_in(**functions: object) -> types.ModuleType:
    """Return a room of pictures that draws as told."""
    module = types.ModuleType("harness_opt.stand_in")
    vars(module).update(functions)
    return module

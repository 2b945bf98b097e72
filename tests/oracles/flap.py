"""A small problem file, one that is violated, one that nothing redeems, and ways to run the program on them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import types
from pathlib import Path

from oracles.problems import ROOT

HIT = (ROOT / "scripts" / "checks" / "flap.toml").read_text(encoding="utf-8")
FLAP = HIT.replace("position = [0.08, 0.01, 0.092]", "position = [0.08, 0, 0]")
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
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def stand_in(**functions: object) -> types.ModuleType:
    """Return a room of pictures that draws as told."""
    module = types.ModuleType("harness_opt.stand_in")
    vars(module).update(functions)
    return module

"""Where the project lies, and the problems that it ships."""

from __future__ import annotations

from pathlib import Path

import harness_opt as ho

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS = ROOT / "problems"


def shipped(name: str) -> ho.Problem:
    """Return the problem ``name`` as it is drawn."""
    return ho.read_problem(PROBLEMS / name / f"{name}.toml")

"""The problem that is studied."""

from __future__ import annotations

import pytest

import harness_opt as ho
from oracles.flap import FLAP


@pytest.fixture
def problem(here) -> ho.Problem:
    (here / "flap.toml").write_text(FLAP)
    return ho.read_problem("flap.toml")

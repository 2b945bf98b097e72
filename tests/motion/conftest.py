"""Motions that the tests of this room share."""

from __future__ import annotations

import pytest

import harness_opt as ho
from oracles.hinged import PROBLEM


@pytest.fixture(scope="session")
def motion() -> ho.Motion:
    found = ho.simulate(PROBLEM)
    assert not found.snaps
    return found

"""Motions that the tests of this room share."""

from __future__ import annotations

import numpy as np
import pytest

import harness_opt as ho
from oracles.stories import lift


@pytest.fixture(scope="session")
def coarse():
    """The motion of :func:`lift` in five frames, over four more clamp ways of 63 mm."""
    motion = ho.simulate(lift({}), frames=np.linspace(0, 1, 5))
    fine = ho.simulate(lift({}), frames=np.linspace(0, 1, 401))
    return motion, fine

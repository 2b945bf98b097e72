"""The peers of the error against run time, as far as they are installed: set up so that they find the exact shape."""

from __future__ import annotations

import contextlib
import dataclasses
import time

import numpy as np
import pytest

from oracles.scripts import script

pytestmark = pytest.mark.filterwarnings("ignore")  # what the peers warn of is theirs

CASES = ("cantilever P = 5", "elastica 0.6")  # a force at the end, and a moving clamp
COARSE = 5e-3  # L: of the coarsest resolution each


def way(name: str):
    study = script("work_precision")
    (benchmark,) = (one for one in study.benchmarks() if one.name == name)
    return study.Way(benchmark, 20)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(
    ("module", "needed"), [("exudyn_peer", "exudyn"), ("elastica_peer", "elastica"), ("mujoco_peer", "mujoco")]
)
def test_a_peer_follows_a_motion_to_the_exact_shape(module, needed, name):
    pytest.importorskip(needed)
    peer, motion = script(module), way(name)
    run = peer.Peer(motion.near(1).rod, motion.cases[-2], peer.RESOLUTIONS[0])
    assert run.frame(motion.cases[-1]) == "ok"
    assert motion.benchmark.error(run.position(), motion.truth) < COARSE


@pytest.mark.parametrize("name", CASES)
def test_solve_bvp_follows_it_too(name):
    motion, peer = way(name), script("bvp_peer")
    mesh = np.linspace(0.0, 1.0, 33)
    at = motion.near(1).rod.sample(mesh)
    found = peer.Peer(motion.cases[-1]).solve(mesh, np.concatenate([at.q.T, at.moment.T, at.r.T]), at.force[0], 1e-6)
    study = script("work_precision")
    assert motion.benchmark.error(found.sol(study.S)[7:].T, motion.truth) < 1e-6


# --- a limit for each row --------------------------------------------------------------------------------


def idle(seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass


def test_work_that_takes_too_long_is_ended_even_where_it_takes_the_end_for_something_else():
    limit = script("time_limit")
    with limit.time_limit(5.0):
        idle(0.01)
    with pytest.raises(ZeroDivisionError), limit.time_limit(5.0):
        raise ZeroDivisionError
    with pytest.raises(limit.OutOfTimeError), limit.time_limit(0.05):
        idle(20.0)
    with pytest.raises(limit.OutOfTimeError), limit.time_limit(0.05):
        try:
            idle(20.0)
        except limit.OutOfTimeError:
            raise RuntimeError from None
    with pytest.raises(limit.OutOfTimeError), limit.time_limit(0.05), contextlib.suppress(limit.OutOfTimeError):
        idle(20.0)
    idle(1.2)  # no alarm is left


def test_a_row_that_takes_too_long_is_given_up_and_stays(monkeypatch):
    study, motion = script("work_precision"), way("elastica 0.6")
    monkeypatch.setattr(study, "TOO_LONG", 0.05)
    row, given_up = study.limited(motion, "any", 1, "cold", lambda _: idle(20.0))
    assert given_up and row["status"] == "longer than 0.05 s" and np.isnan(row["milliseconds"])
    rows = list(study.cold(motion, dataclasses.replace(study.QUICK, slow=True, repeats=1)))
    assert {(row["method"], row["resolution"]) for row in rows} >= {("collocation, ipopt", 1e-5), ("dqm, ipopt", 1e-5)}

"""The peers of the error against run time, as far as they are installed: set up so that they find the exact shape."""

from __future__ import annotations

import numpy as np
import pytest
from scripts_of import script

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

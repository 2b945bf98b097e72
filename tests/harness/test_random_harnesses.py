"""Random harnesses against one discrete energy of the whole, minimised by IPOPT: see ``oracles.harnesses``."""

from __future__ import annotations

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.model.results import at_clip, joined, split
from harness_opt.model.spans import joints
from oracles.harnesses import compared, random_harness

CLOSE = 1e-6  # of the energies, and of the first cable's B / L: what the oracle's extrapolation leaves
BALANCE = 1e-9  # of the largest force and moment that a body or a clip is held by


@pytest.mark.parametrize("seed", [1, 3, 5, 12, 18, 25])
def test_energy_is_that_of_the_whole_in_one(seed):
    problem = random_harness(seed)
    found = compared(problem)
    assert found.solved
    assert found.off <= CLOSE


@pytest.mark.parametrize("seed", [0, 1, 5, 11])
def test_forces_balance_at_every_body_and_clip(seed):
    problem = random_harness(seed)
    motion = ho.simulate(problem)
    spans, (position, turn) = split(motion), ({}, {})
    for name, body in problem.bodies.items():
        stands = motion.problem.poses(name, [0.0])
        position[name], turn[name] = stands[0][0], stands[1][0]
        forces, moments = [np.asarray(problem.gravity) * body.mass], [np.zeros(3)]
        for cable, run in problem.cables.items():
            shapes = motion.cables[cable]
            for end, station, sign in ((run.start, 0, 1.0), (run.end, -1, -1.0)):
                if end.body == name:
                    force, moment = sign * shapes.force[0, station], sign * shapes.moment[0, station]
                    forces.append(force)
                    moments.append(moment + np.cross(shapes.position[0, station] - position[name], force))
        largest = max(np.linalg.norm(one) for one in forces)
        assert np.linalg.norm(np.sum(forces, axis=0)) <= BALANCE * largest
        assert np.linalg.norm(np.sum(moments, axis=0)) <= BALANCE * max(np.linalg.norm(one) for one in moments)
    for clip, before, behind in joints(spans.problem):
        loads = at_clip(spans.cables[before], spans.cables[behind])
        if spans.problem.cables[before].end.kind in ("pivot", "ring"):
            assert (
                np.linalg.norm(loads.moment[0, 0])
                <= BALANCE * np.linalg.norm(spans.cables[before].moment[0, -1]) + 1e-12
            ), clip


def test_spans_and_whole_cables_are_one_result():
    motion = ho.simulate(random_harness(1))
    again = joined(motion.problem, split(motion))
    shapes, others = motion.cables["lead"], again.cables["lead"]
    assert np.max(np.abs(shapes.s - others.s)) < 1e-12
    assert np.array_equal(shapes.position, others.position)

"""The shipped problems give their verdicts, and what a redesign writes holds on a simulation twice as fine.

Every redesigned file is read back from disk and simulated with half the spatial step and twice the elements: other
frames, another mesh, another cold start than those the redesign saw.
"""

import dataclasses
import functools

import pytest

import harness_opt as ho
from harness_opt.clearance.limits import all_hold, all_limits
from harness_opt.model.design_variables import apply
from oracles.problems import shipped

ELEMENTS = 24  # three times those that the search uses, and half as many again as its own verification
NAMES = ["lift_arm", "door", "drawer", "camera_pan", "dress_pack", "y_branch"]


@functools.cache
def redesigned(name: str) -> ho.Redesign:
    return ho.redesign(shipped(name))


def rows(motion: ho.Motion):
    return all_limits(motion.problem, motion, ho.clearances(motion))


@pytest.mark.parametrize(
    ("name", "violated"),
    [
        ("lift_arm", {("clearance", "bracket")}),
        ("door", {("clearance", "striker")}),
        ("drawer", {("bend_radius", None), ("clearance", "tray")}),  # the tray by 5 um
        ("camera_pan", {("twist", None)}),
        ("dress_pack", {("clearance", "elbow"), ("bend_radius", None), ("clip_force", None)}),
        ("y_branch", {("bend_radius", None)}),
    ],
)
def test_as_drawn(name, violated):
    motion = ho.simulate(shipped(name))
    assert motion.ok and not motion.snaps
    assert all(cable.stable.all() for cable in motion.cables.values())
    assert {(row.name, row.part) for row in rows(motion) if row.margin < 0} == violated


@pytest.mark.parametrize("name", NAMES)
def test_redesigned(name, tmp_path):
    design = redesigned(name)
    assert design.ok and design.active
    file = tmp_path / "better.toml"
    ho.write_problem(design.problem, file)
    again = ho.read_problem(file)
    fine = ho.simulate(again, spatial_step=again.spatial_step / 2, elements=ELEMENTS)
    assert len(fine.motion) - 1 >= 2 * (len(design.motion_before.motion) - 1) - 1
    assert fine.ok and not fine.snaps and all_hold(rows(fine)) == "yes"


@pytest.mark.parametrize("name", NAMES)
def test_least_change(name):
    # the design stops where a limit does: halfway back to the original some limit is violated
    design = redesigned(name)
    before, after = ([getattr(v, end) for v in design.variables.values()] for end in ("before", "after"))
    half = apply(design.original, [0.5 * (b + a) for b, a in zip(before, after, strict=True)])
    assert all_hold(rows(ho.simulate(half))) == "no"


def test_door_is_not_helped_by_length():
    problem = shipped("door")
    only = tuple(v for v in problem.design.variables if v.name == "loom.length")
    design = ho.redesign(dataclasses.replace(problem, design=dataclasses.replace(problem.design, variables=only)))
    assert not design.ok and design.status.ok
    assert {row.part for row in design.limits if row.margin < 0} == {"striker"}


def test_the_dress_pack_lets_cable_over_the_elbow_through_its_clip():
    """No length is bought: what lay in a bow on the forearm goes to the span over the elbow, and one clip is moved."""
    design = redesigned("dress_pack")
    before, after = (problem.cables["pack"] for problem in (design.original, design.problem))
    assert after.cable.length == before.cable.length
    shifted = {clip.name: clip.at - drawn.at for clip, drawn in zip(after.clips, before.clips, strict=True)}
    assert shifted["upper"] == 0.0 and 0.02 < shifted["fore"] < 0.04
    lowered = before.clips[0].position[2] - after.clips[0].position[2]
    assert 0.004 < lowered < 0.015
    assert {row.id.clip for row in design.limits_before if row.name == "clip_force" and row.margin < 0} == {"upper"}

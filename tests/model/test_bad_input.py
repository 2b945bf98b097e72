"""What cannot be is refused: ends, cables, motions, frames and options, each by its key."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import harness_opt as ho
from oracles.held import CABLE, END, START, UP, moving

NAN = math.nan


def test_ends_further_apart_than_the_length():
    with pytest.raises(ho.ProblemError, match=r"length: found 1 m, expected at least 1\.2 m"):
        ho.equilibrium(CABLE, START, ho.End((0, 0, 1.2), UP))


def test_clamp_that_moves_further_than_the_length():
    run = ho.CableRun(CABLE, START, ho.End((0, 0, 0.9), UP, body="lift"))
    with pytest.raises(ho.ProblemError, match=r"cables\.lead\.length: .*expected at least"):
        ho.Problem({"lead": run}, {"lift": ho.Body(ho.Slide((0, 0, 1), 0.0, 0.3))})


@pytest.mark.parametrize("end", [ho.End(), ho.End(force=(0, 0, 1)), ho.End(quaternion=UP, force=(0, 0, 1))])
def test_neither_end_has_a_position(end):
    with pytest.raises(ho.ProblemError, match="found no position at either end, expected one"):
        ho.equilibrium(CABLE, dataclasses.replace(START, position=None), end)
    with pytest.raises(ho.ProblemError, match="found no position at either end, expected one"):
        ho.CableRun(CABLE, dataclasses.replace(START, position=None), end)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"position": (0, 0, 0), "force": (0, 0, 1)}, "force: found position as well, expected position or force"),
        ({"quaternion": UP, "moment": (0, 0, 1)}, "moment: found quaternion as well, expected quaternion or moment"),
        ({"quaternion": (1, 1, 0, 0)}, "quaternion: .*unit quaternion"),
        ({"quaternion": (0, 0, 0, 0)}, "quaternion: .*unit quaternion"),
        ({"position": (0, 0)}, "position: .*three numbers"),
        ({"position": "here"}, "position: .*three numbers"),
        ({"turns": 0.5}, "turns: .*whole number"),
        ({"turns": NAN}, "turns: found nan, expected a number"),
        ({"turns": math.inf}, "turns: found inf, expected a number"),
    ],
)
def test_an_end_that_cannot_be(given, words):
    with pytest.raises(ho.ProblemError, match=words):
        ho.End(**given)


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf])
@pytest.mark.parametrize(("name", "count"), [("position", 3), ("quaternion", 4), ("force", 3), ("moment", 3)])
def test_an_end_that_is_not_finite(name, count, bad):
    for k in range(count):
        numbers = [0.0] * count
        numbers[k] = bad
        with pytest.raises(ho.ProblemError, match=rf"{name}: .*(three numbers|four numbers of a unit quaternion)"):
            ho.End(**{name: tuple(numbers)})


@pytest.mark.parametrize("bad", [NAN, math.inf, -1.0])
@pytest.mark.parametrize("name", ["length", "diameter", "bending_stiffness", "torsional_stiffness", "mass_per_length"])
def test_a_cable_that_cannot_be(name, bad):
    with pytest.raises(ho.ProblemError, match=f"{name}: .*expected a number"):
        dataclasses.replace(CABLE, **{name: bad})


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("bending_stiffness", (1.0, NAN)),
        ("bending_stiffness", (1.0, 0.0)),
        ("bending_stiffness", (1.0, 1.0, 1.0)),
        ("rest_curvature", (0.0, NAN, 0.0)),
        ("length", 0.0),
        ("length", "long"),
        ("length", True),
    ],
)
def test_other_cables_that_cannot_be(name, bad):
    with pytest.raises(ho.ProblemError, match=f"{name}: found"):
        dataclasses.replace(CABLE, **{name: bad})


@pytest.mark.parametrize(
    "option",
    [
        {"gravity": (0, 0, NAN)},
        {"gravity": (0, 0, math.inf)},
        {"gravity": (0, 0)},
        {"bow": (0, NAN, 0)},
        {"bow": (0, 0, 0)},
        {"bow": (0, 0)},
        {"tolerance": NAN},
        {"tolerance": -1e-9},
        {"solver": "newton"},
        {"transcription": "shooting"},
    ],
    ids=str,
)
def test_options_that_cannot_be(option):
    name = next(iter(option))
    with pytest.raises(ho.ProblemError, match=f"{name}: .*expected"):
        ho.equilibrium(CABLE, START, END, **option)


def test_the_names_of_solvers_are_told():
    with pytest.raises(ho.ProblemError, match=r"'newton'.*'gauss-newton'.*'levenberg-marquardt'.*'ipopt'"):
        ho.equilibrium(CABLE, START, END, solver="newton")


@pytest.mark.parametrize(
    "build",
    [
        lambda: moving(ho.Hinge((0, NAN, 0), (0, 0, 1), 0, 0.1)),
        lambda: moving(ho.Hinge((0, 0, 0), (0, 0, NAN), 0, 0.1)),
        lambda: moving(ho.Hinge((0, 0, 0), (0, 0, 0), 0, 0.1)),
        lambda: moving(ho.Hinge((0, 0, 0), (0, 0, 1), 0, NAN)),
        lambda: moving(ho.Slide((0, 0, NAN), 0, 0.1)),
        lambda: moving(ho.Slide((0, 0, 1), NAN, 0.1)),
        lambda: moving(ho.Poses((0.0, 1.0), ((0, 0, 0), (0, NAN, 0)), (UP, UP))),
        lambda: moving(ho.Poses((0.0, NAN), ((0, 0, 0), (0, 0, 0)), (UP, UP))),
        lambda: moving(ho.Poses((0.0, 1.0), ((0, 0, 0), (0, 0, 0)), (UP, (0, 0, 0, 0)))),
        lambda: moving(ho.Slide((0, 0, 1), 0, 0.1), gravity=(0, 0, NAN)),
        lambda: moving(ho.Slide((0, 0, 1), 0, 0.1), spatial_step=NAN),
        lambda: moving(ho.Slide((0, 0, 1), 0, 0.1), spatial_step=-1.0),
    ],
    ids=[
        "hinge point",
        "hinge axis",
        "hinge axis of no length",
        "hinge angle",
        "slide direction",
        "slide travel",
        "poses position",
        "poses times",
        "poses quaternion",
        "gravity",
        "spatial step",
        "negative spatial step",
    ],
)
def test_a_motion_that_cannot_be(build):
    with pytest.raises(ho.ProblemError):
        ho.simulate(build())


@pytest.mark.parametrize("step", [NAN, -0.1, 0.0, 0.11])
def test_a_spatial_step_that_cannot_be(step):
    with pytest.raises(ho.ProblemError, match=r"spatial_step: found .*, expected"):
        ho.simulate(moving(ho.Slide((0, 0, 1), 0, 0.1)), spatial_step=step)


def test_a_spatial_step_as_long_as_the_trail():
    assert len(ho.simulate(moving(ho.Slide((0, 0, 1), 0, 0.1)), spatial_step=0.1).motion) == 2


@pytest.mark.parametrize("frames", [[], [0.0, 0.0], [0.5, 0.2], [-0.1, 1.0], [0.0, 1.1], [0.0, NAN], [[0.0, 1.0]]])
def test_frames_that_cannot_be(frames):
    with pytest.raises(ho.ProblemError, match=r"frames: found .*, expected"):
        ho.simulate(moving(ho.Slide((0, 0, 1), 0, 0.1)), frames=frames)


def test_frames_as_given():
    motion = ho.simulate(moving(ho.Slide((0, 0, 1), 0, 0.1)), frames=[0.1, 0.5, 0.7])
    np.testing.assert_array_equal(motion.motion, [0.1, 0.5, 0.7])
    with pytest.raises(ho.ProblemError, match="spatial_step: found beside frames"):
        ho.simulate(motion.problem, frames=[0.1, 0.5], spatial_step=0.01)

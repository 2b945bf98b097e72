"""Turns stay in a cable: what its clamps ask for is there, or it is refused; and rolls found once are held."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.limits import all_limits
from harness_opt.errors import Status
from harness_opt.numerics import rotations

HOSE = ho.Cable(1.0, 0.012, 0.05, 0.05)
TEXT = """
schema = 1
[cables.hose]
length = 1.0
diameter = 0.012
bending_stiffness = 0.05
torsional_stiffness = 0.05
start = {{ position = [0, 0, 0], tangent = [1, 0, 0] }}
end = {{ position = [0.5, 0, 0], tangent = [1, 0, 0], turns = {turns} }}
[limits]
{clearance}
twist_deg_per_m = 10
"""


def hose(turns: float, distance: float = 0.5, **more: object) -> ho.Problem:
    """Return a hose between two clamps on one line; with ``travel`` its end comes nearer and goes back."""
    ends = ho.End((0, 0, 0), tangent=(1, 0, 0)), ho.End((distance, 0, 0), tangent=(1, 0, 0), turns=turns, body="b")
    travel = more.pop("travel", 0.0)
    bodies = {"b": ho.Body(ho.Slide((-1, 0, 0), 0.0, travel) if travel else None)}
    return ho.Problem({"hose": ho.CableRun(HOSE, *ends)}, bodies, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("turns", [3, 4])
def test_turns_that_would_have_to_pass_through_are_refused(turns):
    with pytest.raises(ho.SolveError) as error:
        ho.simulate(hose(turns))
    assert error.value.status is Status.NOT_WITHOUT_CONTACT
    shape = ho.equilibrium(HOSE, *hose(turns).ends("hose", [0.0])[0], throw=False)
    assert shape.ok  # the clamps alone ask for none: the frames are the same
    ends = hose(turns).cables["hose"].start, dataclasses.replace(hose(turns).cables["hose"].end, body="world")
    assert ho.equilibrium(HOSE, *ends, throw=False).status is Status.NOT_WITHOUT_CONTACT


@pytest.mark.parametrize("turns", [3, 4])
def test_with_a_limit_the_clearance_to_itself_is_violated(turns):
    problem = hose(turns, limits=ho.Limits(clearance=0.001))
    motion = ho.simulate(problem)
    assert motion.begun_through_themselves == ("hose",) and motion.through_themselves == {"hose": (0, 0.0)}
    row = next(row for row in all_limits(problem, motion, ho.clearances(motion)) if row.part == "cable:hose")
    assert row.margin == pytest.approx(-0.013) and row.certified


@pytest.mark.parametrize(("clearance", "code"), [("clearance = 0.001", 1), ("", 3)])
@pytest.mark.parametrize("turns", [3, 4])
def test_exit_codes(turns, clearance, code, tmp_path):
    file = tmp_path / "hose.toml"
    file.write_text(TEXT.format(turns=turns, clearance=clearance))
    command = ["simulate", str(file), "-o", str(tmp_path / "out"), "--no-pictures", "--json"]
    done = subprocess.run([sys.executable, "-m", "harness_opt", *command], capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    if code == 3:
        assert "not without contact" in done.stderr + done.stdout
    else:
        assert json.loads(done.stdout)["status"] == "violated"


@pytest.mark.parametrize("turns", [0.0, 0.2])
def test_one_of_a_family_ends_where_it_began(turns):
    motion = ho.simulate(hose(turns, 0.9, travel=0.3, out_and_back=True, spatial_step=0.02))
    shapes = motion.cables["hose"]
    assert shapes.stable.all() and not motion.snaps
    assert np.max(np.abs(shapes.position[-1] - shapes.position[0])) < 1e-9
    assert any("one of a family, free to turn about" in words for words in motion.left_out)


def test_weight_or_clamps_aside_leave_no_family():
    aside = hose(0, 0.9)
    run_ = aside.cables["hose"]
    moved = dataclasses.replace(run_, end=dataclasses.replace(run_.end, position=(0.9, 0.01, 0.0)))
    assert not any(
        "family" in words for words in ho.simulate(dataclasses.replace(aside, cables={"hose": moved})).left_out
    )


def swung(fitted_at: float) -> ho.Motion:
    """Return the motion of a cable whose end is hinged by 140 degrees about an axis across it."""
    cable = ho.Cable(0.3, 0.004, 6e-4, 5e-4, 0.03)
    end = ho.End((0.1, 0, 0.15), tangent=(0.3, 0.1, 1), body="b")
    runs = {"lead": ho.CableRun(cable, ho.End((0, 0, 0), tangent=(0, 0.2, 1)), end, fitted_at=fitted_at)}
    bodies = {"b": ho.Body(ho.Hinge((0, 0, 0), (0, 0.2, 1), 0.0, math.radians(140)))}
    return ho.simulate(ho.Problem(runs, bodies, gravity=(0, 0, -9.81), spatial_step=0.01))


@pytest.mark.parametrize("fitted_at", [0.0, 0.5, 1.0])
def test_the_roll_is_held_from_where_it_was_fitted(fitted_at):
    motion = swung(fitted_at)
    shapes = motion.cables["lead"]
    twist = [float(np.interp(fitted_at, motion.motion, shapes.curvature[:, k, 2])) for k in (0, 50, 100)]
    assert np.max(np.abs(twist)) < (1e-4 if fitted_at != 0.5 else 0.1)  # 1/m; between two frames it is interpolated
    assert np.max(np.abs(shapes.curvature[..., 2])) > 1.0
    body = motion.problem.poses("b", motion.motion)[1]
    held = rotations.multiply(rotations.conjugate(body), shapes.quaternion[:, -1])
    held *= np.sign(held @ held[0])[:, None]
    assert np.max(np.abs(held - held[0])) < 1e-9

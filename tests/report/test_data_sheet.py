"""Data sheets: ranges against motions that are known in closed form, rainflow counts against the standard's example."""

from __future__ import annotations

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.model.results import CableMotion, Motion
from harness_opt.report.data_sheet import data_sheets, rainflow_cycles
from harness_opt.report.summary import summary

# ASTM E1049-85, section 5.4.5 and figure 6: the counts of this history, begun at its highest peak
STANDARD = np.array([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0])
CLOCKWISE = ho.Hinge((0, 0, 0), (0, 0, 1), 0.0, 1.0)


def moved(curvature: np.ndarray, position: np.ndarray | None = None, **changes: object) -> Motion:
    """Return a motion with the given Darboux vectors (P, N, 3), of a cable 0.1 m long and 4 mm thick."""
    frames, stations, _ = curvature.shape
    s = np.linspace(0.0, 0.1, stations)
    if position is None:
        position = np.zeros((frames, stations, 3))
        position[..., 0] = s
    ends = (ho.End((0, 0, 0), (1, 0, 0, 0)), ho.End((0, 0, 0.1), (1, 0, 0, 0), body="arm"))
    given = {
        "cables": {"lead": ho.CableRun(ho.Cable(0.1, 0.004, 1e-3, 1e-3), *ends)},
        "bodies": {"arm": ho.Body(CLOCKWISE)},
        "gravity": (0.0, 0.0, -9.81),
    }
    problem = ho.Problem(**{**given, **changes})  # type: ignore[arg-type]
    known, zero = np.ones(frames, dtype=bool), np.zeros((frames, stations, 3))
    quaternion = np.broadcast_to([1.0, 0, 0, 0], (frames, stations, 4))
    cable = CableMotion(s, position, quaternion, curvature, zero, zero, known, *np.zeros((3, frames)))
    return Motion(problem, np.linspace(0, 1, frames), {"lead": cable})


def test_rainflow_counts_are_those_of_the_standard():
    found = {cycle.range: cycle.count for cycle in rainflow_cycles(STANDARD, closed=True)}
    assert found == pytest.approx({9.0: 1.0, 7.0: 1.0, 4.0: 1.0, 3.0: 1.0}, rel=1e-3)


def test_a_way_that_is_not_closed_is_gone_back():
    there = np.array([0.0, 3.0, 1.0, 2.0])
    found = {cycle.range: cycle.count for cycle in rainflow_cycles(there, closed=False)}
    # 0 3 1 2 1 3 and again: between the peaks of 3 one cycle to 0, one to 1, and one of 1 within it
    assert found == pytest.approx({3.0: 1.0, 2.0: 1.0, 1.0: 1.0}, rel=5e-3)


def test_what_does_not_range_has_no_cycles():
    assert rainflow_cycles(np.full(5, 7.0), closed=False) == ()
    assert rainflow_cycles(np.zeros(0), closed=False) == ()


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.3])
def test_bending_ranges_along_the_direction_it_ranges_in(angle):
    amount = np.linspace(-20.0, 30.0, 11)[:, None] * np.linspace(0.2, 1.0, 5)  # most at the end of the cable
    way = np.array([np.cos(angle), np.sin(angle), 0.0])
    sheet = data_sheets(moved(amount[..., None] * way))["lead"]
    assert sheet.bend.range == pytest.approx(50.0, rel=1e-4)
    assert sheet.bend.arc_length == pytest.approx(0.1)
    assert [(cycle.range, cycle.count) for cycle in sheet.bend.cycles] == [(pytest.approx(50.0, rel=2e-3), 1.0)]
    assert sheet.bend_radius == pytest.approx(1 / 30) and sheet.bend_diameters == pytest.approx(1 / 30 / 0.004)
    assert sheet.twisting.range == 0.0 and sheet.twisting.cycles == ()


def test_a_closed_motion_is_one_cycle_and_an_open_one_two_ways():
    twist = np.zeros((21, 3, 3))
    twist[..., 2] = np.sin(np.linspace(0, 2 * np.pi, 21))[:, None]
    closed = data_sheets(moved(twist, bodies={"arm": ho.Body(ho.Hinge((0, 0, 0), (0, 0, 1), 0.0, 2 * np.pi))}))["lead"]
    there = data_sheets(moved(twist))["lead"]
    assert [(cycle.range, cycle.count) for cycle in closed.twisting.cycles] == [(pytest.approx(2.0), 1.0)]
    # 0 1 -1 0 -1 1 0, and again: the whole range once, and from either peak to 0 and back
    counted = [(round(cycle.range, 6), abs(round(cycle.mean, 6)), cycle.count) for cycle in there.twisting.cycles]
    assert counted == [(2.0, 0.0, 1.0), (1.0, 0.5, 1.0), (1.0, 0.5, 1.0)]
    out_and_back = data_sheets(moved(twist, out_and_back=True))["lead"]
    assert out_and_back == closed


def test_sag_hangs_below_the_lower_end_along_gravity():
    position = np.zeros((2, 3, 3))
    position[0] = [[0, 0, 0.0], [0.05, 0, -0.07], [0.1, 0, -0.02]]
    position[1] = [[0, 0, 0.0], [0.05, 0, 0.07], [0.1, 0, -0.02]]
    zero = np.zeros((2, 3, 3))
    assert data_sheets(moved(zero, position))["lead"].sag == pytest.approx(0.05)
    assert data_sheets(moved(zero, position, gravity=(0.0, 0.0, 0.0)))["lead"].sag is None
    assert data_sheets(moved(zero, position))["lead"].reach == pytest.approx((0.104, 0.004, 0.144))


def test_the_summary_tells_it_in_the_units_of_the_problem_file():
    twist = np.zeros((3, 4, 3))
    twist[..., 2] = np.array([-1.0, 0.0, 2.0])[:, None]
    content = summary(moved(twist))["data_sheet"]["lead"]
    assert content["twist_deg_per_m"] == pytest.approx(np.degrees(2.0))
    assert content["twist_range_deg_per_m"]["range"] == pytest.approx(np.degrees(3.0))
    assert content["twist_range_deg_per_m"]["cycles"][0]["range"] == pytest.approx(np.degrees(3.0), rel=1e-3)

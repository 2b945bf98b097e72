"""The four reference shapes, solved outside the project by ``solve_bvp`` at 1e-10 and checked by shooting."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations
from oracles.reference import CASES, ENERGY, LOAD, SHAPE, G, assert_tabulated, cable, ends, table


def test_elastica():
    name = "clamped_elastica_060"
    shape = ho.equilibrium(cable(name), *ends(name), bow=(0, 0, 1))
    assert shape.ok and shape.stable
    assert_tabulated(name, shape, shape.energy)


def test_3d_shape_is_where_the_motion_of_the_readme_leads():
    name = "clamped_3d"
    start, end = ends(name)
    turned = rotations.normalise(rotations.multiply(end.quaternion, rotations.conjugate(start.quaternion)))
    motion = ho.Poses((0.0, 1.0), ((0.9, 0, 0), end.position), ((1, 0, 0, 0), tuple(turned)))
    run = ho.CableRun(cable(name), start, ho.End((0, 0, 0), start.quaternion, body="gripper"), bow=(0, 0, 1))
    result = ho.simulate(ho.Problem({"lead": run}, {"gripper": ho.Body(motion)}))
    lead = result.cables["lead"]
    assert result.ok and not result.snaps and np.all(lead.stable)
    last = SimpleNamespace(**{key: getattr(lead, key)[-1] for key in vars(table(name)) if key != "s"})
    assert_tabulated(name, last)
    # the energy, from the curvatures: half of K omega^2, integrated by Simpson's rule over the 101 stations
    density = 0.5 * lead.curvature[-1] ** 2 @ cable(name).stiffness
    simpson = (density[0] + density[-1] + 4 * density[1:-1:2].sum() + 2 * density[2:-1:2].sum()) / 300
    assert simpson == pytest.approx(CASES[name]["energy"], rel=ENERGY)


@pytest.mark.parametrize("negated", [False, True])
def test_weight_switched_on(negated):
    name = "clamped_3d_weight_30"
    start, end = ends(name)
    if negated:  # the same clamp: a quaternion and its negative are one orientation
        end = ho.End(end.position, tuple(-np.array(end.quaternion)))
    shape = ho.equilibrium(cable("clamped_3d"), start, end, bow=(0, 1, 0))
    assert_tabulated("clamped_3d", shape, shape.energy)
    for weight in (10.0, 20.0, 30.0):
        heavy = ho.Cable(1.0, 0.01, 1.0, 0.7, weight / G)
        shape = ho.equilibrium(heavy, start, end, (0, 0, -G), guess=shape)
    assert shape.ok and shape.stable
    assert_tabulated(name, shape, shape.energy)


@pytest.mark.parametrize("bow", [None, (0, 0, 1), (0, 0, -1), (0, 1, 0), (0, -1, 0)])
def test_twist_rig(bow):
    name = "twist_rig_080_180deg"
    shape = ho.equilibrium(cable(name), *ends(name), (0, 0, -G), bow=bow)
    assert shape.ok and shape.stable
    assert_tabulated(name, shape, shape.energy)


def test_twist_rig_the_other_way_is_the_mirror_image():
    name = "twist_rig_080_180deg"
    start, end = ends(name)
    shape = ho.equilibrium(cable(name), start, ho.End(end.position, end.quaternion, turns=-1), (0, 0, -G))
    expected = table(name)
    assert shape.ok and shape.stable
    assert np.max(np.abs(shape.position * (1, -1, 1) - expected.position)) < SHAPE
    assert np.max(np.abs(shape.moment * (-1, 1, -1) - expected.moment)) < LOAD * np.max(np.abs(expected.moment))

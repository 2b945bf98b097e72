"""Derivatives of the collocation's equations against finite differences: the Jacobian, and rates by parameters."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from harness_opt.numerics import rotations
from oracles.equations import KINDS, bound, named, setup

STEP = 1e-5  # of central differences of functions that are polynomials of entries of order one
CLOSE = 1e-8  # relative; the differences themselves are good to about 1e-9


def differences(function, at: np.ndarray, step: float = STEP) -> np.ndarray:
    """Return the Jacobian of ``function`` by central differences of fourth order."""
    columns = []
    for direction in np.eye(len(at)) * step:
        near = function(at + direction) - function(at - direction)
        far = function(at + 2 * direction) - function(at - 2 * direction)
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("loaded", [False, True], ids=["weightless", "loaded"])
@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_jacobian(kind, loaded):
    given, x = setup(kind, loaded)
    equations = bound(given)
    residual, jacobian = equations.linearise(x)
    assert jacobian.shape == (len(x), len(x))
    np.testing.assert_array_equal(residual, equations.residual(x))
    exact = differences(equations.residual, x, 1e-3)
    assert np.max(np.abs(jacobian.toarray() - exact)) < CLOSE * np.max(np.abs(exact))


@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_symbolic_residual_is_the_numeric_one(kind):
    import casadi as ca

    given, x = setup(kind, True)
    unknowns, residual = bound(given).symbolic()
    symbolic = np.asarray(ca.Function("r", [unknowns], [residual])(x)).ravel()
    np.testing.assert_allclose(symbolic, bound(given).residual(x), rtol=0, atol=1e-12)


def changed(given: dict, parameter: str, amount: np.ndarray) -> dict:
    """Return the parameters with one of them moved by ``amount`` (3,)."""
    boundary = given["boundary"]
    if parameter == "load":
        return given | {"load": given["load"] + amount}
    if parameter == "rest":
        rest = given["section"].rest_curvature + amount
        return given | {"section": dataclasses.replace(given["section"], rest_curvature=rest)}
    if parameter.endswith("_turn"):
        name = parameter.replace("turn", "quaternion")
        turned = rotations.multiply(getattr(boundary, name), rotations.from_rotation_vector(amount))
        return given | {"boundary": dataclasses.replace(boundary, **{name: turned})}
    return given | {"boundary": dataclasses.replace(boundary, **{parameter: getattr(boundary, parameter) + amount})}


LOADS = ("start_force", "end_force", "start_moment", "end_moment")
PARAMETERS = ("gap", "start_turn", "end_turn", "rest", "load", *LOADS)


@pytest.mark.parametrize("parameter", PARAMETERS)
@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_parameter_rates(kind, parameter):
    given, x = setup(kind, True)
    exact = differences(lambda p: bound(changed(given, parameter, p)).residual(x), np.zeros(3), 1e-3)
    rates = {name: np.zeros((3, 3)) for name in PARAMETERS} | {parameter: np.eye(3)}
    loads = {name: rates.pop(name) for name in LOADS}
    found = bound(given).rates(x, **rates, loads=loads)
    assert np.max(np.abs(found - exact)) < CLOSE * (1 + np.max(np.abs(exact)))
    if parameter in LOADS:  # a load counts where it is given, and only there
        given_there = not getattr(kind, parameter.replace("force", "position").replace("moment", "orientation"))
        assert np.any(exact) == given_there

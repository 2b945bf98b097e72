"""Very heavy cables against the theory of their clamp layers.

Where weight rules, the cable is a catenary with thin layers at its clamps, in which it turns by an angle D from the
clamp's tangent into the pull F of the catenary. A beam under tension F does that with the clamp moment
2 sqrt(B |F|) sin(D / 2) (Love, "Mathematical Theory of Elasticity", section 262), up to the weight of the layer itself.
"""

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations

END = ho.End((0.5, 0.2, 0.1), (0.8, 0.6, 0, 0))


@pytest.mark.parametrize("stiffness", [0.7, 1000.0])
@pytest.mark.parametrize(("weight", "layer"), [(1e4, 0.1), (1e5, 0.05), (1e6, 0.03)])
def test_clamp_moment_of_a_heavy_cable(weight, layer, stiffness):
    cable = ho.Cable(1.0, 0.01, 1.0, stiffness, weight)
    shape = ho.equilibrium(cable, ho.End((0, 0, 0), (1, 0, 0, 0)), END, (0, 0, -1), tolerance=1e-7)
    assert shape.ok and shape.stable
    np.testing.assert_allclose(shape.position[-1], END.position, atol=1e-7)
    assert abs(abs(shape.quaternion[-1] @ np.array(END.quaternion)) - 1) < 1e-9
    # no station is further from the next one than the arc between them
    assert np.max(np.linalg.norm(np.diff(shape.position, axis=0), axis=1)) <= 0.01 * (1 + 1e-9)
    pull = np.linalg.norm(shape.force[0])
    turn = np.arccos(shape.force[0] @ rotations.tangent(shape.quaternion[0]) / pull)
    expected = 2.0 * np.sqrt(pull) * np.sin(0.5 * turn)
    assert np.linalg.norm(shape.moment[0]) == pytest.approx(expected, rel=layer)

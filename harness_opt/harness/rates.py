"""How what is free in a harness follows the design: implicit differentiation of its balance.

What the design moves by itself, the clamps and lengths of the spans with all poses held, changes what pulls at the
joints by the spans' end stiffnesses; the poses follow until nothing pulls any more. From g(y, p) = 0 follows
dy/dp = -H^-1 dg/dp with the Hessian H of the whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness_opt.harness.balance import NEUTRAL, State
from harness_opt.harness.span_loads import POSITION, ROTATION
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array


def followed_by(state: State, own: Sequence[Array]) -> list[Array]:
    """Return how the ends and lengths of all spans move with k design variables, what is free following.

    Args:
        state: balanced.
        own: how they move where all poses are held, for each span (SIZE, k): in the order of
            :mod:`harness_opt.harness.span_loads`, world.

    Returns:
        The same with everything free in balance.
    """
    freedoms, moved = state.harness.freedoms, np.zeros((state.harness.freedoms.size, own[0].shape[1]))
    for number, (span, (columns, moves), ends) in enumerate(zip(state.spans, state.moves, own, strict=True)):
        moved[columns] += moves.T @ span.stiffness @ ends
        for side, end in enumerate(freedoms.ends[number]):
            if end.carrier is not None:  # the arm of the force grows by what the design moves on the body
                force = span.gradient[POSITION[side]]
                place = freedoms.of_body(end.carrier)
                moved[place.start + 3 : place.stop] += np.cross(ends[POSITION[side]].T, force).T
            if end.clip is not None and freedoms.clips[end.clip].clip.freedoms == 1:
                tangent = rotations.tangent(state.placed.clips[end.clip])
                tilted = np.cross(ends[ROTATION[side]].T, tangent)
                moved[freedoms.of_clip(end.clip).start] += tilted @ span.gradient[ROTATION[side]]
    scales, stiff = state.harness.scales, state.harness.stiff
    slope = moved * scales[:, None] / stiff
    way = -scales[:, None] * np.linalg.lstsq(state.matrix, slope, rcond=NEUTRAL)[0]
    return [ends + moves @ way[columns] for ends, (columns, moves) in zip(own, state.moves, strict=True)]

"""What of a clearance is of second order where a cable passes the edges and corners of a part.

A point of the cable that moves by u relative to the part has the distance d + n.u + u.H.u / 2, with H the Hessian of
the distance: zero over a flat face, round an edge or a corner of size 1 / d. And the nearest point slides along the
cable, by s, to where n.k s^2 / 2 + n.u' s + (T s + u).H.(T s + u) / 2 is least (T tangent, k curvature of the cable);
at the end of a stretch that counts it stays. The movement u itself is taken as linear in what moves it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance.witnesses import Witnesses
from harness_opt.design.margins import at_stations
from harness_opt.model.results import STATIONS, CableMotion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.geometry import Geometry

REACH = 0.1  # of the distance: over which its gradient is differenced, so that an edge is seen before it is nearest
LEAST_REACH = 1e-5  # m
STIFFEST = 1.0  # 1/m: the least that d2/ds2 of the distance is taken for; flatter places slide further than is linear


@dataclass(frozen=True)
class Passing:
    """Points of a cable that pass a part, W of them, and how they move with k quantities.

    Args:
        found: the points, and what is nearest to them.
        moved: their rates relative to the part, (W, 3, k).
        rates: rates (P, N, 3, k) of the whole cable at its stations.
        still: (W,), whether a point stays where it is along the cable.
    """

    found: Witnesses
    moved: Array
    rates: Array
    still: NDArray[np.bool_]


def second_order(passing: Passing, shapes: CableMotion, geometry: Geometry, pose: tuple[Array, Array]) -> Array:
    """Return the second derivatives (W, k, k) of the clearances by the quantities, m.

    Args:
        passing: the points.
        shapes: of the cable.
        geometry: the part.
        pose: of the part's body at each point: (W, 3), (W, 4).
    """
    found, s = passing.found, shapes.s
    frame, arc, step = found.frame, found.arc_length, s[-1] / (STATIONS - 1)
    before, after = np.clip(arc - step, s[0], s[-1]), np.clip(arc + step, s[0], s[-1])
    width = after - before
    tangents = rotations.tangent(shapes.quaternion)[..., None]
    tangent = at_stations(tangents, s, frame, arc)[..., 0]
    turned = at_stations(tangents, s, frame, after) - at_stations(tangents, s, frame, before)
    bent = np.einsum("wc,wc->w", found.normal, turned[..., 0]) / width
    parted = at_stations(passing.rates, s, frame, after) - at_stations(passing.rates, s, frame, before)
    place = at_stations(shapes.position[..., None], s, frame, arc)[..., 0]
    hessian = _hessian(geometry, place, pose)
    pushed = hessian @ passing.moved
    pull = np.einsum("wc,wck->wk", tangent, pushed) + np.einsum("wc,wck->wk", found.normal, parted) / width[:, None]
    stiffness = np.maximum(np.einsum("wc,wcd,wd->w", tangent, hessian, tangent) + bent, STIFFEST)
    slid = pull[:, :, None] * pull[:, None, :] / stiffness[:, None, None]
    slid[passing.still] = 0.0
    result: Array = np.swapaxes(passing.moved, 1, 2) @ pushed - slid
    return result


def _hessian(geometry: Geometry, place: Array, pose: tuple[Array, Array]) -> Array:
    """Return the Hessians (W, 3, 3), world, of the distance to a part at ``place`` (W, 3), world."""
    position, quaternion = pose
    local = rotations.rotate(rotations.conjugate(quaternion), place - position)
    reach = np.maximum(REACH * np.abs(geometry.signed_distance(local)[0]), LEAST_REACH)[:, None]
    columns = [
        (geometry.signed_distance(local + reach * axis)[1] - geometry.signed_distance(local - reach * axis)[1])
        / (2.0 * reach)
        for axis in np.eye(3)
    ]
    hessian = np.stack(columns, axis=-1)
    frame = rotations.matrix(quaternion)
    return frame @ (0.5 * (hessian + np.swapaxes(hessian, 1, 2))) @ np.swapaxes(frame, 1, 2)

"""A cable clipped to a stand and to an arm that turns."""

from __future__ import annotations

import numpy as np

import harness_opt as ho


def arm(**changes: object) -> ho.Problem:
    """Return the problem, with ``changes`` of its parts."""
    clips = (
        ho.Clip(name="elbow", at=0.15, position=(0.0, 0.04, 0.23), tangent=(0.3, 0, 1)),
        ho.Clip(name="wrist", at=0.42, body="arm", position=(0.1, 0.04, 0.4), tangent=(1, 0, 0.2)),
    )
    run = ho.CableRun(
        ho.Cable(0.66, 0.006, 2.1e-3, 1.6e-3, 0.05),
        ho.End((0, 0, 0.1), tangent=(0, 0, 1)),
        ho.End((0.3, 0, 0.45), tangent=(1, 0, 0), body="arm"),
        clips=clips,
    )
    given = {
        "cables": {"lead": run},
        "bodies": {"arm": ho.Body(ho.Hinge((0, 0, 0.3), (0, 1, 0), 0.0, float(np.radians(40))))},
        "parts": {"post": ho.Part(ho.Box((0.02, 0.02, 0.2)), position=(0.06, 0.0, 0.2))},
        "gravity": (0, 0, -9.81),
        "limits": ho.Limits(clearance=0.004, bend_radius=0.02, clamp_force=20, clip_force=10, clip_moment=0.4),
    }
    return ho.Problem(**{**given, **changes})  # type: ignore[arg-type]

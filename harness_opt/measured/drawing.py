"""Measured points and the shapes found, as a drawing: SVG, in the plane of gravity."""

from __future__ import annotations

from html import escape

import numpy as np

from harness_opt.measured.fit import Agreement, Identification
from harness_opt.numerics.rotations import Array

WIDE, HIGH, MARGIN, WORDS = 260.0, 220.0, 16.0, 34.0  # of one shape, and of the words above it, in pixels
COLUMNS = 4
SHAPE, POINT, INK = "#0072b2", "#d55e00", "#444"  # blue and vermilion, which everybody can tell apart


def drawing(found: Identification) -> str:
    """Return the shapes of all measured loops as one SVG, empty where none was measured."""
    loops = [one for one in found.agreements if len(one.points)]
    if not loops:
        return ""
    columns = min(COLUMNS, len(loops))
    rows = -(-len(loops) // columns)
    size = f"{columns * WIDE:.0f} {rows * (HIGH + WORDS):.0f}"
    body = "\n".join(_loop(one, WIDE * (k % columns), (HIGH + WORDS) * (k // columns)) for k, one in enumerate(loops))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" font-family="sans-serif" font-size="13">\n'
        f'<rect width="100%" height="100%" fill="white"/>\n{body}\n</svg>\n'
    )


def _loop(one: Agreement, left: float, top: float) -> str:
    """Return one loop at a place of the drawing: the computed shape as a line, the points as rings."""
    places = np.vstack([one.shape, one.points])[:, [0, 2]]
    low, span = places.min(axis=0), np.ptp(places, axis=0)
    scale = min((WIDE - 2 * MARGIN) / max(span[0], 1e-12), (HIGH - 2 * MARGIN) / max(span[1], 1e-12))
    middle = np.array([0.5 * (WIDE - scale * span[0]), 0.5 * (HIGH - scale * span[1])])

    def placed(points: Array) -> Array:
        seen = middle + scale * (points[:, [0, 2]] - low)
        return np.column_stack([left + seen[:, 0], top + WORDS + HIGH - seen[:, 1]])

    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in placed(one.shape))
    rings = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3"/>' for x, y in placed(one.points))
    words = f"{1e3 * one.after:.1f} mm, {100 * (one.share or 0.0):.2f} % of the length"
    return (
        f'<text x="{left + MARGIN:.0f}" y="{top + 16:.0f}" fill="{INK}">{escape(one.name)}</text>\n'
        f'<text x="{left + MARGIN:.0f}" y="{top + 32:.0f}" fill="{INK}">{words}</text>\n'
        f'<polyline points="{line}" fill="none" stroke="{SHAPE}" stroke-width="2"/>\n'
        f'<g fill="none" stroke="{POINT}">{rings}</g>'
    )

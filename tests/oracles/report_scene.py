"""A cable over a ball to a flap, and what its report says: for tests of pages."""

from __future__ import annotations

import json
import re

import numpy as np

import harness_opt as ho
from harness_opt.model.results import Motion
from harness_opt.report import html_page as html_report
from harness_opt.report.summary import summary


def flap(**changes: object) -> ho.Problem:
    """Return a cable that bows over a ball to a flap that opens by 20 degrees."""
    ends = {
        "start": ho.End(position=(0, 0, 0), quaternion=(1, 0, 0, 0)),
        "end": ho.End(position=(0.15, 0.02, 0), quaternion=(0, 0, 1, 0), body="flap"),
    }
    given = {
        "cables": {"lead": ho.CableRun(ho.Cable(0.3, 0.005, 2e-3, 1.5e-3, 0.05), **ends)},
        "bodies": {"flap": ho.Body(ho.Hinge((0.2, 0, 0), (0, 1, 0), 0.0, np.deg2rad(20)))},
        "parts": {"ball": ho.Part(ho.Sphere(0.02), position=(0.08, 0, 0))},
        "gravity": (0.0, 0.0, -9.81),
        "limits": ho.Limits(clearance=0.004, bend_radius=0.01, twist=6.0, clamp_force=50.0, clamp_moment=5.0),
        "spatial_step": 0.01,
        "title": "A flap",
    }
    return ho.Problem(**{**given, **changes})  # type: ignore[arg-type]


def page_of(result) -> str:
    return html_report.html(html_report.prepare(result), summary(result))


def data_of(page: str) -> dict:
    """Return what the page's script is given."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1])


def many(frames: int) -> Motion:
    """Return the flap's motion in so many frames."""
    return ho.simulate(flap(), frames=np.linspace(0.0, 1.0, frames))


def heights(path: str) -> list[float]:
    return [float(y) for y in re.findall(r"[ML][\d.]+ (-?[\d.]+)", path)]

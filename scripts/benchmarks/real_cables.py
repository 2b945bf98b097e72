"""Photographed loops of two real cables beside computed ones: the table of the validation page.

    python scripts/benchmarks/real_cables.py

For each cable the mean distance of the points of its five loops from the computed shapes, in per cent of its length,
with the published stiffness and with the one that ``identify`` finds in them; and the twist of one holder at which the
loop leaves its plane, measured and computed with the published stiffness.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

import harness_opt as ho
from harness_opt.measured.measurements import Pose
from harness_opt.measured.snap import snap_twist

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from oracles.measured import CABLES, GRAVITY, LOOPS, photographed  # noqa: E402


def main() -> None:
    """Print the table."""
    print("| cable | B published | B found, 95 % | distance, published | distance, found | twist seen | computed |")
    print("|---|---|---|---|---|---|---|")
    for name, (mass, bending, ratio, seen) in CABLES.items():
        file = LOOPS / f"{name}.toml"
        file.write_text(photographed(name), encoding="utf-8")
        try:
            found = ho.identify(file)
        finally:
            file.unlink()
        (one,) = found.estimates
        before, after = (
            100 * float(np.mean([getattr(each, when) for each in found.agreements])) / 1.5
            for when in ("before", "after")
        )
        cable = ho.Cable(1.5, 3e-3, bending, ratio * bending, mass)
        ends = ho.End((0, 0, 0), tangent=(1, 0, 0), roll_deg=0), ho.End((-0.123, 0, 0), tangent=(1, 0, 0))
        twist = math.degrees(snap_twist(Pose(1.5, *ends, bow=(0, 0, -1)), cable, GRAVITY, math.radians(seen)))
        print(
            f"| {name} | {bending:.3e} | {one.value:.3e}, {one.low:.2e} to {one.high:.2e} | {before:.2f} % "
            f"| {after:.2f} % | {seen:.0f} deg | {twist:.0f} deg, {100 * (twist / seen - 1):+.1f} % |"
        )


if __name__ == "__main__":
    main()

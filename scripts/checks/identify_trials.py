"""How often the stated interval of 95 % holds the true stiffness: 1,000 photographs of one loop, each with other noise.

    python scripts/checks/identify_trials.py
    python scripts/checks/identify_trials.py --trials 100

Says how many intervals hold it, and how long one identification takes. Of 1,000, 950 are expected, and 930 to 970 in
997 of 1,000 such counts. Exit code 1 outside of that.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time

import numpy as np

import harness_opt as ho
from harness_opt.measured.measurements import Measurement, Measurements, Pose

BENDING, NOISE, POINTS = 1e-3, 2e-3, 40  # N m2; m, of every coordinate; along the loop
GRAVITY = (0.0, 0.0, -9.81)


def main() -> int:
    """Run the trials; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=1000)
    trials = parser.parse_args().trials
    cable = ho.Cable(1.2, 6e-3, BENDING, 0.8 * BENDING, 0.05)
    start = ho.End((0.0, 0.0, 0.0), tangent=(1.0, 0.0, 0.0), roll_deg=0.0)
    pose = Pose(1.2, start, ho.End((-0.1, 0.0, 0.0), tangent=(1.0, 0.0, 0.0)), bow=(0.0, 0.0, -1.0))
    points = ho.equilibrium(cable, pose.start, pose.end, GRAVITY, bow=pose.bow).at(np.linspace(0.0, 1.2, POINTS))
    inside, seconds = 0, []
    for seed in range(trials):
        noise = NOISE * np.random.default_rng(seed).standard_normal((POINTS, 3)) * np.array([1.0, 0.0, 1.0])
        loop = Measurement("loop", "loop", pose, 0.0, points.position + noise, None, True, NOISE, True)
        begin = time.perf_counter()
        (estimate,) = ho.identify(Measurements(cable, ("bending_stiffness",), GRAVITY, (loop,))).estimates
        seconds.append(time.perf_counter() - begin)
        inside += estimate.low <= BENDING <= estimate.high
    spread = 3.0 * math.sqrt(trials * 0.95 * 0.05)
    print(f"{inside} of {trials} intervals hold the true stiffness; {0.95 * trials:.0f} +- {spread:.0f} expected")
    print(f"one identification: {1e3 * statistics.median(seconds):.0f} ms, the median")
    return 0 if abs(inside - 0.95 * trials) <= spread else 1


if __name__ == "__main__":
    sys.exit(main())

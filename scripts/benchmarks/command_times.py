"""How long do the commands take, as whole processes, with pictures and without?

    python scripts/benchmarks/command_times.py
    python scripts/benchmarks/command_times.py --runs 9

``check``, ``simulate`` and ``redesign`` of ``lift_arm``: medians of the processor's time, which hardly minds what else
the machine does, and of the wall's. Commands take turns; their first runs fill caches and are not counted.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PROBLEM = Path(__file__).resolve().parents[2] / "problems" / "lift_arm" / "lift_arm.toml"
COMMANDS = (
    ("check",), ("simulate",), ("redesign",), ("simulate", "--pictures", "--film"),
    ("redesign", "--pictures", "--film"),
)  # fmt: skip


def seconds(command: tuple[str, ...], folder: Path) -> tuple[float, float]:
    """Return how long a command takes by the processor and by the wall's clock, s.

    Raises:
        RuntimeError: it failed.
    """
    name, *options = command
    output = [] if name == "check" else ["-o", str(folder / "-".join(command))]
    clock, before = time.perf_counter(), sum(os.times()[2:4])
    line = [sys.executable, "-m", "harness_opt", name, str(PROBLEM), *options, *output]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    if done.returncode > 1:  # 1: a limit is violated
        raise RuntimeError(done.stderr)
    return sum(os.times()[2:4]) - before, time.perf_counter() - clock


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="that are counted")
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        rounds = [[seconds(command, Path(folder)) for command in COMMANDS] for _ in range(runs + 1)][1:]
    print("| command | processor, s | wall, s |\n|---|---|---|")
    for command, times in zip(COMMANDS, zip(*rounds, strict=True), strict=True):
        processor, wall = (statistics.median(one) for one in zip(*times, strict=True))
        print(f"| `{' '.join(command)}` | {processor:.2f} | {wall:.2f} |")


if __name__ == "__main__":
    main()

"""What does the cable of the paper's rig do when it is twisted further and further, and which rigidity makes it wrap?

    python scripts/problems/twist_rig.py -o results/twist_rig --jobs 2
    python scripts/problems/twist_rig.py --quick

The rig of section 5 of Liu et al.: a straight cable, one end turned about its own tangent, then brought towards the
other. Table 1 prints its bending rigidity as "0.134.5", so both readings of ``problems/twist_rig`` are taken. Here the
end turns by 90 to 1080 degrees (the paper's model ends at 360) while it stands at 0.98 of the cable's length, and
then comes in to 0.2: the history of the rig, so that the number of turns is what was turned in and not what a first
guess makes of it. What :func:`harness_opt.equilibrium` finds at 0.98 with no history is compared.

A table on the terminal, ``twist_rig.csv`` (a row a run), ``frames.csv`` (a row a frame), ``wrapping.png`` (how the
twist turns into loops), ``wrapping_134_5.png`` and ``readings.png`` (both readings at 180 degrees). The model knows
no contact: what follows the first touch is not what a real cable does, and a loop may pull through itself, which
takes two turns out of it. Table and pictures say where.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from twist_rig_pictures import draw_readings, draw_twists
from twist_rig_runs import CABLE, FILES, Run, run

from harness_opt.numerics import rotations

TWISTS, QUICK_TWISTS = (90, 180, 270, 360, 540, 720, 1080), (90, 180, 360)  # degrees


# --- tables -----------------------------------------------------------------------------------------------


def row(found: Run) -> dict[str, str]:
    """Return one line of the table, by its column."""
    wanted, motion = found.rig, found.motion
    stiffness = wanted.cable.stiffness
    head = {"twist deg": f"{wanted.twist:.0f}", "kz/kx": f"{stiffness[2] / stiffness[0]:.4g}"}
    if not motion.cables:
        return head | {"frames": f"0 of {len(wanted.frames)}"}
    shapes = found.shapes
    last = len(motion.motion) - 1
    snaps = [found.place(snap.frame) for snap in motion.snaps]
    coming = [at for at in snaps if "deg" not in at]
    return head | {
        "frames": f"{last + 1} of {len(wanted.frames)}",
        "stable": f"{np.count_nonzero(shapes.stable)}",
        "snaps turning": f"{len(snaps) - len(coming)}",
        "snaps coming in": ", ".join(coming) or "-",
        "ends at": found.place(last),
        "error": f"{np.max(shapes.estimated_error):.0e}",
        "residual": f"{np.max(shapes.residual):.0e}",
        "bend radius mm": f"{1e3 / np.max(np.linalg.norm(shapes.curvature[..., :2], axis=-1)):.1f}",
        "twist left rad": f"{2 * math.pi * found.twist[last]:+.2f}",
        "writhe": f"{found.writhe[last]:+.3f}",
        "turns": f"{found.turns[last]:+.4f}",
        "touches itself": found.place(found.touches),
        "turns lost": found.place(found.slipped),
        "cold start": found.cold,
        "s": f"{found.seconds:.0f}",
    }


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """Return rows as text in columns."""
    names = list(max(rows, key=len))
    wide = [max(len(name), *(len(line.get(name, "")) for line in rows)) for name in names]
    lines = [names, *([line.get(name, "") for name in names] for line in rows)]
    return "\n".join("  ".join(word.rjust(w) for word, w in zip(line, wide, strict=True)).rstrip() for line in lines)


def write_csv(file: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Write rows, the first of which has all columns."""
    rows = list(rows)
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(max(rows, key=len)))
        writer.writeheader()
        writer.writerows(rows)


def frame_rows(found: Run) -> Iterable[dict[str, object]]:
    """Return a line for each frame of a run, SI units and turns."""
    wanted, snapped = found.rig, {snap.frame for snap in found.motion.snaps}
    along = rotations.tangent(wanted.problem.cables[CABLE].start.frame)
    for k in range(len(found.motion.motion)):
        shapes = found.shapes
        yield {
            "reading": wanted.reading,
            "twist_deg": wanted.twist,
            "turned_deg": round(float(wanted.angle[k]), 6),
            "distance": round(float(wanted.distance[k]), 6),
            "twist_turns": found.twist[k],
            "writhe_turns": found.writhe[k],
            "clamp_twist_moment": shapes.moment[k, 0] @ along,
            "clamp_pull": shapes.force[k, 0] @ along,
            "bend_radius": 1.0 / np.max(np.linalg.norm(shapes.curvature[k, :, :2], axis=-1)),
            "self_clearance": found.clearance[k],
            "stable": bool(shapes.stable[k]),
            "stability_margin": shapes.stability_margin[k],
            "snapped": k in snapped,
            "estimated_error": shapes.estimated_error[k],
        }


# --- the study --------------------------------------------------------------------------------------------


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/twist_rig"), help="folder of the results")
    parser.add_argument("--quick", action="store_true", help="three twists, and half of the frames")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    twists, coarser = (QUICK_TWISTS, 2) if options.quick else (TWISTS, 1)
    asked = [(reading, twist) for reading in FILES for twist in twists]
    with ProcessPoolExecutor(options.jobs) as pool:
        pending = [pool.submit(run, *one, coarser) for one in asked]
        runs = {}
        for one, future in zip(asked, pending, strict=True):
            runs[one] = future.result()
            print(f"{one[0]} mN m2, {one[1]} degrees: {runs[one].seconds:.0f} s {runs[one].motion.message}", flush=True)
    rows = [row(found) for found in runs.values()]
    print("\n" + table(rows))
    write_csv(options.output / "twist_rig.csv", rows)
    write_csv(options.output / "frames.csv", (line for found in runs.values() for line in frame_rows(found)))
    for reading, name in (("0.1345", "wrapping.png"), ("134.5", "wrapping_134_5.png")):
        draw_twists(options.output / name, [runs[reading, twist] for twist in twists])
    draw_readings(options.output / "readings.png", [runs[reading, 180] for reading in FILES])
    print(f"\nResults: {options.output}")


if __name__ == "__main__":
    main()

"""What do large meshes, crowded scenes and long studies take, in time and in memory?

    python scripts/benchmarks/large_scenes.py -o results/large_scenes
    python scripts/benchmarks/large_scenes.py meshes crowds --quick

Each row is a process of its own: seconds of processor time, and the most memory that it held.

* meshes: a bumpy ball of so many triangles read from a binary STL file; a cable's 2,000 points asked for distances
  to it, and again; then points all around it, so that every tree that there can be is made. The triangles of a ``soup``
  have corners of their own each.
* crowds: so many cables over a hinge, beside so many boxes that stand still, all within limits: 30 frames simulated,
  and every clearance certified. The exponents are those of power laws through the largest sizes.
* study: so many variants of a small problem, on two workers, by the command: rows a second by the wall's clock, and
  the memory of the process that hands them out and of the largest worker.
"""

from __future__ import annotations

import argparse
import csv
import json
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from memory import most_memory

import harness_opt as ho
from harness_opt.parts.mesh_headers import MOST_FACES
from harness_opt.parts.scene import load_scene

ROOT = Path(__file__).resolve().parents[2]
FLAP = ROOT / "scripts" / "checks" / "flap.toml"
MESHES = ((2_000_000, "ball"), (2_000_000, "soup"), (MOST_FACES, "ball"))
CROWDS = ((5, 125), (5, 250), (5, 500), (5, 1000), (5, 100), (10, 100), (20, 100), (40, 100), (100, 1000))
VARIANTS = 5000
LARGE = 3  # sizes that an exponent is fitted to
Row = dict[str, Any]


def bumpy_ball(file: Path, triangles: int, kind: str) -> None:
    """Write a closed surface of at most so many triangles; of a soup each shrinks about its middle."""
    around = 2 * int((triangles / 4) ** 0.5)
    along = triangles // (2 * around)
    u, v = np.meshgrid(
        np.linspace(0, 2 * np.pi, around, endpoint=False), np.linspace(0, np.pi, along + 1), indexing="ij"
    )
    r = 20 + 0.5 * np.sin(9 * u) * np.sin(v) ** 2 * np.sin(7 * v)
    points = np.stack([r * np.sin(v) * np.cos(u), r * np.sin(v) * np.sin(u), r * np.cos(v)], axis=-1)
    points[:, 0], points[:, -1] = points[0, 0], points[0, -1]
    after = np.roll(points, -1, axis=0)
    a, b, c, d = points[:, :-1], after[:, :-1], after[:, 1:], points[:, 1:]
    one, other = np.stack([a, c, b], axis=2)[:, 1:], np.stack([a, d, c], axis=2)[:, :-1]  # without those at the poles
    corners = np.concatenate([one.reshape(-1, 3, 3), other.reshape(-1, 3, 3)])
    if kind == "soup":
        middle = corners.mean(axis=1, keepdims=True)
        corners = middle + 0.98 * (corners - middle)
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
    rows["corners"] = corners
    with file.open("wb") as stream:
        stream.write(bytes(80) + len(rows).to_bytes(4, "little"))
        rows.tofile(stream)


def mesh(triangles: int, kind: str) -> Row:
    """Return the row of one mesh."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "mesh.stl")
        making = multiprocessing.get_context("fork").Process(target=bumpy_ball, args=(file, triangles, kind))
        making.start()
        making.join()  # what it takes is not the reader's
        problem = crowd(1, 0)
        part = ho.Part(ho.MeshFile(file, "mm", shell=kind == "soup"))
        problem = ho.Problem(problem.cables, problem.bodies, parts={"mesh": part})
        begin = time.process_time()
        geometry = load_scene(problem).parts["mesh"]
        loading, held = time.process_time() - begin, most_memory()
    dice = np.random.default_rng(0)
    ways = dice.normal(size=(triangles // 200, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    lead = np.array([0.021, 0.0, 0.0]) + np.linspace(0, 0.002, 2000)[:, None] * [0.0, 1.0, 0.3]
    seconds = []
    for points in (lead, lead, 0.021 * ways):
        begin = time.process_time()
        geometry.signed_distance(points)
        seconds.append(round(time.process_time() - begin, 2))
    return {
        "triangles": len(geometry.faces), "kind": kind, "loading_s": round(loading, 1),
        "loading_MB": round(held / 1e6), "first_cable_s": seconds[0], "next_cable_s": seconds[1],
        "all_trees_s": seconds[2], "all_trees_MB": round(most_memory() / 1e6),
    }  # fmt: skip


def crowd(cables: int, parts: int) -> ho.Problem:
    """Return cables side by side over a hinge, beside a field of boxes."""
    up, across = ((0.5**0.5, 0.0, 0.5**0.5, 0.0), (1.0, 0.0, 0.0, 0.0))
    cable = ho.Cable(0.3, 6e-3, 2.1e-3, 1.6e-3, 0.15)
    runs = {
        f"c{k}": ho.CableRun(
            cable, ho.End((0.0, 0.05 * k, 0.1), across), ho.End((0.16, 0.03 + 0.05 * k, 0.12), up, body="arm")
        )
        for k in range(cables)
    }
    arm = ho.Body(ho.Hinge((0.05, 0.0, 0.104), (0.0, -1.0, 0.0), 0.0, np.pi / 3))
    side = max(1, int(np.ceil(parts**0.5)))
    boxes = {
        f"p{k}": ho.Part(ho.Box((0.02, 0.02, 0.02)), position=(0.3 + 0.06 * (k // side), 0.06 * (k % side), 0.0))
        for k in range(parts)
    }
    limits = ho.Limits(clearance=0.002)
    return ho.Problem(runs, {"arm": arm}, parts=boxes, gravity=(0.0, 0.0, -9.81), limits=limits)


def crowded(cables: int, parts: int) -> Row:
    """Return the row of one crowd."""
    problem = crowd(cables, parts)
    begin = time.process_time()
    motion = ho.simulate(problem, frames=np.linspace(0, 1, 30))
    between = time.process_time()
    found = ho.clearances(motion)
    end = time.process_time()
    return {
        "cables": cables, "parts": parts,
        "simulate_s": round(between - begin, 2), "clearances_s": round(end - between, 2),
        "MB": round(most_memory() / 1e6), "pairs": len(found.pairs),
        "certified": sum(pair.certified for pair in found.pairs),
    }  # fmt: skip


def studied(variants: int) -> Row:
    """Return the row of a study of so many variants."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "flap.toml").write_bytes(FLAP.read_bytes())
        lines = ["schema = 1", 'problem = "flap.toml"', 'method = "monte carlo"', f"samples = {variants}", "seed = 1"]
        lines += [
            "[vary]",
            '"cables.lead.length" = { plus_minus = 0.005 }',
            '"parts.ball.position.z" = { plus_minus = 0.002 }',
        ]
        Path(folder, "study.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
        begin = time.perf_counter()
        command = [sys.executable, "-m", "harness_opt", "study", "study.toml", "--workers", "2", "--quiet"]
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, env=environment())
        own = 0
        while process.poll() is None:
            own = max(own, held_by(process.pid))
            time.sleep(0.5)
        seconds = time.perf_counter() - begin
        if process.returncode not in (0, 1):
            raise RuntimeError(f"the study ended with exit code {process.returncode}")
    workers = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "variants": variants, "seconds": round(seconds), "rows_a_second": round(variants / seconds, 1),
        "processor_s": round(workers.ru_utime + workers.ru_stime), "handing_out_MB": round(own / 1e6),
        "largest_process_MB": round(1024 * workers.ru_maxrss / 1e6),
    }  # fmt: skip


def held_by(process: int) -> int:
    """Return the most memory that a process has held, bytes; 0 where that is not told."""
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0
    return 1024 * next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), 0)


def environment() -> dict[str, str]:
    """Return the environment of a process that runs this tree."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONSAFEPATH": "1"}


def alone(function: Callable[..., Row], *arguments: object) -> Row:
    """Return the row that ``function`` of this file gives in a process of its own."""
    code = "import sys, json; sys.path.append(sys.argv[1]); import large_scenes as here; "
    code += "print(json.dumps(getattr(here, sys.argv[2])(*json.loads(sys.argv[3]))))"
    call = [sys.executable, "-c", code, str(Path(__file__).parent), function.__name__, json.dumps(arguments)]
    done = subprocess.run(call, env=environment(), capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    row: Row = json.loads(done.stdout)
    print(*(f"{key}: {value}" for key, value in row.items()), sep="   ", flush=True)
    return row


def exponent(rows: list[Row], key: str, fixed: str, value: int) -> float:
    """Return the exponent of the clearances' time by ``key``, where ``fixed`` has ``value``."""
    some = sorted((row[key], row["clearances_s"]) for row in rows if row[fixed] == value)[-LARGE:]
    return float(np.polyfit(*np.log(np.array(some).T), 1)[0])


def main() -> None:
    """Run what is asked for and print the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", choices=[[], "meshes", "crowds", "study"], help="all where left out")
    parser.add_argument("-o", "--output", type=Path, help="folder for a CSV file each")
    parser.add_argument("--quick", action="store_true", help="small sizes")
    given = parser.parse_args()
    quick = given.quick
    meshes, crowds = (((300_000, "ball"),), CROWDS[:2] + CROWDS[4:6]) if quick else (MESHES, CROWDS)
    work: dict[str, Callable[[], list[Row]]] = {
        "meshes": lambda: [alone(mesh, *size) for size in meshes],
        "crowds": lambda: [alone(crowded, *size) for size in crowds],
        "study": lambda: [alone(studied, 20 if quick else VARIANTS)],
    }
    for name in given.what or work:
        rows = work[name]()
        if name == "crowds" and not quick:
            by_parts, by_cables = exponent(rows, "parts", "cables", 5), exponent(rows, "cables", "parts", 100)
            print(f"clearances: exponent {by_parts:.2f} in the parts, {by_cables:.2f} in the cables")
        if given.output:
            given.output.mkdir(parents=True, exist_ok=True)
            with (given.output / f"{name}.csv").open("w", newline="", encoding="utf-8") as stream:
                writer = csv.DictWriter(stream, rows[0])
                writer.writeheader()
                writer.writerows(rows)


if __name__ == "__main__":
    main()

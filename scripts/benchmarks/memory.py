"""How much memory do long motions and crowded scenes take?

    python scripts/benchmarks/memory.py -o results/memory
    python scripts/benchmarks/memory.py --quick

Each row is a whole ``harness-opt simulate`` in a process of its own, report included, pictures left out: the most
memory that it held at any time, its time, and whether everything was certified. Scenes are made here: a
cable over a hinge among balls of 1,280 triangles each that stand clear of it, or several cables side by side; some on
far more elements than they need, so that their frames have to go to disk.
``memory.csv`` is the table; the exit code is 1 where a row is above the 2 GB that all have to keep to.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import trimesh

MOST = 2 * 10**9  # bytes
ROOT = Path(__file__).resolve().parents[2]
ROUND = 3  # subdivisions of an icosahedron: 1,280 triangles
TURN = 90.0  # degrees of the hinge
ARM = 0.2  # m from the hinge to the clamp on it


@dataclass(frozen=True)
class Scene:
    """A scene to simulate.

    Args:
        frames, parts, cables: how many.
        elements: of each cable, at least.
    """

    frames: int
    parts: int
    cables: int
    elements: int = 0

    @property
    def name(self) -> str:
        """For the table."""
        fine = f" x {self.elements} elements" if self.elements else ""
        return f"{self.frames} frames x {self.parts} parts x {self.cables} cables{fine}"

    def text(self) -> str:
        """Return the problem file; the clamp's way is a quarter of a circle."""
        step = 0.999 * ARM * TURN / 180 * 3.141592653589793 / (self.frames - 1)
        lines = ["schema = 1", "gravity = [0, 0, -9.81]", "[bodies.arm.motion]", 'kind = "hinge"']
        lines += ["point = [0, 0, 0]", "axis = [0, -1, 0]", "from_deg = 0", f"to_deg = {TURN}"]
        lines += ["[motion]", f"spatial_step = {step!r}", "[limits]", "clearance = 0.001", "bend_radius = 0.01"]
        for k in range(self.cables):
            y = 0.03 * k
            lines += [
                f"[cables.c{k}]", "length = 0.42", "diameter = 0.006", "bending_stiffness = 2e-3",
                "torsional_stiffness = 1.5e-3", "mass_per_length = 0.05", "bow = [0, 0, 1]",
                f"start = {{ position = [-0.1, {y}, 0], tangent = [0, 0, 1] }}",
                f'end = {{ body = "arm", position = [{ARM}, {y}, 0], tangent = [0, 0, -1] }}',
            ]  # fmt: skip
        for k in range(self.parts):
            body = "arm" if k % 4 == 0 else "world"
            place = f"[{-0.3 + 0.04 * k:.3f}, {-0.12 - 0.02 * (k % 3):.3f}, {0.05 * (k % 5):.3f}]"
            lines += [f"[parts.p{k}]", 'mesh = "ball.stl"', 'mesh_unit = "m"']
            lines += [f'body = "{body}"', f"position = {place}"]
        return "\n".join(lines) + "\n"


SCENES = (
    Scene(1000, 20, 1), Scene(100, 3, 10),
    Scene(1000, 1, 1), Scene(3000, 1, 1), Scene(9900, 1, 1),
    Scene(150, 1, 1, 256), Scene(1000, 1, 1, 256), Scene(3000, 1, 1, 256),
)  # fmt: skip
QUICK = (Scene(200, 20, 1), Scene(20, 3, 10))


def most_memory() -> int:
    """Return the most memory that this process has held, bytes."""
    status = Path("/proc/self/status")
    if status.is_file():  # getrusage would count what the process held that started this one
        lines = status.read_text(encoding="ascii").splitlines()
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most


def run(scene: Scene, folder: Path) -> dict[str, object]:
    """Simulate ``scene`` in a process of its own, and return its row of the table."""
    trimesh.creation.icosphere(ROUND, 0.015).export(folder / "ball.stl")
    (folder / "scene.toml").write_text(scene.text(), encoding="utf-8")
    code = (
        "import sys; from harness_opt.cli.commands import main;"
        "sys.path.append(sys.argv[1]); from memory import most_memory;"
        "import functools, harness_opt.motion.simulate as m;"
        "m.simulate = functools.partial(m.simulate, elements=int(sys.argv[2]));"
        "code = main(['simulate', 'scene.toml', '-o', 'result', '-q', '--json']);"
        "print(most_memory(), file=sys.stderr); sys.exit(code)"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONSAFEPATH": "1"}
    begin = time.perf_counter()
    # pyvista is hidden: what is measured is ours, and no graphics driver's
    hide = "import sys; sys.modules['pyvista'] = None;"
    done = subprocess.run(
        [sys.executable, "-c", hide + code, str(Path(__file__).parent), str(scene.elements)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - begin
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{scene.name}: exit code {done.returncode}: {done.stderr[-2000:]}")
    summary = json.loads(done.stdout)
    rows = [row for row in summary["limits"] if row["name"] == "clearance"]
    return {
        "scene": scene.name,
        "frames": summary["frames"],
        "memory_MB": round(int(done.stderr.split()[-1]) / 1e6),
        "seconds": round(seconds, 1),
        "certified": f"{sum(row['certified'] for row in rows)} of {len(rows)}",
        "status": summary["status"],
    }


def main() -> int:
    """Simulate all scenes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, help="folder for memory.csv")
    parser.add_argument("--quick", action="store_true", help="two small scenes")
    given = parser.parse_args()
    rows = []
    for scene in QUICK if given.quick else SCENES:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(run(scene, Path(folder)))
        print(*(f"{key}: {value}" for key, value in rows[-1].items()), sep="   ", flush=True)
    if given.output:
        given.output.mkdir(parents=True, exist_ok=True)
        with (given.output / "memory.csv").open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, rows[0])
            writer.writeheader()
            writer.writerows(rows)
    return 1 if any(int(str(row["memory_MB"])) * 10**6 > MOST for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())

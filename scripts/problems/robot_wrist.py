"""Makes what the problem ``robot_wrist`` needs: a robot's joint trajectory as motions of its links, and their meshes.

    pip install "harness-opt[robots]"
    python scripts/problems/robot_wrist.py
    harness-opt simulate problems/robot_wrist/robot_wrist.toml

The robot is the UR5 of the package example-robot-data, whose files are not kept here: its URDF is read by pinocchio,
which also finds where each link stands at each moment. One CSV table of poses and one mesh a link are written beside
the problem file. The trajectory goes through TRAJECTORY and rests at both ends.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import shutil
import sys
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

FOLDER = Path(__file__).resolve().parents[2] / "problems" / "robot_wrist"
MISSING = 'robot_wrist is left out: it needs the robot\'s files and pinocchio; try pip install "harness-opt[robots]"'
LINKS = ("upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link")
DURATION = 3.0  # s
ROWS = 121  # of each table
# rad, in the order of the URDF: shoulder pan and lift, elbow, wrist 1, 2 and 3
TRAJECTORY = np.array(
    [
        [0.0, -1.2, 1.4, -0.2, 1.57, 0.0],
        [0.2, -1.1, 1.5, -0.5, 1.3, 0.4],
        [0.4, -1.0, 1.5, -0.3, 1.9, -0.3],
        [0.5, -1.2, 1.3, 0.1, 1.7, 0.2],
    ]
)


def available() -> bool:
    """Whether the extra ``robots`` is installed."""
    if importlib.util.find_spec("pinocchio") is None:
        return False
    try:
        importlib.metadata.version("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def urdf() -> Path:
    """Return the robot's description in the package that is installed."""
    files = importlib.metadata.files("example-robot-data") or []
    return next(Path(str(file.locate())).resolve() for file in files if file.name == "ur5_robot.urdf")


def joints(share: np.ndarray) -> np.ndarray:
    """Return the joints' angles (n, 6), rad, at shares (n,) of the duration: a cubic spline at rest at both ends."""
    at_rest = [(1, np.zeros(TRAJECTORY.shape[1]))]
    spline = make_interp_spline(np.linspace(0, 1, len(TRAJECTORY)), TRAJECTORY, k=3, bc_type=(at_rest, at_rest))
    return spline(share)


def link_poses(angles: np.ndarray) -> dict[str, np.ndarray]:
    """Return positions and quaternions, scalar first, (n, 7) of each link in the world."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(urdf()))
    data = model.createData()
    found: dict[str, list[np.ndarray]] = {link: [] for link in LINKS}
    for row in angles:
        pinocchio.framesForwardKinematics(model, data, row)
        for link, poses in found.items():
            placed = data.oMf[model.getFrameId(link)]
            turn = pinocchio.Quaternion(placed.rotation).coeffs()  # scalar last
            poses.append(np.concatenate([placed.translation, np.roll(turn, 1)]))
    return {link: np.array(poses) for link, poses in found.items()}


def write_motions(folder: Path) -> None:
    """Write one table of poses a link."""
    folder.mkdir(parents=True, exist_ok=True)
    share = np.linspace(0.0, 1.0, ROWS)
    for link, poses in link_poses(joints(share)).items():
        # neighbours on the same side: q and -q are one orientation
        signs = np.cumprod(np.concatenate([[1.0], np.sign(np.sum(poses[1:, 3:] * poses[:-1, 3:], axis=1))]))
        table = np.column_stack([DURATION * share, poses[:, :3], signs[:, None] * poses[:, 3:]])
        name = folder / f"{link.removesuffix('_link')}.csv"
        np.savetxt(name, table, fmt="%.12g", delimiter=",", header="t,x,y,z,qw,qx,qy,qz", comments="")


def write_meshes(folder: Path) -> None:
    """Copy the links' collision meshes, which are closed and in metres."""
    folder.mkdir(parents=True, exist_ok=True)
    source = urdf().parents[1] / "meshes" / "ur5" / "collision"
    for link in LINKS:
        name = link.removesuffix("_link")
        shutil.copyfile(source / f"{name.replace('_', '')}.stl", folder / f"{name}.stl")


def main(folder: Path = FOLDER) -> int:
    """Write everything, or say what is missing."""
    if not available():
        print(MISSING, file=sys.stderr)
        return 0
    write_motions(folder / "motion")
    write_meshes(folder / "meshes")
    print(f"{folder}: motions and meshes of {', '.join(LINKS)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Makes the meshes of the shipped problems: run it again after changing a shape here.

    python scripts/problems/make_meshes.py
    python scripts/problems/make_meshes.py FOLDER          # one bracket in five states, for tests of what reads meshes

Needs the extra ``meshes`` (manifold3d does the cutting). Coordinates are those of the body each part belongs to, in
millimetres, and every mesh is closed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from trimesh import Trimesh
from trimesh.creation import box, cylinder
from trimesh.transformations import translation_matrix

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Trimesh:
    """Return the box between two corners, mm."""
    return box(bounds=np.array([low, high], dtype=float))


def rod(radius: float, start: tuple[float, float, float], end: tuple[float, float, float]) -> Trimesh:
    """Return a round bar between two points, mm."""
    return cylinder(radius=radius, segment=np.array([start, end], dtype=float), sections=48)


def union(*parts: Trimesh) -> Trimesh:
    """Return parts grown together."""
    return trimesh.boolean.union(parts, engine="manifold")


def cut(body: Trimesh, *tools: Trimesh) -> Trimesh:
    """Return ``body`` with ``tools`` taken away."""
    return trimesh.boolean.difference([body, *tools], engine="manifold")


def lift_arm() -> dict[str, Trimesh]:
    """Return a housing with a hinge bracket on its front edge, and the arm that it carries (hinge at x 50, z 100)."""
    shell = block((-70, -45, 0), (50, 45, 92))
    window = block((-55, -46, 15), (30, 46, 70))
    vents = [block((-71, y, 20), (-60, y + 6, 75)) for y in (-30, -12, 6, 24)]
    ears = [union(block((30, y, 88), (62, y + 8, 104)), rod(13, (50, y, 104), (50, y + 8, 104))) for y in (-26.0, 18.0)]
    stop = block((22, -18, 88), (34, 18, 151))
    arm = union(
        rod(11, (50, -17, 104), (50, 17, 104)),
        block((50, -14, 97), (290, 14, 111)),
        cylinder(radius=26, height=20, transform=translation_matrix((290, 0, 104)), sections=64),
    )
    arm = cut(arm, cylinder(radius=12, height=40, transform=translation_matrix((290, 0, 104)), sections=48))
    return {
        "housing": cut(shell, window, *vents),
        "bracket": union(stop, *ears),
        "arm": arm,
    }


def door() -> dict[str, Trimesh]:
    """Return a door's post with its knuckles, the leaf, and a striker bracket on the post (hinge line x 0, y 0)."""
    post = cut(block((-60, -40, -200), (-4, 60, 200)), block((-48, -28, -201), (-16, 48, 201)))
    knuckles = [rod(7, (0, 0, z - 25), (0, 0, z + 25)) for z in (-150.0, 150.0)]
    leaf = cut(block((6, -12, -200), (300, 12, 200)), block((40, -13, -150), (260, 6, 150)))
    striker = union(block((-6, 52, -25), (46, 60, 25)), block((28, 24, -25), (46, 60, 25)))
    return {"frame": union(post, *knuckles), "leaf": leaf, "striker": striker}


def drawer() -> dict[str, Trimesh]:
    """Return a cabinet with an open front and the drawer that slides out of it along x."""
    cabinet = cut(block((-400, -170, -112), (0, 170, 190)), block((-388, -158, -100), (1, 158, 178)))
    tray = cut(block((-290, -150, 100), (0, 150, 160)), block((-280, -140, 106), (-10, 140, 161)))
    handle = union(block((0, -150, 92), (12, 150, 165)), rod(6, (30, -50, 130), (30, 50, 130)))
    posts = [rod(5, (5, y, 130), (30, y, 130)) for y in (-45.0, 45.0)]
    return {"cabinet": cabinet, "tray": union(tray, handle, *posts)}


def camera_pan() -> dict[str, Trimesh]:
    """Return the mast with its collar, and the camera head that pans about z above it."""
    mast = union(rod(22, (0, 0, -120), (0, 0, 0)), block((-45, -45, -130), (45, 45, -112)))
    collar = cut(rod(34, (0, 0, -12), (0, 0, 0)), rod(8, (0, 0, -13), (0, 0, 1)))
    yoke = union(
        block((-40, -55, 118), (40, 55, 126)),
        block((-20, -55, 118), (20, -47, 190)),
        block((-20, 47, 118), (20, 55, 190)),
    )
    lens = rod(20, (-35, 0, 165), (60, 0, 165))
    hood = rod(26, (48, 0, 165), (70, 0, 165))
    bearing = rod(7, (0, 0, 0), (0, 0, 120))
    return {
        "mast": union(mast, collar),
        "head": union(yoke, bearing),
        "camera": union(block((-45, -30, 140), (20, 30, 190)), lens, hood),
    }


def variants() -> dict[str, Trimesh]:
    """Return one bracket closed, open, inside out and degenerate, in m, and in mm: always the same solid."""
    closed = lift_arm()["bracket"]
    millimetres = closed.copy()
    closed.apply_scale(1e-3)
    gap = Trimesh(closed.vertices, closed.faces[3:], process=False)
    inverted = closed.copy()
    inverted.invert()
    # points twice in one face, and a face folded flat, there and back
    a, b = (int(corner) for corner in closed.faces[0][:2])
    middle = len(closed.vertices)
    flat = [[a, a, b], [b, b, b], [a, middle, b], [b, middle, a]]
    corners = np.vstack([closed.vertices, closed.vertices[[a, b]].mean(axis=0)])
    degenerate = Trimesh(corners, np.vstack([closed.faces, flat]), process=False)
    return {"closed": closed, "open": gap, "inverted": inverted, "degenerate": degenerate, "millimetres": millimetres}


def main() -> None:
    """Write all meshes, or the variants of one."""
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        folder.mkdir(parents=True, exist_ok=True)
        for name, mesh in variants().items():
            mesh.export(folder / f"{name}.ply")
        return
    for name, make in (
        ("lift_arm", lift_arm),
        ("door", door),
        ("drawer", drawer),
        ("camera_pan", camera_pan),
    ):
        folder = PROBLEMS / name / "meshes"
        folder.mkdir(parents=True, exist_ok=True)
        for part, mesh in make().items():
            if not mesh.is_watertight:
                raise SystemExit(f"{name}/{part}: the mesh is not closed")
            mesh.export(folder / f"{part}.stl")


if __name__ == "__main__":
    main()

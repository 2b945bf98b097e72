"""A result for other programs: ParaView, spreadsheets, 3-D viewers and CAD."""

from __future__ import annotations

import functools
import io
import itertools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from harness_opt.clearance import along_cable as colouring
from harness_opt.clearance.limits import STRAIGHT, bending
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.errors import HarnessError
from harness_opt.files.stored_results import read_motion
from harness_opt.files.whole_folder import filling
from harness_opt.model.results import Motion
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_at_a_time
from harness_opt.parts.scene import Scene, load_scene
from harness_opt.parts.triangles import triangles
from harness_opt.pictures import dxf, step
from harness_opt.pictures.drawing import placement, pose_at
from harness_opt.pictures.dxf import UNITS
from harness_opt.pictures.gltf import gltf
from harness_opt.pictures.opengl import load_pyvista
from harness_opt.pictures.swept_volume import for_stl, swept_volume

KINDS = ("paraview", "csv", "gltf", "stl", "dxf", "step")
COLUMNS = (
    "frame", "motion", "time_s", "arc_length_m", "x_m", "y_m", "z_m", "quaternion_w", "quaternion_x", "quaternion_y",
    "quaternion_z", "curvature_x_per_m", "curvature_y_per_m", "twist_rad_per_m", "bend_radius_m", "force_x_N",
    "force_y_N", "force_z_N", "moment_x_Nm", "moment_y_Nm", "moment_z_Nm", "clearance_m",
)  # fmt: skip


@one_at_a_time
def export(folder: str | Path, kind: str, target: str | Path, unit: str = "m") -> list[str]:
    """Write the motion that a result folder holds for another program; return what was written, a sentence each.

    Args:
        folder: of a result.
        kind: "paraview" (``motion.pvd``, with a ``.vtp`` for each frame), "csv" (a table for each cable), "gltf"
            (``motion.glb``, animated), "stl" (the volume that each cable sweeps), "dxf" or
            "step" (each centreline).
        target: folder to write in; made where it is missing.
        unit: of STL, DXF and STEP files, "m" or "mm".

    Raises:
        HarnessError: no result in ``folder``, or a package that the export needs is missing; one line.
        ProblemError: its problem file, or a mesh, can't be read any more.
    """
    writers: dict[str, Callable[[Motion, Scene, Path], Iterator[str]]] = {
        "paraview": _paraview,
        "csv": _csv,
        "gltf": _gltf,
        "stl": functools.partial(_stl, unit=unit),
        "dxf": functools.partial(_centrelines, unit=unit, kind="dxf"),
        "step": functools.partial(_centrelines, unit=unit, kind="step"),
    }
    if unit not in UNITS:
        raise HarnessError(f"found the unit {unit!r}, expected one of {', '.join(UNITS)}")
    if kind not in writers:
        raise HarnessError(f"found an export to {kind!r}, expected one of {', '.join(KINDS)}")
    motion, _, _ = read_motion(folder)
    scene = load_scene(motion.problem)
    with filling(Path(target)) as aside:
        return [line.replace(str(aside), str(target), 1) for line in writers[kind](motion, scene, aside)]


def _file_names(names: Iterable[str]) -> dict[str, str]:
    """Return names of cables or parts as those of files: no two the same, not even where capitals don't count."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        plain = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)
        tried = (plain if number == 1 else f"{plain}-{number}" for number in itertools.count(1))
        found[name] = next(one for one in tried if one.casefold() not in taken)
        taken.add(found[name].casefold())
    return found


def _along(motion: Motion, scene: Scene, measured: ClearanceResult, name: str, frame: int) -> dict[str, Array]:
    """Return what is known at the stations of a cable in one frame, by name; a clearance that does not count is NaN."""
    shapes = motion.cables[name]
    points = colouring.Points(name, np.array([frame]), shapes.s, shapes.position[[frame]])
    clearance = colouring.states(motion, scene, measured.pairs, points, np.inf)[0][0]
    radius = 1.0 / np.maximum(bending(shapes.frames(slice(frame + 1)))[frame], STRAIGHT)
    return {
        "arc_length": shapes.s,
        "curvature": shapes.curvature[frame],
        "bend_radius": radius,
        "twist_deg_per_m": np.degrees(shapes.curvature[frame, :, 2]),
        "force": shapes.force[frame],
        "moment": shapes.moment[frame],
        "clearance": np.where(np.isfinite(clearance), clearance, np.nan),
        "quaternion": shapes.quaternion[frame],
    }


def _csv(motion: Motion, scene: Scene, target: Path) -> Iterator[str]:
    measured = measure(motion.problem, scene, motion.motion, motion.cables)
    files = _file_names(motion.cables)
    for name, shapes in motion.cables.items():
        rows = []
        for frame, at in enumerate(motion.motion):
            found = _along(motion, scene, measured, name, frame)
            when = np.tile([frame, at, at * motion.problem.duration], (len(shapes.s), 1))
            columns = (
                when, shapes.s, shapes.position[frame], found["quaternion"], found["curvature"], found["bend_radius"],
                found["force"], found["moment"], found["clearance"],
            )  # fmt: skip
            rows.append(np.column_stack(columns))
        file = target / f"{files[name]}.csv"
        text = io.StringIO()
        np.savetxt(text, np.vstack(rows), fmt="%.10g", delimiter=",")
        # no number is an empty cell to spreadsheets
        file.write_text(",".join(COLUMNS) + "\n" + text.getvalue().replace("nan", ""), encoding="utf-8")
        yield f"{file}: {len(motion.motion)} frames of {len(shapes.s)} points"


def _gltf(motion: Motion, scene: Scene, target: Path) -> Iterator[str]:
    file = target / "motion.glb"
    file.write_bytes(gltf(motion, scene))
    yield f"{file}: animated, {motion.problem.duration:g} s"


def _centrelines(motion: Motion, _scene: Scene, target: Path, *, unit: str, kind: str) -> Iterator[str]:
    write, each = {"dxf": (dxf.centreline, "a layer"), "step": (step.centreline, "a curve")}[kind]
    for name, plain in _file_names(motion.cables).items():
        file = target / f"{plain}_{unit}.{kind}"
        file.write_text(write(motion, name, unit), encoding="ascii")
        yield f"{file}: the centreline of {name} in {unit}, {len(motion.motion)} frames, {each} each"


def _stl(motion: Motion, _scene: Scene, target: Path, unit: str) -> Iterator[str]:
    import trimesh

    for name, plain in _file_names(motion.cables).items():
        swept = swept_volume(motion, name)
        file = target / f"swept_{plain}_{unit}.stl"
        trimesh.Trimesh(*for_stl(UNITS[unit][1] * swept.vertices, swept.faces), process=False).export(file)
        litres, named = f"{1e6 * swept.volume:.1f} cm3", {"m": "metres", "mm": "millimetres"}[unit]
        yield f"{file}: {litres} in {named}, nowhere more than {1e3 * swept.excess:.2f} mm too large"


def _paraview(motion: Motion, scene: Scene, target: Path) -> Iterator[str]:
    """Write a file for each frame of what moves, one for what does not, and the list of them that ParaView opens."""
    pyvista = load_pyvista()
    measured = measure(motion.problem, scene, motion.motion, motion.cables)
    data = target / "frames"
    data.mkdir(exist_ok=True)
    solids = {name: pyvista.PolyData.from_regular_faces(*triangles(part)) for name, part in scene.parts.items()}
    cables, parts = _file_names(motion.cables), _file_names(solids)
    entries: list[str] = []
    written: set[Path] = set()
    for frame, at in enumerate(motion.motion):
        shown: dict[str, Any] = {}
        for name, shapes in motion.cables.items():
            line = pyvista.MultipleLines(shapes.position[frame])
            for key, values in _along(motion, scene, measured, name, frame).items():
                line.point_data[key] = values
            line.field_data["radius"] = [motion.problem.cables[name].cable.radius]
            shown[f"cable_{cables[name]}_{frame:05d}.vtp"] = line
        for name, solid in solids.items():
            body = scene.parts[name].body
            number = f".{frame:05d}" if motion.problem.is_moved(body) else ""  # no name has a dot
            placed = solid.transform(placement(*pose_at(motion, frame, body)), inplace=False)
            shown[f"part_{parts[name]}{number}.vtp"] = placed
        for place, (name, mesh) in enumerate(shown.items()):
            if data / name not in written:
                mesh.save(data / name)
                written.add(data / name)
            time = f"{at * motion.problem.duration:.9g}"
            entries.append(f'    <DataSet timestep="{time}" part="{place}" file={quoteattr(f"frames/{name}")}/>')
    file = target / "motion.pvd"
    listed = "\n".join(entries)
    file.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
        f"{listed}\n  </Collection>\n</VTKFile>\n",
        encoding="utf-8",
    )
    yield f"{file}: {len(motion.motion)} frames; colour by bend_radius, twist_deg_per_m or clearance"

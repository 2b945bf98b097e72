"""A Problem as the text of a problem file, laid out for people, with no digit lost."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import InlineTable, Item, Table

from harness_opt.errors import ProblemError
from harness_opt.files.bodies import HEADER, WAYS, parse_poses, parse_values
from harness_opt.files.places import MOST_MESH_BYTES, Places, digest
from harness_opt.files.tolerance_table import content_of
from harness_opt.model.bodies import WORLD, Body, BodyMotion, Hinge, Poses
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.courses import Moves, ValueTable
from harness_opt.model.design import Limits
from harness_opt.model.ends import End
from harness_opt.model.parts import Box, Capsule, Cylinder, MeshFile, Part, Robot, Solid, Sphere
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations

Rows = list[tuple[str, Any, str]]  # key, value (None leaves it out), unit for the comment

MOST_DIGITS = 17  # significant digits that tell any two doubles apart


def problem_text(problem: Problem, file: Path) -> tuple[str, dict[Path, bytes]]:
    """Return the text of a problem file and the tables of poses that must be written with it.

    Args:
        problem: what to write.
        file: absolute path the text is for; paths in it are relative to its folder.

    Returns:
        The TOML text, and the contents of CSV files by absolute path.

    Raises:
        OSError: a mesh or a table outside of the folder cannot be read.
    """
    pending: dict[Path, bytes] = {}
    places = Places.around(file.parent)
    document = tomlkit.document()
    _fill(
        document,
        [
            ("schema", 1, ""),
            ("title", problem.title or None, ""),
            ("gravity", _numbers(problem.gravity) if any(problem.gravity) else None, "m/s2"),
        ],
    )
    _section(document, "cables", {name: _cable(run) for name, run in problem.cables.items()})
    robots = {name: robot for name, robot in problem.robots.items() if _is_as_read(robot, problem, places)}
    told = {name for robot in robots.values() for name in (*robot.bodies, *robot.parts)}
    bodies = {name: _body(name, body, file, pending) for name, body in problem.bodies.items() if name not in told}
    _section(document, "bodies", bodies)
    _section(document, "robots", {name: _robot(robot, places) for name, robot in robots.items()})
    step = None if problem.spatial_step is None else float(problem.spatial_step)
    path = [
        ("duration", float(problem.duration), "s, for playback"),
        ("out_and_back", True if problem.out_and_back else None, "half the motion out, half of it back"),
        ("spatial_step", step, "m, most that a clamp moves between two solved frames"),
    ]
    document["motion"] = _fill(tomlkit.table(), path)
    _section(document, "parts", {name: _part(part, places) for name, part in problem.parts.items() if name not in told})
    limits = _fill(tomlkit.table(), _limit_rows(problem.limits))
    if limits:
        document["limits"] = limits
    _design(document, problem)
    _robust(document, problem)
    return tomlkit.dumps(document), pending


# --- TOML ----------------------------------------------------------------------------------------------


def _fill(table: Any, rows: Rows) -> Any:
    """Add what is not None of ``rows`` to ``table``, with the units as comments."""
    for key, value, unit in rows:
        if value is not None:
            item = value if isinstance(value, Item) else tomlkit.item(value)
            if unit:
                item.comment(unit)
            table.add(key, item)
    return table


def _section(document: Any, name: str, tables: dict[str, Table]) -> None:
    """Add ``[name.key]`` for each of ``tables``."""
    if tables:
        parent = tomlkit.table(is_super_table=True)
        for key, table in tables.items():
            parent.add(key, table)
        document[name] = parent


def _inline(rows: Rows) -> InlineTable:
    found: InlineTable = _fill(tomlkit.inline_table(), [(key, value, "") for key, value, _ in rows])
    return found


def _numbers(values: Iterable[float] | None) -> list[float] | None:
    return None if values is None else [float(value) for value in values]


def _degrees(angle: float) -> float:
    """Return the shortest number of degrees that reads back as ``angle``, rad: 110 where 110 was typed.

    Not every double in radians is the image of one in degrees; the nearest is taken then.
    """
    middle = math.degrees(angle)
    for close in (middle, math.nextafter(middle, math.inf), math.nextafter(middle, -math.inf)):
        for digits in range(1, MOST_DIGITS + 1):
            rounded = float(f"{close:.{digits}g}")
            if math.radians(rounded) == angle:
                return rounded
    return middle


def _relative(path: Path, folder: Path) -> str:
    """Return ``path`` seen from ``folder``, with forward slashes; absolute where they share no drive."""
    absolute = path.parent.resolve() / path.name
    try:
        return Path(os.path.relpath(absolute, folder)).as_posix()
    except ValueError:  # another drive of Windows
        return absolute.as_posix()


# --- sections ------------------------------------------------------------------------------------------


def _cable(run: CableRun) -> Table:
    cable: Cable = run.cable
    bending = cable.bending_stiffness
    rows: Rows = [
        ("length", float(cable.length), "m"),
        ("diameter", float(cable.diameter), "m"),
        ("bending_stiffness", _numbers(bending) if isinstance(bending, tuple) else float(bending), "N m2"),
        ("torsional_stiffness", float(cable.torsional_stiffness), "N m2"),
        ("mass_per_length", float(cable.mass_per_length) or None, "kg/m"),
        ("rest_curvature", _numbers(cable.rest_curvature) if any(cable.rest_curvature) else None, "1/m"),
        ("bend_radius", None if run.bend_radius is None else float(run.bend_radius), "m, this cable's own limit"),
        ("bow", _numbers(run.bow), "to which side it bows at the start"),
        ("fitted_at", float(run.fitted_at) or None, "of the motion, 0 to 1, where an untwisted end is clamped"),
        ("start", _inline(_end_rows(run.start)), ""),
        ("end", _inline(_end_rows(run.end)), ""),
    ]
    found: Table = _fill(tomlkit.table(), rows)
    if run.clips:
        clips = tomlkit.aot()
        for clip in run.clips:
            kind = clip.kind if clip.kind != "fixed" else None
            own: Rows = [("name", clip.name, ""), ("at", clip.at, "m"), ("kind", kind, "")]
            own.append(("optional", clip.optional or None, ""))
            clips.append(_fill(tomlkit.table(), [*own, *_end_rows(clip)]))
        found.add("clips", clips)
    return found


def _end_rows(end: End) -> Rows:
    return [
        ("body", end.body, ""),
        ("position", _numbers(end.position), ""),
        ("force", _numbers(end.force), ""),
        ("quaternion", _numbers(end.quaternion), ""),
        ("tangent", _numbers(end.tangent), ""),
        ("roll", end.roll if end.roll != "untwisted" else None, ""),
        ("roll_deg", end.roll_deg, ""),
        ("moment", _numbers(end.moment), ""),
        ("turns", end.turns or None, ""),
        ("holders", None if end.holders is None else list(end.holders), ""),
        ("let_off", end.let_off, ""),
    ]


def _body(name: str, body: Body, file: Path, pending: dict[Path, bytes]) -> Table:
    rows: Rows = [
        ("parent", body.parent if body.parent != WORLD else None, ""),
        ("position", _numbers(body.position) if any(body.position) else None, "m"),
        ("quaternion", None if tuple(body.quaternion) == rotations.IDENTITY else _numbers(body.quaternion), ""),
        ("free", body.free or None, "hangs on its cables"),
        ("mass", body.mass or None, "kg"),
    ]
    given = any(value is not None for _, value, _ in rows)
    table = _fill(tomlkit.table(is_super_table=body.motion is not None and not given), rows)
    if body.motion is not None:
        table.add("motion", _fill(tomlkit.table(), _motion_rows(name, body.motion, file, pending)))
    found: Table = table
    return found


def _is_as_read(robot: Robot, problem: Problem, places: Places) -> bool:
    """Return whether a written file may name the URDF: its links and parts are what it says, and it may be read there.

    Else they are written one by one, each mesh with its SHA-256.
    """
    as_made = all(problem.bodies.get(name) == body for name, body in robot.bodies.items()) and all(
        problem.parts.get(name) == part for name, part in robot.parts.items()
    )
    files = {part.shape.path for part in robot.parts.values() if isinstance(part.shape, MeshFile)}
    inside = isinstance(robot.urdf, str) or not any(
        places.fault(str(file), "", None, MOST_MESH_BYTES) for file in (robot.urdf, *files)
    )
    if not (as_made and inside):
        return False
    try:
        return all(digest(file) == sha256 for file, sha256 in robot.files)
    except OSError:
        return False


def _robot(robot: Robot, places: Places) -> Table:
    base = robot.base
    stands = [
        ("body", base.parent if base.parent != WORLD else None, ""),
        ("position", _numbers(base.position), ""),
        ("quaternion", _numbers(base.quaternion), ""),
    ]
    program = robot.program
    rows: Rows = [
        ("urdf", robot.urdf if isinstance(robot.urdf, str) else _relative(robot.urdf, places.folder), ""),
        ("base", _inline(stands) if base.is_placed or base.parent != WORLD else None, ""),
        ("program", None if program is None else _relative(program, places.folder), "t, joints"),
        ("program_sha256", None if program is None else places.sha256_of(program), ""),
        ("unit", robot.unit if program is not None and robot.unit != "rad" else None, ""),
        ("meshes", robot.meshes if robot.meshes != "collision" else None, "collision | visual"),
        ("shell", True if robot.shell else None, ""),
        ("leave_out", list(robot.leave_out) or None, ""),
    ]
    found: Table = _fill(tomlkit.table(), rows)
    return found


def _motion_rows(name: str, motion: BodyMotion, file: Path, pending: dict[Path, bytes]) -> Rows:
    beside = file.parent / f"{file.stem}_{name}.csv"
    if isinstance(motion, Poses):
        return [("kind", "poses", ""), *_table_rows(motion, beside, pending)]
    if isinstance(motion, Hinge):
        rows: Rows = [
            ("kind", "hinge", ""),
            ("point", _numbers(motion.point), "m"),
            ("axis", _numbers(motion.axis), ""),
        ]
        first, last, words = *WAYS["hinge"], ""
    else:
        rows = [("kind", "slide", ""), ("direction", _numbers(motion.direction), "")]
        first, last, words = *WAYS["slide"], "m"
    in_unit = _degrees if isinstance(motion, Hinge) else float
    if isinstance(motion.follows, ValueTable):
        si = "rad" if isinstance(motion, Hinge) else "m"
        told = motion.follows if motion.follows.unit else dataclasses.replace(motion.follows, unit=si)
        return [*rows, *_table_rows(told, beside, pending, si)]
    rows.append((first, in_unit(motion.start), words))
    if not isinstance(motion.follows, Moves):
        return [*rows, (last, in_unit(motion.stop), words)]
    moves = tomlkit.aot()
    for move in motion.follows.moves:
        one: Rows = [(last, in_unit(move.to), words), ("seconds", float(move.seconds), "")]
        moves.append(_fill(tomlkit.table(), [*one, ("dwell", float(move.dwell) or None, "s")]))
    return [*rows, ("moves", moves, "")]


def _table_rows(told: Poses | ValueTable, beside: Path, pending: dict[Path, bytes], si: str = "") -> Rows:
    """Return the keys that name a CSV table: its own, or one that is to be written ``beside``, in the unit ``si``."""
    table = told.file
    if table is None or not _holds(table, told):
        table = beside
        told = dataclasses.replace(told, unit=si) if isinstance(told, ValueTable) else told
        pending[table] = _table_text(told).encode()
    return [
        ("file", _relative(table, beside.parent), ", ".join(HEADER) if isinstance(told, Poses) else "t, value"),
        ("unit", told.unit if isinstance(told, ValueTable) else None, ""),
        ("file_sha256", None if table in pending else Places.around(beside.parent).sha256_of(table), ""),
    ]


def _holds(table: Path, told: Poses | ValueTable) -> bool:
    """Return whether the file ``table`` still holds ``told``."""
    try:
        content = table.read_bytes()
        held = parse_poses(content, table) if isinstance(told, Poses) else parse_values(content, table, told.unit)
        return held == dataclasses.replace(told, file=table)
    except (OSError, ProblemError):
        return False


def _table_text(told: Poses | ValueTable) -> str:
    """Return the CSV table of ``told``, in SI units; every number reads back to the same bits."""
    if isinstance(told, Poses):
        units, header = "s, m, unit quaternion (scalar first)", ",".join(HEADER)
        rows: Iterable[tuple[float, ...]] = (
            (t, *position, *quaternion)
            for t, position, quaternion in zip(told.times, told.positions, told.quaternions, strict=True)
        )
    else:
        units, header, rows = f"s, {told.unit}", "t,value", zip(told.times, told.entries, strict=True)
    return "\n".join([f"# {units}", header, *(",".join(repr(float(number)) for number in row) for row in rows), ""])


def _part(part: Part, places: Places) -> Table:
    moved = any(part.position)
    turned = not np.array_equal(part.quaternion, rotations.IDENTITY)
    rows: Rows = [
        ("body", part.body, ""),
        *_shape_rows(part.shape, places),
        ("position", _numbers(part.position) if moved else None, "m"),
        ("quaternion", _numbers(part.quaternion) if turned else None, ""),
        ("clearance", None if part.clearance is None else float(part.clearance), "m"),
    ]
    found: Table = _fill(tomlkit.table(), rows)
    return found


def _shape_rows(shape: MeshFile | Solid, places: Places) -> Rows:
    if isinstance(shape, MeshFile):
        return [
            ("mesh", _relative(shape.path, places.folder), ""),
            ("mesh_unit", shape.unit, ""),
            ("mesh_scale", None if tuple(shape.scale) == (1.0, 1.0, 1.0) else _numbers(shape.scale), ""),
            ("mesh_sha256", places.sha256_of(shape.path), ""),
            ("shell", True if shape.shell else None, ""),
            ("up", shape.up, ""),
        ]
    if isinstance(shape, Box):
        return [("box", _inline([("size", _numbers(shape.size), "")]), "m")]
    if isinstance(shape, Sphere):
        return [("sphere", _inline([("radius", float(shape.radius), "")]), "m")]
    kind = {Cylinder: "cylinder", Capsule: "capsule"}[type(shape)]
    sizes = [("radius", float(shape.radius), ""), ("length", float(shape.length), "")]
    return [(kind, _inline(sizes), "m")]


def _limit_rows(limits: Limits) -> Rows:
    given = {key: None if value is None else float(value) for key, value in dataclasses.asdict(limits).items()}
    twist = given["twist"]
    return [
        ("clearance", given["clearance"], "m"),
        ("bend_radius", given["bend_radius"], "m"),
        ("twist_deg_per_m", None if twist is None else _degrees(twist), ""),
        ("clamp_force", given["clamp_force"], "N"),
        ("clamp_moment", given["clamp_moment"], "N m"),
        ("clip_force", given["clip_force"], "N"),
        ("clip_moment", given["clip_moment"], "N m"),
        ("travel", given["travel"], "m, back and forth through a clip"),
    ]


def _design(document: Any, problem: Problem) -> None:
    design = problem.design
    if design == type(design)():
        return
    goal: Rows = [("minimise", design.minimise, "change | length | clips")]
    if design.maximise is not None:
        goal = [("maximise", design.maximise, "the largest worst margin")]
    usual = type(design)()
    for key, words in (("snaps", "allowed"), ("round_length", "m"), ("round_deg", "degrees"), ("seed", "")):
        given = getattr(design, key)
        goal.append((key, None if given == getattr(usual, key) else given, words))
    table = _fill(tomlkit.table(), goal)
    if design.weights:
        table.add("weights", _fill(tomlkit.table(), [(name, float(w), "") for name, w in design.weights.items()]))
    if design.variables:
        units = {"deg": "degrees, from the pose given"}
        rows: Rows = [(v.name, [float(v.lower), float(v.upper)], units.get(v.name[-3:], "m")) for v in design.variables]
        rows += [(c.name, f"= {c.words}", "") for c in design.couplings]
        table.add("variables", _fill(tomlkit.table(), rows))
    document["design"] = table


def _robust(document: Any, problem: Problem) -> None:
    robust = problem.robust
    if robust is None:
        return
    quantile = robust.hold == "quantile"
    rows: Rows = [
        ("hold", robust.hold, "quantile | corners"),
        ("share", float(robust.share) if quantile else None, "of what is built"),
        ("samples", robust.samples, "of the Monte Carlo study that verifies it"),
        ("seed", robust.seed or None, ""),
    ]
    table = _fill(tomlkit.table(), rows)
    tolerances = {
        key: _inline([(name, value, "") for name, value in content_of(spread).items()])
        for key, spread in robust.tolerances.items()
    }
    table.add("tolerances", _fill(tomlkit.table(), [(key, value, "") for key, value in tolerances.items()]))
    document["robust"] = table

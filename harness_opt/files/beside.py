"""Files that a problem file names: meshes, which are looked for, libraries of cables and robots, which are read.

A library is a TOML file with a table for each cable. ``from = "my_cables.toml#power"`` takes from its table ``[power]``
what the cable does not say itself.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from harness_opt.errors import ProblemError
from harness_opt.files.bodies import MOST_TABLE_BYTES, PER_UNIT, RobotTable, numbers_of
from harness_opt.files.places import MEGABYTE, MOST_MESH_BYTES, Places
from harness_opt.files.schema import PART_SHAPES
from harness_opt.model.between import is_name, mistakes_between
from harness_opt.model.bodies import WORLD, Body
from harness_opt.model.checks import INVALID, KeyPath, Mistake, Tree, one_of, shown, table, value
from harness_opt.model.parts import UNITLESS_MESHES, Y_UP, Robot, mesh_mistakes
from harness_opt.robots.links import Program, bodies_of, limit_warnings, part_of, program_mistakes, shapes_of
from harness_opt.robots.packages import mesh_candidates, package_folders
from harness_opt.robots.urdf import Description, Shape, description_of

MOST_LIBRARY_BYTES = MEGABYTE
MOST_URDF_BYTES = 20 * MEGABYTE
PACKAGE = "package:"  # begins the name of a URDF in an installed Python package
PACKAGE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
OF_A_LIBRARY = (
    "diameter", "bending_stiffness", "torsional_stiffness", "density", "mass_per_length", "rest_curvature",
    "bend_radius_factors",
)  # fmt: skip
OF_A_MESH = {
    "mesh_unit": "a unit", "mesh_scale": "a scale", "mesh_sha256": "a SHA-256", "shell": "a shell", "up": "an axis",
}  # fmt: skip
NEEDED = ("diameter", "bending_stiffness", "torsional_stiffness")
MASSES = ("density", "mass_per_length")


def mistakes_of_parts(tree: Tree, places: Places) -> Iterator[Mistake]:
    """Yield what is wrong about the shapes of parts.

    Args:
        tree: the tables, with ``INVALID`` for values that are known to be wrong.
        places: where meshes may lie.
    """
    for name in table(tree, "parts"):
        yield from _part(tree, name, places)


def _part(tree: Tree, name: str, places: Places) -> Iterator[Mistake]:
    path, part = ("parts", name), table(tree, "parts", name)
    if not isinstance(tree["parts"][name], Mapping):
        return
    shapes = [shape for shape in PART_SHAPES if shape in part]
    if len(shapes) != 1:
        found = " and ".join(shapes) or "no shape"
        yield path, f"found {found}, expected exactly one of {', '.join(PART_SHAPES)}"
    for key, words in OF_A_MESH.items():
        if key in part and "mesh" not in part:
            yield (*path, key), f"found {words} without a mesh, expected it beside mesh only"
    if value(part, "mesh") is not None:
        yield from _mesh(path, part, places)


def _mesh(path: KeyPath, part: Tree, places: Places) -> Iterator[Mistake]:
    """Check the suffix, the unit, the place and the presence of a mesh file; what is in it is the scene's to read."""
    mesh = part["mesh"]
    for key, words in mesh_mistakes(mesh, "m" if "mesh_unit" in part else None):
        yield (*path, key), words
    why = places.fault(mesh, "a mesh", value(part, "mesh_sha256"), MOST_MESH_BYTES)
    if why:
        yield (*path, "mesh"), why


# --- libraries of cables -------------------------------------------------------------------------------


def with_cables(raw: Mapping[str, Any], places: Places, own: Path) -> tuple[dict[str, Any], list[Mistake]]:
    """Return the tables of a problem file with what its cables take from libraries, and the mistakes met.

    Args:
        raw: the nested tables, as TOML has them.
        places: where libraries may lie.
        own: the problem file, which is no library.
    """
    cables = raw.get("cables")
    if not isinstance(cables, Mapping):
        return dict(raw), []
    filled, mistakes = dict(cables), list[Mistake]()
    for name, cable in cables.items():
        if not isinstance(cable, Mapping) or not isinstance(cable.get("from"), str):
            continue
        path = ("cables", str(name), "from")
        taken, wrong = _taken(cable["from"], places, own)
        mistakes += [(path, words) for words in wrong]
        if wrong and not taken:  # what it would have said is not missing
            taken = dict.fromkeys(NEEDED, INVALID)
        if any(mass in cable for mass in MASSES):
            taken = {key: value for key, value in taken.items() if key not in MASSES}
        filled[name] = {**taken, **cable}
        if taken and not wrong:
            mistakes += [
                (("cables", str(name), key), f"found nothing, here or in {cable['from']}, expected a number above 0")
                for key in NEEDED
                if key not in filled[name]
            ]
    return {**raw, "cables": filled}, mistakes


def _taken(reference: str, places: Places, own: Path) -> tuple[dict[str, Any], list[str]]:
    """Return what a library says of a cable, and what is wrong with it."""
    try:
        table = _table_of(reference, places, own)
    except Refused as error:
        return {}, [str(error)]
    strange = [key for key in table if key not in OF_A_LIBRARY]
    wrong = [f"found {shown(key)} in {reference}, expected {one_of(OF_A_LIBRARY, key)}" for key in strange]
    return {key: value for key, value in table.items() if key in OF_A_LIBRARY}, wrong


class Refused(ValueError):
    """A reference that leads to no cable; in words."""


def _table_of(reference: str, places: Places, own: Path) -> Mapping[str, Any]:
    """Return the table of a cable in a library.

    Raises:
        Refused: there is none that may be read.
    """
    name, _, cable = reference.partition("#")
    if not (name and cable):
        raise Refused(f'found {shown(reference)}, expected a file and a cable, such as "my_cables.toml#power"')
    file, why = places.located(name), places.fault(name, "a library of cables", None, MOST_LIBRARY_BYTES)
    if why:
        raise Refused(why)
    if file == own:
        raise Refused(f"found {shown(reference)}, the problem file itself, expected a library of cables")
    try:
        tables = tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise Refused(f"found {shown(name)}, which can't be read ({error}), expected TOML") from None
    known = [key for key, table in tables.items() if isinstance(table, dict)]
    if cable not in known:
        raise Refused(f"found {shown(reference)}, expected {one_of(known, cable) or 'a table for each cable'} in it")
    if "from" in tables[cable]:
        raise Refused(f"found {shown(reference)}, which refers to another cable itself, expected its own values")
    found: Mapping[str, Any] = tables[cable]
    return found


def library_of(reference: str, places: Places) -> Path:
    """Return the file of a reference such as ``my_cables.toml#power``."""
    return places.located(reference.partition("#")[0])


# --- robots --------------------------------------------------------------------------------------------


def robots_of(tree: Tree, places: Places, pending: Mapping[Path, bytes]) -> tuple[dict[str, Robot], list[Mistake]]:
    """Return the robots whose tables are in order, and the mistakes in their files.

    Args:
        tree: the tables, with ``INVALID`` for values that are known to be wrong.
        places: where their files may lie.
        pending: contents of programs that are yet to be written, by absolute path.
    """
    found: dict[str, Robot] = {}
    mistakes: list[Mistake] = []
    for name, given in table(tree, "robots").items():
        try:
            robot = RobotTable.model_validate(given)
        except ValidationError:
            continue  # named already when the whole file was structured
        if not is_name(name):
            continue  # named by the checks between keys
        wrong = [((key,), f"found {words} without a program, expected it beside program only")
                 for key, words in (("unit", "a unit"), ("program_sha256", "a SHA-256"))
                 if key in given and robot.program is None]  # fmt: skip
        made, more = _robot(name, robot, places, pending)
        mistakes += [(("robots", name, *path), words) for path, words in (*wrong, *more)]
        if made is not None:
            found[name] = made
    bodies = {WORLD, *table(tree, "bodies"), *(link for robot in found.values() for link in robot.bodies)}
    for name, one in found.items():
        if one.base.parent not in bodies:
            words = f"found {shown(one.base.parent)}, expected {one_of(sorted(bodies), one.base.parent)}"
            mistakes.append((("robots", name, "base", "body"), words))
        for section, given in (("bodies", one.bodies), ("parts", one.parts)):
            for taken in given.keys() & table(tree, section).keys():
                words = f"found a name that robot {shown(name)} gives to a link, expected another"
                mistakes.append(((section, taken), words))
    return found, mistakes


def between_with(tree: Tree, robots: Mapping[str, Robot]) -> Iterator[Mistake]:
    """Yield the mistakes that only several keys show, the links and parts of robots among the others."""
    bodies, parts = dict(table(tree, "bodies")), dict(table(tree, "parts"))
    for robot in robots.values():
        base = robot.base.parent
        bodies |= {
            name: {"parent": INVALID if one.parent == base else one.parent} for name, one in robot.bodies.items()
        }
        parts |= {name: {"body": one.body} for name, one in robot.parts.items()}
    lacking = [f"found {json.dumps(name)[:-1]}." for name in table(tree, "robots") if name not in robots]
    joined = {**tree, "bodies": bodies, "parts": parts} if robots else tree
    for path, words in mistakes_between(joined):
        if not words.startswith(tuple(lacking)):  # what a robot with mistakes would have had is no mistake of others
            yield path, words


def _robot(
    name: str, given: RobotTable, places: Places, pending: Mapping[Path, bytes]
) -> tuple[Robot | None, list[Mistake]]:
    """Return a robot with its bodies and parts, or its mistakes, by keys of its table."""
    urdf = ("urdf",)
    try:
        file, own = _urdf_file(given.urdf, places)
        content = file.read_bytes()
        described = description_of(content, given.meshes)
    except Refused as error:
        return None, [(urdf, str(error))]
    except ProblemError as error:
        return None, [(urdf, line) for line in error.mistakes]
    mistakes: list[Mistake] = []
    files, program = [(file, hashlib.sha256(content).hexdigest())], None
    if given.program is not None:
        try:
            table_file, data = _program_file(given, places, pending)
            files.append((table_file, hashlib.sha256(data).hexdigest()))
            program = _program(data, table_file, given.unit, described)
        except ProblemError as error:
            mistakes += [(("program",), line) for line in error.mistakes]
    shapes, wrong = shapes_of(name, described, given.leave_out)
    mistakes += [(("leave_out",), words) for words in wrong]
    meshes, wrong = _mesh_files(shapes, file, own)
    mistakes += [(urdf, words) for words in wrong]
    if mistakes:
        return None, mistakes
    base = Body(None, given.base.body, given.base.position, given.base.quaternion)
    try:
        bodies = bodies_of(name, described, base, program)
        parts = {
            key: part_of(name, link, shape, meshes.get(shape.mesh), given.shell)
            for key, (link, shape) in shapes.items()
        }
        doubts = tuple(limit_warnings(described, program))
    except ProblemError as error:
        return None, [(urdf, line) for line in error.mistakes]
    return Robot(
        urdf=given.urdf if given.urdf.startswith(PACKAGE) else file,
        base=base,
        program=None if given.program is None else files[1][0],
        unit=given.unit or "rad",
        meshes=given.meshes,
        shell=given.shell,
        leave_out=tuple(given.leave_out),
        bodies=bodies,
        parts=parts,
        files=tuple(files),
        doubts=doubts,
    ), []


def _urdf_file(name: str, places: Places) -> tuple[Path, Places]:
    """Return the URDF called ``name``, and where the meshes may lie that it names.

    Raises:
        Refused: there is none that may be read.
    """
    if not name.startswith(PACKAGE):
        why = places.fault(name, "a URDF", None, MOST_URDF_BYTES)
        if why:
            raise Refused(why)
        if name.lower().endswith(".xacro"):
            raise Refused(f"found {shown(name)}, a template, expected a URDF: xacro {name} > robot.urdf makes one")
        return places.located(name), places
    package, _, rest = name.removeprefix(PACKAGE).partition("/")
    wanted = f'expected a file of an installed Python package, such as "{PACKAGE}example_robot_data/robots/..."'
    if not PACKAGE_NAME.fullmatch(package) or not rest or ".." in Path(rest).parts:
        raise Refused(f"found {shown(name)}, {wanted}")
    for folder in package_folders(package, rest):
        own = Places.around(folder)
        if not own.fault(rest, "a URDF", None, MOST_URDF_BYTES):
            return own.located(rest), own
    raise Refused(f"found {shown(name)}, of which nothing is installed here, {wanted}")


def _program_file(given: RobotTable, places: Places, pending: Mapping[Path, bytes]) -> tuple[Path, bytes]:
    name = str(given.program)
    file = places.located(name)
    if file in pending:
        return file, pending[file]
    why = places.fault(name, "a program", given.program_sha256, MOST_TABLE_BYTES)
    if why:
        raise ProblemError(why)
    return file, file.read_bytes()


def _program(content: bytes, file: Path, unit: str | None, described: Description) -> Program:
    """Return what a CSV table tells the joints to do, rad or m."""
    wanted = "t and the names of joints, such as t,elbow"

    def fits(names: tuple[str, ...]) -> bool:
        return names[0] == "t" and len(set(names)) == len(names) > 1

    names, rows = numbers_of(content, file, wanted, fits)
    wrong = [f"{file.name}: {words}" for words in program_mistakes(described, list(names[1:]))]
    if wrong:
        raise ProblemError(wrong)
    straight = {joint.name for joint in described.joints if joint.kind == "prismatic"}
    units = [1.0 if name in straight else PER_UNIT[unit or "rad"] for name in names[1:]]
    columns = (rows[:, 1:] * units).T.tolist()
    return Program(tuple(rows[:, 0].tolist()), dict(zip(names[1:], map(tuple, columns), strict=True)))


def _mesh_files(
    shapes: Mapping[str, tuple[str, Shape]], urdf: Path, places: Places
) -> tuple[dict[str, Path], list[str]]:
    """Return the files of meshes by what a URDF calls them, and what is wrong with others."""
    found: dict[str, Path] = {}
    wrong: dict[str, str] = {}
    known = (*UNITLESS_MESHES, *Y_UP)
    for link, shape in shapes.values():
        name = shape.mesh
        if not name or name in found or name in wrong:
            continue
        if Path(name).suffix.lower() not in known:
            words = f"expected a mesh ending in {one_of(known)}, or to leave it out"
            wrong[name] = f"link {link}: found {shown(Path(name).name)}, {words}"
            continue
        faults = {}
        for file in mesh_candidates(name, urdf):
            faults[file] = places.fault(str(file), "a mesh", None, MOST_MESH_BYTES)
            if not faults[file]:
                found[name] = places.located(str(file))
                break
        else:
            wrong[name] = f"link {link}, mesh {shown(name)}: {next(iter(faults.values()))}"
    return found, list(wrong.values())


# --- limits --------------------------------------------------------------------------------------------


def mistakes_of_limits(tree: Tree) -> Iterator[Mistake]:
    """Yield what is wrong about a bend limit in diameters."""
    limits, path = table(tree, "limits"), ("limits", "bend_radius_factor")
    factor = value(limits, "bend_radius_factor")
    if factor is None:
        return
    if "bend_radius" in limits:
        yield path, "found bend_radius as well, expected one of the two"
    for name in table(tree, "cables"):
        cable = table(tree, "cables", name)
        told = table(cable, "bend_radius_factors").get(factor) if isinstance(factor, str) else factor
        if "bend_radius" in cable:
            yield path, f"found cables.{name}.bend_radius as well, expected one of the two"
        if told is None:
            words = f"expected it in cables.{name}.bend_radius_factors, or in the library that the cable is from"
            yield path, f"found {shown(factor)}, {words}"


def bend_radii(limits: Any, cables: Mapping[str, Any]) -> tuple[float | None, dict[str, float | None]]:
    """Return the bend limit of a file for all cables, m, and those of their own by name.

    A limit in diameters that is the same for all is one for all.
    """
    own = {name: cable.bend_radius for name, cable in cables.items()}
    factor = limits.bend_radius_factor
    if factor is None:
        return limits.bend_radius, own
    radii = {
        name: float((cable.bend_radius_factors[factor] if isinstance(factor, str) else factor) * cable.diameter)
        for name, cable in cables.items()
    }
    return (next(iter(radii.values())), own) if len(set(radii.values())) == 1 else (None, {**radii})

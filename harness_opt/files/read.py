"""Problem files: TOML to :class:`~harness_opt.model.problem.Problem` and back.

The way in: bytes -> TOML -> tables (``file_schema``) -> checks between keys (``file_checks``) -> Problem.
Every mistake met on the way is gathered and raised as one :class:`~harness_opt.errors.ProblemError`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import math
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from harness_opt.errors import ProblemError
from harness_opt.files import schema as file_schema
from harness_opt.files.beside import (
    bend_radii,
    between_with,
    library_of,
    mistakes_of_limits,
    mistakes_of_parts,
    robots_of,
    with_cables,
)
from harness_opt.files.bodies import motions_of
from harness_opt.files.places import MEGABYTE, Places, unreadable
from harness_opt.files.quantity_keys import robust_mistakes
from harness_opt.files.schema import schema
from harness_opt.files.tolerance_table import tolerance
from harness_opt.files.values import structured
from harness_opt.files.whole_folder import write_whole
from harness_opt.model.bodies import Body, BodyMotion, Hinge, Slide, seconds_of
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.checks import Mistake, coupling, dotted, shown
from harness_opt.model.courses import Moves
from harness_opt.model.design import Coupling, Design, Limits, Robust, Variable
from harness_opt.model.ends import Clip, End
from harness_opt.model.parts import Box, Capsule, Cylinder, MeshFile, Part, Robot, Solid, Sphere
from harness_opt.model.problem import Problem

__all__ = ["parse_problem", "read_problem", "schema", "write_problem"]

MOST_BYTES = 4 * MEGABYTE  # of a problem file: some fifty thousand lines
MOST_KEYS = 50_000  # of all its tables
DEEPEST = 32  # tables within tables; none of ours lies deeper than five
_PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+"""  # of a dotted key, bare or quoted
LONG_KEY = re.compile(rf"(?<![A-Za-z0-9_-])(?:{_PART}\.[ \t]*+){{{DEEPEST}}}{_PART}[.\]=]")
MOST_NAMES = {"cables": 100, "bodies": 1000, "parts": 1000, "robots": 100}
_OWN, _OF_A_STUDY = {"cables", "bodies", "parts"}, {"vary", "variants", "problem"}  # tables of either kind of file
NEAR = 20  # letters that are shown around one that cannot be written
CLOCK = 1e-9  # of a motion's seconds, by which two of them differ in rounding
MOST_MISTAKES = 200  # that are told one by one


def read_problem(path: str | os.PathLike[str], folders: Iterable[str | os.PathLike[str]] = ()) -> Problem:
    """Return the problem that a TOML file describes.

    Meshes are looked for, not read; tables of poses are read.

    Args:
        path: of the problem file; paths inside it start at its folder.
        folders: from which it may read meshes and tables beside its own folder; see
            :mod:`~harness_opt.files.places`.

    Raises:
        ProblemError: one line a mistake, ``FILE: cables.lead.length: found -1, expected a number above 0``.
    """
    file = Path(path)
    return parse_problem(content_of(file, "a problem file"), Places.around(file.parent, folders), file)


def content_of(file: Path, what: str) -> bytes:
    """Return the bytes of a TOML file that is expected to be ``what``.

    Raises:
        ProblemError: it cannot be read, or is too large.
    """
    why = unreadable(file, MOST_BYTES)
    if why:
        raise ProblemError(f"{file}: found {why}, expected {what}")
    with file.open("rb") as stream:
        content = stream.read(MOST_BYTES + 1)  # a pipe does not say how much there is
    if len(content) > MOST_BYTES:
        raise ProblemError(f"{file}: found more than {MOST_BYTES / MEGABYTE:g} MB, expected {what}")
    return content


def write_problem(problem: Problem, path: str | os.PathLike[str]) -> Path:
    """Write ``problem`` as a TOML file that runs from where it lies, and return its absolute path.

    Paths of meshes and tables of poses are rewritten relative to the file's folder, which is made where it is
    missing. A table of poses that is in no file, or is no longer what its file holds, is written beside as
    ``NAME_BODY.csv``.
    Each file is written aside and then renamed, so that none is ever half there.

    Args:
        problem: what to write; read back it is equal, but for ``file`` and ``sha256``.
        path: of the file.

    Raises:
        ProblemError: the file can't be written, or could not be read back: nothing is written then.
    """
    from harness_opt.files.write import problem_text  # what writes TOML is not waited for by what reads it

    file = Path(path)
    file = file.parent.resolve() / file.name
    if file.is_dir():
        raise ProblemError(f"{file}: found a folder, expected the name of a file to write")
    try:
        text, tables = problem_text(problem, file)
        try:
            content = text.encode()
        except UnicodeEncodeError as error:
            name = shown(text[max(error.start - NEAR, 0) : error.end + NEAR].encode("utf-8", "replace").decode())
            words = f"found the name of a mesh or table that is no UTF-8, near {name}, expected one that TOML can hold"
            raise ProblemError(f"{file}: {words}") from None
        # the proof that it can be read, before anything is touched
        parse_problem(content, Places.around(file.parent), file, pending=tables)
        file.parent.mkdir(parents=True, exist_ok=True)
        for target, data in (*tables.items(), (file, content)):
            write_whole(target, data)
    except OSError as error:
        where = error.filename or file
        raise ProblemError(f"{file}: found no way to write {where} ({error.strerror}), expected one") from error
    return file


def parse_problem(content: bytes, places: Places, file: Path, pending: Mapping[Path, bytes] | None = None) -> Problem:
    """Return the problem that the bytes of a TOML file describe.

    Args:
        content: the bytes.
        places: where the files may lie that it names.
        file: where they lie, or will lie.
        pending: contents of tables of poses that are yet to be written, by absolute path.

    Raises:
        ProblemError: as :func:`read_problem`.
    """
    if len(content) > MOST_BYTES:
        raise ProblemError(f"{file}: found more than {MOST_BYTES / MEGABYTE:g} MB, expected a problem file")
    problem = problem_from(toml_tables(content, file), places, file, pending)
    return dataclasses.replace(problem, sha256=hashlib.sha256(content).hexdigest())


def problem_from(
    raw: dict[str, Any], places: Places, file: Path, pending: Mapping[Path, bytes] | None = None
) -> Problem:
    """Return the problem that the nested tables of a TOML file describe; see :func:`parse_problem`."""
    if not _OWN & raw.keys() and "measurements" in raw:
        raise ProblemError(
            f"{file}: found measurements, expected a problem file; they are taken by: harness-opt identify {file}"
        )
    if not _OWN & raw.keys() and _OF_A_STUDY & raw.keys():
        raise ProblemError(
            f"{file}: found a study, expected a problem file; a study is run by: harness-opt study {file}"
        )
    raw, of_libraries = with_cables(raw, places, places.folder / file.name)
    tables, tree, mistakes = structured(raw, file_schema.ProblemTable)
    told = {path for path, _ in of_libraries}
    mistakes = [*of_libraries, *(mistake for mistake in mistakes if mistake[0] not in told)]
    robots, wrong = robots_of(tree, places, pending or {})
    mistakes += [*wrong, *between_with(tree, robots), *mistakes_of_parts(tree, places), *mistakes_of_limits(tree)]
    motions, wrong = motions_of(tree, places, pending or {})
    mistakes += wrong
    duration = 1.0
    if tables is not None:
        links = {name: body.motion for robot in robots.values() for name, body in robot.bodies.items()}
        motions, duration, wrong = on_one_clock({**motions, **links}, tables.motion)
        mistakes += wrong
    if tables is not None and tables.robust is not None:
        mistakes += robust_mistakes(tables, tables.robust)
    if mistakes or tables is None:
        lines = [f"{file}: {dotted(path)}: {words}" for path, words in mistakes[:MOST_MISTAKES]]
        left = len(mistakes) - len(lines)
        raise ProblemError([*lines, f"{file}: found {left:,} more mistakes, expected none"] if left else lines)
    with naming(file):
        return _problem(tables, motions, duration, robots, places, file)


@contextlib.contextmanager
def naming(file: Path) -> Iterator[None]:
    """Put the name of ``file`` before mistakes that come without."""
    try:
        yield
    except ProblemError as error:
        raise ProblemError(f"{file}: {line}" for line in error.mistakes) from None


def _problem(
    tables: file_schema.ProblemTable,
    motions: Mapping[str, BodyMotion | None],
    duration: float,
    robots: Mapping[str, Robot],
    places: Places,
    file: Path,
) -> Problem:
    bend_radius, own_radii = bend_radii(tables.limits, tables.cables)
    bodies = {
        name: Body(motions[name], body.parent, body.position, body.quaternion, body.free, body.mass)
        for name, body in tables.bodies.items()
    }
    parts = {name: _part(part, places) for name, part in tables.parts.items()}
    for robot in robots.values():
        bodies |= robot.bodies
        parts |= robot.parts
    return Problem(
        cables={name: _cable_run(cable, own_radii[name]) for name, cable in tables.cables.items()},
        bodies=bodies,
        parts=parts,
        robots=robots,
        gravity=tables.gravity,
        limits=_limits(tables.limits, bend_radius),
        design=_design(tables.design),
        robust=_robust(tables.robust),
        duration=duration,
        out_and_back=tables.motion.out_and_back,
        spatial_step=tables.motion.spatial_step,
        title=tables.title,
        file=places.folder / file.name,
        libraries=tuple(library_of(cable.from_, places) for cable in tables.cables.values() if cable.from_),
    )


def toml_tables(content: bytes, file: Path) -> dict[str, Any]:
    """Return the nested tables of a TOML text; a byte order mark, as Windows editors write, is let pass."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ProblemError(f"{file}: line {line}: found bytes that are not UTF-8, expected a TOML text") from None
    deep = LONG_KEY.search(text)  # tomllib takes a time that grows with the square of a key's length
    if deep is not None:
        line = text.count("\n", 0, deep.start()) + 1
        words = f"found more keys or levels than any problem has, expected at most {DEEPEST} levels"
        raise ProblemError(f"{file}: line {line}: {words}")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ProblemError(f"{file}: found brackets nested too deeply, expected a problem file") from None
    except ValueError as error:
        raise ProblemError(f"{file}: {_syntax_words(str(error), text)}") from None
    _refuse_many(tables, file)
    return tables


def _refuse_many(raw: dict[str, Any], file: Path) -> None:
    """Raise where a file holds more than anybody types, before time is spent on it."""
    keys, level, depth = 0, [raw], 0
    while level:
        keys, depth = keys + sum(map(len, level)), depth + 1
        if keys > MOST_KEYS or depth > DEEPEST:
            words = f"at most {MOST_KEYS:,} keys, {DEEPEST} levels deep"
            raise ProblemError(f"{file}: found more keys or levels than any problem has, expected {words}")
        level = [item for one in level for item in one.values() if isinstance(item, dict)]
    crowds = [
        f"{file}: {name}: found {len(raw[name]):,}, expected at most {most:,}"
        for name, most in MOST_NAMES.items()
        if isinstance(raw.get(name), dict) and len(raw[name]) > most
    ]
    if crowds:
        raise ProblemError(crowds)


def _syntax_words(message: str, text: str) -> str:
    """Return tomllib's message with its place first and the text of the line."""
    lines = text.split("\n")
    placed = re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", message, re.DOTALL)
    if placed:
        line = int(placed[2])
        found = shown(lines[line - 1].strip()) if line <= len(lines) else "the end of the file"
        return f"line {line}, column {placed[3]}: found {found}, expected TOML: {_lowered(placed[1])}"
    ended = re.fullmatch(r"(.*) \(at end of document\)", message, re.DOTALL)
    if ended:
        return f"line {len(lines)}: found the end of the file, expected TOML: {_lowered(ended[1])}"
    words = _lowered(message.partition("; use sys.")[0])  # what is behind is advice to programmers
    return f"found a value that can't be read, expected TOML: {words}"


def _lowered(words: str) -> str:
    return words[:1].lower() + words[1:]


def on_one_clock(
    motions: Mapping[str, BodyMotion | None], path: file_schema.PathTable
) -> tuple[dict[str, BodyMotion | None], float, list[Mistake]]:
    """Return the motions, with moves that end first at rest until all have ended; the duration; and mistakes.

    The duration is that of the longest moves or table of values where it is left out, twice that there and back.
    """
    times = 2.0 if path.out_and_back else 1.0
    told = {name: seconds_of(one) for name, one in motions.items() if isinstance(one, (Hinge, Slide))}
    seconds = {name: second for name, second in told.items() if second is not None}
    duration = path.duration
    if seconds and "duration" not in path.model_fields_set:
        duration = times * max(seconds.values())
    found, mistakes = dict(motions), list[Mistake]()
    for name, second in seconds.items():
        one = motions[name]
        if not isinstance(one, (Hinge, Slide)) or not isinstance(one.follows, Moves):
            continue
        rest = duration / times - second
        if rest < -CLOCK * second:
            words = f"expected at least {times * second:.6g}, the seconds of the moves of {name}"
            mistakes.append((("motion", "duration"), f"found {shown(duration)}, {words}"))
        elif rest > CLOCK * second:
            last = one.follows.moves[-1]
            moves = (*one.follows.moves[:-1], dataclasses.replace(last, dwell=last.dwell + rest))
            found[name] = dataclasses.replace(one, follows=Moves(one.follows.begin, moves))
    return found, duration, mistakes


def _cable_run(cable: file_schema.CableTable, bend_radius: float | None) -> CableRun:
    ends = _end(cable.start), _end(cable.end)
    clips = tuple(Clip(**clip.model_dump()) for clip in cable.clips)
    return CableRun(_cable(cable), *ends, cable.bow, cable.fitted_at, clips, bend_radius)


def _cable(cable: file_schema.CableTable) -> Cable:
    mass = cable.mass_per_length or 0.0
    if cable.density is not None:
        mass = cable.density * 0.25 * math.pi * cable.diameter * cable.diameter
    return Cable(
        length=cable.length,
        diameter=cable.diameter,
        bending_stiffness=cable.bending_stiffness,
        torsional_stiffness=cable.torsional_stiffness,
        mass_per_length=mass,
        rest_curvature=cable.rest_curvature,
    )


def _end(end: file_schema.EndTable) -> End:
    return End(**end.model_dump())


def _part(part: file_schema.PartTable, places: Places) -> Part:
    return Part(_shape(part, places), part.body, part.position, part.quaternion, part.clearance)


def _shape(part: file_schema.PartTable, places: Places) -> MeshFile | Solid:
    if part.box is not None:
        return Box(part.box.size)
    if part.sphere is not None:
        return Sphere(part.sphere.radius)
    if part.cylinder is not None:
        return Cylinder(part.cylinder.radius, part.cylinder.length)
    if part.capsule is not None:
        return Capsule(part.capsule.radius, part.capsule.length)
    given = 1.0 if part.mesh_scale is None else part.mesh_scale
    scale = given if isinstance(given, tuple) else (given, given, given)
    return MeshFile(places.located(str(part.mesh)), part.mesh_unit, part.shell, part.up, scale)


def _limits(limits: file_schema.LimitsTable, bend_radius: float | None) -> Limits:
    twist = limits.twist_deg_per_m
    return Limits(
        clearance=limits.clearance,
        bend_radius=bend_radius,
        twist=None if twist is None else math.radians(twist),
        clamp_force=limits.clamp_force,
        clamp_moment=limits.clamp_moment,
        clip_force=limits.clip_force,
        clip_moment=limits.clip_moment,
        travel=limits.travel,
    )


def _design(design: file_schema.DesignTable) -> Design:
    variables, couplings = [], []
    for name, given in design.variables.items():
        if isinstance(given, str):
            leader, factor, offset = coupling(given) or (name, 1.0, 0.0)  # checked before
            couplings.append(Coupling(name, leader, factor, offset))
        else:
            variables.append(Variable(name, *given))
    plain = design.model_dump(exclude={"variables"})
    return Design(**plain, variables=tuple(variables), couplings=tuple(couplings))


def _robust(robust: file_schema.RobustTable | None) -> Robust | None:
    if robust is None:
        return None
    tolerances = {key: tolerance(spread.model_dump()) for key, spread in robust.tolerances.items()}
    return Robust(tolerances, robust.hold, robust.share, robust.samples, robust.seed)

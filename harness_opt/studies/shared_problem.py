"""What all variants of a study share, and how a worker finds it on its own machine: the problem, its files, its parts.

A worker reads the problem once and each mesh once; a part that a variant moves is built from the mesh that is there.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import hashlib
import json
import os
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from harness_opt.errors import ProblemError
from harness_opt.files.beside import PACKAGE, robots_of
from harness_opt.files.places import Places
from harness_opt.files.quantities import Quantities, Tree
from harness_opt.model.checks import table
from harness_opt.model.parts import MeshFile, Part
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from harness_opt.parts.geometry import Geometry
from harness_opt.parts.mesh import Mesh
from harness_opt.parts.scene import Scene, load_scene

Command = Literal["simulate", "redesign"]
COMMANDS = ("simulate", "redesign")
DIGITS = 32  # of a study's name
SILENT = ("title",)  # sections that no result depends on


@dataclass(frozen=True)
class Shared:
    """What all variants of a study share; small, and made of plain values, so that it travels with each.

    Args:
        tables: of the problem's file, as JSON.
        file: of the problem; its paths start at that folder.
        folders: from which it may read files beside its own.
        files: names in the problem, and sha256, of the meshes and tables of poses.
        command: what to run.
        version: of harness-opt.
    """

    tables: str
    file: str
    folders: tuple[str, ...]
    files: tuple[tuple[str, str], ...]
    command: Command
    version: str

    @classmethod
    def of(cls, quantities: Quantities, variants: Sequence[Mapping[str, Any]], command: Command) -> Shared:
        """Return what the variants of a problem share, its files looked at."""
        names = {name for _, _, name in _files(quantities.tree)}
        # a variant may name other files, by a key of its own or within a table
        varied = [values for values in variants if any(isinstance(value, (str, dict)) for value in values.values())]
        names |= {name for values in varied for _, _, name in _files(quantities.changed(values))}
        names |= _meshes_of_robots(quantities)
        places = quantities.places
        hashes = tuple((name, sha256(places.located(name))) for name in sorted(names))
        told = {key: value for key, value in quantities.tree.items() if key not in SILENT}
        return cls(
            json.dumps(told, sort_keys=True), str(quantities.file), _words(places.others), hashes, command, version()
        )

    def key(self, values: Mapping[str, Any]) -> str:
        """Return what names a variant: the sha256 of all that its result depends on, but for where files lie."""
        content = [self.tables, self.files, self.command, self.version, values]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def name(self) -> str:
        """What names the study where its files are kept: no two read each other's."""
        content = json.dumps([self.tables, self.files, self.command])
        return hashlib.sha256(content.encode()).hexdigest()[:DIGITS]

    def paths(self) -> dict[Path, str]:
        """Return the absolute paths of the files where the study was started, and their sha256."""
        places = Places.around(Path(self.file).parent)
        return {places.located(name): digest for name, digest in self.files}


def _words(paths: Iterable[Path]) -> tuple[str, ...]:
    return tuple(str(path) for path in paths)


def _files(tree: Mapping[str, Any]) -> Iterator[tuple[dict[str, Any], str, str]]:
    """Yield the files that a problem names: the table that does, the key, the name."""
    for part in table(tree, "parts").values():
        if isinstance(part.get("mesh"), str):
            yield part, "mesh", part["mesh"]
    for body in table(tree, "bodies").values():
        motion = table(body, "motion")
        if isinstance(motion.get("file"), str):
            yield motion, "file", motion["file"]  # type: ignore[misc]
    for robot in table(tree, "robots").values():
        for key in ("urdf", "program"):
            if isinstance(robot.get(key), str) and not robot[key].startswith(PACKAGE):
                yield robot, key, robot[key]


def _meshes_of_robots(quantities: Quantities) -> set[str]:
    """Return the absolute paths of meshes that URDFs name, not those of installed packages."""
    robots, _ = robots_of(quantities.tree, quantities.places, {})
    parts = (part for robot in robots.values() if isinstance(robot.urdf, Path) for part in robot.parts.values())
    return {str(part.shape.path) for part in parts if isinstance(part.shape, MeshFile)}


def version() -> str:
    """Return the version of harness-opt that runs here."""
    return str(sys.modules["harness_opt"].__version__)


def sha256(path: Path) -> str:
    """Return the sha256 of a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _holds(path: Path, digest: str) -> bool:
    return path.is_file() and sha256(path) == digest


def carried_root(study: str) -> Path:
    """Return the folder for the files of a study that are sent to this machine, this user's alone.

    Args:
        study: its :attr:`Shared.name`.

    Raises:
        ProblemError: somebody else's stands in its place, or it cannot be made.
    """
    user = os.getuid() if hasattr(os, "getuid") else "files"  # elsewhere the folder above is the user's own
    above = Path(tempfile.gettempdir()) / f"harness-opt-{user}"
    try:
        above.mkdir(mode=0o700, exist_ok=True)
        info = above.lstat()
        if not stat.S_ISDIR(info.st_mode) or (os.name == "posix" and (info.st_uid != user or info.st_mode & 0o077)):
            raise ProblemError(f"{above}: found a folder that others may write to, expected one of this user alone")
        (above / study).mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise ProblemError(f"{above}: found no way to use it ({error.strerror}), expected a folder of ours") from error
    return above / study


class LocalProblem:
    """The problem of a study as it stands on this machine, and its parts.

    Args:
        shared: what came with the variant.

    Raises:
        ProblemError: a file is missing here, or is another one than where the study was started.
    """

    def __init__(self, shared: Shared):
        tree, file, mistakes = json.loads(shared.tables), Path(shared.file), []
        self._moved: dict[str, str] = {}
        granted = shared.folders
        for name, digest in shared.files:
            found = Places.around(file.parent).located(name)
            if not _holds(found, digest):
                root = carried_root(shared.name)
                sent, granted = root / digest / found.name, (*shared.folders, str(root))
                if not _holds(sent, digest):
                    words = "found no such file, or another, on this machine, expected that of the study"
                    mistakes.append(f"{found}: {words}")
                found = sent
            self._moved[name] = str(found)
        if mistakes:
            raise ProblemError(mistakes)
        self.quantities = Quantities(self._here(tree), file, granted)
        self._at_rest: dict[tuple[str, MeshFile], Geometry] = {}
        self._placed: dict[str, tuple[Part, Geometry]] = {}  # the last of each name: most variants move none

    def _here(self, tree: Tree) -> Tree:
        """Return a copy of ``tree`` with files named where they lie on this machine."""
        tree = copy.deepcopy(tree)
        for holder, key, name in _files(tree):
            holder[key] = self._moved.get(name, name)
        return tree

    def problem(self, values: Mapping[str, Any]) -> Problem:
        """Return the problem with ``values`` by key put in.

        Raises:
            ProblemError: the values make no problem.
        """
        return self.quantities.problem(values, self._here)

    def scene(self, problem: Problem) -> Scene:
        """Return the parts of ``problem``; only what moved since the last variant is built again.

        Raises:
            ProblemError: a mesh that cannot be used.
        """
        parts = {}
        for name, part in problem.parts.items():
            if name not in self._placed or self._placed[name][0] != part:
                self._placed[name] = part, self._geometry(problem, name, part)
            parts[name] = self._placed[name][1]
        return Scene(parts)

    def _geometry(self, problem: Problem, name: str, part: Part) -> Geometry:
        if not isinstance(part.shape, MeshFile):
            return _loaded(problem, name, part)
        known = name, part.shape
        if known not in self._at_rest:
            self._at_rest[known] = _loaded(problem, name, Part(part.shape))
        mesh = self._at_rest[known]
        still = not any(part.position) and tuple(part.quaternion) == rotations.IDENTITY and part.body == mesh.body
        if still or not isinstance(mesh, Mesh):
            return mesh
        vertices = part.position + rotations.rotate(part.quaternion, mesh.vertices)
        return Mesh.of(name, part.body, vertices, mesh.faces, mesh.closed, mesh.gap)


def _loaded(problem: Problem, name: str, part: Part) -> Geometry:
    return load_scene(dataclasses.replace(problem, parts={name: part})).parts[name]


@functools.lru_cache(maxsize=1)
def local_problem(shared: Shared) -> LocalProblem:
    """Return the problem of a study on this machine, set up when its first variant comes."""
    return LocalProblem(shared)

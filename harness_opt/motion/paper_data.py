"""The paper's data of a motion, section 4.1: a "Path" is the poses of one clamp, a "Profile" the poses along one shape.

Both list positions and rotation matrices, eqs. (27) and (28). The columns of a matrix A are d1, d2, d3, so that A takes
section coordinates to the world, and the third column of a node's is the tangent that eq. (17) integrates.

A file holds them as plain arrays, an npz archive of ``path/position`` (M, 3) and ``path/rotation`` (M, 3, 3), or
``profile/position`` (P, N, 3) and ``profile/rotation`` (P, N, 3, 3). SI units, world coordinates, indices from 0.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.files.arrays import plain_array, unpacked_size
from harness_opt.model import checks
from harness_opt.model.bodies import Poses
from harness_opt.model.ends import End
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion
from harness_opt.motion.path import place_frames
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

# what NumPy raises on a file that is no npz archive of plain arrays: cut short, another program's, pickled, damaged
UNREADABLE = (ValueError, EOFError, KeyError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error)

File = str | os.PathLike[str]


@dataclass(frozen=True, eq=False)
class _Poses:
    """Positions and rotation matrices of at least two points; see the two classes below."""

    position: Array
    rotation: Array
    point: ClassVar[str] = "point"  # what one of them is called in messages

    def __post_init__(self) -> None:
        mistakes = []
        for name, shape in (("position", (3,)), ("rotation", (3, 3))):
            array, mistake = _numbers(name, getattr(self, name), shape, self.point)
            mistakes.append(mistake or (_improper(array, self.point) if name == "rotation" else ""))
            array.setflags(write=False)  # what is checked stays so
            object.__setattr__(self, name, array)
        if not any(mistakes) and len(self.position) != len(self.rotation):
            mistakes.append(
                f"rotation: found {len(self.rotation)} matrices, expected one a {self.point}, {len(self.position)}"
            )
        if any(mistakes):
            raise ProblemError([mistake for mistake in mistakes if mistake])

    def __len__(self) -> int:
        return len(self.position)


class Path(_Poses):
    """The poses of one clamp at all its path points, eq. (27).

    Args:
        position: of the clamp, (M, 3), M >= 2, m.
        rotation: section frame that the clamp holds, (M, 3, 3).

    Raises:
        ProblemError: another shape, numbers that are not finite, matrices that are not rotations to 1e-9.
    """

    point = "path point"

    def poses(self, duration: float = 1.0) -> Poses:
        """Return the path as the motion of a body whose coordinates are those of the clamp.

        ``Body(path.poses())`` carries an ``End((0, 0, 0), (1, 0, 0, 0), body=...)`` along the path. The path points are
        reached at equal intervals of time: dispersion sets them one step of travel or turn apart, so that the clamp
        keeps its pace; and a clamp that turns on the spot has no travelled length to go by. Between them positions and
        rotations are smooth splines through the points.

        Args:
            duration: from the first point to the last, s.

        Raises:
            ProblemError: a duration that is not above 0.
        """
        times = np.linspace(0.0, checks.positive("duration", duration), len(self))
        quaternions = np.array([rotations.from_matrix(matrix) for matrix in self.rotation])
        turned = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0  # neighbours on one side of the sphere
        quaternions[1:] *= np.cumprod(np.where(turned, -1.0, 1.0))[:, None]
        return Poses(
            tuple(times.tolist()),
            tuple(map(tuple, self.position.tolist())),
            tuple(map(tuple, rotations.unit(quaternions).tolist())),
        )

    def save(self, file: File) -> None:
        """Write the path to ``file``, an npz archive.

        Raises:
            ProblemError: the file can't be written.
        """
        _save(file, {"path/position": self.position, "path/rotation": self.rotation})

    @classmethod
    def load(cls, file: File) -> Path:
        """Return the path that ``file`` holds.

        Raises:
            ProblemError: a file that can't be read, is no path, or holds poses that are none.
        """
        arrays = _load(file, "path")
        with _told(file):
            return cls(*arrays)


class Profile(_Poses):
    """The poses of all nodes of one shape, eq. (28).

    Args:
        position: of the nodes, (N, 3), N >= 2, m.
        rotation: their section frames, (N, 3, 3).

    Raises:
        ProblemError: another shape, numbers that are not finite, matrices that are not rotations to 1e-9.
    """

    point = "node"

    def save(self, file: File) -> None:
        """Write the profile to ``file``, an npz archive.

        Raises:
            ProblemError: the file can't be written.
        """
        save_profiles(file, [self])

    @classmethod
    def load(cls, file: File) -> Profile:
        """Return the one profile that ``file`` holds.

        Raises:
            ProblemError: as :func:`load_profiles`, or there is more than one.
        """
        found = load_profiles(file)
        if len(found) != 1:
            raise ProblemError(f"{file}: found {len(found)} profiles, expected one (load_profiles reads them all)")
        return found[0]


def save_profiles(file: File, profiles: Iterable[Profile]) -> None:
    """Write the list of profiles of a motion, one a path point, to ``file``, an npz archive.

    Raises:
        ProblemError: no profile, profiles of different numbers of nodes, or the file can't be written.
    """
    listed = list(profiles)
    counts = sorted({len(profile) for profile in listed})
    if len(counts) != 1:
        found = f"profiles of {' and '.join(map(str, counts))} nodes" if counts else "none"
        raise ProblemError(f"profiles: found {found}, expected profiles of one cable, all of one number of nodes")
    names = ("position", "rotation")
    _save(file, {f"profile/{name}": np.stack([getattr(profile, name) for profile in listed]) for name in names})


def load_profiles(file: File) -> tuple[Profile, ...]:
    """Return the profiles that ``file`` holds, as :func:`save_profiles` or :meth:`Profile.save` wrote them.

    Raises:
        ProblemError: a file that can't be read, holds no profiles, or holds poses that are none.
    """
    position, rotation = _load(file, "profile")
    if position.ndim != 3 or rotation.ndim != 4 or len(position) != len(rotation) or not len(position):
        raise ProblemError(
            f"{file}: found profile/position of shape {position.shape} and profile/rotation of shape {rotation.shape}, "
            "expected (P, N, 3) and (P, N, 3, 3)"
        )
    found = []
    for k, arrays in enumerate(zip(position, rotation, strict=True)):
        with _told(f"{file}: profile {k}"):
            found.append(Profile(*arrays))
    return tuple(found)


def disperse(
    problem: Problem, cable: str, spatial_step: float | None = None, clamp: Literal["start", "end"] = "end"
) -> Path:
    """Return the path of one clamp, its poses at the frames that :func:`harness_opt.simulate` solves.

    The paper's dispersion, section 4.2.

    Args:
        problem: with the cable and the bodies that carry its clamps.
        cable: name.
        spatial_step: most that a clamp moves between two path points, m; None takes the problem's own.
        clamp: which one; that of a body that stands still gives a path of equal points.

    Raises:
        ProblemError: no such cable or clamp, an end that is not clamped, a step as in
            :func:`harness_opt.motion.path.place_frames`, or nothing moves.
    """
    if cable not in problem.cables:
        raise ProblemError(f"cable: found {cable!r}, expected one of {', '.join(map(repr, problem.cables))}")
    if clamp not in ("start", "end"):
        raise ProblemError(f"clamp: found {clamp!r}, expected 'start' or 'end'")
    end: End = getattr(problem.cables[cable], clamp)
    if end.position is None or end.frame is None:
        free = [name for name, given in (("position", end.position), ("quaternion", end.frame)) if given is None]
        raise ProblemError(
            f"cables.{cable}.{clamp}: found an end without {' and '.join(free)}, expected both: only a clamp has a path"
        )
    if not problem.moves:
        raise ProblemError("bodies: found none with a motion, expected one: a clamp that stands still has no path")
    position, quaternion = problem.poses(end.body, place_frames(problem, spatial_step))
    position = position + rotations.rotate(quaternion, end.position)
    return Path(position, rotations.matrix(rotations.multiply(quaternion, end.frame)))


def profiles(motion: Motion, cable: str) -> tuple[Profile, ...]:
    """Return the profiles of a simulated motion, one a path point: what the paper's computation ends with, section 4.2.

    Args:
        motion: simulated.
        cable: name.

    Raises:
        ProblemError: no such cable in the motion.
    """
    lead = solved(motion, cable)
    return tuple(map(Profile, lead.position, rotations.matrix(lead.quaternion)))


def solved(motion: Motion, cable: str) -> CableMotion:
    """Return the shapes of one cable, or raise ProblemError that names the cables there are."""
    if cable not in motion.cables:
        known = ", ".join(map(repr, motion.cables)) or "none: no cable was solved"
        raise ProblemError(f"cable: found {cable!r}, expected one of {known}")
    return motion.cables[cable]


# --- checks -------------------------------------------------------------------------------------------------


def _numbers(name: str, value: object, shape: tuple[int, ...], point: str) -> tuple[Array, str]:
    """Return ``value`` as a new array (M, *shape) of finite numbers, and what is wrong with it or an empty text."""
    wanted = f"expected ({', '.join(['M', *map(str, shape)])}), at least two {point}s"
    try:
        found = np.asarray(value)
    except ValueError:
        return np.zeros(0), f"{name}: found rows of different lengths, {wanted}"
    if found.dtype.kind not in "fiu":
        return np.zeros(0), f"{name}: found an array of {found.dtype.name}, expected real numbers"
    array = np.array(found, dtype=float)
    if array.shape[1:] != shape or len(array) < 2:
        return array, f"{name}: found an array of shape {array.shape}, {wanted}"
    finite = np.isfinite(array).reshape(len(array), -1).all(axis=1)
    k = int(finite.argmin())  # the first that is not
    return array, "" if finite[k] else f"{name}: found {array[k].tolist()} at {point} {k}, expected finite numbers"


def _improper(rotation: Array, point: str) -> str:
    """Return which of the matrices (M, 3, 3) is the first that is no rotation, and why, or an empty text."""
    orthonormal = 1e-9  # most that A^T A may differ from the identity: matrices typed in full, or computed
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.max(np.abs(np.swapaxes(rotation, 1, 2) @ rotation - np.eye(3)), axis=(1, 2))
        bad = np.flatnonzero(~((off <= orthonormal) & (np.linalg.det(rotation) > 0)))
    if not len(bad):
        return ""
    k = int(bad[0])
    if off[k] <= orthonormal:
        return f"rotation: found a matrix of determinant -1 at {point} {k}, expected a rotation, determinant +1"
    return (
        f"rotation: found a matrix A at {point} {k} whose A^T A differs from the identity by {off[k]:.2g}, "
        f"expected a rotation, at most {orthonormal:g}"
    )


# --- files --------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def _told(where: object) -> Iterator[None]:
    """Have mistakes say where they are."""
    try:
        yield
    except ProblemError as error:
        raise ProblemError([f"{where}: {mistake}" for mistake in error.mistakes]) from None


def _save(file: File, arrays: dict[str, Array]) -> None:
    """Write ``arrays`` to ``file``, which is complete or as it was: written beside, then renamed."""
    target = pathlib.Path(file)
    aside = target.parent / f".{target.name}.{os.getpid()}.part"
    try:
        try:
            with aside.open("wb") as handle:  # by handle: given a name, NumPy may add to it
                np.savez(handle, **arrays)  # type: ignore[arg-type]
            os.replace(aside, target)
        finally:
            aside.unlink(missing_ok=True)
    except OSError as error:
        raise ProblemError(f"{file}: found no way to write it ({error.strerror}), expected a file name") from None


def _load(file: File, name: str) -> tuple[Array, Array]:
    """Return the arrays ``name/position`` and ``name/rotation`` of an npz file."""
    wanted = f"expected an npz archive of {name}/position and {name}/rotation"
    try:
        # by handle: NumPy leaves a file open that it has opened and can't read
        with pathlib.Path(file).open("rb") as handle:
            size = unpacked_size(handle) if zipfile.is_zipfile(handle) else 0
            handle.seek(0)
            archive = np.load(handle, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ProblemError(f"{file}: found a single array, {wanted}")
            missing = {f"{name}/position", f"{name}/rotation"} - set(archive.files)
            if missing:
                found = ", ".join(sorted(archive.files)) or "nothing"
                raise ProblemError(f"{file}: found {found}, {wanted}")
            position, rotation = (plain_array(f"{name}/{key}", archive, size) for key in ("position", "rotation"))
            return position, rotation
    except OSError as error:
        raise ProblemError(f"{file}: found no way to read it ({error.strerror or error}), {wanted}") from None
    except UNREADABLE as error:
        raise ProblemError(f"{file}: found a file that is none, or damaged ({error}), {wanted}") from None

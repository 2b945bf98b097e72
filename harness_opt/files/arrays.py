"""``motion.npz``: the shapes of a motion as plain arrays on disk, written whole and read with suspicion."""

from __future__ import annotations

import errno
import math
import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

import numpy as np

from harness_opt.model.courses import FoundPoses
from harness_opt.model.results import CableMotion
from harness_opt.numerics.rotations import Array

MOTION = "motion"
KEPT = {"position": 3, "quaternion": 4, "curvature": 3, "force": 3, "moment": 3}  # numbers a station, in every file
EXTRA = ("stable", "stability_margin", "residual", "estimated_error")  # a number a frame, in those of harness-opt
FOUND = "found"  # what is free: a body, or the cable in a clip
WAY = ("motion", "positions", "quaternions", "jumps", "kinks", "places")  # as of FoundPoses
NOTHING: Mapping[str, FoundPoses] = MappingProxyType({})
ROUNDING, STRETCH = 1e-6, 1.01  # what shapes of any tolerance keep to: a cable does not stretch
MOST_BYTES = 4 * 2**30  # of all arrays together, unpacked


def write_arrays(
    file: Path, motion: Array, cables: Mapping[str, CableMotion], found: Mapping[str, FoundPoses] = NOTHING
) -> None:
    """Write the motion values (P,), the shapes of all cables, and where everything free was found.

    What is told of a frame beside its shape is left out where it is not finite: nothing else says "not known" there.

    Raises:
        ValueError: a shape that is not finite; nothing is written then.
        OSError: the disk refuses.
    """
    arrays = {MOTION: motion}
    for name, cable in cables.items():
        shapes = {field: np.asarray(value) for field, value in vars(cable).items()}
        arrays |= {f"{name}/{field}": value for field, value in shapes.items() if field not in EXTRA or _finite(value)}
    for name, way in found.items():
        kept = {key: getattr(way, key) for key in WAY if getattr(way, key) is not None}
        arrays |= {f"{FOUND}/{name}/{key}": np.asarray(value, dtype=float) for key, value in kept.items()}
    wrong = [key for key, values in arrays.items() if not _finite(values)]
    if wrong:
        raise ValueError(f"numbers that are not finite in {', '.join(wrong)}")
    np.savez(file, allow_pickle=False, **arrays)


def _finite(values: Array) -> bool:
    return bool(np.all(np.isfinite(values)))


def read_arrays(file: Path) -> tuple[Array, dict[str, CableMotion], dict[str, FoundPoses]]:
    """Return the motion values (P,), the shapes by name, what is not kept of them is NaN, and where what is free was.

    Raises:
        ValueError: the file is damaged, would take more than :data:`MOST_BYTES`, or does not hold the shapes of a
            motion.
        OSError: it cannot be read.
    """
    if not file.is_file():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(file))
    try:
        size = unpacked_size(file)
        with np.load(file, allow_pickle=False) as stored:
            arrays = {name: plain_array(name, stored, size) for name in stored.files}
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, KeyError) as error:
        raise ValueError(f"{file.name}: {error}") from error
    motion = arrays.pop(MOTION, np.zeros(0))
    within = motion.ndim == 1 and _finite(motion) and np.all((motion >= 0.0) & (motion <= 1.0))
    if not within or np.any(np.diff(motion) <= 0):
        raise ValueError(f"{file.name}: frames that do not follow each other")
    names = [key.removesuffix("/position") for key in arrays if key.endswith("/position")]
    free = [key.split("/")[1] for key in arrays if key.startswith(f"{FOUND}/") and key.endswith(f"/{WAY[0]}")]
    found = {name: _way(name, arrays) for name in free}
    return motion, {name: _cable(name, arrays, len(motion), found) for name in names}, found


def _way(name: str, arrays: Mapping[str, Array]) -> FoundPoses:
    """Return where what is called ``name`` was found over the motion."""
    at, positions, quaternions, jumps, kinks = (arrays.get(f"{FOUND}/{name}/{key}", np.zeros(0)) for key in WAY[:-1])
    places, count = arrays.get(f"{FOUND}/{name}/{WAY[-1]}"), len(at) if at.ndim == 1 else 0
    along = at if places is None else places
    shapes = [values.shape for values in (at, positions, quaternions, along)]
    known = count > 0 and shapes == [(count,), (count, 3), (count, 4), (count,)]
    known = known and all(map(_finite, (at, positions, quaternions, along))) and not np.any(np.diff(at) <= 0)
    known = known and all(one.ndim == 1 and bool(np.all((one > 0) & (one < count))) for one in (jumps, kinks))
    if not known or not np.all(np.abs(np.linalg.norm(quaternions, axis=1) - 1.0) <= ROUNDING):
        raise ValueError(f"{FOUND}/{name}: no places over the motion")
    jumped, kinked = (tuple(int(number) for number in numbers) for numbers in (jumps, kinks))
    return FoundPoses(at, positions, quaternions, jumped, kinked, places)


def unpacked_size(file: Path | IO[bytes]) -> int:
    """Return how many bytes an npz archive unpacks to.

    Raises:
        ValueError: more than :data:`MOST_BYTES`.
        zipfile.BadZipFile: it is none.
    """
    with zipfile.ZipFile(file) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > MOST_BYTES:
        raise ValueError(f"{size:,} bytes of arrays, of which at most {MOST_BYTES:,} are read")
    return size


def plain_array(name: str, stored: Any, size: int) -> Array:
    """Return one array of an open npz archive that unpacks to ``size`` bytes.

    Raises:
        ValueError: it holds no numbers, or its own header promises more of them than the archive has.
    """
    with stored.zip.open(f"{name}.npy") as member:
        version = np.lib.format.read_magic(member)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(member)
    if dtype.hasobject:
        raise ValueError(f"{name}: pickled objects, which are not opened")
    if dtype.kind not in "fiub" or math.prod(shape) * dtype.itemsize > size or min(shape, default=1) < 0:
        raise ValueError(f"{name}: {shape} of {dtype}")
    return np.asarray(stored[name])


@np.errstate(all="ignore")  # whatever overflows is refused in words
def _cable(name: str, arrays: Mapping[str, Array], frames: int, free: Mapping[str, FoundPoses]) -> CableMotion:
    """Return the shapes of cable ``name``, all of them of the sizes that fit each other."""
    s = arrays.get(f"{name}/s", np.zeros(0))
    if s.ndim != 1 or len(s) < 2 or not _finite(s) or s[0] != 0.0 or not s[-1] > 0.0 or np.any(np.diff(s) < 0.0):
        raise ValueError(f"{name}/s: no arc lengths")
    found: dict[str, Array] = {}
    for field, numbers in KEPT.items():
        values = arrays.get(f"{name}/{field}", np.zeros(0))
        if values.shape != (frames, len(s), numbers) or not _finite(values):
            raise ValueError(f"{name}/{field}: {values.shape}, or not finite")
        found[field] = values
    if not np.all(np.abs(np.linalg.norm(found["quaternion"], axis=2) - 1.0) <= ROUNDING):
        raise ValueError(f"{name}/quaternion: not of unit length")
    chords = np.linalg.norm(np.diff(found["position"], axis=1), axis=2)
    clips = [way.places for key, way in free.items() if key.startswith(f"{name}, ") and way.places is not None]
    if not np.all(chords <= STRETCH * _slid(s, clips) * np.diff(s) + ROUNDING * s[-1]):
        raise ValueError(f"{name}/position: stations further apart than their arc lengths")
    for field in EXTRA:
        values = arrays.get(f"{name}/{field}", np.full(frames, np.nan))
        if values.shape != (frames,):
            raise ValueError(f"{name}/{field}: {values.shape}")
        found[field] = values
    mesh = arrays.get(f"{name}/mesh", s / s[-1])
    if mesh.ndim != 1 or len(mesh) < 2 or not _finite(mesh) or np.any(np.diff(mesh) < 0.0):
        raise ValueError(f"{name}/mesh: no nodes of elements")
    return CableMotion(s, **found, mesh=mesh)


def _slid(s: Array, clips: Sequence[Array]) -> Array:
    """Return how many times as long as along ``s`` (N,) the cable gets between two stations (N - 1,), where it slides.

    Args:
        s: arc lengths of the first frame, two alike at each clip.
        clips: the arc lengths (n,) at each clip that it slides through.
    """
    edges = [s[0], *s[1:][np.diff(s) == 0.0], s[-1]]
    moved = [next((at for at in clips if math.isclose(at[0], edge, rel_tol=ROUNDING)), edge) for edge in edges]
    most = [
        float(np.max(np.subtract(b, a))) / max(q - p, 1e-300)
        for a, b, p, q in zip(moved[:-1], moved[1:], edges[:-1], edges[1:], strict=True)
    ]
    span = np.searchsorted(edges[1:-1], s[:-1], side="right")
    times: Array = np.maximum(np.array(most)[span], 1.0)
    return times

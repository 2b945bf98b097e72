"""Where the files may lie that a problem file names, and how large they may be.

A problem file may come from anybody, so it reads what lies in its own folder, or in folders that the user gives, and
nothing else: links are followed first, and where they lead counts. One thing is let out: a file whose SHA-256 stands
beside its name, as in problem files that harness-opt writes. Whoever wrote that knew what is in it.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from harness_opt.model.checks import one_of, shown

REMOTE = re.compile(r"[\\/]{2}")  # begins the name of a file on another computer, which merely asking for it contacts
MEGABYTE = 10**6
MOST_MESH_BYTES = 600 * MEGABYTE  # of a mesh and what it needs beside it: ten million triangles of binary STL


@dataclass(frozen=True)
class Places:
    """The folders that a problem file may read from.

    Args:
        folder: that of the problem file, absolute, links followed; relative names start there.
        others: given by the user.
    """

    folder: Path
    others: tuple[Path, ...] = ()

    @staticmethod
    def around(folder: Path, others: Iterable[str | os.PathLike[str]] = ()) -> Places:
        """Return ``folder`` and ``others`` with all links followed."""
        return Places(folder.resolve(), tuple(Path(other).resolve() for other in others))

    def located(self, name: str) -> Path:
        """Return the absolute path of the file called ``name``.

        Links of folders are followed, as opening the file would; that of the file is not: its suffix counts.
        """
        file = self.folder / name
        return file if _unspeakable(name) else file.parent.resolve() / file.name

    def fault(self, name: str, what: str, sha256: str | None, most_bytes: int) -> str:
        """Return why the file called ``name`` is not read, and what was expected; nothing where it is.

        Args:
            name: as the problem file has it.
            what: it should be.
            sha256: of its content, where the problem file says so.
            most_bytes: that it may have.
        """
        file = self.located(name)
        outside = _unspeakable(name)
        if not outside and not self._holds(file):
            # before anything is said about a file that is none of the problem's business
            if sha256 is None:
                outside = "a file outside the problem's folder"
            elif not _has(file, sha256, most_bytes):
                outside = "a file outside the problem's folder, and not what it was when this problem was written"
        if outside:
            words = f"expected {what} in {self.folder} or below, or in a folder given by --files"
            return f"found {shown(name)}, {outside}, {words}"
        why = unreadable(file, most_bytes)
        if not why and not file.is_file():
            why = "a device or a pipe"
        return f"found {shown(name)}, {why}, expected {what} (paths start at {self.folder})" if why else ""

    def _holds(self, file: Path) -> bool:
        """Return whether ``file``, links followed, lies in one of the folders."""
        try:
            real = file.resolve()
        except (OSError, RuntimeError):  # links that lead in a circle
            return False
        return any(real.is_relative_to(folder) for folder in (self.folder, *self.others))

    def sha256_of(self, file: Path) -> str | None:
        """Return the SHA-256 with which a problem file may name ``file``; None where it needs none or has no content.

        Raises:
            OSError: the file cannot be read.
        """
        return None if self._holds(file) or not file.is_file() else digest(file)


def _has(file: Path, sha256: str, most_bytes: int) -> bool:
    """Return whether ``file`` is there, may be read, and has the content of that SHA-256: one answer for all else."""
    try:
        return file.is_file() and digest(file, most_bytes) == sha256.lower()
    except (OSError, ValueError):  # a ValueError: a name that the system cannot have
        return False


def digest(file: Path, most_bytes: float = math.inf) -> str:
    """Return the SHA-256 of the content of ``file``, in hexadecimal digits; nothing where that is too large to read.

    Raises:
        OSError: it cannot be read.
    """
    if file.stat().st_size > most_bytes:
        return ""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _unspeakable(name: str) -> str:
    """Return why a file of this name is not even looked for, or an empty text."""
    if "\0" in name:
        return "a name with a null character"
    return "the name of a file on another computer" if REMOTE.match(name) else ""


def unreadable(file: Path, most_bytes: int) -> str:
    """Return what stands in the place of a readable ``file``, or an empty text where there is one."""
    try:
        if file.is_dir():
            return "a folder"
        if not file.exists():
            return _missing(file)
        size = file.stat().st_size
        if size > most_bytes:
            return f"a file of {size / MEGABYTE:,.0f} MB, of which at most {most_bytes / MEGABYTE:,.0f} are read"
        # pipes have no size
        if file.is_file() and size == 0:
            return "an empty file"
        return "" if os.access(file, os.R_OK) else "a file that may not be read"
    except (OSError, ValueError) as error:  # a ValueError: a name that the system cannot have
        return f"a file that can't be opened ({getattr(error, 'strerror', None) or error})"


def _missing(file: Path) -> str:
    """Return the words for a file that is not there, with the one whose name is nearest."""
    near = [other.name for other in file.parent.iterdir()] if file.parent.is_dir() else []
    nearest = one_of(near, file.name).partition("; ")[2]
    return "no such file" + (f" ({nearest})" if nearest else "")

"""Putting a finished folder in the place of another in one step, and clearing away what killed runs left."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import secrets
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

if os.name != "nt":
    import fcntl

PART, BEFORE = ".part", ".before"  # ends of hidden names: what is being written | what gives way
RENAME_EXCHANGE, RENAME_SWAP = 2, 2  # of renameat2 (Linux, since 2014) and renamex_np (macOS, since 2016)
AT_FDCWD = -100  # names are taken as they stand, not from an open folder (Linux)


def beside(target: Path, end: str = PART) -> Path:
    """Return a hidden name beside ``target`` that nobody else uses: of this process, and of this once."""
    return target.with_name(f".{target.name}.{os.getpid()}{secrets.randbelow(10**9):09}{end}")


@contextlib.contextmanager
def locked(entry: Path) -> Iterator[None]:
    """Hold a lock on a file or folder, which ends with this process at the latest."""
    if os.name == "nt":  # Windows opens no folders
        yield
        return
    handle = os.open(entry, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks: leftovers stay there
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


def _abandoned(entry: Path) -> bool:
    """Return whether nobody holds a file or folder any more."""
    if os.name == "nt":
        return False
    try:
        handle = os.open(entry, os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    except OSError:
        return False
    finally:
        os.close(handle)


def left_over(entry: Path, of: str = ".+") -> bool:
    """Return whether a killed run left ``entry`` while it wrote a file or folder whose name the pattern ``of`` fits."""
    hidden = re.fullmatch(rf"\.(?:{of})\.\d+(?:{re.escape(PART)}|{re.escape(BEFORE)})", entry.name, re.DOTALL)
    return hidden is not None and not entry.is_symlink() and _abandoned(entry)


def clear_away(target: Path) -> None:
    """Remove what killed runs left beside ``target``; a result that had given way comes back if none took its place."""
    try:
        entries = sorted(target.parent.iterdir())
    except PermissionError:  # a folder to write in, and not to look into
        return
    for entry in entries:
        if not left_over(entry, re.escape(target.name)):
            continue
        if entry.name.endswith(BEFORE) and not target.exists():
            os.rename(entry, target)
        elif entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            entry.unlink(missing_ok=True)


def put(aside: Path, target: Path) -> None:
    """Rename ``aside`` to ``target``; what stood there gives way in the same step, and is then removed.

    Where the system cannot exchange two folders, it is hidden for the moment between two renames, and comes back where
    the second one fails.

    Raises:
        OSError: the disk refuses.
    """
    if not target.exists():
        os.rename(aside, target)
    elif exchanged(aside, target):
        shutil.rmtree(aside, ignore_errors=True)
    else:
        before = beside(target, BEFORE)
        os.rename(target, before)
        try:
            os.rename(aside, target)
        finally:
            if not target.exists():
                os.rename(before, target)
        shutil.rmtree(before, ignore_errors=True)
    flush_entry(target.parent)


def exchanged(one: Path, other: Path) -> bool:
    """Exchange the names of two folders in one step; return False where the system cannot."""
    try:
        names = os.fsencode(one), os.fsencode(other)
        if sys.platform.startswith("linux"):
            call = ctypes.CDLL(None, use_errno=True).renameat2
            return bool(call(AT_FDCWD, names[0], AT_FDCWD, names[1], RENAME_EXCHANGE) == 0)
        if sys.platform == "darwin":
            return bool(ctypes.CDLL(None, use_errno=True).renamex_np(*names, RENAME_SWAP) == 0)
    except AttributeError:  # an older system library
        return False
    return False


@contextlib.contextmanager
def filling(folder: Path) -> Iterator[Path]:
    """Give an empty folder beside ``folder`` to write in; what is in it moves to ``folder`` if all goes well.

    Files and folders of the same names give way, one by one; others stay.

    Raises:
        OSError: the disk refuses.
    """
    target = folder.resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    # nothing can be renamed from one file system to another, as out of the folder above into a container's volume
    written = target / target.name if target.is_mount() else target
    clear_away(written)
    aside = beside(written)
    aside.mkdir()
    try:
        with locked(aside):
            yield aside
            flush(aside)
            target.mkdir(exist_ok=True)
            for entry in aside.iterdir():
                if entry.is_dir():
                    put(entry, target / entry.name)
                else:
                    os.replace(entry, target / entry.name)
            flush_entry(target)
    except OSError as error:
        error.filename = error.filename or str(folder)  # a full disk names no file
        raise
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def write_whole(file: Path, content: bytes) -> None:
    """Put ``content`` in the place of ``file`` in one step; what killed runs left of it goes.

    Raises:
        OSError: the disk refuses; ``file`` is as it was.
    """
    clear_away(file)
    aside = beside(file)
    try:
        with aside.open("xb") as stream, locked(aside):
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
            if os.name != "nt":  # Windows renames nothing that is open
                os.replace(aside, file)
        if os.name == "nt":
            os.replace(aside, file)
    finally:
        aside.unlink(missing_ok=True)


def flush(folder: Path) -> None:
    """Have the disk hold all that is in ``folder`` before its name does."""
    for place, _, files in os.walk(folder, topdown=False):
        for name in files:
            flush_entry(Path(place, name))
        flush_entry(Path(place))


def flush_entry(path: Path) -> None:
    """Have the disk hold one file or the names in one folder."""
    if path.is_symlink() or (os.name == "nt" and path.is_dir()):  # Windows opens no folders
        return
    handle = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)

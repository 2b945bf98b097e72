"""A folder of results that is complete or absent: written beside, flushed to the disk, then renamed.

What stands in the place already gives way only where a run of harness-opt wrote it; files that somebody else
put into it are carried over.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from harness_opt.errors import ProblemError
from harness_opt.files.whole_folder import beside, clear_away, flush, left_over, locked, put, write_whole

SUMMARY = "summary.json"
ASIDE = "-interrupted"  # added to the name of a folder that holds a whole result, for a part of another
COMMANDS = ("simulate", "redesign")  # that write a result folder
MOST_BYTES = 50_000_000  # of a summary; those of a hundred cables among a thousand parts are smaller
NAMES_SHOWN = 3  # of the files that stand in the way


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Return the summary that ``folder`` holds, or None where it is no result folder of harness-opt.

    Raises:
        OSError: the file is there and cannot be read.
    """
    file = folder / SUMMARY
    if not file.is_file() or file.stat().st_size > MOST_BYTES:
        return None
    try:
        summary = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):  # neither JSON nor UTF-8: another program's file of that name
        return None
    ours = isinstance(summary, dict) and summary.get("command") in COMMANDS
    ours = ours and isinstance(summary.get("versions"), dict) and "harness-opt" in summary["versions"]
    files = summary.get("files", []) if ours else []
    ours = ours and isinstance(files, list) and all(isinstance(name, str) for name in files)
    return summary if ours else None


def check_target(folder: Path, inputs: Iterable[Path] = ()) -> Path:
    """Return the absolute path of ``folder``, where results may be written.

    Args:
        folder: where the results are to stand; it need not exist.
        inputs: files of the problem, which must outlive the results.

    Raises:
        ProblemError: it is a file, holds another's files, holds an input, is the working folder, or lies
            where nothing may be written.
    """
    target = folder.resolve()
    try:
        why = _in_the_way(target, inputs)
    except OSError as error:
        why = f"a place that can't be looked at ({error.strerror})"
    if why:
        raise ProblemError(f"{folder}: found {why}, expected a folder to write the results in")
    return target


def _in_the_way(target: Path, inputs: Iterable[Path]) -> str:
    """Return what keeps results from being written to ``target``, or nothing."""
    held = [file.name for file in inputs if file.resolve().is_relative_to(target)]
    parent = next((p for p in target.parents if p.exists()), target)
    if Path.cwd().is_relative_to(target):
        why = "the folder you work in, which the results would replace"
    elif held:
        why = f"{held[0]} in it, which this problem needs"
    elif not parent.is_dir():
        why = f"{parent}, which is no folder"
    elif not os.access(parent, os.W_OK | os.X_OK):
        why = f"no right to write in {parent}"
    elif target.exists() and not target.is_dir():
        why = "a file"
    elif target.is_mount():  # such as a volume of a container: told before the work, and not after it
        why = "a mount point, in whose place no folder can be put: a folder in it can"
    elif target.exists() and any(target.iterdir()) and read_summary(target) is None:
        names = sorted(entry.name for entry in target.iterdir())
        listed = ", ".join(names[:NAMES_SHOWN]) + (", ..." if len(names) > NAMES_SHOWN else "")
        why = f"files that are no result of harness-opt ({listed})"
    else:
        why = ""
    return why


@contextlib.contextmanager
def replacing(folder: Path, inputs: Iterable[Path] = ()) -> Iterator[Path]:
    """Give an empty folder beside ``folder`` to write in, and put it in its place if all goes well.

    Killed at any moment, the results that were there are whole, and in their place wherever the system can exchange two
    folders in one step (Linux, macOS). What an exception interrupts leaves nothing; what a kill leaves is hidden, and
    goes when the next result is written there.

    Args:
        folder, inputs: as in :func:`check_target`.

    Raises:
        ProblemError: as :func:`check_target`, or the disk refuses.
    """
    target = check_target(folder, inputs)
    aside = beside(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        clear_away(target)
        aside.mkdir()
        with locked(aside):
            yield aside
            keep_foreign(target, aside)
            flush(aside)
            put(aside, target)
    except OSError as error:
        where = error.filename or folder
        raise ProblemError(
            f"{folder}: found no way to write {where} ({error.strerror or error}), expected one"
        ) from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def keep_foreign(earlier: Path, aside: Path) -> None:
    """Have ``aside`` hold, too, what somebody else put into an ``earlier`` result: linked, nothing moves yet."""
    if not earlier.is_dir():
        return
    written = (read_summary(earlier) or {}).get("files", ())
    for entry in earlier.iterdir():
        new = aside / entry.name
        if entry.name in written or os.path.lexists(new) or left_over(entry):
            continue
        if entry.is_dir() and not entry.is_symlink():
            shutil.copytree(entry, new, symlinks=True, copy_function=_linked)
        else:
            _linked(entry, new)


def _linked(source: str | Path, target: str | Path) -> None:
    """Give a file a second name, or copy it where the disk knows no such thing."""
    try:
        os.link(source, target, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(source, target, follow_symlinks=False)


def add_file(folder: Path, name: str) -> None:
    """Name a file that was added to a result folder among its own, so that it goes when the result is replaced."""
    content = read_summary(folder)
    if content is None or name in content.get("files", ()):
        return
    content["files"] = sorted([*content.get("files", ()), name])
    write_whole(folder / SUMMARY, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())


def check_own(folder: Path, mark: str) -> None:
    """Raise ProblemError where ``folder`` holds something else than what the same command wrote before.

    Args:
        folder: to write into; it need not exist.
        mark: name of a file that the command always writes.

    Raises:
        ProblemError: it is in use, no folder, or may not be written.
    """
    if (folder / mark).is_file():
        return
    check_target(folder)
    if folder.exists() and any(folder.iterdir()):
        raise ProblemError(f"{folder}: found the results of another command, expected a folder of this one, or none")

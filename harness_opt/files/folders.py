"""Folders that a command writes into file by file, and that are its own: those of studies and sensitivities."""

from __future__ import annotations

from pathlib import Path

from harness_opt.errors import ProblemError
from harness_opt.files.result_folder import check_target


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

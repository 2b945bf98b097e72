"""Rows of numbers in a file that has no name: nobody else sees it, and it goes with the process, however that ends."""

from __future__ import annotations

import os
import tempfile
import weakref
from typing import IO

import numpy as np

from harness_opt.numerics.rotations import Array


class RowsOnDisk:
    """Rows of equal width by number, from 0 on; what the disk does not take stays in memory.

    Args:
        width: numbers a row.
    """

    def __init__(self, width: int):
        self._width = width
        self._file = _nameless()
        if self._file is not None:
            weakref.finalize(self, self._file.close)
        self._refused: dict[int, Array] = {}

    def __setitem__(self, number: int, row: Array) -> None:
        """Set a row (width,)."""
        self._refused.pop(number, None)
        if not self._written(number, row):
            self._refused[number] = row

    def __getitem__(self, number: int) -> Array:
        """Return a row (width,) that was set."""
        if self._file is None or number in self._refused:
            return self._refused[number]
        self._file.seek(8 * self._width * number)  # 8 bytes a number
        return np.fromfile(self._file, float, self._width)

    def _written(self, number: int, row: Array) -> bool:
        """Write a row; return whether the disk took it."""
        if self._file is None:
            return False
        data = np.ascontiguousarray(row, dtype=float).tobytes()
        try:
            self._file.seek(len(data) * number)
            return self._file.write(data) == len(data)
        except OSError:  # full, over a quota, or gone
            return False


def _nameless() -> IO[bytes] | None:
    """Return an empty file without a name, in $TMPDIR or else where large ones belong; None where there is no room."""
    large_files = "/var/tmp"  # where systems keep large temporary files: /tmp may be memory itself (file-hierarchy(7))
    folder = None if "TMPDIR" in os.environ or not os.access(large_files, os.W_OK | os.X_OK) else large_files
    try:
        return tempfile.TemporaryFile(dir=folder, buffering=0)
    except OSError:
        return None

"""Commands, options, exit codes: the only room that prints or exits."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; Ctrl-C counts from here on, while the commands are being read, too.

    Args:
        argv: the arguments, without the program's name; None takes those of the process.
    """
    begin = time.perf_counter()
    try:
        from . import commands
    except KeyboardInterrupt:
        os.write(2, b"Interrupted.\n")
        return 130
    return commands.main(argv, begin)

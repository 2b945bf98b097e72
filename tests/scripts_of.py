"""The scripts beside the package, as modules."""

from __future__ import annotations

import importlib
import sys
import types
from pathlib import Path

SCRIPTS = str(Path(__file__).resolve().parent.parent / "scripts")


def script(name: str) -> types.ModuleType:
    """Return ``scripts/NAME.py``; scripts import each other by name."""
    if SCRIPTS not in sys.path:
        sys.path.append(SCRIPTS)
    return importlib.import_module(name)

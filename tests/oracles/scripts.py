"""The scripts beside the package, as modules."""

from __future__ import annotations

import importlib
import sys
import types

from oracles.problems import ROOT


def script(name: str) -> types.ModuleType:
    """Return the script ``NAME.py``, in whatever folder it lies; those of one folder import each other by name."""
    (file,) = (ROOT / "scripts").glob(f"*/{name}.py")
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))
    return importlib.import_module(name)

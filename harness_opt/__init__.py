"""Motional cable harness design: shapes, clearances and redesign of cables between moving clamps.

Names are imported when first used, so that ``import harness_opt`` and the commands that solve nothing start at once.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .equilibrium import Shape, equilibrium
    from .errors import HarnessError, ProblemError, SolveError, Status
    from .motion import simulate
    from .problem import (
        Body,
        Box,
        Cable,
        CableRun,
        Capsule,
        Cylinder,
        Design,
        End,
        Hinge,
        Limits,
        MeshFile,
        Part,
        Poses,
        Problem,
        Slide,
        Sphere,
        Variable,
    )
    from .problem_file import read_problem, write_problem
    from .redesign import Redesign, redesign
    from .report import clearances, write_results
    from .results import Motion

_ROOMS = {
    "equilibrium": ("Shape", "equilibrium"),
    "errors": ("HarnessError", "ProblemError", "SolveError", "Status"),
    "motion": ("simulate",),
    "problem": (
        "Body",
        "Box",
        "Cable",
        "CableRun",
        "Capsule",
        "Cylinder",
        "Design",
        "End",
        "Hinge",
        "Limits",
        "MeshFile",
        "Part",
        "Poses",
        "Problem",
        "Slide",
        "Sphere",
        "Variable",
    ),
    "problem_file": ("read_problem", "write_problem"),
    "redesign": ("Redesign", "redesign"),
    "report": ("clearances", "write_results"),
    "results": ("Motion",),
}
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [  # noqa: PLE0604
    *sorted(_ROOM_OF)
]


def __getattr__(name: str) -> Any:
    """Import a public name from its room (PEP 562)."""
    if name not in _ROOM_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_ROOM_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_ROOM_OF})

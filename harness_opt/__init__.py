"""Motional cable harness design: shapes, clearances and redesign of cables between moving clamps.

Names are imported when first used, so that ``import harness_opt`` and the commands that solve nothing start at once.
No room is called like a public function: importing a room binds its name here.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .body_motion import Hinge, Poses, Slide
    from .errors import CompilerError, HarnessError, ProblemError, SolveError, Status
    from .html_report import write_report
    from .machine_code import compiled
    from .motion import simulate
    from .multistart import equilibria
    from .outer_loop import Redesign
    from .plausibility import doubts
    from .playback import display
    from .playback_error import DisplayError, display_error
    from .pose import Shape, equilibrium
    from .problem import (
        Body,
        Box,
        Cable,
        CableRun,
        Capsule,
        Coupling,
        Cylinder,
        Design,
        End,
        Limits,
        MeshFile,
        Part,
        Problem,
        Sphere,
        Variable,
    )
    from .problem_file import read_problem, write_problem
    from .profile import Path, Profile, disperse, load_profiles, profiles, save_profiles
    from .report import clearances, write_results
    from .results import Motion
    from .robust_loop import redesign
    from .studies import study
    from .study_file import read_study
    from .tolerances import Tolerance
    from .variant_run import VariantResult
    from .variations import Variations

_ROOMS = {
    "body_motion": ("Hinge", "Poses", "Slide"),
    "errors": ("CompilerError", "HarnessError", "ProblemError", "SolveError", "Status"),
    "html_report": ("write_report",),
    "machine_code": ("compiled",),
    "motion": ("simulate",),
    "multistart": ("equilibria",),
    "problem": (
        "Body",
        "Box",
        "Cable",
        "CableRun",
        "Capsule",
        "Coupling",
        "Cylinder",
        "Design",
        "End",
        "Limits",
        "MeshFile",
        "Part",
        "Problem",
        "Sphere",
        "Variable",
    ),
    "problem_file": ("read_problem", "write_problem"),
    "outer_loop": ("Redesign",),
    "robust_loop": ("redesign",),
    "playback": ("display",),
    "playback_error": ("DisplayError", "display_error"),
    "plausibility": ("doubts",),
    "pose": ("Shape", "equilibrium"),
    "profile": ("Path", "Profile", "disperse", "load_profiles", "profiles", "save_profiles"),
    "report": ("clearances", "write_results"),
    "results": ("Motion",),
    "studies": ("study",),
    "study_file": ("read_study",),
    "tolerances": ("Tolerance",),
    "variant_run": ("VariantResult",),
    "variations": ("Variations",),
}
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}

__version__ = "0.1.0"
__all__ = sorted(_ROOM_OF)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    """Import a public name from its room (PEP 562)."""
    if name not in _ROOM_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_ROOM_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_ROOM_OF})

"""Motional cable harness design: shapes, clearances and redesign of cables between moving clamps.

Names are imported when first used, so that ``import harness_opt`` and the commands that solve nothing start at once.
No room is called like a public function: importing a room binds its name here.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .clearance.measure import clearances
    from .design.redesign import redesign
    from .design.result import Redesign
    from .errors import CompilerError, HarnessError, ProblemError, SolveError, Status
    from .files.read import read_problem, write_problem
    from .model.bodies import Body, Hinge, Poses, Slide
    from .model.cable import Cable, CableRun, End
    from .model.design import Coupling, Design, Limits, Variable
    from .model.parts import Box, Capsule, Cylinder, MeshFile, Part, Sphere
    from .model.plausibility import doubts
    from .model.problem import Problem
    from .model.results import Motion
    from .model.tolerances import Tolerance
    from .motion.paper_data import Path, Profile, disperse, load_profiles, profiles, save_profiles
    from .motion.playback import display
    from .motion.playback_error import DisplayError, display_error
    from .motion.simulate import simulate
    from .numerics.machine_code import compiled
    from .report.html_page import write_report
    from .report.result_files import write_results
    from .statics.equilibria import equilibria
    from .statics.equilibrium import Shape, equilibrium
    from .studies.study import study
    from .studies.study_file import read_study
    from .studies.variant import VariantResult
    from .studies.variations import Variations

_ROOMS = {
    "clearance.measure": ("clearances",),
    "design.redesign": ("redesign",),
    "design.result": ("Redesign",),
    "errors": (
        "CompilerError",
        "HarnessError",
        "ProblemError",
        "SolveError",
        "Status",
    ),
    "files.read": (
        "read_problem",
        "write_problem",
    ),
    "model.bodies": (
        "Body",
        "Hinge",
        "Poses",
        "Slide",
    ),
    "model.cable": (
        "Cable",
        "CableRun",
        "End",
    ),
    "model.design": (
        "Coupling",
        "Design",
        "Limits",
        "Variable",
    ),
    "model.parts": (
        "Box",
        "Capsule",
        "Cylinder",
        "MeshFile",
        "Part",
        "Sphere",
    ),
    "model.plausibility": ("doubts",),
    "model.problem": ("Problem",),
    "model.results": ("Motion",),
    "model.tolerances": ("Tolerance",),
    "motion.paper_data": (
        "Path",
        "Profile",
        "disperse",
        "load_profiles",
        "profiles",
        "save_profiles",
    ),
    "motion.playback": ("display",),
    "motion.playback_error": (
        "DisplayError",
        "display_error",
    ),
    "motion.simulate": ("simulate",),
    "numerics.machine_code": ("compiled",),
    "report.html_page": ("write_report",),
    "report.result_files": ("write_results",),
    "statics.equilibria": ("equilibria",),
    "statics.equilibrium": (
        "Shape",
        "equilibrium",
    ),
    "studies.study": ("study",),
    "studies.study_file": ("read_study",),
    "studies.variant": ("VariantResult",),
    "studies.variations": ("Variations",),
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

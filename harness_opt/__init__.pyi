"""The public names of harness-opt, and the rooms that they come from: the one list of them."""

from .clearance.measure import clearances as clearances
from .design.redesign import redesign as redesign
from .design.result import Redesign as Redesign
from .errors import (
    CompilerError as CompilerError,
)
from .errors import (
    HarnessError as HarnessError,
)
from .errors import (
    ProblemError as ProblemError,
)
from .errors import (
    SolveError as SolveError,
)
from .errors import (
    Status as Status,
)
from .files.read import read_problem as read_problem
from .files.read import write_problem as write_problem
from .measured.fit import Identification as Identification
from .measured.fit import identify as identify
from .measured.measurements_file import read_measurements as read_measurements
from .model.bodies import Body as Body
from .model.bodies import Hinge as Hinge
from .model.bodies import Poses as Poses
from .model.bodies import Slide as Slide
from .model.cable import Cable as Cable
from .model.cable import CableRun as CableRun
from .model.courses import Move as Move
from .model.courses import Moves as Moves
from .model.courses import ValueTable as ValueTable
from .model.design import Coupling as Coupling
from .model.design import Design as Design
from .model.design import Limits as Limits
from .model.design import Tolerance as Tolerance
from .model.design import Variable as Variable
from .model.ends import Clip as Clip
from .model.ends import End as End
from .model.parts import (
    Box as Box,
)
from .model.parts import (
    Capsule as Capsule,
)
from .model.parts import (
    Cylinder as Cylinder,
)
from .model.parts import (
    MeshFile as MeshFile,
)
from .model.parts import (
    Part as Part,
)
from .model.parts import (
    Sphere as Sphere,
)
from .model.plausibility import doubts as doubts
from .model.problem import Problem as Problem
from .model.results import Motion as Motion
from .motion.paper_data import (
    Path as Path,
)
from .motion.paper_data import (
    Profile as Profile,
)
from .motion.paper_data import (
    disperse as disperse,
)
from .motion.paper_data import (
    load_profiles as load_profiles,
)
from .motion.paper_data import (
    profiles as profiles,
)
from .motion.paper_data import (
    save_profiles as save_profiles,
)
from .motion.playback import display as display
from .motion.playback_error import DisplayError as DisplayError
from .motion.playback_error import display_error as display_error
from .motion.simulate import simulate as simulate
from .numerics.machine_code import compiled as compiled
from .report.html_page import write_report as write_report
from .report.result_files import write_results as write_results
from .statics.equilibria import equilibria as equilibria
from .statics.equilibrium import Shape as Shape
from .statics.equilibrium import equilibrium as equilibrium
from .studies.study import study as study
from .studies.study_file import read_study as read_study
from .studies.variant import VariantResult as VariantResult
from .studies.variations import Variations as Variations

__version__: str

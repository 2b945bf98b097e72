"""The command line: the only room that prints or exits.

The rooms that solve are imported inside the commands, so that help, ``schema`` and ``check`` start at once.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from harness_opt.cli.ending import BAD_INPUT, DEBUG, code_of
from harness_opt.cli.info import COMMANDS
from harness_opt.cli.options import (
    Positive,
    compiling,
    debugging,
    file_argument,
    folders_option,
    json_option,
    output_option,
    running,
    seconds_option,
)
from harness_opt.cli.run import BEGIN, Voice, Wanted, naming, remedied, run
from harness_opt.cli.streams import lasting, say, tell, warn
from harness_opt.errors import HarnessError, ProblemError
from harness_opt.rod.methods import SOLVERS, TRANSCRIPTIONS

if TYPE_CHECKING:
    from harness_opt.cli.progress import Shown
    from harness_opt.design.result import Redesign
    from harness_opt.model.problem import Problem
    from harness_opt.model.results import Motion

EXPORTS = ("paraview", "csv", "gltf", "stl", "dxf", "step")
MOST_ELEMENTS = 1000  # of a cable: more than any mesh has here, and all that memory is sure to hold
EXPORT_FOLDER = "export"  # in a result folder


def main(argv: Sequence[str] | None = None, begin: float | None = None) -> int:
    """Run one command and return its exit code.

    Args:
        argv: the arguments, without the program's name; None takes those of the process.
        begin: when it began, s of ``time.perf_counter``; None is now.
    """
    begin = time.perf_counter() if begin is None else begin
    state: dict[str, Any] = {BEGIN: begin}  # --debug is added, wherever it stands

    def command() -> int | None:
        code: int | None = commands.main(args=argv, prog_name="harness-opt", standalone_mode=False, obj=state)
        return code

    with lasting():
        return code_of(command, lambda: DEBUG in state)


VOICE = Voice(say, tell, warn)


def _version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """Print the version, if ``wanted``, and end."""
    if wanted:
        from harness_opt.report.summary import versions

        say(f"harness-opt {versions()['harness-opt']}")
        context.exit()


_CODES = (
    "Exit codes: 0 all limits hold, 1 a limit is violated or no design holds them, 2 bad input, "
    "3 a shape could not be found, 70 a fault of the program, 130 interrupted."
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, epilog=_CODES)
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show it.")
def commands() -> None:
    """Shapes, clearances and redesign of cables between moving clamps.

    \b
    harness-opt check problems/lift_arm/lift_arm.toml
    harness-opt preview problems/lift_arm/lift_arm.toml
    harness-opt simulate problems/lift_arm/lift_arm.toml
    harness-opt redesign problems/lift_arm/lift_arm.toml -o results/better
    harness-opt show results/better
    harness-opt new my_cable
    """


# --- commands ------------------------------------------------------------------------------------------


@commands.command()
@file_argument
@json_option
@folders_option
def check(file: Path, as_json: bool, folders: tuple[Path, ...]) -> int:
    """Validate FILE and say what would be solved; nothing is written.

    \b
    harness-opt check problems/lift_arm/lift_arm.toml
    """
    from harness_opt.files.read import read_problem
    from harness_opt.model.spans import too_short
    from harness_opt.parts.scene import load_scene
    from harness_opt.report.description import description, facts

    problem = read_problem(file, folders)
    with naming(file):
        if short := too_short(problem, problem.cables):
            raise ProblemError([one.message for one in short])
        content = facts(problem, load_scene(problem))
    if not as_json:
        say(description(problem, content))
        return 0
    from harness_opt.report import summary as report

    head = {"schema": report.SCHEMA, "command": "check", "problem": report.problem_words(problem)}
    say(report.as_json(head | {"versions": report.versions(), "status": "ok"} | content))
    return 0


@commands.command()
@running
@folders_option
@seconds_option
@compiling
@click.option("--spatial-step", type=Positive(), metavar="M", help="Most that a clamp moves between frames, m.")
@click.option("--out-and-back", is_flag=True, help="Go through the motion and back: shows which snaps stay.")
@click.option("--elements", type=click.IntRange(1, MOST_ELEMENTS), help="Least number of elements of a cable.")
@click.option("--solver", type=click.Choice(SOLVERS), help="Way to solve; gauss-newton where left out.")
@click.option("--transcription", type=click.Choice(TRANSCRIPTIONS), help="collocation, or dqm: the paper's.")
@click.option("--points", type=int, metavar="N", help="Of dqm, 5 to 200; as many as it takes where left out.")
@click.option("--closure", is_flag=True, default=None, help="Of dqm: with the length closure (25).")
@click.option("--tolerance", type=Positive(), help="Error allowed in a shape, in lengths of the cable.")
@click.option(
    "--clearance-tolerance", type=Positive(), metavar="M",
    help="How certain the smallest clearances are wanted, m; 1 % of the cable's diameter where left out.",
)  # fmt: skip
def simulate(
    file: Path,
    folder: Path | None,
    as_json: bool,
    quiet: bool,
    pictures: bool,
    film: bool,
    *,
    folders: tuple[Path, ...],
    seconds: float | None,
    out_and_back: bool,
    clearance_tolerance: float | None,
    **numerics: Any,
) -> int:
    """Simulate the whole motion of FILE: shapes, clearances, limits, verdict.

    \b
    harness-opt simulate problems/lift_arm/lift_arm.toml
    harness-opt simulate lift_arm.toml -o results/fine --spatial-step 0.002 --json
    """
    chosen = {name: value for name, value in numerics.items() if value is not None}

    def solve(problem: Problem, progress: Shown) -> Motion:
        from harness_opt.model.spans import spans_of
        from harness_opt.motion.simulate import simulate

        if out_and_back:
            problem = dataclasses.replace(problem, out_and_back=True)
        return simulate(problem, progress=progress.solving(list(spans_of(problem))), throw=False, **chosen)

    wanted = Wanted(folder, as_json, quiet, pictures, film, clearance_tolerance, seconds, folders)
    return run("simulate", file, wanted, solve, VOICE)


@commands.command()
@running
@folders_option
@seconds_option
@compiling
@click.option(
    "--pareto", metavar="FIRST,SECOND",
    help="The trade-off curve of two quantities as well, such as length,clearance: a table, a plot, and a problem file "
    "for each point. Of length, change, clearance, bend_radius, twist, clamp_force, clamp_moment, clip_force, "
    "clip_moment and travel.",
)  # fmt: skip
def redesign(
    file: Path,
    folder: Path | None,
    as_json: bool,
    quiet: bool,
    pictures: bool,
    film: bool,
    *,
    folders: tuple[Path, ...],
    seconds: float | None,
    pareto: str | None,
) -> int:
    """Change the design of FILE as little as holds every limit over the whole motion.

    DIR/redesigned.toml is a problem file that simulate passes. A redesign that was interrupted goes on where it was.

    \b
    harness-opt redesign problems/lift_arm/lift_arm.toml -o results/better
    harness-opt redesign problems/door/door.toml --pareto change,clearance
    harness-opt simulate results/better/redesigned.toml
    """

    def solve(problem: Problem, progress: Shown) -> Redesign:
        from harness_opt.cli.redesign import redesigned

        return redesigned(problem, progress, folder or Path("results") / file.stem, pareto)

    wanted = Wanted(folder, as_json, quiet, pictures, film, seconds=seconds, folders=folders)
    return run("redesign", file, wanted, solve, VOICE)


@commands.command()
@file_argument
@output_option("Folder of what it finds; results/<name of FILE> where left out.")
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Processes; as many as cores where left out.")
@compiling
@click.option("--scheduler", metavar="ADDRESS", help="Run on the Dask cluster of this scheduler (extra cluster).")
@json_option
@folders_option
@click.option("--quiet", "-q", is_flag=True, help="No progress and no table.")
def study(file: Path, folder: Path | None, folders: tuple[Path, ...], **asked: Any) -> int:
    """Run every variant that the study FILE describes; started again, it goes on where it was.

    DIR holds variants.csv, a row a variant, and study.sqlite, which keeps what is finished.

    \b
    harness-opt study problems/lift_arm/tolerances.toml
    harness-opt study tolerances.toml --scheduler tcp://cluster:8786
    """
    from harness_opt.cli.study import Asked, run_study

    return run_study(file, Asked(folder, folders=folders, **asked), VOICE)


@commands.command()
@file_argument
@output_option("Folder for table and chart; results/<name of FILE>_sensitivity where left out.")
@json_option
@folders_option
def sensitivity(file: Path, folder: Path | None, as_json: bool, folders: tuple[Path, ...]) -> int:
    """Say what moves the worst clearance of FILE most, per millimetre, degree and percent.

    FILE is a problem, or a study, whose tolerances are then weighed in.

    \b
    harness-opt sensitivity problems/lift_arm/lift_arm.toml
    """
    from harness_opt.cli.sensitivity import run_sensitivity

    return run_sensitivity(file, folder, as_json, VOICE, folders)


@commands.command()
@file_argument
@output_option("For what is written; results/<name of FILE>_identified where left out.")
@json_option
@folders_option
def identify(file: Path, folder: Path | None, as_json: bool, folders: tuple[Path, ...]) -> int:
    """Find the stiffness of a real cable from the measurements in FILE: points along a loop, sags, forces, snaps.

    Prints what was found with its intervals of 95 %, how each measurement agrees, and what a further one would help
    most with; writes a table for a library of cables, and the shapes as a drawing. Exit code 1: the measurements do
    not say all that is sought.

    \b
    harness-opt identify my_loops.toml
    harness-opt schema --measurements > measurements.schema.json
    """
    from harness_opt.cli.identify import run_identify

    return run_identify(file, folder, as_json, VOICE, folders)


@commands.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
def show(folder: Path) -> int:
    """Show the result in DIR in a window, to turn about and to scrub along the motion.

    \b
    harness-opt show results/lift_arm
    """
    from harness_opt.files.stored_results import read_results

    read_results(folder)  # says what is wrong with the folder, if anything
    try:
        from harness_opt.pictures import stills as pictures

        pictures.show(folder)
    except (MemoryError, RecursionError):
        raise
    except Exception as error:  # no pyvista, no display, no OpenGL: as many errors as there are computers
        tell(f"No window can be shown: {remedied(error)}")
        return BAD_INPUT
    return 0


@commands.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--to", "kinds", multiple=True, required=True, type=click.Choice(EXPORTS), help="May be given several times."
)
@click.option(
    "-o", "--output", "target", metavar="PATH", type=click.Path(path_type=Path), help="DIR/export if left out."
)
@click.option("--unit", type=click.Choice(["m", "mm"]), default="m", help="Of STL, DXF and STEP files; m if left out.")
def export(folder: Path, kinds: tuple[str, ...], target: Path | None, unit: str) -> int:
    """Write the result in DIR for other programs.

    paraview: motion.pvd, with curvature, clearance and loads as arrays; csv: a table of each cable's centreline in
    every frame; gltf: motion.glb, animated; stl: the volume that each cable sweeps, for CAD; dxf and
    step: each centreline, for CAD.

    \b
    harness-opt export results/lift_arm --to paraview --to csv
    harness-opt export results/lift_arm --to stl --to step --unit mm -o for_cad
    """
    from harness_opt.files.result_folder import add_file
    from harness_opt.files.stored_results import read_results, within
    from harness_opt.pictures.export import export

    read_results(folder)  # says what is wrong with the folder, if anything
    place = target or within(folder, folder / EXPORT_FOLDER)
    if place.exists() and not place.is_dir():
        raise ProblemError(f"{place}: found a file, expected a folder to write in")
    try:
        for kind in kinds:
            for line in export(folder, kind, place, unit):
                say(line)
    except HarnessError as error:
        if isinstance(error, ProblemError):
            raise
        tell(f"Nothing exported to {kind}: {remedied(error)}")
        return BAD_INPUT
    if target is None:
        add_file(folder, EXPORT_FOLDER)
    return 0


for _command in COMMANDS:
    commands.add_command(_command)
for _command in (commands, *commands.commands.values()):
    debugging(_command)

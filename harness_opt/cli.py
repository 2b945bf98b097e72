"""The command line: the only room that prints or exits.

The rooms that solve are imported inside the commands, so that help, ``schema`` and ``check`` start at once.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .errors import HarnessError, ProblemError, SolveError, Status
from .progress import Abandoned, Interrupts, progress_for

if TYPE_CHECKING:
    from .clearance import ClearanceResult
    from .motion import Progress
    from .outer_loop import Redesign
    from .problem import Problem
    from .results import Motion
    from .scene import Scene

    Solve = Callable[[Problem, Progress], Motion | Redesign]
    _Found = tuple[Motion | Redesign, ClearanceResult | None, str]  # with the command that found it
    _Summary = dict[str, Any]

BAD_INPUT, UNSOLVED, INTERRUPTED = 2, 3, 130
EXIT = {"ok": 0, "violated": 1, "infeasible": 1, "unsolved": UNSOLVED}
SOLVERS = ("gauss-newton", "levenberg-marquardt", "ipopt", "paper")
TRANSCRIPTIONS = ("collocation", "dqm")
REMEDY = 'pip install "harness-opt[pictures]"'


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Args:
        argv: the arguments, without the program's name; None takes those of the process.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a name that the terminal's encoding lacks must not end a run
            stream.reconfigure(errors="replace")
    try:
        code = commands.main(args=argv, prog_name="harness-opt", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        return BAD_INPUT
    except ProblemError as error:
        _tell(*error.mistakes)
        return BAD_INPUT
    except OSError as error:  # such as a full disk behind stdout
        _tell(f"harness-opt: {error.filename or 'output'}: {error.strerror or error}")
        return BAD_INPUT
    except (click.Abort, KeyboardInterrupt, Abandoned):
        _tell("Interrupted.")
        return INTERRUPTED
    return code or 0


def _say(text: str) -> None:
    """Print on stdout; a reader that has gone away (``harness-opt schema | head``) is no mistake."""
    try:
        click.echo(text)
    except BrokenPipeError:
        # what is still buffered would fail again when Python ends; docs.python.org/3/library/signal.html
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _warn(text: str) -> None:
    """Print on stderr from a signal handler, where Python's own streams may be in use."""
    os.write(2, text.encode())


def _tell(*lines: str) -> None:
    """Print on stderr."""
    for line in lines:
        click.echo(line, err=True)


# --- options -------------------------------------------------------------------------------------------


class _Positive(click.ParamType):
    """A finite number above 0."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number > 0):
            self.fail(f"found {value!r}, expected a number above 0", param, ctx)
        return number


@dataclass(frozen=True)
class _Wanted:
    """What the user wants to be shown and kept; ``folder`` is None for the usual place."""

    folder: Path | None
    as_json: bool
    quiet: bool
    pictures: bool


_file = click.argument("file", type=click.Path(path_type=Path))
_as_json = click.option("--json", "as_json", is_flag=True, help="The summary on stdout, and nothing else there.")


def _running(command: Callable[..., int]) -> Callable[..., int]:
    """Add the argument and the options of the commands that write results."""
    for decorate in (
        click.option(
            "--no-pictures", "pictures", flag_value=False, default=True, help="Write no report and draw no pictures."
        ),
        click.option("--quiet", "-q", is_flag=True, help="No progress and no table."),
        _as_json,
        click.option(
            "-o", "--output", "folder", metavar="DIR", type=click.Path(path_type=Path),
            help="Result folder; results/<name of FILE> where left out.",
        ),
        _file,
    ):  # fmt: skip
        command = decorate(command)
    return command


def _version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """Print the version, if ``wanted``, and end."""
    if wanted:
        from .report import versions

        _say(f"harness-opt {versions()['harness-opt']}")
        context.exit()


_CODES = (
    "Exit codes: 0 all limits hold, 1 a limit is violated or no design holds them, 2 bad input, "
    "3 a shape could not be found, 130 interrupted."
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, epilog=_CODES)
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show it.")
def commands() -> None:
    """Shapes, clearances and redesign of cables between moving clamps.

    \b
    harness-opt check problems/lift_arm/lift_arm.toml
    harness-opt simulate problems/lift_arm/lift_arm.toml
    harness-opt redesign problems/lift_arm/lift_arm.toml -o results/better
    harness-opt show results/better
    """


# --- commands ------------------------------------------------------------------------------------------


@commands.command()
@_file
@_as_json
def check(file: Path, as_json: bool) -> int:
    """Validate FILE and say what would be solved; nothing is written.

    \b
    harness-opt check problems/lift_arm/lift_arm.toml
    """
    from .description import description, facts
    from .problem_file import read_problem
    from .scene import load_scene

    problem = read_problem(file)
    with _naming(file):
        content = facts(problem, load_scene(problem))
    if not as_json:
        _say(description(problem, content))
        return 0
    from . import report

    head = {"schema": report.SCHEMA, "command": "check", "problem": report.problem_words(problem)}
    _say(report.as_json(head | {"versions": report.versions(), "status": "ok"} | content))
    return 0


@commands.command()
@_running
@click.option("--spatial-step", type=_Positive(), metavar="M", help="Most that a clamp moves between frames, m.")
@click.option("--out-and-back", is_flag=True, help="Go through the motion and back: shows which snaps stay.")
@click.option("--elements", type=click.IntRange(min=1), help="Least number of elements of a cable.")
@click.option("--solver", type=click.Choice(SOLVERS), help="Way to solve; gauss-newton where left out.")
@click.option("--transcription", type=click.Choice(TRANSCRIPTIONS), help="collocation, or dqm: the paper's.")
@click.option("--points", type=int, metavar="N", help="Of dqm, 5 to 200; as many as it takes where left out.")
@click.option("--closure", is_flag=True, default=None, help="Of dqm: with the length closure (25).")
@click.option("--tolerance", type=_Positive(), help="Error allowed in a shape, in lengths of the cable.")
def simulate(
    file: Path,
    folder: Path | None,
    as_json: bool,
    quiet: bool,
    pictures: bool,
    out_and_back: bool,
    **numerics: Any,
) -> int:
    """Simulate the whole motion of FILE: shapes, clearances, limits, verdict.

    \b
    harness-opt simulate problems/lift_arm/lift_arm.toml
    harness-opt simulate lift_arm.toml -o results/fine --spatial-step 0.002 --json
    """
    chosen = {name: value for name, value in numerics.items() if value is not None}

    def solve(problem: Problem, progress: Progress) -> Motion:
        from .motion import simulate

        if out_and_back:
            problem = dataclasses.replace(problem, out_and_back=True)
        return simulate(problem, progress=progress, throw=False, **chosen)

    return _run("simulate", file, _Wanted(folder, as_json, quiet, pictures), solve)


@commands.command()
@_running
def redesign(file: Path, folder: Path | None, as_json: bool, quiet: bool, pictures: bool) -> int:
    """Change the design of FILE as little as holds every limit over the whole motion.

    DIR/redesigned.toml is a problem file that simulate passes.

    \b
    harness-opt redesign problems/lift_arm/lift_arm.toml -o results/better
    harness-opt simulate results/better/redesigned.toml
    """

    def solve(problem: Problem, progress: Progress) -> Redesign:
        from .outer_loop import redesign

        return redesign(problem, progress=progress, throw=False)

    return _run("redesign", file, _Wanted(folder, as_json, quiet, pictures), solve)


@commands.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
def show(folder: Path) -> int:
    """Show the result in DIR in a window, to turn about and to scrub along the motion.

    \b
    harness-opt show results/lift_arm
    """
    from .report import read_results

    read_results(folder)  # says what is wrong with the folder, if anything
    try:
        from . import pictures

        pictures.show(folder)
    except Exception as error:  # no pyvista, no display, no OpenGL: as many errors as there are computers
        _tell(f"No window can be shown: {_remedied(error)}")
        return BAD_INPUT
    return 0


@commands.command()
def schema() -> int:
    """Print the JSON Schema of problem files, for editors.

    \b
    harness-opt schema > problem.schema.json
    """
    import json

    from .problem_file import schema

    _say(json.dumps(schema(), indent=2))
    return 0


# --- a run ---------------------------------------------------------------------------------------------


@contextlib.contextmanager
def _naming(file: Path) -> Iterator[None]:
    """Put the name of ``file`` before mistakes that come without."""
    try:
        yield
    except ProblemError as error:
        raise ProblemError(
            line if line.startswith(str(file)) else f"{file}: {line}" for line in error.mistakes
        ) from None


def _run(command: str, file: Path, wanted: _Wanted, solve: Solve) -> int:
    """Read, solve, measure, write, draw and tell; return the exit code."""
    begin = time.perf_counter()
    from .problem_file import read_problem
    from .report import input_files, timed
    from .result_folder import check_target
    from .scene import load_scene

    problem = read_problem(file)
    folder = wanted.folder or Path("results") / file.stem
    check_target(folder, input_files(problem))  # now, and not after an hour of solving
    with _naming(file):
        scene = load_scene(problem)
    if not wanted.quiet:
        _tell(*(f"{file}: {warning}" for warning in scene.warnings))
    loaded = time.perf_counter() - begin
    with Interrupts(_warn) as interrupts:
        with _naming(file), progress_for(interrupts, None if wanted.quiet else sys.stderr) as progress:
            result = _solved(problem, solve, progress)
        result, measured = _measured(result, scene)
        result = timed(result, load=loaded, total=time.perf_counter() - begin)
        summary, place = _kept(wanted, folder, interrupts.asked, (result, measured, command))
        interrupts.patient = False
        try:
            interrupts.stop_here()
            if wanted.pictures and summary["frames"]:
                summary = _with_pictures(folder, (result, measured, command), scene)
        except KeyboardInterrupt:
            interrupts.asked = True
    _show(wanted, summary, place)
    return INTERRUPTED if interrupts.asked else EXIT[summary["status"]]


def _kept(wanted: _Wanted, folder: Path, interrupted: bool, found: _Found) -> tuple[_Summary, Path | None]:
    """Write what was found; return its summary and the folder, or None where nothing was written."""
    from .report import summary, write_results

    result, measured, command = found
    content = summary(result, measured, command=command)
    if interrupted and not content["frames"]:
        return content, None  # an earlier result is worth more
    try:
        return write_results(result, folder, measured=measured, command=command), folder
    except ProblemError:
        _show(wanted, content, None)  # what was found is not lost with the disk
        raise


def _show(wanted: _Wanted, summary: _Summary, place: Path | None) -> None:
    """Print the summary, and where it was written, if it was."""
    from .report import as_json
    from .tables import report

    if wanted.as_json:
        _say(as_json(summary))
    where = "Nothing was written." if place is None else f"Results: {place}{os.sep}"
    if not wanted.quiet:
        (_tell if wanted.as_json else _say)(f"{report(summary)}\n{where}")
    elif summary["status"] == "unsolved":
        _tell(summary["message"])


def _solved(problem: Problem, solve: Solve, progress: Progress) -> Motion | Redesign:
    """Return what ``solve`` finds, or what it had found when it gave up."""
    try:
        return solve(problem, progress)
    except SolveError as error:
        partial, status, message = error.partial, error.status, str(error)
    except KeyboardInterrupt:
        partial, status, message = None, Status.INTERRUPTED, Status.INTERRUPTED.value
    if partial is None:
        import numpy as np

        from .results import Motion

        partial = Motion(problem, np.zeros(0), {})
    return dataclasses.replace(partial, status=status, message=message)


def _measured(result: Motion | Redesign, scene: Scene) -> tuple[Motion | Redesign, ClearanceResult | None]:
    """Return a motion, with the seconds that measuring took, and its clearances; a redesign has its own."""
    from .report import clearances, timed
    from .results import Motion

    if not isinstance(result, Motion):
        return result, None
    begin = time.perf_counter()
    measured = clearances(result, scene)
    return timed(result, clearance=time.perf_counter() - begin), measured


def _with_pictures(folder: Path, found: _Found, scene: Scene) -> _Summary:
    """Write the results again with a report, and then with pictures; where none can be drawn say why.

    The results stand already, and the report before the pictures, so that nothing that a graphics driver does can
    cost them.
    """
    from .html_report import prepare, write_report
    from .report import write_results

    result, measured, command = found
    page = functools.partial(write_report, prepare(result, measured, scene))
    content = write_results(result, folder, measured=measured, command=command, page=page)
    try:
        from .animation import write_pictures_and_film

        draw = functools.partial(write_pictures_and_film, clearances=measured)
        return write_results(result, folder, measured=measured, command=command, pictures=draw, page=page)
    except Exception as error:  # no pyvista, no OpenGL, no room: as many errors as there are computers
        _tell(f"Pictures left out: {_remedied(error)}")
        return content


def _remedied(error: Exception) -> str:
    """Return the first line of an error about pictures, and what to do about it."""
    words = next(iter(str(error).splitlines()), "") or type(error).__name__
    missing = isinstance(error, ImportError) or isinstance(error.__cause__, ImportError)
    return words if isinstance(error, HarnessError) and not missing else f"{words}; try {REMEDY}"

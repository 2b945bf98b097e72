"""One run of the command line: read, solve, measure, write, draw and tell, in an order in which nothing is lost."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import os
import re
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from harness_opt.cli.ending import INTERRUPTED, UNSOLVED
from harness_opt.cli.interrupts import Interrupts
from harness_opt.cli.progress import Shown, progress_for
from harness_opt.errors import HarnessError, ProblemError, SolveError, Status

if TYPE_CHECKING:
    from harness_opt.clearance.pairs import ClearanceResult
    from harness_opt.design.result import Redesign
    from harness_opt.files.summary import Command, Summary
    from harness_opt.model.problem import Problem
    from harness_opt.model.results import Motion
    from harness_opt.parts.scene import Scene
    from harness_opt.report.result_files import Page

    Solve = Callable[[Problem, Shown], Motion | Redesign]

EXIT = {"ok": 0, "violated": 1, "uncertain": 1, "infeasible": 1, "unsolved": UNSOLVED}
BEGIN = "begin"  # key of the context's object: when the command began
_AGAIN = "Ctrl-C again stops at once and keeps nothing."
STOPPING = {
    "simulate": f"Stopping after this frame; {_AGAIN}",
    "redesign": f"Stopping after this frame; the same command goes on from there. {_AGAIN}",
}
REMEDY = 'pip install "harness-opt[pictures]"'


@dataclass(frozen=True)
class Voice:
    """What the user is told by: results, messages a line each, and a line from inside a signal handler."""

    say: Callable[[str], None]
    tell: Callable[..., None]
    warn: Callable[[str], None]


@dataclass(frozen=True)
class Wanted:
    """What the user wants to be shown and kept; ``folder`` is None for the usual place.

    ``tolerance`` is that of the clearances, m, or None; ``seconds`` the time limit, or None; ``folders`` are where
    files may come from beside the problem's own.
    """

    folder: Path | None
    as_json: bool
    quiet: bool
    pictures: bool
    film: bool
    tolerance: float | None = None
    seconds: float | None = None
    folders: tuple[Path, ...] = ()

    @property
    def stream(self) -> TextIO | None:
        """Where progress is shown; None shows none."""
        return None if self.quiet else sys.stderr


@dataclass(frozen=True, eq=False)
class Found:
    """What a run found: the result, the clearances of a motion, with which command, the parts, and when it began."""

    result: Motion | Redesign
    measured: ClearanceResult | None
    command: Command
    scene: Scene
    begin: float

    @property
    def kept(self) -> dict[str, Any]:
        """What is written with the result."""
        return {"measured": self.measured, "command": self.command, "scene": self.scene}


@contextlib.contextmanager
def naming(file: Path) -> Iterator[None]:
    """Put the name of ``file`` before mistakes that come without."""
    try:
        yield
    except ProblemError as error:
        raise ProblemError(
            line if line.startswith(str(file)) else f"{file}: {line}" for line in error.mistakes
        ) from None


def run(command: Command, file: Path, wanted: Wanted, solve: Solve, voice: Voice) -> int:
    """Read, solve, measure, write, draw and tell; return the exit code.

    Args:
        command: "simulate" or "redesign".
        file: of the problem.
        wanted: what to show and to keep.
        solve: finds the motion, or the design.
        voice: what the user is told by.

    Raises:
        ProblemError: bad input, or a folder that cannot be written.
    """
    begin = click.get_current_context().obj[BEGIN]
    from harness_opt.model.plausibility import doubts
    from harness_opt.report.summary import timed

    folder = wanted.folder or Path("results") / file.stem
    with Interrupts(voice.warn, wanted.seconds, words=STOPPING[command], patient=False) as interrupts:
        problem, scene = _loaded(file, folder, wanted, interrupts)
        if not wanted.quiet:
            voice.tell(*(f"{file}: {warning}" for warning in (*doubts(problem), *scene.warnings)))
        loaded = time.perf_counter() - begin
        interrupts.patient = True
        with naming(file), progress_for(interrupts, wanted.stream) as progress:
            result = _solved(problem, solve, progress, interrupts)
            result = _timely(result, wanted.seconds, interrupts)
            result, measured = _measured(result, scene, wanted, interrupts, progress)
        result = timed(result, load=loaded, total=time.perf_counter() - begin)
        found = Found(result, measured, command, scene, begin)
        _tell_verdict(wanted, found, voice)
        summary, place, page = _kept(wanted, folder, found, interrupts, voice)
        if not wanted.quiet:
            _tell_place(wanted, summary, place, voice)
        interrupts.patient = False
        try:
            interrupts.stop_here()
            if (wanted.pictures or wanted.film) and summary["frames"] and place is not None:
                with interrupts.cut_off(), progress_for(interrupts, wanted.stream) as progress:
                    summary = _with_pictures(wanted, place, found, page, summary, progress, voice)
        except KeyboardInterrupt:
            if not interrupts.late:
                interrupts.asked = True
    if wanted.as_json:
        _say_json(summary, voice)
    return INTERRUPTED if interrupts.asked else EXIT[summary["status"]]


def _loaded(file: Path, folder: Path, wanted: Wanted, interrupts: Interrupts) -> tuple[Problem, Scene]:
    """Return the problem and its parts.

    Raises:
        ProblemError: bad input, or a folder that cannot be written.
        SolveError: reading took longer than the time limit.
    """
    from harness_opt.files.read import read_problem
    from harness_opt.files.result_folder import check_target
    from harness_opt.model.problem import input_files
    from harness_opt.parts.scene import load_scene

    try:
        with interrupts.cut_off():
            problem = read_problem(file, wanted.folders)
            check_target(folder, input_files(problem))  # now, and not after an hour of solving
            with naming(file):
                scene = load_scene(problem)
        if interrupts.asked:  # and a library heard it
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        if interrupts.asked or not interrupts.late:
            raise
        words = f"found no end of reading the files within the time limit, {wanted.seconds:g} s"
        advice = "try a longer --time-limit. Nothing was written."
        raise SolveError(f"{file}: {words}; {advice}", Status.TIME_LIMIT) from None
    return problem, scene


def _tell_verdict(wanted: Wanted, found: Found, voice: Voice) -> None:
    """Print what was found, before anything is written: nothing that comes after can cost it."""
    from harness_opt.report.summary import summary
    from harness_opt.report.words import report

    content = summary(found.result, found.measured, command=found.command)
    if not wanted.quiet:
        _aloud(wanted, voice)(report(content))
    elif content["status"] == "unsolved":
        voice.tell(content["message"])


def _tell_place(wanted: Wanted, summary: Summary, place: Path | None, voice: Voice) -> None:
    """Print where the results are, if anywhere, and what to do next."""
    from harness_opt.report.words import advice

    where = "Nothing was written." if place is None else f"Results: {place}{os.sep}"
    _aloud(wanted, voice)("\n".join([where, *advice(summary, place)]))


def _aloud(wanted: Wanted, voice: Voice) -> Callable[[str], None]:
    """Return what prints for people: beside the summary on stdout, where that is asked for."""
    return voice.tell if wanted.as_json else voice.say


def _kept(
    wanted: Wanted, folder: Path, found: Found, interrupts: Interrupts, voice: Voice
) -> tuple[Summary, Path | None, Page | None]:
    """Write what was found, with its report.

    Returns:
        Its summary, the folder, or None where nothing was written, and what writes its report.

    Raises:
        ProblemError: it cannot be written.
    """
    from harness_opt.report.result_files import write_results
    from harness_opt.report.summary import summary

    part = found.result.status in (Status.INTERRUPTED, Status.TIME_LIMIT)
    if part:
        content = summary(found.result, found.measured, command=found.command)
        if not content["frames"]:
            return content, None, None  # an earlier result is worth more
    if part and _is_whole(folder):
        from harness_opt.files.result_folder import ASIDE

        folder = folder.with_name(folder.name + ASIDE)  # so it is than a part of a new one
    page = _page(found, interrupts)
    try:
        return write_results(found.result, folder, page=page, **found.kept), folder, page
    except ProblemError:  # what was found is not lost with the disk
        content, place = summary(found.result, found.measured, command=found.command), None
        with contextlib.suppress(ProblemError):  # nor with the room that a report takes
            content, place = write_results(found.result, folder, **found.kept), folder
        if not wanted.quiet:
            _tell_place(wanted, content, place, voice)
        if wanted.as_json:
            _say_json(content, voice)
        raise


def _is_whole(folder: Path) -> bool:
    """Return whether ``folder`` holds a result of a run that went to its end."""
    from harness_opt.files.result_folder import read_summary

    earlier = read_summary(folder)
    parts = (Status.INTERRUPTED.name.lower(), Status.TIME_LIMIT.name.lower())
    return earlier is not None and earlier.get("reason") not in parts


def _solved(problem: Problem, solve: Solve, progress: Shown, interrupts: Interrupts) -> Motion | Redesign:
    """Return what ``solve`` finds, or what it had found when it gave up."""
    try:
        interrupts.stop_here()
        with interrupts.cut_off():
            return solve(problem, progress)
    except SolveError as error:
        partial, status, message = error.partial, error.status, str(error)
    except KeyboardInterrupt:
        partial, status, message = None, Status.INTERRUPTED, Status.INTERRUPTED.value
    if partial is None:
        import numpy as np

        from harness_opt.model.results import Motion

        partial = Motion(problem, np.zeros(0), {})
    found: Motion | Redesign = dataclasses.replace(partial, status=status, message=message)
    return found


def _timely(result: Motion | Redesign, seconds: float | None, interrupts: Interrupts) -> Motion | Redesign:
    """Return ``result``; where the time limit ended the solve, with that for a reason."""
    if result.status is not Status.INTERRUPTED or interrupts.asked or not interrupts.late:
        return result
    message = f"{Status.TIME_LIMIT.value}, {seconds:g} s; try a longer --time-limit, or a larger motion.spatial_step"
    return dataclasses.replace(result, status=Status.TIME_LIMIT, message=message)


def _measured(
    result: Motion | Redesign, scene: Scene, wanted: Wanted, interrupts: Interrupts, progress: Shown
) -> tuple[Motion | Redesign, ClearanceResult | None]:
    """Return a motion, with the seconds that measuring took, and its clearances; a redesign has its own."""
    from harness_opt.clearance.measure import clearances
    from harness_opt.clearance.pairs import pairs_asked
    from harness_opt.model.results import Motion
    from harness_opt.model.spans import in_spans
    from harness_opt.report.summary import timed

    if not isinstance(result, Motion):
        return result, None
    begin = time.perf_counter()
    pairs, asked = itertools.count(), pairs_asked(in_spans(result.problem), scene)

    def give_up() -> bool:  # asked before each pair
        progress.tell("certifying clearances", min(next(pairs), asked), asked)
        return interrupts.overdue()

    measured = clearances(result, scene, tolerance=wanted.tolerance, stop=interrupts.stopping, give_up=give_up)
    if not measured.whole and result.ok:
        result = dataclasses.replace(result, status=Status.INTERRUPTED)
        result = _timely(result, wanted.seconds, interrupts)
    return timed(result, clearance=time.perf_counter() - begin), measured


def _page(found: Found, interrupts: Interrupts) -> Page | None:
    """Return what writes the report of ``found``; None where the time is up."""
    from harness_opt.report.html_page import prepare, write_page

    begin = time.perf_counter()
    try:
        if interrupts.late:
            return None
        with interrupts.cut_off():
            prepared = prepare(found.result, found.measured, found.scene)
    except KeyboardInterrupt:
        return None
    seconds = time.perf_counter() - begin

    def page(content: Summary, folder: Path) -> str:
        content["timing"] |= {"report": seconds, "total": time.perf_counter() - found.begin}  # all until here
        return write_page(prepared, content, folder)

    return page


def _with_pictures(
    wanted: Wanted, folder: Path, found: Found, page: Page | None, content: Summary, progress: Shown, voice: Voice
) -> Summary:
    """Write the results again with the pictures asked for; where none can be drawn say why.

    The results stand already, so that nothing that a graphics driver does can cost them.

    Raises:
        ProblemError: the folder cannot be written any more.
    """
    from harness_opt.report.result_files import write_results

    try:
        from harness_opt.pictures.film import write_pictures_and_film

        draw = functools.partial(
            write_pictures_and_film, clearances=found.measured, pictures=wanted.pictures, film=wanted.film,
            progress=progress,
        )  # fmt: skip
        return write_results(found.result, folder, page=page, pictures=draw, **found.kept)
    except ProblemError:
        if wanted.as_json:
            _say_json(content, voice)  # what stands is not lost with the disk
        raise
    except Exception as error:  # no pyvista, no OpenGL, no room: as many errors as there are computers
        voice.tell(f"Pictures left out: {remedied(error)}")
        return content


def _say_json(content: Summary, voice: Voice) -> None:
    from harness_opt.report.summary import as_json

    voice.say(as_json(content))


def remedied(error: Exception) -> str:
    """Return the first line of an error about pictures, and what to do about it."""
    words = next(iter(str(error).splitlines()), "") or type(error).__name__
    missing = isinstance(error, ImportError) or isinstance(error.__cause__, ImportError)
    if isinstance(error, HarnessError) and not missing:
        return words
    named = re.search(r"harness-opt\[(\w+)\]", words)
    return f"{words}; try {REMEDY if named is None else REMEDY.replace('pictures', named[1])}"

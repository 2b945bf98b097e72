"""``harness-opt study``: read, run on all cores or a cluster, keep, tell."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness_opt.cli.ending import BAD_INPUT, INTERRUPTED, UNSOLVED
from harness_opt.cli.interrupts import Interrupts
from harness_opt.cli.progress import progress_for
from harness_opt.cli.run import EXIT, Voice
from harness_opt.errors import HarnessError, ProblemError

STORE = "study.sqlite"
SUMMARY = "summary.json"
SCHEMA = 1  # of the summary
STOPPING = (
    "Stopping after the variants that run; Ctrl-C again stops at once. What is finished is kept: run it again to go on."
)


@dataclass(frozen=True)
class Asked:
    """What the user asks of a study.

    Args:
        folder: for what it finds; None is results/<name of the file>.
        workers: processes; None takes all cores.
        scheduler: address of a Dask scheduler, or None.
        as_json, quiet: what to show.
        folders: where files may come from beside the problem's own.
    """

    folder: Path | None
    workers: int | None
    scheduler: str | None
    as_json: bool
    quiet: bool
    folders: tuple[Path, ...] = ()


def run_study(file: Path, asked: Asked, voice: Voice) -> int:
    """Run, or go on with, the study of ``file``; return the exit code.

    Raises:
        ProblemError: bad input, a folder that cannot be written, a scheduler that is not there.
    """
    begin = time.perf_counter()
    from harness_opt.files.quantities import quantities_of
    from harness_opt.files.result_folder import check_own
    from harness_opt.studies.store import Store
    from harness_opt.studies.study import plan, run
    from harness_opt.studies.study_file import read_study
    from harness_opt.studies.variant import VariantResult, variant_runner
    from harness_opt.studies.workers import Crew

    study = read_study(file, asked.folders)
    planned = plan(quantities_of(study.problem, asked.folders), study.variations, study.command)
    folder = asked.folder or Path("results") / file.stem
    check_own(folder, STORE)
    results: list[VariantResult] = []
    broken = ""
    with Interrupts(voice.warn, words=STOPPING) as interrupts, _executor(asked, planned.shared) as executor:
        crew = Crew(variant_runner(), executor, asked.workers, lambda: interrupts.asked)
        with progress_for(interrupts, None if asked.quiet else sys.stderr) as progress:
            try:
                for result in run(planned, crew, Store(folder / STORE)):
                    results.append(result)
                    with contextlib.suppress(KeyboardInterrupt):  # the crew has been asked to stop already
                        progress("variants", len(results), len(planned.keys))
            except ProblemError:
                raise
            except HarnessError as error:
                broken = f"{error}; what is finished is kept: start the study again to go on"
    content = _kept(folder, results, study, planned, time.perf_counter() - begin)
    _show(asked, content, study.title or file.stem, folder, voice)
    if broken:
        voice.tell(broken)
    if interrupts.asked:
        return INTERRUPTED
    if broken:
        return UNSOLVED if asked.scheduler is None else BAD_INPUT  # the address no longer leads to a scheduler
    return EXIT[content["status"]]


@contextlib.contextmanager
def _executor(asked: Asked, shared: Any) -> Iterator[Executor | None]:
    """Give the executor of a cluster, or None for processes of our own."""
    if asked.scheduler is None:
        yield None
        return
    from harness_opt.studies.cluster import cluster

    with cluster(asked.scheduler, shared) as executor:
        yield executor


def _kept(folder: Path, results: list[Any], study: Any, planned: Any, seconds: float) -> dict[str, Any]:
    """Write the tables and the summary of what was found; return the summary."""
    from harness_opt.report.summary import versions
    from harness_opt.studies.table import facts, write_json, write_tables

    content = facts(results, len(planned.keys))
    counts, done = content["counts"], content["finished"] == content["variants"]
    solved = sum(counts.get(status, 0) for status in ("ok", "violated", "uncertain", "infeasible"))
    status = "ok" if done and counts.get("ok") == content["variants"] else "violated" if solved else "unsolved"
    files = write_tables(folder, results) if results else []
    content = {
        "schema": SCHEMA,
        "command": "study",
        "study": {"title": study.title, "file": str(study.file.resolve()), "runs": study.command},
        "problem": {"file": str(study.problem.resolve())},
        "versions": versions(),
        "status": status,
        **content,
        "timing": {"total": seconds, "variants": sum(result.seconds for result in results)},
        "files": sorted([*files, STORE, SUMMARY]),
    }
    write_json(folder / SUMMARY, content)
    return content


def _show(asked: Asked, content: dict[str, Any], title: str, folder: Path, voice: Voice) -> None:
    from harness_opt.report.summary import as_json
    from harness_opt.studies.table import report

    if asked.as_json:
        voice.say(as_json(content))
    if not asked.quiet:
        (voice.tell if asked.as_json else voice.say)(f"{report(title, content)}\nResults: {folder}")

"""Does any input bring the program down? Spoilt problem files, tables of poses, meshes and results, thousands of them.

    python scripts/checks/fuzz.py --inputs 20000
    python scripts/checks/fuzz.py --seed 7 --inputs 1 --keep spoilt

Each input is one of the shipped problems, or a small one that has all kinds of files, with a few bytes or a few keys of
one of its files changed. Most are given to ``check``, some to ``simulate``, ``redesign`` or, as a result folder, to
``export``, or with what was found so far to ``study``. Every run has to end with an exit code from 0 to 3 and no
traceback within a stated time and memory, say something where the code is 2, and leave a whole result folder or none.
Time is the processor's, not the wall's, so that a busy machine is no fault of the program's; what waits without working
is a hang, and told after the same time and half a minute.
What fails is kept with its number, which makes it again; the table at the end counts exit codes by command.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import io
import json
import multiprocessing
import os
import random
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from fuzz_inputs import Example, examples, put

SECONDS = dict.fromkeys(("check", "simulate", "redesign", "export", "study"), 10.0)  # of its own, that a run may take
TIME_LIMIT = "4"  # s, given to the commands that take one
MEMORY = 4 * 2**30  # bytes of address space that a run may take
COMMANDS = ("check",) * 89 + ("simulate",) * 3 + ("redesign",) + ("export",) * 5 + ("study",) * 2


# --- running -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outcome:
    """How one run ended.

    Args:
        code: its exit code, or None where there was none.
        wrong: what should not be, a line each; empty where all is well.
        seconds: of processor time that it took.
    """

    code: int | None
    wrong: tuple[str, ...]
    seconds: float = 0.0


def tried(command: str, file: str, folder: Path) -> Outcome:
    """Run ``command`` on ``file`` in ``folder`` within this process, and return what was wrong with that."""
    from harness_opt.cli.commands import main

    arguments = [command, file]
    if command in ("simulate", "redesign"):
        arguments += ["--time-limit", TIME_LIMIT]
    elif command == "export":
        arguments += ["--to", "csv", "--to", "gltf"]
    elif command == "study":
        arguments += ["--workers", "1", "-q"]
    before, out, err = Path.cwd(), io.StringIO(), io.StringIO()
    begin, code, wrong = time.process_time(), None, []
    os.chdir(folder)
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            warnings.catch_warnings(record=True) as caught,
        ):
            warnings.simplefilter("default")
            code = main(arguments)
    except BaseException:  # whatever escapes is what is looked for
        wrong.append(f"escaped: {traceback.format_exc(limit=-3)}")
    finally:
        os.chdir(before)
    seconds = time.process_time() - begin
    said = out.getvalue() + err.getvalue()
    wrong += [f"python warns: {w.category.__name__}: {w.message} ({w.filename}:{w.lineno})" for w in caught]
    if not wrong and code not in (0, 1, 2, 3):
        wrong.append(f"exit code {code}")
    if "Traceback" in said:
        wrong.append("a traceback")
    if code == 2 and not err.getvalue().strip():
        wrong.append("nothing said")
    if seconds > SECONDS[command]:
        wrong.append(f"{seconds:.0f} s of processor time")
    if command != "export":
        wrong += left_behind(folder)
    return Outcome(code, tuple(wrong), seconds)


def left_behind(folder: Path) -> Iterator[str]:
    """Yield what is wrong with the results that a run left in ``folder``."""
    from harness_opt.files.stored_results import read_results

    results = folder / "results"
    for place in sorted(results.iterdir()) if results.is_dir() else ():
        if place.name.startswith("."):
            yield f"left behind: {place.name}"
            continue
        if (place / "study.sqlite").exists():
            continue
        stored = read_results(place)
        text = (place / "summary.json").read_text(encoding="utf-8")
        json.loads(text, parse_constant=lambda name: (_ for _ in ()).throw(ValueError(name)))
        for name, cable in stored.cables.items():
            for key in ("s", "position", "quaternion", "curvature", "force", "moment"):
                if not np.all(np.isfinite(getattr(cable, key))):
                    yield f"{place.name}: {name}/{key} is not finite"


def result_of(example: Example, folder: Path) -> Example:
    """Return the result folder of ``example``, as an example that ``export`` takes."""
    from harness_opt.cli.commands import main

    put(example.contents, folder)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        main(["simulate", str(folder / example.file), "-o", str(folder / "result"), "-q"])
    files = [file for file in (folder / "result").rglob("*") if file.is_file()]
    return Example("result/summary.json", {f.relative_to(folder).as_posix(): f.read_bytes() for f in files})


def study_of(example: Example, folder: Path) -> Example:
    """Return a study of ``example`` with what it has found, as an example that ``study`` takes."""
    from harness_opt import study

    store = "results/study/study.sqlite"
    text = f'schema = 1\nproblem = "{example.file}"\nmethod = "grid"\n[vary]\n"cables.lead.length" = [0.3, 0.31]\n'
    contents = example.contents | {"study.toml": text.encode()}
    put(contents, folder)
    lengths = [{"cables.lead.length": length} for length in (0.3, 0.31)]
    list(study(folder / example.file, lengths, workers=1, store=folder / store))
    return Example("study.toml", contents | {store: (folder / store).read_bytes()})


@dataclass
class Inputs:
    """All inputs, by number: the same number is the same input."""

    problems: list[Example] = field(default_factory=examples)
    result: Example | None = None
    study: Example | None = None

    def make(self, number: int, folder: Path) -> tuple[str, str]:
        """Put input ``number`` into ``folder``; return the command and what it is given."""
        dice = random.Random(number)
        command = dice.choice(COMMANDS)
        if command == "export" and self.result is not None:
            put(self.result.spoilt(dice), folder)
            return command, "result"
        if command == "study" and self.study is not None:
            put(self.study.spoilt(dice), folder)
            return command, self.study.file
        example = dice.choice(self.problems)
        contents = example.spoilt(dice)
        put(contents, folder)
        return ("check" if command in ("export", "study") else command), example.file


def work(inputs: Inputs, numbers: Sequence[int], pipe: object, place: str) -> None:
    """Try ``numbers`` one after the other, and send what came out."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    os.nice(10)
    for number in numbers:
        with tempfile.TemporaryDirectory(dir=place) as name:
            command, file = inputs.make(number, Path(name))
            pipe.send((number, command, None))
            pipe.send((number, command, tried(command, file, Path(name))))
    pipe.send(None)


def campaign(numbers: Sequence[int], report: Callable[[int, str, Outcome], None]) -> None:
    """Try all ``numbers`` in a process of their own, another one after each hang."""
    place = tempfile.mkdtemp(prefix="fuzz")
    base = Path(place, "base")
    base.mkdir()
    inputs = Inputs()
    inputs.result = result_of(inputs.problems[-1], base)
    inputs.study = study_of(inputs.problems[-1], Path(place, "study"))
    left = list(numbers)
    context = multiprocessing.get_context("fork")
    while left:
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=work, args=(inputs, left, sender, place))
        process.start()
        sender.close()
        running: tuple[int, str] = (left[0], "check")
        while True:
            grace = 30.0  # of what only tidies up
            try:
                heard = receiver.recv() if receiver.poll(SECONDS[running[1]] + grace) else "silence"
            except EOFError:
                heard = "death"
            if heard is None:
                left = []
                break
            if isinstance(heard, str):
                process.kill()
                process.join()
                words = "hangs" if heard == "silence" else f"dies with code {process.exitcode}"
                report(*running, Outcome(None, (words,)))
                left = left[left.index(running[0]) + 1 :]
                break
            number, command, outcome = heard
            running = (number, command)
            if outcome is not None:
                report(number, command, outcome)
        process.join()
    shutil.rmtree(place, ignore_errors=True)


def main() -> int:
    """Run the campaign and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0, help="number of the first input")
    parser.add_argument("--keep", type=Path, help="folder to put the inputs in instead of trying them")
    given = parser.parse_args()
    numbers = range(given.seed, given.seed + given.inputs)
    if given.keep:
        inputs = Inputs()
        inputs.result = result_of(inputs.problems[-1], Path(tempfile.mkdtemp()))
        for number in numbers:
            print(*inputs.make(number, given.keep / str(number)))
        return 0
    counts: collections.Counter[tuple[str, object]] = collections.Counter()
    slowest: dict[str, float] = collections.defaultdict(float)
    failures = 0

    def report(number: int, command: str, outcome: Outcome) -> None:
        nonlocal failures
        counts[command, outcome.code] += 1
        slowest[command] = max(slowest[command], outcome.seconds)
        if outcome.wrong:
            failures += 1
            print(f"--- input {number}, {command}:", *outcome.wrong, sep="\n", flush=True)
        if sum(counts.values()) % 1000 == 0:
            print(f"{sum(counts.values())} inputs, {failures} failures", file=sys.stderr, flush=True)

    campaign(numbers, report)
    print(f"\n{'command':10} {'0':>7} {'1':>7} {'2':>7} {'3':>7} {'other':>7} {'slowest':>9} (processor time)")
    for command in SECONDS:
        codes = [counts[command, code] for code in range(4)]
        other = sum(n for (name, code), n in counts.items() if name == command and code not in range(4))
        print(f"{command:10}", *(f"{n:7}" for n in (*codes, other)), f"{slowest[command]:7.1f} s")
    print(f"{sum(counts.values())} inputs, {failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())

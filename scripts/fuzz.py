"""Does any input bring the program down? Spoilt problem files, tables of poses, meshes and results, thousands of them.

    python scripts/fuzz.py --inputs 20000
    python scripts/fuzz.py --seed 7 --inputs 1 --keep spoilt

Each input is one of the shipped problems, or a small one that has all kinds of files, with a few bytes or a few keys of
one of its files changed. Most are given to ``check``, some to ``simulate``, ``redesign`` or, as a result folder, to
``export``. Every run has to end with an exit code from 0 to 3 and no traceback within a stated time and memory, say
something where the code is 2, and leave a whole result folder or none. What fails is kept with its number, which makes
it again; the table at the end counts exit codes by command.
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
import trimesh

PROBLEMS = Path(__file__).resolve().parent.parent / "problems"
SECONDS = {"check": 20.0, "simulate": 60.0, "redesign": 60.0, "export": 60.0}  # that a run may take
TIME_LIMIT = "4"  # s, given to the commands that take one
MEMORY = 4 * 2**30  # bytes of address space that a run may take
COMMANDS = ("check",) * 92 + ("simulate",) * 3 + ("redesign",) + ("export",) * 4
CHANGES = (1, 1, 1, 2, 4)  # of one file; most often so few that what follows is reached

SMALL = """\
schema = 1
title = "All kinds of files"
gravity = [0, 0, -9.81]

[cables.lead]
length = 0.3
diameter = 0.005
bending_stiffness = [2e-3, 3e-3]
torsional_stiffness = 1.5e-3
density = 2500
rest_curvature = [0, 0.5, 0]
start = { position = [0, 0, 0], tangent = [0, 0, 1], roll_deg = 10 }
end = { body = "flap", position = [0.15, 0.02, 0], quaternion = [0, 1, 0, 0], turns = 0 }
bow = [1, 0, 0]

[bodies.flap.motion]
kind = "poses"
file = "flap.csv"

[bodies.drawer.motion]
kind = "slide"
direction = [0, 1, 0]
from = 0
to = 0.02

[motion]
duration = 2
spatial_step = 0.01

[parts.wall]
mesh = "meshes/wall.SUFFIX"
mesh_unit = "mm"
position = [0.1, 0.1, 0.1]
quaternion = [0.7071, 0, 0, 0.7071]
clearance = 0.001

[parts.ball]
body = "drawer"
sphere = { radius = 0.01 }
position = [-0.1, 0, 0]

[limits]
clearance = 0.002
bend_radius = 0.01
twist_deg_per_m = 700
clamp_force = 20
clamp_moment = 0.5

[design]
minimise = "length"

[design.variables]
"lead.length" = [0.25, 0.45]
"lead.end.rotate_x_deg" = [-20, 20]
"""
FORMATS = ("stl", "obj", "ply", "glb", "gltf")

NUMBERS = [
    "nan", "inf", "-inf", "0", "-0.0", "-1", "1e-320", "1e-100", "1e99", "1e308", "-1e308", "9" * 400, "0x" + "f" * 50,
    "0.1", "3", "1e5", "2020-01-01", "true", '""', "[]", "{}", "1_000", "1e", "12:00:00",
]  # fmt: skip
WORDS = [
    "../../../../etc/passwd", "/dev/zero", "/dev/stdin", "/proc/self/mem", ".", "..", "~", "a\\u0000b", "C:\\\\con",
    "//host/share/x.stl", "http://localhost/x.stl", "<script>alert(1)</script>", "{{ 7 * 7 }}", "%s%n", "\\u202e", "é",
    "x" * 5000, "world", "lead", "flap", "lead.length", "start", "hinge", "poses", "-o", "nul", "meshes", " ",
]  # fmt: skip
TOKENS = [b"\0", b"\xff\xfe", b"\n", b"[", b"]", b"[[", b'"""', b"'''", b"=", b".", b",", b"#", b"\xed\xa0\x80", b"\r"]


# --- spoiling ------------------------------------------------------------------------------------------


def spoilt_bytes(content: bytes, dice: random.Random) -> bytes:
    """Return ``content`` with a few bytes or stretches changed, taken out, doubled, put in or cut off."""
    data = bytearray(content)
    for _ in range(dice.choice(CHANGES)):
        # files begin with what says how long they are: half of the changes go there
        end = len(data) if dice.random() < 0.5 else min(len(data), 200)
        at = dice.randrange(end + 1)
        length = min(dice.choice([1, 1, 2, 4, 8, 64, 4096]), len(data) - at)
        kind = dice.randrange(6)
        if kind == 0:
            data[at : at + length] = dice.randbytes(length)
        elif kind == 1:
            del data[at : at + length]
        elif kind == 2:
            data[at:at] = data[at : at + length] * dice.choice([1, 2, 100])
        elif kind == 3:
            data[at:at] = dice.choice([*TOKENS, *(w.encode() for w in NUMBERS), *(w.encode() for w in WORDS)])
        elif kind == 4 and dice.random() < 0.3:
            del data[at:]
        else:
            for place in range(at, min(at + 4, len(data))):  # a number of four bytes, such as a count
                data[place] = dice.choice([0x00, 0x7F, 0x80, 0xFF])
    return bytes(data)


def spoilt_lines(text: str, dice: random.Random) -> str:
    """Return a text of keys and values, or of rows, with a few of them changed to what somebody might type."""
    lines = text.split("\n")
    for _ in range(dice.choice(CHANGES)):
        at = dice.randrange(len(lines))
        line = lines[at]
        kind = dice.randrange(7)
        if kind == 0:
            del lines[at]
            lines = lines or [""]
        elif kind == 1:
            lines.insert(dice.randrange(len(lines)), line)
        elif kind == 2 and "=" in line:  # another value
            key, _, _ = line.partition("=")
            other = dice.choice(lines).partition("=")[2]
            lines[at] = f"{key}= {dice.choice([*NUMBERS, other, json.dumps(dice.choice(WORDS))])}"
        elif kind == 3:  # another number somewhere in it
            words = line.replace(",", " , ").replace("]", " ] ").replace("[", " [ ").split(" ")
            places = [k for k, word in enumerate(words) if word[:1].isdigit() or word[:1] == "-"]
            if places:
                words[dice.choice(places)] = dice.choice(NUMBERS)
            lines[at] = " ".join(words)
        elif kind == 4 and line:  # a letter more, less or another
            place = dice.randrange(len(line))
            lines[at] = line[:place] + dice.choice(["", "x", "_", '"', "é", "\t"]) + line[place + 1 :]
        elif kind == 5 and '"' in line:  # another word
            before, _, after = line.partition('"')
            lines[at] = f'{before}"{dice.choice(WORDS)}"{after.partition(chr(34))[2]}'
        else:
            other = dice.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
    return "\n".join(lines)


@dataclass(frozen=True)
class Example:
    """A folder with a problem file in it, whole.

    Args:
        file: name of the problem file.
        contents: of all its files, by name from its folder.
    """

    file: str
    contents: dict[str, bytes]

    def spoilt(self, dice: random.Random) -> dict[str, bytes]:
        """Return the contents with one of the files spoilt."""
        name = self.file if dice.random() < 0.5 else dice.choice(sorted(self.contents))
        content = self.contents[name]
        if name.endswith((".toml", ".csv", ".json")) and dice.random() < 0.7:
            return self.contents | {name: spoilt_lines(content.decode(), dice).encode(errors="surrogatepass")}
        return self.contents | {name: spoilt_bytes(content, dice)}


def examples() -> list[Example]:
    """Return the shipped problems, and a small one for each format of meshes."""
    found = []
    for file in sorted(PROBLEMS.glob("*/*.toml")):
        used = [file, *(f for kind in ("meshes/*", "motion/*") for f in file.parent.glob(kind) if f.is_file())]
        if file.parent.name != "robot_wrist" and b"[vary]" not in file.read_bytes():
            found.append(Example(file.name, {f.relative_to(file.parent).as_posix(): f.read_bytes() for f in used}))
    return [*found, *(small(suffix, ascii_) for suffix in FORMATS for ascii_ in ((False, True) if suffix in
            ("stl", "ply") else (False,)))]  # fmt: skip


def small(suffix: str, ascii_: bool) -> Example:
    """Return a problem that has all kinds of files, its mesh in the format ``suffix``."""
    box = trimesh.creation.box((60, 40, 30))
    text = SMALL.replace("SUFFIX", suffix)
    if suffix == "gltf":
        from trimesh.exchange.gltf import export_gltf

        exported = export_gltf(trimesh.Scene(box))
        files = {f"meshes/{'wall.gltf' if name == 'model.gltf' else name}": data for name, data in exported.items()}
    elif suffix == "stl" and ascii_:
        files = {"meshes/wall.stl": box.export(file_type="stl_ascii").encode()}
    else:
        options = {"encoding": "ascii"} if suffix == "ply" and ascii_ else {}
        data = box.export(file_type=suffix, **options)
        files = {f"meshes/wall.{suffix}": data.encode() if isinstance(data, str) else data}
    rows = ["t,x,y,z,qw,qx,qy,qz"]
    for k in range(8):
        angle = 0.05 * k
        rows.append(f"{0.25 * k},{0.002 * k},0,0,{np.cos(angle / 2):.17g},0,{np.sin(angle / 2):.17g},0")
    return Example("small.toml", {"small.toml": text.encode(), "flap.csv": "\n".join([*rows, ""]).encode(), **files})


def put(contents: dict[str, bytes], folder: Path) -> None:
    """Write ``contents`` into ``folder``."""
    for name, content in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


# --- running -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outcome:
    """How one run ended.

    Args:
        code: its exit code, or None where there was none.
        wrong: what should not be, a line each; empty where all is well.
        seconds: that it took.
    """

    code: int | None
    wrong: tuple[str, ...]
    seconds: float = 0.0


def tried(command: str, file: str, folder: Path) -> Outcome:
    """Run ``command`` on ``file`` in ``folder`` within this process, and return what was wrong with that."""
    from harness_opt.cli import main

    arguments = [command, file]
    if command in ("simulate", "redesign"):
        arguments += ["--no-pictures", "--time-limit", TIME_LIMIT]
    elif command == "export":
        arguments += ["--to", "csv", "--to", "gltf"]
    before, out, err = Path.cwd(), io.StringIO(), io.StringIO()
    begin, code, wrong = time.perf_counter(), None, []
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
    seconds = time.perf_counter() - begin
    said = out.getvalue() + err.getvalue()
    wrong += [f"python warns: {w.category.__name__}: {w.message} ({w.filename}:{w.lineno})" for w in caught]
    if not wrong and code not in (0, 1, 2, 3):
        wrong.append(f"exit code {code}")
    if "Traceback" in said:
        wrong.append("a traceback")
    if code == 2 and not err.getvalue().strip():
        wrong.append("nothing said")
    if seconds > SECONDS[command]:
        wrong.append(f"{seconds:.0f} s")
    if command != "export":
        wrong += left_behind(folder)
    return Outcome(code, tuple(wrong), seconds)


def left_behind(folder: Path) -> Iterator[str]:
    """Yield what is wrong with the results that a run left in ``folder``."""
    from harness_opt.report import read_results

    results = folder / "results"
    for place in sorted(results.iterdir()) if results.is_dir() else ():
        if place.name.startswith("."):
            yield f"left behind: {place.name}"
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
    from harness_opt.cli import main

    put(example.contents, folder)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        main(["simulate", str(folder / example.file), "-o", str(folder / "result"), "--no-pictures", "-q"])
    contents = {f"result/{f.name}": f.read_bytes() for f in (folder / "result").iterdir()}
    where = json.dumps(str(folder))[1:-1].encode()
    contents["result/summary.json"] = contents["result/summary.json"].replace(where, b"HERE")
    return Example("result/summary.json", contents)


@dataclass
class Inputs:
    """All inputs, by number: the same number is the same input."""

    problems: list[Example] = field(default_factory=examples)
    result: Example | None = None

    def make(self, number: int, folder: Path) -> tuple[str, str]:
        """Put input ``number`` into ``folder``; return the command and what it is given."""
        dice = random.Random(number)
        command = dice.choice(COMMANDS)
        if command == "export" and self.result is not None:
            base = self.problems[-1]
            put(base.contents | self.result.spoilt(dice), folder)
            summary = folder / "result" / "summary.json"
            summary.write_bytes(summary.read_bytes().replace(b"HERE", json.dumps(str(folder))[1:-1].encode()))
            return command, "result"
        example = dice.choice(self.problems)
        contents = example.spoilt(dice)
        put(contents, folder)
        return ("check" if command == "export" else command), example.file


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
    left = list(numbers)
    context = multiprocessing.get_context("fork")
    while left:
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=work, args=(inputs, left, sender, place), daemon=True)
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
    print(f"\n{'command':10} {'0':>7} {'1':>7} {'2':>7} {'3':>7} {'other':>7} {'slowest':>9}")
    for command in SECONDS:
        codes = [counts[command, code] for code in range(4)]
        other = sum(n for (name, code), n in counts.items() if name == command and code not in range(4))
        print(f"{command:10}", *(f"{n:7}" for n in (*codes, other)), f"{slowest[command]:7.1f} s")
    print(f"{sum(counts.values())} inputs, {failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())

"""The pages of the documentation as a list of blocks, and what running each block means.

A comment of one line in front of a block says how it is taken:

| comment | meaning |
|---|---|
| ``<!-- needs: problems/lift_arm -->`` | anywhere: the folder is copied to where the page runs, at the same path |
| ``<!-- file: NAME -->`` | the block is written to NAME in the working folder, and then checked |
| ``<!-- in: FOLDER -->`` | a problem or study file that lies in FOLDER of the project |
| ``<!-- fragment of: FILE -->`` | tables that, put into FILE of the project, make a file without mistakes |
| ``<!-- edit: FILE -->`` | what the reader types into FILE of the working folder: its tables are put into it |
| ``<!-- exit: N -->`` | the exit code of the last command, 0 where left out |
| ``<!-- continues -->`` | a Python block that goes on where the last one of the page stopped |
| ``<!-- not run: REASON -->`` | the block is not run |
| ``<!-- test line -->`` | the line that CI runs: not run here, for it runs the tests |

Blocks of ``sh``, ``console``, ``python`` and ``toml`` run in the order of the page, in one folder, empty at first. In a
block of ``console`` lines behind ``$`` are run, and the others are what they print; numbers may differ.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit

from harness_opt.files.quantities import quantities_of
from harness_opt.files.read import read_problem
from harness_opt.studies.study import plan
from harness_opt.studies.study_file import read_study

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>[a-z]*)[^\n]*\n(?P<text>.*?)^(?P=indent)```$", re.DOTALL | re.MULTILINE
)
COMMENT = re.compile(r"<!-- ([a-z ]+?)(?:: (.*?))? -->")
NUMBER = re.compile(r"[-+]?\d[\d.,]*(?:e[-+]?\d+)?")
RUN = ("sh", "console", "python", "toml")
SHOWN = ("text", "csv", "json", "yaml", "")


@dataclass(frozen=True)
class Block:
    """One fenced block: its language, text, line, and the comments in front of it."""

    language: str
    text: str
    line: int
    asked: Mapping[str, str] = field(default_factory=dict)


def pages() -> list[Path]:
    """Return all pages with fenced blocks."""
    files = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [file for file in files if "```" in file.read_text(encoding="utf-8")]


def blocks(file: Path) -> Iterator[Block]:
    """Yield the blocks of a page."""
    page = file.read_text(encoding="utf-8")
    for found in FENCE.finditer(page):
        asked = {}
        for line in reversed(page[: found.start()].rstrip().splitlines()):
            comment = COMMENT.fullmatch(line.strip())
            if comment is None:
                break
            asked[comment[1]] = comment[2] or ""
        indent = len(found["indent"])
        text = "".join(line[indent:] if line.strip() else "\n" for line in found["text"].splitlines(keepends=True))
        yield Block(found["language"], text, page.count("\n", 0, found.start()) + 1, asked)


def needed(file: Path) -> list[str]:
    """Return the folders of the project that a page needs in its working folder."""
    return re.findall(r"<!-- needs: (.*?) -->", file.read_text(encoding="utf-8"))


# --- running -------------------------------------------------------------------------------------------


@dataclass
class Reader:
    """Who reads a page and does what it says, in ``folder``.

    ``python`` is what the Python blocks of the page have said so far.
    """

    folder: Path
    python: str = ""

    def prepare(self, file: Path) -> None:
        """Copy what the page needs."""
        for name in needed(file):
            shutil.copytree(
                ROOT / name, self.folder / name, ignore=shutil.ignore_patterns("results"), dirs_exist_ok=True
            )

    def do(self, block: Block) -> str:
        """Do what a block says; return what it printed.

        Raises:
            AssertionError: it does not work.
        """
        if "test line" in block.asked:
            return ""
        if "not run" in block.asked:
            assert block.asked["not run"], "a block that is not run says why"
            return ""
        return {"sh": self._sh, "console": self._console, "python": self._python, "toml": self._toml}[block.language](
            block
        )

    def command(self, text: str, expected: int = 0) -> str:
        """Run lines of a shell; return what they print."""
        paths = [str(Path(sys.executable).parent), os.environ["PATH"]]
        environment = {**os.environ, "PATH": os.pathsep.join(paths), "COLUMNS": "80"}
        environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), environment.get("PYTHONPATH", "")]).rstrip(os.pathsep)
        done = subprocess.run(
            ["bash", "-c", text],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=900,
        )
        assert done.returncode == expected, f"{text}\nexit code {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def _sh(self, block: Block) -> str:
        return self.command(block.text, int(block.asked.get("exit", 0)))

    def _console(self, block: Block) -> str:
        """Run the commands of a console; their output is as shown, but for numbers."""
        commands = commands_of(block.text)
        printed = ""
        for number, (command, shown) in enumerate(commands):
            last = number == len(commands) - 1
            output = self.command(command, int(block.asked.get("exit", 0)) if last else 0)
            assert alike(output, shown), f"$ {command}\nprints\n{output}\nand not\n{shown}"
            printed += f"$ {command}\n{output}"
        return printed

    def _python(self, block: Block) -> str:
        self.python = (self.python if "continues" in block.asked else "") + block.text
        file = self.folder / "page.py"
        file.write_text(self.python, encoding="utf-8")
        return self.command(f'"{sys.executable}" page.py')

    def _toml(self, block: Block) -> str:
        tables = tomllib.loads(block.text)
        if "edit" in block.asked:
            file = self.folder / block.asked["edit"]
            file.write_text(completed(file, block.text), encoding="utf-8")
            read_problem(file)
        elif "fragment of" in block.asked:
            file = ROOT / block.asked["fragment of"]
            self._checked(completed(file, block.text), file.parent)
        elif "file" in block.asked:
            file = self.folder / block.asked["file"]
            file.write_text(block.text, encoding="utf-8")
            check(file, tables)
        else:
            self._checked(block.text, ROOT / block.asked["in"] if "in" in block.asked else self.folder)
        return ""

    def _checked(self, text: str, beside: Path) -> None:
        """Check a file as if it lay in the folder ``beside``."""
        copy = self.folder / "beside"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(beside, copy, ignore=shutil.ignore_patterns("results", "beside"))
        file = copy / "page.toml"
        file.write_text(text, encoding="utf-8")
        check(file, tomllib.loads(text))


def check(file: Path, tables: Mapping[str, Any]) -> None:
    """Read a problem file, or a study file and what it varies.

    Raises:
        ProblemError: it has mistakes.
    """
    if "problem" in tables:
        study = read_study(file)
        plan(quantities_of(study.problem, ()), study.variations, study.command)
    else:
        read_problem(file)


def completed(file: Path, fragment: str) -> str:
    """Return the text of a file with the tables of ``fragment`` put into it."""
    whole = tomlkit.parse(file.read_text(encoding="utf-8"))
    merge(whole, tomllib.loads(fragment))
    return tomlkit.dumps(whole)


def merge(into: Any, tables: Mapping[str, Any]) -> None:
    """Put ``tables`` into others, key by key."""
    for key, value in tables.items():
        if isinstance(value, Mapping) and key in into:
            merge(into[key], value)
        else:
            into[key] = value


def commands_of(text: str) -> list[tuple[str, str]]:
    """Return the commands of a console block, each with the output that is shown."""
    found: list[tuple[str, str]] = []
    for line in text.splitlines():
        if line.startswith("$ "):
            found.append((line.removeprefix("$ "), ""))
        else:
            command, shown = found[-1]
            found[-1] = (command, f"{shown}{line}\n")
    return found


def alike(output: str, shown: str) -> bool:
    """Return whether an output is the one shown: the same words in the same order, whatever the numbers.

    A line ``...`` stands for any lines.
    """
    pieces = [re.escape(words(piece)) for piece in re.split(r"^\.\.\.$", shown, flags=re.MULTILINE)]
    return re.fullmatch(".*".join(pieces), words(output), re.DOTALL) is not None


def words(text: str) -> str:
    """Return a text with every number as # and every space as one."""
    return "".join(NUMBER.sub("#", text).split())

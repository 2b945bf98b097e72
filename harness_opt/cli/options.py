"""Options that several commands have."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from harness_opt.cli.ending import DEBUG
from harness_opt.cli.streams import tell
from harness_opt.errors import CompilerError


class Positive(click.ParamType[float]):
    """A finite number above 0."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number that ``value`` is."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number > 0):
            self.fail(f"found {value!r}, expected a number above 0", param, ctx)
        return number


file_argument = click.argument("file", type=click.Path(path_type=Path))
folders_option = click.option(
    "--files", "folders", multiple=True, metavar="DIR", type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder that meshes and tables may come from, beside FILE's own; may be given several times.",
)  # fmt: skip
seconds_option = click.option(
    "--time-limit", "seconds", type=Positive(), metavar="S",
    help="Stop after so many seconds, and keep what is solved by then; exit code 3.",
)  # fmt: skip
json_option = click.option("--json", "as_json", is_flag=True, help="The summary on stdout, and nothing else there.")


def output_option(words: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Return the option of the folder that a command writes; ``words`` are its help, with the name if left out."""
    return click.option("-o", "--output", "folder", metavar="DIR", type=click.Path(path_type=Path), help=words)


def running(command: Callable[..., int]) -> Callable[..., int]:
    """Add the argument and the options of the commands that write results."""
    for decorate in (
        click.option("--film", is_flag=True, help="A film of the motion too (extra pictures)."),
        click.option("--pictures/--no-pictures", help="Still pictures of the worst moment too (extra pictures)."),
        click.option("--quiet", "-q", is_flag=True, help="No progress and no table."),
        json_option,
        output_option("Result folder; results/<name of FILE> where left out."),
        file_argument,
    ):
        command = decorate(command)
    return command


def compiling(command: Callable[..., int]) -> Callable[..., int]:
    """Add the option that has functions compiled; where they can't be, say so and do without."""

    @click.option(
        "--compile", "machine", is_flag=True,
        help="Have the system's C compiler make it faster, for some seconds the first time: same results.",
    )  # fmt: skip
    @functools.wraps(command)
    def compiled_or_not(*arguments: Any, machine: bool, **options: Any) -> int:
        with contextlib.ExitStack() as stack:
            if machine:
                from harness_opt.numerics.machine_code import compiled

                try:
                    stack.enter_context(compiled())
                except CompilerError as error:
                    tell(f"--compile: {error}; going on without: the results are the same")
            return command(*arguments, **options)

    return compiled_or_not


def _debug(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    """Remember that a traceback is wanted, if something unforeseen happens."""
    if wanted and context.obj is not None:
        context.obj[DEBUG] = True


def debugging(command: click.Command) -> None:
    """Give a command the option that every one has."""
    option = click.Option(
        [DEBUG], is_flag=True, is_eager=True, expose_value=False, callback=_debug,
        help="A traceback where the program itself fails.",
    )  # fmt: skip
    command.params.append(option)

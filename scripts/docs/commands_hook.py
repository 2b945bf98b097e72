"""A hook of MkDocs: the page of the command line, made from the program's own commands while the site is built.

A page says ``<!-- generated: commands -->``.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

import click

MARKER = "<!-- generated: commands -->"
PROGRAM = "harness-opt"


def on_page_markdown(markdown: str, /, **_: Any) -> str:
    """Put the commands where the page asks for them."""
    return markdown.replace(MARKER, "\n".join(_all())) if MARKER in markdown else markdown


def _all() -> Iterator[str]:
    from harness_opt.cli.commands import commands

    context = click.Context(commands, info_name=PROGRAM)
    yield "| command | what it does |\n|---|---|"
    found = [(name, commands.get_command(context, name)) for name in commands.list_commands(context)]
    for name, command in found:
        assert command is not None
        yield f"| [`{PROGRAM} {name}`](#{PROGRAM}-{name}) | {_paragraphs(command)[0]} |"
    yield ""
    for name, command in found:
        yield from _command(command, click.Context(command, info_name=name, parent=context))


def _paragraphs(command: click.Command) -> list[str]:
    """Return the paragraphs of a command's help; one of lines to type begins with a backspace."""
    parts = inspect.cleandoc(command.help or "").split("\n\n")
    return [part if part.startswith("\b") else " ".join(part.split()).replace("|", "\\|") for part in parts]


def _command(command: click.Command, context: click.Context) -> Iterator[str]:
    """Yield the lines of one command."""
    yield f"## {context.command_path}\n"
    usage = command.get_usage(context).removeprefix("Usage: ")
    yield f"```text\n{' '.join(usage.split())}\n```\n"
    for part in _paragraphs(command):
        lines = part.removeprefix("\b").strip("\n")
        yield f"```text\n{lines}\n```\n" if part.startswith("\b") else f"{lines}\n"
    yield "| option | meaning |\n|---|---|"
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and record[1]:
            name, words = (" ".join(cell.split()) for cell in record)
            yield f"| `{name}` | {words.replace('|', chr(92) + '|')} |"  # in backticks a bar is just a bar
    yield ""

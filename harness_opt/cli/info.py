"""The commands that solve nothing: a first file, a look at a scene, words, schemas, completion."""

from __future__ import annotations

from pathlib import Path

import click

from harness_opt.cli.options import file_argument, folders_option
from harness_opt.cli.run import Voice
from harness_opt.cli.streams import say, tell, warn


@click.command()
@file_argument
@click.option(
    "-o", "--output", "page", metavar="FILE.html", type=click.Path(path_type=Path),
    help="Page to write; results/<name of FILE>_preview.html where left out.",
)  # fmt: skip
@folders_option
def preview(file: Path, page: Path | None, folders: tuple[Path, ...]) -> int:
    """Draw the scene of FILE as it is described, unsolved, as one page for a browser, without any network.

    Parts, clamps and their directions, axes, the bodies at both ends of their motion; what is suspicious is marked.

    \b
    harness-opt preview problems/lift_arm/lift_arm.toml
    harness-opt preview my_cable.toml -o my_cable.html
    """
    from harness_opt.cli.page import write_preview_page

    return write_preview_page(file, page, folders, Voice(say, tell, warn))


@click.command()
@click.argument("name", type=click.Path(path_type=Path))
def new(name: Path) -> int:
    """Write NAME.toml, a problem file with comments that runs as it stands, to change into your own.

    \b
    harness-opt new my_cable
    harness-opt simulate my_cable.toml
    """
    from harness_opt.cli.template import write_template

    file = write_template(name)
    say(f"{file}\nNext: harness-opt check {file}, then harness-opt simulate {file}")
    return 0


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> int:
    """Print what makes SHELL complete commands, options and files.

    \b
    harness-opt completion bash >> ~/.bashrc
    harness-opt completion fish > ~/.config/fish/completions/harness-opt.fish
    """
    from click.shell_completion import get_completion_class

    root = click.get_current_context().find_root().command
    complete = get_completion_class(shell)
    if complete is None:
        raise click.UsageError(f"found no completion for {shell}")
    say(complete(root, {}, "harness-opt", "_HARNESS_OPT_COMPLETE").source())
    return 0


@click.command()
@click.option("--results", "kind", flag_value="results", help="Of summary.json in a result folder.")
@click.option("--study", "kind", flag_value="study", help="Of study files.")
@click.option("--measurements", "kind", flag_value="measurements", help="Of files of measurements, for identify.")
def schema(kind: str | None) -> int:
    """Print the JSON Schema of problem files, for editors; of results, studies and measurements, where asked.

    \b
    harness-opt schema > problem.schema.json
    harness-opt schema --results > summary.schema.json
    """
    import json

    if kind == "results":
        from harness_opt.files.summary import results_schema as wanted
    elif kind == "study":
        from harness_opt.studies.study_file import schema as wanted
    elif kind == "measurements":
        from harness_opt.measured.measurements_file import schema as wanted
    else:
        from harness_opt.files.read import schema as wanted
    say(json.dumps(wanted(), indent=2))
    return 0


@click.command()
@click.argument("words", metavar="[WORD]", nargs=-1)
def explain(words: tuple[str, ...]) -> int:
    """Explain WORD, as results and messages use it; without one, list what can be explained.

    \b
    harness-opt explain snap
    harness-opt explain bend radius
    """
    from harness_opt.cli.explain import explained, names

    if not words:
        say("\n".join(names()))
        return 0
    say(explained(" ".join(words)))
    return 0


COMMANDS = (preview, new, explain, completion, schema)

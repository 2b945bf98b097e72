"""``harness-opt preview``: read, draw as described, tell what to look at."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from harness_opt.cli.run import Voice, naming
from harness_opt.errors import ProblemError

PAGES = (".html", ".htm")


def write_preview_page(file: Path, page: Path | None, folders: Iterable[Path], voice: Voice) -> int:
    """Write the page of the problem in ``file`` and return the exit code.

    Args:
        file: of the problem.
        page: to write; None takes the usual place.
        folders: where files may come from beside the problem's own.
        voice: what the user is told by.

    Raises:
        ProblemError: bad input, or a page that cannot be written.
    """
    from harness_opt.files.read import read_problem
    from harness_opt.parts.scene import load_scene
    from harness_opt.report.preview import warnings_of, write_preview

    target = page or Path("results") / f"{file.stem}_preview.html"
    if target.suffix.lower() not in PAGES:
        raise ProblemError(f"{target}: found no name of a page, expected one that ends in .html")
    problem = read_problem(file, tuple(folders))
    with naming(file):
        scene = load_scene(problem)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_preview(problem, scene, target)
    except OSError as error:
        raise ProblemError(f"{target}: found no way to write it ({error.strerror or error}), expected one") from error
    voice.tell(*(f"{file}: {warning}" for warning in warnings_of(problem, scene)))
    voice.say(f"{target}\nNext: open it in a browser, then harness-opt simulate {file}")
    return 0

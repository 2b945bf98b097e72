"""Words that results and messages use, explained: the glossary of the documentation."""

from __future__ import annotations

import re
import textwrap
from difflib import get_close_matches
from pathlib import Path

from harness_opt.errors import ProblemError
from harness_opt.report.words import WIDTH

GLOSSARY = "glossary.md"  # beside this file, where it is installed; in docs/explain, where it is written
LINK = re.compile(r"\[([^]]*)\]\(([^)]*)\)")
ENTRY = re.compile(r"^(?P<names>\S[^\n]*)\n:[ ]+(?P<words>[^\n]*(?:\n[ ]+[^\n]*)*)", re.MULTILINE)


def names() -> list[str]:
    """Return all words that are explained."""
    return [name for entry, _ in _entries() for name in entry]


def explained(word: str) -> str:
    """Return what ``word`` means, with the page that says more.

    Raises:
        ProblemError: an unknown word.
    """
    asked = _plain(word)
    for entry, words in _entries():
        if asked in map(_plain, entry):
            pages = [page.removeprefix("../") for _, page in LINK.findall(words)]
            told = LINK.sub(r"\1", words).replace("`", "").replace("**", "")
            more = [f"More: docs/{page}" for page in pages]
            return "\n".join([textwrap.fill(f"{', '.join(entry)}: {told}", WIDTH), *more])
    near = get_close_matches(asked, [_plain(name) for name in names()], n=3, cutoff=0.5)
    advice = f"did you mean {' or '.join(repr(name) for name in near)}?" if near else "harness-opt explain lists them"
    raise ProblemError(f"{word}: found no such word, expected one of the glossary; {advice}")


def _plain(word: str) -> str:
    """Return a word as it is compared: case, underscores and plurals do not count."""
    return re.sub(r"s$", "", word.strip().lower().replace("_", " "))


def _entries() -> list[tuple[list[str], str]]:
    """Return the names of each entry, and its words."""
    here = Path(__file__).resolve()
    written = here.parents[2] / "docs" / "explain" / GLOSSARY
    text = (here.with_name(GLOSSARY) if here.with_name(GLOSSARY).is_file() else written).read_text(encoding="utf-8")
    return [(found["names"].split(", "), " ".join(found["words"].split())) for found in ENTRY.finditer(text)]

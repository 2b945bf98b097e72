"""The documentation says what is so: every block of every page runs, and the site builds without a warning."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys

import pytest

from oracles.pages import ROOT, RUN, SHOWN, Reader, blocks, pages

SLOW = {
    "README.md",
    "tutorial.md",
    "none-found.md",
    "studies.md",
    "tolerances.md",
    "python.md",
    "cad-export.md",
    "ci.md",
}
NAMES = [
    pytest.param(page, id=str(page.relative_to(ROOT)), marks=[pytest.mark.slow] if page.name in SLOW else [])
    for page in pages()
]
LOADED = re.compile(
    r"""<(?:script|img|iframe)[^>]*\ssrc=["']?(?:https?:)?//|<link[^>]*\shref=["']?(?:https?:)?//|@import|url\(["']?https?:"""
)


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_every_block_is_of_a_known_language(page):
    assert {block.language for block in blocks(page)} <= {*RUN, *SHOWN}


@pytest.mark.parametrize("page", NAMES)
def test_every_block_runs(page, tmp_path):
    reader = Reader(tmp_path)
    reader.prepare(page)
    for block in blocks(page):
        if block.language in RUN:
            try:
                reader.do(block)
            except Exception as error:
                raise AssertionError(f"{page.relative_to(ROOT)}, line {block.line}: {error}") from error


@pytest.mark.slow
def test_site_builds_and_loads_nothing_from_elsewhere(tmp_path):
    for package in ("mkdocs", "material", "mkdocstrings", "math_core"):
        if not importlib.util.find_spec(package):
            pytest.skip(f"{package} (the extra 'docs') is not installed")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    written = sorted((tmp_path / "site").rglob("*.html"))
    assert len(written) > len(list((ROOT / "docs").rglob("*.md")))  # the pages, and the one for what is not found
    loading = [page.name for page in written if LOADED.search(page.read_text(encoding="utf-8"))]
    assert not loading


def test_prose_is_spelt_as_in_a_dictionary():
    if not importlib.util.find_spec("codespell_lib"):
        pytest.skip("codespell (the extra 'test') is not installed")
    files = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "docs", "problems"]
    done = subprocess.run(
        [sys.executable, "-m", "codespell_lib", *files], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120

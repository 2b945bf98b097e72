"""A hook of MkDocs: formulas become MathML while the site is built, so that pages need no script and no font."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

FORMULA = re.compile(r'<(span|div) class="arithmatex">(.*?)</\1>', re.DOTALL)


def on_page_content(page: str, **_: Any) -> str:
    """Replace what the extension arithmatex has marked by MathML."""
    return FORMULA.sub(_mathml, page)


def _mathml(found: re.Match[str]) -> str:
    block = found[1] == "div"
    latex = html.unescape(found[2]).strip().removeprefix(r"\[" if block else r"\(")
    latex = latex.removesuffix(r"\]" if block else r"\)").strip()
    mathml = convert(latex, display="block" if block else "inline")
    return f'<div class="formula">{mathml}</div>' if block else mathml

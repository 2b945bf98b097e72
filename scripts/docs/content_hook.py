"""A hook of MkDocs: what is done to a page once it is HTML.

Formulas become MathML, so that pages need no script and no font. Roles of docstrings (``:func:``) leave the name alone.
"""

from __future__ import annotations

import html
import re
from typing import Any

from math_core import LatexToMathML

CONVERTER = LatexToMathML()
FORMULA = re.compile(r'<(span|div) class="arithmatex">(.*?)</\1>', re.DOTALL)
ROLE = re.compile(r":(?:func|mod|class|attr|data|meth):<code>~?(?:[a-z_]+\.)*([\w.]+)")


def on_page_content(content: str, /, **_: Any) -> str:
    """Replace what the extension arithmatex has marked by MathML, and roles by names."""
    return ROLE.sub(r"<code>\1", FORMULA.sub(_mathml, content))


def _mathml(found: re.Match[str]) -> str:
    block = found[1] == "div"
    latex = html.unescape(found[2]).strip().removeprefix(r"\[" if block else r"\(")
    latex = latex.removesuffix(r"\]" if block else r"\)").strip()
    mathml = CONVERTER.convert_with_local_state(latex, displaystyle=block)
    return f'<div class="formula">{mathml}</div>' if block else mathml

"""How a mistake is told: the keys that lead to it, what was found, what is expected."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches

from harness_opt.model.limits import quoted

KeyPath = tuple[str, ...]  # the keys that lead to a value
Mistake = tuple[KeyPath, str]  # where, and "found ..., expected ..."

LONGEST_SHOWN = 60  # characters of a wrong value that a message repeats
LARGEST = 1e100  # of any number, in any unit: squares and products of two or three must not overflow

COUPLING = re.compile(
    r"\s*=\s*(?:(?P<factor>[-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\*\s*|(?P<minus>-)\s*)?"
    r"(?P<leader>.+?\.(?:length|(?:start|end)\.(?:position\.[xyz]|rotate_[xyz]_deg)))"
    r"(?:\s*(?P<sign>[-+])\s*(?P<offset>[\d.]+(?:[eE][-+]?\d+)?))?\s*"
)


def shown(value: object) -> str:
    """Return ``value`` as a user would type it in TOML, at most :data:`LONGEST_SHOWN` characters."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, Mapping):
        return "a table"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(shown(item) for item in value[:LONGEST_SHOWN]) + "]"
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, int) and abs(value) > 10**LONGEST_SHOWN:
        # Python refuses to write out numbers of thousands of digits, which TOML's 0x... can hold
        return f"a number of about {round(math.log10(abs(value)))} digits"
    else:
        text = str(value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


def dotted(path: KeyPath) -> str:
    """Return the keys of ``path`` joined by dots, quoted where TOML asks for quotes."""
    return ".".join(quoted(key) for key in path)


def one_of(names: Iterable[str], asked: object = "") -> str:
    """Return ``one of 'a', 'b'``, and which of ``names`` comes nearest to ``asked``."""
    names = list(names)
    listed = ", ".join(repr(name) for name in names[:12]) + (", ..." if len(names) > 12 else "")
    near = get_close_matches(asked, names, n=1) if isinstance(asked, str) else []
    return f"{'one of ' if len(names) > 1 else ''}{listed}" + (f"; did you mean {near[0]!r}?" if near else "")


def coupling(text: str) -> tuple[str, float, float] | None:
    """Return the variable that ``text`` names, the factor and the offset; None where it is of another form.

    ``= NAME``, ``= -NAME``, ``= 2 * NAME``, each with ``+ 0.01`` or ``- 0.01`` behind or not.
    """
    found = COUPLING.fullmatch(text)
    if found is None:
        return None
    try:
        factor = float(found["factor"]) if found["factor"] else -1.0 if found["minus"] else 1.0
        offset = float((found["sign"] or "") + (found["offset"] or "0"))
    except ValueError:  # such as 1.2.3
        return None
    return (found["leader"], factor, offset) if max(abs(factor), abs(offset)) <= LARGEST else None

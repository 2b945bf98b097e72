"""Columns of text: the one layout of all tables that a terminal shows."""

from __future__ import annotations

from collections.abc import Collection, Sequence

WIDTH = 80  # characters of a line, at most where columns may be cut
NARROWEST = 6  # characters to which a column is cut, if need be


def laid_out(
    rows: Sequence[Sequence[str]], left: Collection[int] = (0,), cut: Sequence[int] = (), most: int = WIDTH
) -> list[str]:
    """Return ``rows`` as lines of columns.

    Args:
        rows: cells, the head first; a row may be short of columns at its end.
        left: numbers of the columns set to the left; the others are set to the right.
        cut: numbers of the columns that may be cut, in this order, so that a line has at most ``most`` characters.
        most: characters.
    """
    widths = [max(len(row[i]) for row in rows if i < len(row)) for i in range(max(map(len, rows)))]
    for column in cut:
        excess = sum(widths) + len(widths) - 1 - most
        widths[column] = min(widths[column], max(NARROWEST, widths[column] - max(excess, 0)))
    return [
        " ".join(
            _cell(cell, width, i in left) for i, (cell, width) in enumerate(zip(row, widths, strict=False))
        ).rstrip()
        for row in rows
    ]


def _cell(words: str, width: int, is_left: bool) -> str:
    short = words if len(words) <= width else words[: width - 1] + "~"
    return short.ljust(width) if is_left else short.rjust(width)

"""What a study found, as tables: a row a variant (CSV, Parquet), a line a limit, and the summary."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.files.whole_folder import write_whole
from harness_opt.model.limits import kind_of
from harness_opt.report.words import laid_out, percent
from harness_opt.studies.variant import STATUSES, VariantResult

CSV, PARQUET = "variants.csv", "variants.parquet"
TENTH = 0.1  # the quantile of margins that is reported beside the smallest and the median
REASONS_SHOWN = 5  # of failures in the report, the most frequent first
WIDEST_REASON = 160  # characters

Json = dict[str, Any]


# --- a row a variant -----------------------------------------------------------------------------------


def columns(results: Sequence[VariantResult]) -> dict[str, list[Any]]:
    """Return the table of ``results``, ordered by number, as columns; what a row lacks is None.

    The columns: number, the varied keys, status, reason, worst_limit, worst_margin, then margin.LIMIT and worst.LIMIT
    of every limit, after.VARIABLE of a redesign, frames, snaps and stable. Seconds are none: the table of a study is
    the same whoever ran it.
    """
    results = sorted(results, key=lambda result: result.number)
    rows = [_row(result) for result in results]
    first, last = ["number"], ["frames", "snaps", "stable"]
    varied = dict.fromkeys(key for result in results for key in result.values)
    named = dict.fromkeys(name for row in rows for name in row if name not in (*first, *varied, *last))
    return {name: [row.get(name) for row in rows] for name in (*first, *varied, *named, *last)}


def _row(result: VariantResult) -> dict[str, Any]:
    row: dict[str, Any] = {"number": result.number, **result.values}
    row |= {"status": result.status, "reason": result.reason}
    row |= {"worst_limit": result.worst_limit, "worst_margin": result.worst_margin}
    for prefix in ("margin", "worst", "after"):
        found = result.margins if prefix == "margin" else getattr(result, prefix)
        row |= {f"{prefix}.{name}": value for name, value in found.items()}
    return row | {"frames": result.frames, "snaps": result.snaps, "stable": result.stable}


def csv_text(table: Mapping[str, Sequence[Any]]) -> str:
    """Return a table as CSV: numbers with all their digits, lists and tables as JSON, empty where nothing is known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    for row in zip(*table.values(), strict=True):
        writer.writerow([_cell(value) for value in row])
    return text.getvalue()


def _cell(value: Any) -> Any:
    """Return a value as a cell has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return json.dumps(value) if isinstance(value, (list, dict)) else value


def write_tables(folder: Path, results: Sequence[VariantResult]) -> list[str]:
    """Write the table of ``results``, as CSV and, where pyarrow is installed, as Parquet; return the files' names.

    Raises:
        ProblemError: the disk refuses.
    """
    table = columns(results)
    write_bytes(folder / CSV, csv_text(table).encode("utf-8", "replace"))
    if importlib.util.find_spec("pyarrow") is None:
        return [CSV]
    import pyarrow
    from pyarrow import parquet

    mixed = {name: [_cell(value) if isinstance(value, (list, dict)) else value for value in column]
             for name, column in table.items()}  # fmt: skip
    content = io.BytesIO()
    parquet.write_table(pyarrow.table({name: _alike(column) for name, column in mixed.items()}), content)
    write_bytes(folder / PARQUET, content.getvalue())
    return [CSV, PARQUET]


def _alike(column: list[Any]) -> list[Any]:
    """Return a column of one type: Parquet has no others."""
    kinds = {type(value) for value in column if value is not None}
    if len(kinds) < 2:
        return column
    if kinds == {int, float}:
        return [None if value is None else float(value) for value in column]
    return [None if value is None else str(_cell(value)) for value in column]


def write_json(file: Path, content: Json) -> None:
    """Write ``content`` as strict JSON.

    Raises:
        ProblemError: the disk refuses.
    """
    write_bytes(file, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())


def write_bytes(file: Path, content: bytes) -> None:
    """Put ``content`` in the place of ``file`` in one step.

    Raises:
        ProblemError: the disk refuses.
    """
    try:
        write_whole(file, content)
    except OSError as error:
        raise ProblemError(f"{file}: found no way to write it ({error.strerror}), expected one") from error


# --- the summary ---------------------------------------------------------------------------------------


def facts(results: Sequence[VariantResult], planned: int) -> Json:
    """Return what a study shows: how many variants hold, and how each limit fares.

    Args:
        results: of the finished variants.
        planned: number of variants in all.
    """
    results = sorted(results, key=lambda result: result.number)  # whichever was finished first
    counts = Counter(result.status for result in results)
    reasons = Counter(result.reason for result in results if result.reason)
    names = dict.fromkeys(name for result in results for name in result.margins)
    return {
        "variants": planned,
        "finished": len(results),
        "counts": {status: counts[status] for status in STATUSES if counts[status]},
        "yield": counts["ok"] / len(results) if results else None,
        "limits": [_limit(name, results) for name in names],
        "snapping": sum(result.snaps > 0 for result in results),
        "reasons": [{"reason": reason, "variants": count} for reason, count in reasons.most_common()],
    }


def _limit(name: str, results: Sequence[VariantResult]) -> Json:
    known = [result for result in results if name in result.margins]
    margins = np.array([result.margins[name] for result in known])
    smallest = int(np.argmin(margins))
    return {
        "name": name,
        "held": float(np.mean(margins >= 0)),
        "smallest": float(margins[smallest]),
        "tenth": float(np.quantile(margins, TENTH)),
        "median": float(np.median(margins)),
        "variant": known[smallest].number,
    }


def report(title: str, content: Mapping[str, Any]) -> str:
    """Return the summary of a study in words."""
    lines = [f"{title}: {_counted(content)}", ""]
    if content["limits"]:
        head = ("limit", "held", "smallest", "10 % below", "median", "", "worst variant")
        lines += [*laid_out([head, *(_cells(row) for row in content["limits"])], left=(0, 5)), ""]
    if content["snapping"]:
        lines.append(f"In {content['snapping']} variants a cable snaps to another shape.")
    for row in content["reasons"][:REASONS_SHOWN]:
        words = row["reason"] if len(row["reason"]) <= WIDEST_REASON else row["reason"][:WIDEST_REASON] + "..."
        lines.append(f"{row['variants']} times: {words}")
    held = content["counts"].get("ok", 0)
    share = f" ({percent(content['yield'])})" if content["yield"] is not None else ""
    lines.append(f"{held} of {content['finished']} variants hold every limit{share}.")
    return "\n".join(lines)


def _counted(content: Mapping[str, Any]) -> str:
    """Return how many variants there are and what came of them."""
    done = content["finished"]
    of = f"{done} variants" if done == content["variants"] else f"{done} of {content['variants']} variants"
    return f"{of}; {', '.join(f'{count} {status}' for status, count in content['counts'].items()) or 'none finished'}"


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    unit = kind_of(row["name"]).unit
    margins = [f"{unit.factor * row[key]:+.3g}" for key in ("smallest", "tenth", "median")]
    return (row["name"], percent(row["held"]), *margins, unit.name, str(row["variant"]))

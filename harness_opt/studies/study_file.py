"""Study files: which problem, what is varied and how; TOML to :class:`~harness_opt.studies.variations.Variations`."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag

from harness_opt.errors import ProblemError
from harness_opt.files.places import Places
from harness_opt.files.read import MOST_BYTES, content_of, toml_tables
from harness_opt.files.tolerance_table import WIDTHS, ToleranceTable, tolerance
from harness_opt.files.values import Expected, Number, Seed, Table, Text, Whole, only_integer, schema_of, structured
from harness_opt.model.checks import dotted, one_of, shown
from harness_opt.model.design import Tolerance
from harness_opt.studies.shared_problem import COMMANDS, Command
from harness_opt.studies.variations import METHODS, MOST_VARIANTS, Variations

SPREADS = (*WIDTHS, "distribution", "nominal", "from", "to", "count", "values")
COUNT_MOST = 1_000_000  # values of one key


class SpreadTable(ToleranceTable):
    """What one key is varied by."""

    nominal: Number | None = Field(default=None, description="The middle; the problem's own value where left out.")
    from_: Number | None = Field(default=None, alias="from", description="Smallest value.")
    to: Number | None = Field(default=None, description="Largest value.")
    count: Whole | None = Field(default=None, description="Of a grid: how many values, the ends included.")
    values: list[Any] | None = Field(default=None, description="The values themselves.")


def _kind(value: Any) -> str:
    return "values" if isinstance(value, list) else "table"


Spread = Annotated[
    Annotated[list[Any], Tag("values")] | Annotated[SpreadTable, Tag("table")], Discriminator(_kind)
]  # fmt: skip


class StudyTable(Table):
    """A study file of harness-opt."""

    schema_: Annotated[Literal[1], BeforeValidator(only_integer), Expected("1")] = Field(
        alias="schema", description="Version of this format."
    )
    title: Text = Field(default="", description="One line for people.")
    problem: Text = Field(description="Problem file, relative to this one.")
    command: Annotated[Literal["simulate", "redesign"], Expected(one_of(COMMANDS))] = Field(
        default="simulate", description="What to run for each variant."
    )
    method: Annotated[Literal["grid", "list", "latin hypercube", "monte carlo"], Expected(one_of(METHODS))] = Field(
        description="How variants are made from what is varied."
    )
    samples: Whole | None = Field(default=None, description="How many, of a Latin hypercube or Monte Carlo.")
    seed: Seed = Field(default=0, description="Of the samples; the same seed gives the same.")
    vary: dict[str, Spread] = Field(default_factory=dict, description="By key of the problem, in quotes.")
    variants: list[dict[str, Any]] = Field(default_factory=list, description="Of a list: the values by key, of each.")


@dataclass(frozen=True)
class StudyFile:
    """A study as its file has it.

    Args:
        file, title: of the study.
        problem: path of the problem's file.
        command: what to run for each variant.
        variations: what is varied, and how.
    """

    file: Path
    title: str
    problem: Path
    command: Command
    variations: Variations


def read_study(path: str | os.PathLike[str], folders: Iterable[str | os.PathLike[str]] = ()) -> StudyFile:
    """Return the study that a TOML file describes; the problem that it names is not read.

    Args:
        path: of the study file.
        folders: where the problem may lie beside its folder, as for :func:`harness_opt.read_problem`.

    Raises:
        ProblemError: one line a mistake, as of a problem file.
    """
    file = Path(path)
    raw = toml_tables(content_of(file, "a study file"), file)
    if "cables" in raw and "problem" not in raw:
        words = f"found a problem file, expected a study; a problem is run by: harness-opt simulate {file}"
        raise ProblemError(f"{file}: {words}")
    tables, _, wrong = structured(raw, StudyTable)
    mistakes = [f"{dotted(path)}: {words}" for path, words in wrong]
    if tables is not None:
        places = Places.around(file.parent, folders)
        problem = file.parent / tables.problem
        why = places.fault(tables.problem, "a problem file", None, MOST_BYTES)
        if why:
            mistakes.append(f"problem: {why}")
        mistakes += _crowd(tables)
        if mistakes:  # before anything is listed
            raise ProblemError(f"{file}: {line}" for line in mistakes)
        vary: dict[str, Any] = {}
        for key, spread in tables.vary.items():
            try:
                vary[key] = spread if isinstance(spread, list) else _spread(spread)
            except ProblemError as error:
                mistakes += [f"{dotted(('vary', key))}: {line}" for line in error.mistakes]
        if not mistakes:
            try:
                variations = Variations(tables.method, vary, tables.samples or 0, tables.seed, tuple(tables.variants))
                return StudyFile(file, tables.title, problem, tables.command, variations)
            except ProblemError as error:
                mistakes += error.mistakes
    raise ProblemError(f"{file}: {line}" for line in mistakes)


def _crowd(tables: StudyTable) -> Iterator[str]:
    """Yield that a grid has more variants than anybody waits for, by the counts alone."""
    if tables.method != "grid":
        return
    sizes = [
        len(spread) if isinstance(spread, list) else spread.count or len(spread.values or ()) or 1
        for spread in tables.vary.values()
    ]
    count = math.prod(size for size in sizes if size > 0)
    if count > MOST_VARIANTS:
        yield f"vary: found a grid of {count:,} variants, expected at most {MOST_VARIANTS:,}"


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of study files."""
    return schema_of(StudyTable, "Study file of harness-opt")


def _spread(given: SpreadTable) -> Tolerance | list[Any]:
    """Return the values or the distribution that a table describes.

    Raises:
        ProblemError: none, or several at once.
    """
    content = given.model_dump(by_alias=True)
    named = {key for key in SPREADS if content[key] is not None}
    if named == {"values"}:
        return list(given.values or ())
    if named == {"from", "to", "count"}:
        return _range(content)
    if named in ({"from", "to"}, {"from", "to", "distribution"}):
        if not content["from"] < content["to"]:
            raise ProblemError(f"from: found {shown(content['from'])}, expected a value below to, {shown(given.to)}")
        middle, half = 0.5 * (content["from"] + content["to"]), 0.5 * (content["to"] - content["from"])
        return Tolerance(half, distribution=given.distribution or "uniform", nominal=middle)
    if named & {"values", "from", "to", "count"}:
        words = "plus_minus or deviation, or from and to, or these and count for a grid, or values"
        raise ProblemError(f"found {' and '.join(sorted(named))}, expected {words}")
    return tolerance(content, given.nominal)


def _range(content: Mapping[str, Any]) -> list[float]:
    """Return the values of a grid, the ends included."""
    if not 1 < content["count"] <= COUNT_MOST:
        raise ProblemError(f"count: found {content['count']}, expected at least 2, at most {COUNT_MOST:,}")
    found: list[float] = np.linspace(content["from"], content["to"], content["count"]).tolist()
    return found

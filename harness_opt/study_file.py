"""Study files: which problem, what is varied and how; TOML to :class:`~harness_opt.variations.Variations`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag

from .errors import ProblemError
from .file_checks import unreadable
from .file_schema import Table, structured
from .file_values import Expected, Number, Positive, Text, Whole, dotted, one_of, only_integer, shown
from .problem_file import toml_tables
from .tolerances import DISTRIBUTIONS, Tolerance
from .variations import METHODS, Variations
from .workbench import COMMANDS, Command

SPREADS = ("plus_minus", "plus_minus_percent", "deviation", "deviation_percent", "from", "to", "values")
COUNT_MOST = 1_000_000  # values of one key


class SpreadTable(Table):
    """What one key is varied by."""

    distribution: Annotated[Literal["uniform", "normal", "triangular"], Expected(one_of(DISTRIBUTIONS))] | None = Field(
        default=None, description='"uniform" where left out, "normal" where a deviation is given.'
    )
    plus_minus: Positive | None = Field(default=None, description="Half of the tolerance, in the key's unit.")
    plus_minus_percent: Positive | None = Field(default=None, description="The same, in percent of the nominal value.")
    deviation: Positive | None = Field(
        default=None, description="Standard deviation of a normal distribution, cut off at plus_minus or at four of it."
    )
    deviation_percent: Positive | None = Field(default=None, description="The same, in percent of the nominal value.")
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
    seed: Whole = Field(default=0, description="Of the samples; the same seed gives the same.")
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


def read_study(path: str | os.PathLike[str]) -> StudyFile:
    """Return the study that a TOML file describes; the problem that it names is not read.

    Raises:
        ProblemError: one line a mistake, as of a problem file.
    """
    file = Path(path)
    why = unreadable(file)
    if why:
        raise ProblemError(f"{file}: found {why}, expected a study file")
    tables, _, wrong = structured(toml_tables(file.read_bytes(), file), StudyTable)
    mistakes = [f"{dotted(path)}: {words}" for path, words in wrong]
    if tables is not None:
        problem = file.parent / tables.problem
        why = unreadable(problem)
        if why:
            mistakes.append(f"problem: found {shown(tables.problem)}, {why}, expected a problem file")
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


def _spread(given: SpreadTable) -> Tolerance | list[Any]:
    """Return the values or the distribution that a table describes.

    Raises:
        ProblemError: none, or several at once.
    """
    content = given.model_dump(by_alias=True)
    named = {key for key in SPREADS if content[key] is not None}
    if named == {"values"} and not given.distribution and given.count is None and given.nominal is None:
        return list(given.values or ())
    if named == {"from", "to"} and given.count is not None and not given.distribution and given.nominal is None:
        if not 1 < given.count <= COUNT_MOST:
            raise ProblemError(f"count: found {given.count}, expected at least 2, at most {COUNT_MOST:,}")
        return np.linspace(given.from_, given.to, given.count).tolist()  # type: ignore[arg-type]
    return tolerance(content)


def tolerance(content: Mapping[str, Any]) -> Tolerance:
    """Return the distribution that a table describes.

    Args:
        content: by key of the file; None stands for what is left out.

    Raises:
        ProblemError: none, or several at once.
    """
    named = {key for key in SPREADS if content.get(key) is not None}
    mistakes = list(_misfits(content, named))
    if mistakes:
        raise ProblemError(mistakes)
    distribution: Any = content.get("distribution")
    nominal = content.get("nominal")
    if named == {"from", "to"}:
        middle, half = 0.5 * (content["from"] + content["to"]), 0.5 * (content["to"] - content["from"])
        return Tolerance(half, distribution=distribution or "uniform", nominal=middle)
    percent = any(key.endswith("_percent") for key in named)
    ending = "_percent" if percent else ""
    half, deviation = content.get(f"plus_minus{ending}"), content.get(f"deviation{ending}")
    if half is None:
        return Tolerance.normal(deviation, percent=percent, nominal=nominal)  # type: ignore[arg-type]
    distribution = distribution or ("uniform" if deviation is None else "normal")
    return Tolerance(half, percent, distribution, deviation, nominal)


def _misfits(content: Mapping[str, Any], named: set[str]) -> Iterator[str]:
    """Yield what does not go together in the table of a distribution."""
    whole = {"plus_minus", "deviation"}
    if named == {"from", "to"}:
        if not content["from"] < content["to"]:
            yield f"from: found {shown(content['from'])}, expected a value below to, {shown(content['to'])}"
        if content.get("nominal") is not None:
            yield "nominal: found from and to as well, which have their own middle"
    elif not named or not (named <= whole or named <= {f"{key}_percent" for key in whole}):
        found = " and ".join(sorted(named)) or "no spread"
        words = "plus_minus or deviation, both alike in percent or not, or from and to, or values"
        yield f"found {found}, expected {words}"
    elif content.get("distribution") in ("uniform", "triangular") and named & {"deviation", "deviation_percent"}:
        yield f'distribution: found {shown(content["distribution"])} with a deviation, expected "normal"'
    if content.get("count") is not None:
        yield "count: found one of a distribution, expected it with from and to of a grid"

"""The tables of a file that say how far a quantity may be from its nominal value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from harness_opt.errors import ProblemError
from harness_opt.files.values import Expected, Positive, Table
from harness_opt.model.checks import one_of, shown
from harness_opt.model.design import DISTRIBUTIONS, Tolerance

WIDTHS = ("plus_minus", "plus_minus_percent", "deviation", "deviation_percent")


class ToleranceTable(Table):
    """How far a quantity may be from its nominal value, and how the values are spread."""

    distribution: Annotated[Literal["uniform", "normal", "triangular"], Expected(one_of(DISTRIBUTIONS))] | None = Field(
        default=None, description='"uniform" where left out, "normal" where a deviation is given.'
    )
    plus_minus: Positive | None = Field(default=None, description="Half of the tolerance, in the key's unit.")
    plus_minus_percent: Positive | None = Field(default=None, description="The same, in percent of the nominal value.")
    deviation: Positive | None = Field(
        default=None, description="Standard deviation of a normal distribution, cut off at plus_minus or at four of it."
    )
    deviation_percent: Positive | None = Field(default=None, description="The same, in percent of the nominal value.")


def tolerance(content: Mapping[str, Any], nominal: float | None = None) -> Tolerance:
    """Return the distribution that a :class:`ToleranceTable` describes.

    Args:
        content: by key of the file; None stands for what is left out.
        nominal: the middle; None takes the problem's own value.

    Raises:
        ProblemError: widths that do not go together, or none.
    """
    named = {key for key in WIDTHS if content.get(key) is not None}
    mistakes = list(_misfits(content, named))
    if mistakes:
        raise ProblemError(mistakes)
    percent = any(key.endswith("_percent") for key in named)
    ending = "_percent" if percent else ""
    half, deviation = content.get(f"plus_minus{ending}"), content.get(f"deviation{ending}")
    if half is None:
        return Tolerance.normal(deviation, percent=percent, nominal=nominal)  # type: ignore[arg-type]
    distribution: Any = content.get("distribution") or ("uniform" if deviation is None else "normal")
    return Tolerance(half, percent, distribution, deviation, nominal)


def _misfits(content: Mapping[str, Any], named: set[str]) -> Iterator[str]:
    whole = {"plus_minus", "deviation"}
    if not named or not (named <= whole or named <= {f"{key}_percent" for key in whole}):
        found = " and ".join(sorted(named)) or "no spread"
        yield f"found {found}, expected plus_minus or deviation, both alike in percent or not"
    elif content.get("distribution") in ("uniform", "triangular") and named & {"deviation", "deviation_percent"}:
        yield f'distribution: found {shown(content["distribution"])} with a deviation, expected "normal"'


def content_of(spread: Tolerance) -> dict[str, Any]:
    """Return what :func:`tolerance` reads as ``spread``; its nominal value is left out."""
    ending = "_percent" if spread.percent else ""
    content: dict[str, Any] = {f"plus_minus{ending}": spread.plus_minus}
    if spread.deviation is not None:
        content[f"deviation{ending}"] = spread.deviation
    elif spread.distribution != "uniform":
        content["distribution"] = spread.distribution
    return content

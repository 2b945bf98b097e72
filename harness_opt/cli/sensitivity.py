"""``harness-opt sensitivity``: what moves the worst clearance most, as a table and a tornado chart."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness_opt.cli.ending import UNSOLVED
from harness_opt.cli.run import Voice
from harness_opt.errors import ProblemError, SolveError

if TYPE_CHECKING:
    from harness_opt.design.key_derivatives import Linear
    from harness_opt.files.quantities import Quantities
    from harness_opt.model.design import Tolerance
    from harness_opt.studies.ranking import Effect

TABLE, CHART = "sensitivity.csv", "tornado.png"
REMEDY = 'pip install "harness-opt[studies]"'
SHOWN = 12  # quantities in the printed table


@dataclass(frozen=True)
class _Subject:
    """What is looked at: a problem at its nominal values, the keys, and tolerances where a study states them."""

    quantities: Quantities
    keys: Sequence[str]
    tolerances: Mapping[str, Tolerance]


def run_sensitivity(file: Path, folder: Path | None, as_json: bool, voice: Voice, folders: Sequence[Path] = ()) -> int:
    """Write and tell how far the quantities of ``file`` move its limits; return the exit code.

    Args:
        file: a problem, or a study, whose tolerances then count.
        folder: for table and chart; None is results/<name of the file>_sensitivity.
        as_json: print the table as JSON.
        voice: what the user is told by.
        folders: where files may come from beside the problem's own.

    Raises:
        ProblemError: bad input, or a folder that cannot be written.
    """
    from harness_opt.design.key_derivatives import linear
    from harness_opt.files.result_folder import check_own
    from harness_opt.parts.scene import load_scene
    from harness_opt.report.summary import as_json as as_strict_json
    from harness_opt.studies.ranking import ranked, tightest, worst_margin
    from harness_opt.studies.table import write_bytes

    folder = folder or Path("results") / f"{file.stem}_sensitivity"
    check_own(folder, TABLE)
    subject = _subject(file, folders)
    try:
        found = linear(subject.quantities, subject.keys, load_scene(subject.quantities.problem({})))
    except SolveError as error:
        voice.tell(str(error))
        return UNSOLVED
    limit = tightest(found)
    effects = ranked(found, limit, subject.tolerances)
    unit, factor = limit.kind.unit.name, limit.kind.unit.factor
    heading = f"{limit.words[0].upper()}{limit.words[1:]}: margin {factor * worst_margin(found, limit):.3g} {unit}"
    folder.mkdir(parents=True, exist_ok=True)
    write_bytes(folder / TABLE, _csv(found, subject.tolerances).encode("utf-8", "replace"))
    scaled = [_scaled(effect, factor) for effect in effects]
    if as_json:
        voice.say(
            as_strict_json(
                {"limit": limit.words, "id": str(limit), "unit": unit, "effects": [vars(effect) for effect in scaled]}
            )
        )
    else:
        voice.say("\n".join([heading, "", *_lines(scaled, unit), "", f"Table: {folder / TABLE}"]))
    try:
        from harness_opt.studies.tornado import draw

        draw(folder / CHART, scaled, heading, unit)
    except ImportError as error:
        voice.tell(f"Chart left out: {error}; try {REMEDY}")
    return 0


def _subject(file: Path, folders: Sequence[Path]) -> _Subject:
    """Return what a file asks about: the usual quantities of a problem, or those that a study varies."""
    from harness_opt.design.key_derivatives import usual
    from harness_opt.files.quantities import Quantities, quantities_of
    from harness_opt.files.quantity_keys import differentiable
    from harness_opt.files.read import content_of, toml_tables
    from harness_opt.model.design import Tolerance
    from harness_opt.studies.study_file import read_study
    from harness_opt.studies.variations import expand

    if "method" not in toml_tables(content_of(file, "a problem file or a study file"), file):
        given = quantities_of(file, folders)
        return _Subject(given, list(usual(given)), {})
    study = read_study(file, folders)
    given = quantities_of(study.problem, folders)
    expand(given, study.variations)  # says what is wrong with the study, if anything
    spreads = {
        key: spread
        for key, spread in study.variations.vary.items()
        if isinstance(spread, Tolerance) and differentiable(given[key])
    }
    if not spreads:
        raise ProblemError(f"{file}: vary: found no distribution of a number, expected one for a sensitivity")
    middle = {key: spread.nominal for key, spread in spreads.items() if spread.nominal is not None}
    return _Subject(Quantities(given.changed(middle), given.file, given.places.others), list(spreads), spreads)


def _scaled(effect: Effect, factor: float) -> Effect:
    from harness_opt.studies.ranking import Effect

    return Effect(effect.key, effect.step, factor * effect.per_step, effect.tolerance)


def _lines(effects: Sequence[Effect], unit: str) -> list[str]:
    """Return the ranking as a table."""
    from harness_opt.report.words import laid_out

    within = any(effect.tolerance is not None for effect in effects)
    head = ["quantity", f"{unit} per", "", *(["tolerance", "", unit] if within else [])]
    rows: list[list[str]] = [head]
    for effect in effects[:SHOWN]:
        row = [effect.key, f"{effect.per_step:+.3g}", effect.step]
        if within and effect.tolerance is not None:
            row += [f"+-{effect.tolerance:.3g}", effect.step, f"+-{effect.size:.3g}"]
        rows.append(row)
    lines = laid_out(rows, left=(0, 2, 4))
    rest = len(effects) - SHOWN
    return lines if rest <= 0 else [*lines, f"and {rest} more, each with less effect"]


def _csv(found: Linear, tolerances: Mapping[str, Tolerance]) -> str:
    """Return the effects of all quantities on all limits: a row a quantity, a column a limit, in SI and file units."""
    from harness_opt.studies.ranking import ranked

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns: dict[str, dict[str, Any]] = {}
    for limit in found.limits:
        columns[str(limit)] = {effect.key: effect for effect in ranked(found, limit, tolerances)}
    writer.writerow(["key", "per", "tolerance", *columns])
    for quantity in found.quantities:
        effects = [column[quantity.key] for column in columns.values()]
        # what is not known is an empty cell
        known = (e.per_step if math.isfinite(e.per_step) else None for e in effects)
        writer.writerow([quantity.key, effects[0].step, effects[0].tolerance, *known])
    return text.getvalue()

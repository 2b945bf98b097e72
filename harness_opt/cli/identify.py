"""``harness-opt identify``: what measurements say of a cable's stiffness, as a table, a drawing and a library table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness_opt.cli.ending import UNSOLVED
from harness_opt.cli.run import Voice
from harness_opt.errors import SolveError

if TYPE_CHECKING:
    from harness_opt.measured.fit import Agreement, Estimate, Identification

FOUND, LIBRARY, SHAPES = "identified.json", "cable.toml", "shapes.svg"
NOT_SAID = 1  # exit code: the measurements do not say all that was sought


def run_identify(file: Path, folder: Path | None, as_json: bool, voice: Voice, folders: Sequence[Path] = ()) -> int:
    """Write and tell what the measurements in ``file`` say; return the exit code.

    Args:
        file: of measurements.
        folder: for what is written; None is results/<name of the file>_identified.
        as_json: print what was found as JSON.
        voice: what the user is told by.
        folders: from which points and libraries may be read beside the file's own.

    Raises:
        ProblemError: bad input, or a folder that cannot be written.
    """
    from harness_opt.files.result_folder import check_own
    from harness_opt.measured.drawing import drawing
    from harness_opt.measured.fit import identify
    from harness_opt.measured.measurements_file import read_measurements
    from harness_opt.report.summary import as_json as as_strict_json
    from harness_opt.studies.table import write_bytes

    folder = folder or Path("results") / f"{file.stem}_identified"
    check_own(folder, FOUND)
    given = read_measurements(file, folders)
    try:
        found = identify(given)
    except SolveError as error:
        voice.tell(str(error))
        return UNSOLVED
    content = _content(found)
    folder.mkdir(parents=True, exist_ok=True)
    write_bytes(folder / FOUND, (as_strict_json(content) + "\n").encode())
    write_bytes(folder / LIBRARY, _library(found, file.stem).encode())
    picture = drawing(found)
    if picture:
        write_bytes(folder / SHAPES, picture.encode())
    if as_json:
        voice.say(as_strict_json(content))
    else:
        files = [f"Cable: {folder / LIBRARY}", *([f"Shapes: {folder / SHAPES}"] if picture else [])]
        voice.say("\n".join([*_lines(found), "", *files]))
    return 0 if found.ok else NOT_SAID


def _content(found: Identification) -> dict[str, Any]:
    """Return what was found, for programs: SI units, what is beyond all bounds as null."""

    def known(value: float) -> float | None:
        return value if math.isfinite(value) else None

    cable = found.cable
    return {
        "schema": 1,
        "title": found.given.title,
        "known": found.ok,
        "estimates": {
            one.name: {"value": one.value, "low": known(one.low), "high": known(one.high), "known": one.known}
            for one in found.estimates
        },
        "cable": {
            "diameter": cable.diameter,
            "bending_stiffness": cable.bending_stiffness,
            "torsional_stiffness": cable.torsional_stiffness,
            "mass_per_length": cable.mass_per_length,
            "rest_curvature": list(cable.rest_curvature),
        },
        "construction": None if found.given.band is None else list(found.given.band),
        "measurements": [
            {
                "name": one.name, "unit": one.unit, "measured": one.measured, "before": one.before, "after": one.after,
                "share": one.share,
            }
            for one in found.agreements
        ],
        "scatter": found.scatter,
        "advice": found.advice,
    }  # fmt: skip


def _lines(found: Identification) -> Iterator[str]:
    """Yield what people are told."""
    from harness_opt.report.words import laid_out

    if found.given.title:
        yield found.given.title
        yield ""
    rows = [["found", "value", "", "95 % from", "to", ""]]
    rows += [_estimate(one) for one in found.estimates]
    yield from laid_out(rows, left=(0, 2, 5))
    yield ""
    rows = [["measured", "", "before", "after", "", "share"]]
    rows += [_agreement(one) for one in found.agreements]
    yield from laid_out(rows, left=(0, 4))
    yield ""
    if found.given.band is not None:
        low, high = found.given.band
        yield f"By its construction between {low:.3g} N m2, all wires slipping, and {high:.3g}, all sticking."
    yield f"What is left of the measurements is {found.scatter:.2g} times the errors that were stated or taken."
    if found.advice:
        yield f"{found.advice[0].upper()}{found.advice[1:]}."


def _estimate(one: Estimate) -> list[str]:
    unit = "1/m" if one.name.startswith("rest_curvature") else "N m2"
    if not one.known:
        return [one.name, f"{one.value:.4g}", unit, "", "", "these measurements do not say"]
    return [one.name, f"{one.value:.4g}", unit, f"{one.low:.4g}", f"{one.high:.4g}", ""]


def _agreement(one: Agreement) -> list[str]:
    unit, factor = ("mm", 1e3) if one.unit == "m" else (one.unit, 1.0)
    measured = f"{factor * one.measured:.4g}" if one.share is None else f"{len(one.points)} points"
    share = "" if one.share is None else f"{100 * one.share:.2f} %"
    return [one.name, measured, f"{factor * one.before:.4g}", f"{factor * one.after:.4g}", unit, share]


def _library(found: Identification, name: str) -> str:
    """Return the cable as a table of a library, its intervals as comments."""
    from harness_opt.model.limits import quoted

    cable, told = found.cable, {one.name: one for one in found.estimates}
    lines = [f"[{quoted(name)}]", f"diameter = {cable.diameter!r}"]
    for key in ("bending_stiffness", "torsional_stiffness"):
        one = told.get(key)
        comment = "" if one is None else f"  # N m2, 95 % from {one.low:.4g} to {one.high:.4g}"
        if one is not None and not one.known:
            comment = "  # N m2, not known: the measurements do not say"
        lines.append(f"{key} = {getattr(cable, key)!r}{comment}")
    if cable.mass_per_length:
        lines.append(f"mass_per_length = {cable.mass_per_length!r}")
    if any(cable.rest_curvature):
        lines.append(f"rest_curvature = {list(cable.rest_curvature)!r}")
    return "\n".join(lines) + "\n"

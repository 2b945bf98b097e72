"""A summary in words, for people: the table of limits and the verdict, at most 80 columns wide."""

from __future__ import annotations

import importlib.util
import textwrap
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from harness_opt.files.summary import (
    LimitEntry,
    PairEntry,
    Summary,
    limit_of,
    moments_of,
)
from harness_opt.model.limits import FORCES, KIND_OF_KEY, spoken
from harness_opt.model.problem import SHARES, Moments
from harness_opt.report.redesign_words import changes, redesign_words

ANSWERS = {"yes": "OK", "no": "VIOLATED", "uncertain": "UNCERTAIN"}
HEAD = ("limit", "cable", "part", "limit", "worst", "margin", "", "at", "motion", "arc mm", "")
OWN, SHARE = 7, 8  # columns of HEAD: where the motion stands in its own unit, and its share of all
WIDTH = 80  # characters of a line, at most where columns may be cut
NARROWEST = 6  # characters to which a column is cut, if need be
LEFT = {0, 1, 2, 6, 10}  # columns set to the left, the others to the right
CLIPS = ("cable", "clip", "kind", "at mm", "force", "moment")
SHEET = ("cable", "bend radius", "diameters", "twist", "bend range", "twist range", "sag")
NAMES = (2, 1)  # columns that may be cut, in this order
LARGE = 1e5  # from which numbers are rounded to two digits: a straight cable's bend radius


def table(limits: Sequence[LimitEntry], moments: Moments = SHARES, before: Sequence[LimitEntry] | None = None) -> str:
    """Return the limits of a summary as a table of at most 80 columns; nothing where there are none.

    Args:
        limits: the rows.
        moments: what their moments are told in beside per cent.
        before: those of the drawn design, for a column with what the worst was there; None leaves that out.
    """
    if not limits:
        return ""
    told = next((words for words in map(moments.short, (row["motion"] for row in limits)) if words), "")
    head = (*HEAD[:OWN], told.partition(" ")[2], *HEAD[SHARE:])
    rows, left = [head, *(_cells(row, moments) for row in limits)], LEFT
    if before is not None:
        worst = {row["id"]: _number(row["worst"], KIND_OF_KEY[row["name"]].unit.factor) for row in before}
        column = ["before", *(worst.get(row["id"], "-") for row in limits)]
        rows = [(*row[:4], old, *row[4:]) for row, old in zip(rows, column, strict=True)]
        rows[0] = tuple("after" if cell == "worst" else cell for cell in rows[0])
        left = {number + (number > 3) for number in LEFT}
        if told:  # there is no room for both
            rows = [(*row[: SHARE + 1], *row[SHARE + 2 :]) for row in rows]
            left = {number - (number > SHARE) for number in left}
    return "\n".join(laid_out(rows, left, NAMES))


def _cells(row: LimitEntry, moments: Moments) -> tuple[str, ...]:
    kind = KIND_OF_KEY[row["name"]]
    return (
        kind.words,
        row["cable"],
        against(row) or "-",
        _number(row["limit"], kind.unit.factor),
        _number(row["worst"], kind.unit.factor),
        _number(row["margin"], kind.unit.factor, "+"),
        kind.unit.name if row["worst"] is not None else "",
        "" if row["worst"] is None else moments.short(row["motion"]).partition(" ")[0],
        *where(row),
        ANSWERS[row["holds"]],
    )


def _number(value: float | None, scale: float, sign: str = "") -> str:
    if value is None:
        return "-"
    scaled = value * scale
    return format(scaled, f"{sign}.2g") if abs(scaled) >= LARGE else format(scaled, f"{sign}.2f")


def percent(motion: float) -> str:
    """Return a moment of the motion, given 0 to 1, as ``28.1%``."""
    return f"{100 * motion:.1f}%"


def where(row: LimitEntry) -> tuple[str, str]:
    """Return when and where, in mm of arc, the worst of a row stands; dashes where there is none."""
    if row["worst"] is None:
        return "-", "-"
    return f"{100 * row['motion']:.0f}%", f"{1e3 * row['arc_length']:.0f}"


def quantity(row: LimitEntry, value: float | None, sign: str = "") -> str:
    """Return a value of a limit in the unit shown, as ``3.01 mm``."""
    unit = KIND_OF_KEY[row["name"]].unit
    return "-" if value is None else f"{_number(value, unit.factor, sign)} {unit.name}"


def against(row: LimitEntry) -> str:
    """Return what a row's clearance is measured to, as the cell of a table; nothing for other limits."""
    if row["other_cable"] is None:
        return row["part"] or row.get("clip") or ""
    return "itself" if row["other_cable"] == row["cable"] else f"cable {row['other_cable']}"


def doubt(row: LimitEntry) -> str:
    """Return why it is not certain whether a limit holds, and what to do about it; nothing where it is certain."""
    if row["holds"] != "uncertain":
        return ""
    if not row["certified"]:
        longer = ", or more length where the cable is taut" if row["name"] in {kind.value for kind in FORCES} else ""
        return f"{row['reason'] or 'not looked at between the frames'}; try a smaller --spatial-step{longer}"
    spare, sure = quantity(row, row["margin"]), quantity(row, row["tolerance"])
    remedy = "ask for a little more, or try a smaller --clearance-tolerance or --spatial-step"
    return f"{spare} to spare are known to {sure} only; {remedy}"


def limit_words(row: LimitEntry) -> str:
    """Return what a row is about: ``clearance of lead to bracket``."""
    return limit_of(row).words


def report(summary: Summary) -> str:
    """Return a whole summary in words: title, limits, what changed, what to know, the verdict last."""
    redesigned = summary.get("redesign")
    before = None if redesigned is None else redesigned["limits_before"]
    limits = table(summary["limits"], moments_of(summary), before)
    blocks = [_headline(summary), limits, data_sheet(summary), clips(summary), changes(summary)]
    told = [*notes(summary), *redesign_words(summary), conclusion(summary)]
    blocks.append("\n".join(_wrapped(note) for note in told))
    return "\n\n".join(block for block in blocks if block)


def data_sheet(summary: Summary) -> str:
    """Return what cable makers state, a line for each cable; nothing where nothing was solved."""
    rows = [SHEET]
    for name, sheet in summary["data_sheet"].items():
        radius, diameters = sheet["bend_radius"], sheet["bend_diameters"]
        straight = radius is None or diameters is None or radius >= LARGE
        rows.append(
            (
                name,
                "straight" if straight else f"{1e3 * (radius or 0.0):.1f} mm",
                "-" if straight else f"{diameters:.1f}",
                f"{sheet['twist_deg_per_m']:.0f} deg/m",
                f"{sheet['bend_range']['range']:.3g} 1/m",
                f"{sheet['twist_range_deg_per_m']['range']:.0f} deg/m",
                "-" if sheet["sag"] is None else f"{1e3 * sheet['sag']:.0f} mm",
            )
        )
    return "\n".join(laid_out(rows, cut=(0,))) if len(rows) > 1 else ""


def clips(summary: Summary) -> str:
    """Return what clips do, a line for each; nothing where cables have none."""
    rows = [CLIPS]
    for clip in summary.get("clips", []):
        first, least, most = (1e3 * at for at in clip["arc_length"])
        slid = f"{least:.1f} to {most:.1f}" if clip["kind"] in ("sleeve", "ring") else f"{first:.1f}"
        force, moment = (0.0 if clip[load] is None else clip[load] for load in ("force", "moment"))
        rows.append((clip["cable"], clip["clip"], clip["kind"], slid, f"{force:.2f} N", f"{moment:.3f} N m"))
    return "\n".join(laid_out(rows, cut=(0, 1))) if len(rows) > 1 else ""


def advice(summary: Summary, folder: Path | None) -> list[str]:
    """Return what to do next, a line each.

    Args:
        summary: of a run.
        folder: where its results were written, or None.
    """
    file, lines = summary["problem"]["file"], []
    if folder is None:
        return []
    if summary["command"] == "simulate" and summary["status"] == "violated" and file:
        lines.append(f"Next: harness-opt redesign {_shown(file)}")
    elif summary["command"] == "redesign" and summary["status"] == "ok":
        lines.append(f"Next: harness-opt simulate {folder / 'redesigned.toml'}")
    elif summary["status"] == "infeasible":
        lines.append("Next: widen bounds in [design.variables], let more change, or relax a limit in the way.")
    if summary["snaps"]:
        lines.append("What a snap is: harness-opt explain snap")
    if any(row["holds"] == "uncertain" for row in summary["limits"]):
        lines.append("What uncertain means: harness-opt explain uncertain")
    if "report.html" in summary["files"]:
        lines.append(f"Report: {folder / 'report.html'}")
        if importlib.util.find_spec("pyvista") is not None:
            lines.append(f"Window: harness-opt show {folder}")
    return lines


def _shown(file: str) -> str:
    """Return a file's path from here where that is shorter."""
    try:
        return str(Path(file).relative_to(Path.cwd()))
    except ValueError:
        return file


def _headline(summary: Summary) -> str:
    problem, frames = summary["problem"], summary["frames"]
    title = problem["title"] or problem["file"] or "A problem without title"
    counted = "1 frame" if frames == 1 else f"{frames} frames"
    return _wrapped(f"{title}: {counted}, {summary['timing']['total']:.1f} s")


def notes(summary: Summary) -> Iterable[str]:
    """Give what to know about a summary, a sentence each."""
    snaps = []
    for snap in summary["snaps"]:
        at = f"{moments_of(summary).words(snap['motion'])}, frame {snap['frame']}"
        through = ", through itself," if snap["passes_through_itself"] else ""
        snaps.append(f"Cable {snap['cable']} snaps to another shape{through} at {at}.")
    yield from dict.fromkeys(snaps)  # of a cable whose spans all jump together once
    if summary["frames"] and not summary["stable"]:
        yield "Some frames show an unstable shape."
    yield from _certainty(summary)
    for name in summary["open_meshes"]:
        yield f"Part {name} is not closed: it is a shell, and a cable inside it goes unnoticed."
    near = [words for entry in summary["clearances"] if (words := _excluded(entry))]
    if near:
        yield f"Not measured where the cable leaves its clamp: {', '.join(near)}."
    missing = [words for words in summary["left_out"] if words != "pictures"]  # they are drawn where asked for
    if missing:
        yield f"Left out: {', '.join(missing)}."


def _certainty(summary: Summary) -> Iterable[str]:
    """Return how sure the clearances are, and which are not, and why."""
    rows = [row for row in summary["limits"] if row["name"] == "clearance"]
    sure = [row["tolerance"] or 0.0 for row in rows if row["certified"]]
    between = sum(summary["frames_solved_between"].values())
    if sure and summary["frames"] > 1:
        added = f"; {between} more {'frame was' if between == 1 else 'frames were'} solved for that" if between else ""
        which = "Clearances" if len(sure) == len(rows) else "The other clearances"
        yield f"{which} are known between the frames too, to {1e3 * max(sure):.2g} mm{added}."
    for row in summary["limits"]:
        if doubt(row):
            yield f"Not certain: {limit_words(row)}: {doubt(row)}."


def _excluded(entry: PairEntry) -> str:
    """Return the lengths near clamps that a clearance leaves out: ``lead to housing (first 14.2 mm)``."""
    lengths = entry["excluded_near_clamps"]
    named = [("first", lengths["start"]), ("last", lengths["end"])]
    ends = " and ".join(f"{word} {1e3 * length:.1f} mm" for word, length in named if length)
    return f"{spoken(entry['cable'])} to {spoken(entry['part'])} ({ends})" if ends else ""


def conclusion(summary: Summary) -> str:
    """Return the verdict as a sentence or two."""
    limits, status = summary["limits"], summary["status"]
    moments = moments_of(summary)
    short = [f"{limit_words(row)} ({_shortfall(row, moments)})" for row in limits if row["holds"] == "no"]
    unsure = [limit_words(row) for row in limits if row["holds"] == "uncertain"]
    if status == "unsolved":
        return f"Not solved: {summary['message'] or summary['reason']}"
    if status == "infeasible":
        in_the_way = [*short, *dict.fromkeys(f"a snap of {snap['cable']}" for snap in summary["snaps"])]
        looked = f"None found among {summary['redesign']['looked_at']} designs looked at that holds all limits"
        return f"{looked}; the one given violates them least. In the way: {'; '.join(in_the_way)}."
    if not limits:
        return "Solved; there are no limits to hold."
    more = f" Not certain to hold: {'; '.join(unsure)}." if unsure else ""
    if short:
        return f"{len(short)} of {len(limits)} limits violated: {'; '.join(short)}.{more}"
    if unsure:
        count = f"{len(unsure)} of {len(limits)} limits"
        return f"No limit is found violated, but {count} are not certain to hold: {'; '.join(unsure)}."
    return "The limit holds." if len(limits) == 1 else f"All {len(limits)} limits hold."


def _shortfall(row: LimitEntry, moments: Moments) -> str:
    if row["margin"] is None:
        return "not known"
    return f"by {quantity(row, -row['margin'])} at {moments.words(row['motion'])}"


def _wrapped(words: str) -> str:
    return textwrap.fill(words, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


# --- columns --------------------------------------------------------------------------------------------


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

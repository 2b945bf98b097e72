"""A summary in words, for people: the table of limits and the verdict, at most 80 columns wide."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

WIDTH = 80
NARROWEST = 6  # to which names are cut, if need be
# unit shown for a kind of limit, how many of them are one of the problem file's unit, and a step worth speaking of
LENGTH, ANGLE = ("mm", 1e3, 1.0), ("deg", 1.0, 1.0)  # of bounds
UNITS = {
    "clearance": ("mm", 1e3, 1.0),
    "bend_radius": ("mm", 1e3, 1.0),
    "twist_deg_per_m": ("deg/m", 1.0, 10.0),
    "clamp_force": ("N", 1.0, 0.1),
    "clamp_moment": ("Nm", 1.0, 0.01),
}
LEAST_BOUGHT = 0.05  # of what the best variable buys, in its unit: less is not worth saying
TRADES = 2  # variables named for each limit
SAVED = {"change": ("{:.2g} % of the change", 100.0), "length": ("{:.2g} mm of length", 1e3)}
HEAD = ("limit", "cable", "part", "limit", "worst", "margin", "", "motion", "arc mm", "")
LEFT = {0, 1, 2, 6, 9}  # columns set to the left, the others to the right
SHEET = ("cable", "bend radius", "diameters", "twist", "bend range", "twist range", "sag")
NAMES = (2, 1)  # columns that may be cut, in this order
LARGE = 1e5  # from which numbers are rounded to two digits: a straight cable's bend radius


def table(limits: Sequence[Mapping[str, Any]]) -> str:
    """Return the limits of a summary as a table of at most 80 columns; nothing where there are none."""
    if not limits:
        return ""
    rows = [HEAD, *(_cells(row) for row in limits)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    for column in NAMES:
        excess = sum(widths) + len(widths) - 1 - WIDTH
        widths[column] = min(widths[column], max(NARROWEST, widths[column] - max(excess, 0)))
    return "\n".join(_line(row, widths) for row in rows)


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    unit, scale = UNITS[row["name"]][:2]
    return (
        label(row["name"]),
        row["cable"],
        against(row) or "-",
        _number(row["limit"], scale),
        _number(row["worst"], scale),
        _number(row["margin"], scale, "+"),
        unit,
        percent(row["motion"]),
        f"{1e3 * row['arc_length']:.0f}",
        "OK" if holds(row) else "VIOLATED",
    )


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = []
    for i, (cell, width) in enumerate(zip(row, widths, strict=True)):
        short = _cut(cell, width)
        cells.append(short.ljust(width) if i in LEFT else short.rjust(width))
    return " ".join(cells).rstrip()


def _cut(words: str, width: int) -> str:
    return words if len(words) <= width else words[: width - 1] + "~"


def _number(value: float | None, scale: float, sign: str = "") -> str:
    if value is None:
        return "-"
    scaled = value * scale
    return format(scaled, f"{sign}.2g") if abs(scaled) >= LARGE else format(scaled, f"{sign}.2f")


def percent(motion: float) -> str:
    """Return a moment of the motion, given 0 to 1, as ``28.1%``."""
    return f"{100 * motion:.1f}%"


def quantity(name: str, value: float | None, sign: str = "") -> str:
    """Return a value of the limit called ``name``, in the unit of the problem file, as ``3.01 mm``."""
    unit, scale, _ = UNITS[name]
    return f"{_number(value, scale, sign)} {unit}"


def label(name: str) -> str:
    """Return the words for the limit called ``name``."""
    return name.removesuffix("_deg_per_m").replace("_", " ")


def against(row: Mapping[str, Any]) -> str:
    """Return what a row's clearance is measured to; nothing for other limits."""
    part = row["part"] or ""
    other = part.removeprefix("cable:")
    if other == part:
        return part
    return "itself" if other == row["cable"] else f"cable {other}"


def holds(row: Mapping[str, Any]) -> bool:
    """Return whether a row's limit holds."""
    return row["margin"] is not None and row["margin"] >= 0


def limit_words(row: Mapping[str, Any]) -> str:
    """Return what a row is about: ``clearance of lead to bracket``."""
    part = against(row)
    return f"{label(row['name'])} of {row['cable']}" + (f" to {part}" if part else "")


def report(summary: Mapping[str, Any]) -> str:
    """Return a whole summary in words: title, limits, what changed, what to know, the verdict last."""
    blocks = [_headline(summary), table(summary["limits"]), data_sheet(summary), _changes(summary)]
    told = [*notes(summary), *redesign_words(summary), conclusion(summary)]
    blocks.append("\n".join(_wrapped(note) for note in told))
    return "\n\n".join(block for block in blocks if block)


def data_sheet(summary: Mapping[str, Any]) -> str:
    """Return what cable makers state, a line for each cable; nothing where nothing was solved."""
    rows = [SHEET]
    for name, sheet in summary.get("data_sheet", {}).items():
        straight = sheet["bend_radius"] >= LARGE
        rows.append(
            (
                name,
                "straight" if straight else f"{1e3 * sheet['bend_radius']:.1f} mm",
                "-" if straight else f"{sheet['bend_diameters']:.1f}",
                f"{sheet['twist_deg_per_m']:.0f} deg/m",
                f"{sheet['bend_range']['range']:.3g} 1/m",
                f"{sheet['twist_range_deg_per_m']['range']:.0f} deg/m",
                "-" if sheet["sag"] is None else f"{1e3 * sheet['sag']:.0f} mm",
            )
        )
    if len(rows) == 1:
        return ""
    widths = [max(len(row[i]) for row in rows) for i in range(len(SHEET))]
    widths[0] = min(widths[0], max(NARROWEST, WIDTH - sum(widths[1:]) - len(widths) + 1))
    lines = [
        " ".join(
            _cut(c, w).ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    ]
    return "\n".join(lines)


def advice(summary: Mapping[str, Any], folder: Path | None) -> list[str]:
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
    if "report.html" in summary["files"]:
        lines.append(f"Report: {folder / 'report.html'}")
        if "pictures" not in summary["left_out"]:
            lines.append(f"Window: harness-opt show {folder}")
    return lines


def _shown(file: str) -> str:
    """Return a file's path from here where that is shorter."""
    try:
        return str(Path(file).relative_to(Path.cwd()))
    except ValueError:
        return file


def _headline(summary: Mapping[str, Any]) -> str:
    problem, frames = summary["problem"], summary["frames"]
    title = problem["title"] or problem["file"] or "A problem without title"
    counted = "1 frame" if frames == 1 else f"{frames} frames"
    return _wrapped(f"{title}: {counted}, {summary['timing']['total']:.1f} s")


def _changes(summary: Mapping[str, Any]) -> str:
    variables = summary.get("redesign", {}).get("variables", {})
    lines = []
    for name, found in variables.items():
        after = "-" if found["after"] is None else f"{found['after']:.6g}"
        unit = "deg" if name.endswith("_deg") else "m"
        bounds = f"[{found['lower']:g}, {found['upper']:g}]"
        lines.append(f"{name}: {found['before']:.6g} -> {after} {unit}, within {bounds}")
    return "\n".join(lines)


def notes(summary: Mapping[str, Any]) -> Iterable[str]:
    """Give what to know about a summary, a sentence each."""
    for snap in summary["snaps"]:
        at = f"motion {percent(snap['motion'])} (frame {snap['frame']})"
        yield f"Cable {snap['cable']} snaps to another shape at {at}."
    if summary["frames"] and not summary["stable"]:
        yield "Some frames show an unstable shape."
    yield from _certainty(summary)
    for name in summary["open_meshes"]:
        yield f"Part {name} is not closed: it is a shell, and a cable inside it goes unnoticed."
    near = [words for entry in summary["clearances"] if (words := _excluded(entry))]
    if near:
        yield f"Not measured where the cable leaves its clamp: {', '.join(near)}."
    if summary["left_out"]:
        yield f"Left out: {', '.join(summary['left_out'])}."


def _certainty(summary: Mapping[str, Any]) -> Iterable[str]:
    """Return how sure the clearances are, and which are not, and why."""
    rows = [row for row in summary["limits"] if row["name"] == "clearance"]
    sure = [row["tolerance"] for row in rows if row["certified"]]
    between = sum(summary["frames_solved_between"].values())
    if sure and summary["frames"] > 1:
        added = f"; {between} more {'frame was' if between == 1 else 'frames were'} solved for that" if between else ""
        which = "Clearances" if len(sure) == len(rows) else "The other clearances"
        yield f"{which} hold between the frames too, to {1e3 * max(sure):.2g} mm{added}."
    for row in rows:
        if not row["certified"]:
            yield f"Not certain: {limit_words(row)}: {row['reason']}."


def _excluded(entry: Mapping[str, Any]) -> str:
    """Return the lengths near clamps that a clearance leaves out: ``lead to housing (first 14.2 mm)``."""
    lengths = entry["excluded_near_clamps"]
    named = [("first", lengths["start"]), ("last", lengths["end"])]
    ends = " and ".join(f"{word} {1e3 * length:.1f} mm" for word, length in named if length)
    return f"{entry['cable']} to {entry['part']} ({ends})" if ends else ""


def conclusion(summary: Mapping[str, Any]) -> str:
    """Return the verdict as a sentence or two."""
    limits, status = summary["limits"], summary["status"]
    short = [f"{limit_words(row)} ({_shortfall(row)})" for row in limits if not holds(row)]
    if status == "unsolved":
        return f"Not solved: {summary['message'] or summary['reason']}"
    if status == "infeasible":
        in_the_way = [*short, *(f"a snap of {snap['cable']}" for snap in summary["snaps"])]
        active = summary["redesign"]["active"]
        held = f" It is held by: {'; '.join(active)}." if active else ""
        found = "No design within the bounds holds all limits; the best one found is given."
        return f"{found} In the way: {'; '.join(in_the_way)}.{held}"
    if not limits:
        return "Solved; there are no limits to hold."
    if short:
        return f"{len(short)} of {len(limits)} limits violated: {'; '.join(short)}."
    return "The limit holds." if len(limits) == 1 else f"All {len(limits)} limits hold."


def _shortfall(row: Mapping[str, Any]) -> str:
    if row["margin"] is None:
        return "not known"
    unit, scale = UNITS[row["name"]][:2]
    return f"by {_number(-row['margin'], scale)} {unit} at motion {percent(row['motion'])}"


def _wrapped(words: str) -> str:
    return textwrap.fill(words, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def redesign_words(summary: Mapping[str, Any]) -> Iterator[str]:
    """Give what there is to say about a redesign beside its limits, a sentence each; nothing about a simulation."""
    found = summary.get("redesign", {})
    for name, moved in found.get("moved_inside", {}).items():
        unit, scale, _ = _unit(name, "")
        a, b = (f"{scale * moved[key]:.6g}" for key in ("from", "to"))
        why = "where what it follows puts it" if name in found["coupled"] else "inside its bounds"
        yield f"{name} stood at {a} {unit}; the redesign began at {b} {unit}, {why}."
    yield from _ways_out(found.get("in_the_way", []))
    for cost in found.get("costs", []):
        yield from _cost(cost)
    yield from _robust(found.get("robust"))
    curve = found.get("pareto")
    if curve is not None:
        held = sum(point["verified"] for point in curve["points"])
        yield f"{held} verified designs trade {curve['first']} for {curve['second']}: see pareto.csv."


def _unit(key: str, kind: str) -> tuple[str, float, float]:
    return UNITS.get(kind, ANGLE if key.endswith("_deg") else LENGTH)


def _what(entry: Mapping[str, Any]) -> str:
    """Return what a relaxation or a cost is about: ``bend radius``, ``clearance of housing``, ``lead.length``."""
    words = entry["kind"].removesuffix("_deg_per_m").replace("_", " ")
    if entry["key"].startswith("parts."):
        return f"{words} to {entry['key'].removeprefix('parts.').rpartition('.')[0]}"
    return words if entry["key"].startswith("limits.") else entry["key"].removeprefix("design.variables.")


def _ways_out(entries: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Say what giving way in one limit or bound alone would do."""
    ways = [_way_out(entry) for entry in entries if entry["enough"] is not None]
    if ways:
        yield f"{'Either of these' if len(ways) > 1 else 'This'} alone would do: {'; '.join(ways)}."
    rest = [_what(entry) for entry in entries if entry["enough"] is None]
    if rest:
        yield f"Giving way in one of these alone would not do: {'; '.join(dict.fromkeys(rest))}."


def _way_out(entry: Mapping[str, Any]) -> str:
    unit, scale, _ = _unit(entry["key"], entry["kind"])
    change = entry["enough"] - entry["value"]
    more = f"{abs(scale * change):.3g} {unit} {'more' if change > 0 else 'less'}"
    if entry["kind"] in UNITS:
        return f"{more} {_what(entry)} ({entry['key']} = {entry['enough']:.6g})"
    side = "up" if entry["kind"] == "upper" else "down"
    return f"{more} {_what(entry)} (bound {side} to {entry['enough']:.6g})"


def _cost(entry: Mapping[str, Any]) -> Iterator[str]:
    """Say what a limit or bound costs, and what buys it."""
    unit, scale, step = _unit(entry["key"], entry["kind"])
    words, share = SAVED.get(entry["of"], ("{:.2g} % of the worst margin's limit", 100.0))
    saved = words.format(share * entry["saves"] * step / scale)
    gains = "add" if entry["of"] == "margin" else "save"
    # loads and twist hold below their limits, bounds give way to their own side
    more = entry["kind"] in ("twist_deg_per_m", "clamp_force", "clamp_moment", "upper")
    yield f"{step:g} {unit} {'more' if more else 'less'} {_what(entry)} would {gains} {saved}."
    yield from _bought(entry)


def _bought(entry: Mapping[str, Any]) -> Iterator[str]:
    unit, scale, _ = _unit(entry["key"], entry["kind"])
    steps = {name: rate / _unit(name, "")[1] * scale for name, rate in entry["buys"].items()}
    best = sorted(steps, key=lambda name: -abs(steps[name]))[:TRADES]
    told = [
        f"1 {_unit(name, '')[0]} {'more' if steps[name] > 0 else 'less'} {name} buys {abs(steps[name]):.2g} {unit}"
        for name in best
        if abs(steps[name]) > LEAST_BOUGHT * abs(steps[best[0]])
    ]
    if told:
        yield f"Of {_what(entry)}, {', '.join(told)}."


def _robust(found: Mapping[str, Any] | None) -> Iterator[str]:
    """Say how a design fares within tolerances."""
    if found is None or found["after"] is None:
        return
    held = "hold" if found["holds"] else "do not hold"
    where = "at every corner" if found["hold"] == "corners" else f"for {_share(found['asked'])} of what is built"
    yield f"Within the tolerances all limits {held} {where}, by linearised margins."
    shares = [None if found[when] is None else found[when]["share"] for when in ("before", "after")]
    yield f"Yield by linearised margins: {' -> '.join('?' if share is None else _share(share) for share in shares)}."
    for when in ("yield_before", "yield_after"):
        if found[when] is not None:
            entry, words = found[when], when.replace("_", " ").capitalize()
            share = f"{_share(entry['share'])} +- {100.0 * entry['error']:.1f} %"
            linear = _share(entry["linear"])
            yield f"{words}, {entry['samples']} samples simulated: {share}; by linearised margins: {linear}."


def _share(share: float) -> str:
    return f"{100.0 * share:.1f} %"

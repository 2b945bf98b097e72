"""The trade-off curve as files: a table, a problem file for each point, and a plot where matplotlib is installed."""

from __future__ import annotations

import csv
from pathlib import Path

from harness_opt.design.trade_off import AIMS, FLOORS, TradeOff
from harness_opt.files.read import write_problem
from harness_opt.files.summary import TradeOffEntry
from harness_opt.model.limits import MILLIMETRES, LimitKind, Unit
from harness_opt.report.colours import VERIFIED, VIOLATED

TABLE, PLOT = "pareto.csv", "pareto.png"
AIM_UNITS = {"length": MILLIMETRES, "change": Unit("", 1.0, 2)}  # in which aims are plotted


def _in_file(name: str) -> tuple[str, float]:
    """Return what a quantity is called in the problem file, and how many of its units there one SI unit is."""
    return (name, 1.0) if name in AIMS else (LimitKind(name).key, LimitKind(name).from_si)


def trade_off_summary(curve: TradeOff) -> TradeOffEntry:
    """Return ``curve`` as a summary has it, in the units of the problem file."""
    (first, a), (second, b), (stepped, c) = map(_in_file, (curve.first, curve.second, curve.stepped))
    points = [
        {
            first: a * point.first,
            second: b * point.second,
            "asked": c * point.asked,
            "verified": point.verified,
            "variables": dict(point.values),
            "file": name,
        }
        for point, name in zip(curve.points, point_files(curve), strict=True)
    ]
    return TradeOffEntry(first=first, second=second, stepped=stepped, points=points)


def point_files(curve: TradeOff) -> list[str]:
    """Return the names of the problem files of the points."""
    return [f"pareto_{number}.toml" for number in range(1, len(curve.points) + 1)]


def write_trade_off(curve: TradeOff, folder: Path) -> None:
    """Write the table, the problem files and the plot of ``curve`` into ``folder``.

    Raises:
        ProblemError: a file cannot be written.
    """
    content = trade_off_summary(curve)
    names = list(content["points"][0]["variables"]) if content["points"] else []
    with open(folder / TABLE, "w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow([content["first"], content["second"], "asked", "verified", "file", *names])
        for row in content["points"]:
            numbers = (row[content["first"]], row[content["second"]], row["asked"])
            verified = "yes" if row["verified"] else "no"
            table.writerow([*map(repr, numbers), verified, row["file"], *map(repr, row["variables"].values())])
    for point, name in zip(curve.points, point_files(curve), strict=True):
        write_problem(point.problem, folder / name)
    _plot(curve, folder / PLOT)


def _plot(curve: TradeOff, file: Path) -> None:
    """Draw the curve; the table says the same where there is no matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot()
    labels = []
    columns = []
    for name in (curve.first, curve.second):
        unit = AIM_UNITS[name] if name in AIMS else LimitKind(name).unit
        words = name if name in AIMS else LimitKind(name).words
        labels.append(f"{words}, {unit.name}" if unit.name else words)
        side = "first" if name == curve.first else "second"
        columns.append([_in_file(name)[1] * unit.factor * getattr(point, side) for point in curve.points])
    held = [point.verified for point in curve.points]
    good = [[v for v, ok in zip(column, held, strict=True) if ok] for column in columns]
    bad = [[v for v, ok in zip(column, held, strict=True) if not ok] for column in columns]
    axes.plot(good[1], good[0], "o-", color=VERIFIED, label="verified designs")
    if bad[0]:
        axes.plot(bad[1], bad[0], "x", color=VIOLATED, label="limits violated")
        axes.legend()
    better = "more" if curve.second in FLOORS else "less"
    axes.set_xlabel(f"{labels[1]} ({better} is better)")
    axes.set_ylabel(labels[0])
    axes.grid(alpha=0.3)
    figure.savefig(file, dpi=150)

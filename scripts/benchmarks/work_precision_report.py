"""What the rows of ``work_precision.py`` come to: the README's tables, and a figure a case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]
OURS = "collocation, gauss-newton"
COMPILED = f"{OURS}, compiled"
TARGETS = (1e-5, 1e-6, 1e-8)  # errors that the table compares times at
SHOWN = 1.0  # in lengths of the cable: what is off by more is no shape, and would fill the diagram
REFERENCE = 1e-10  # in lengths of the cable: errors below are those of the references


def cheapest(rows: list[Row], case: str, method: str, start: str, error: float) -> float:
    """Return the least time, ms, in which ``method`` has the case with at most ``error``; infinite where never."""
    kept = [r for r in rows if r["case"] == case and r["method"] == method and r["start"].startswith(start)]
    return min((r["milliseconds"] for r in kept if r["error"] <= error), default=np.inf)


def table(rows: list[Row]) -> str:
    """Return milliseconds of ours, interpreted and compiled, and of ``solve_bvp`` at equal errors."""
    starts = [*(("warm", error) for error in TARGETS), ("cold", 1e-6), ("cold", 1e-8)]
    lines = ["| case | " + " | ".join(f"{start}, {error:g} L" for start, error in starts) + " |"]
    lines.append("|" + "---|" * (len(starts) + 1))
    for case in dict.fromkeys(r["case"] for r in rows if np.isfinite(r["error"])):
        cells = []
        for start, error in starts:
            a, fast, b = (cheapest(rows, case, method, start, error) for method in (OURS, COMPILED, "solve_bvp"))
            ours = " / ".join(f"{time:.2g}" if np.isfinite(time) else "-" for time in (a, fast))
            cells.append(f"{ours} ({b / a:.2g})" if np.isfinite(b) and np.isfinite(a) else f"{ours} (-)")
        lines.append(f"| {case} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def peer_table(rows: list[Row]) -> str:
    """Return the least error of every other peer, its milliseconds, and how many times ours at that error."""
    names = [name for name in dict.fromkeys(r["method"] for r in rows) if "," not in name and name != "solve_bvp"]
    lines = ["| case | " + " | ".join(names) + " |", "|" + "---|" * (len(names) + 1)]
    for case in dict.fromkeys(r["case"] for r in rows if np.isfinite(r["error"])):
        cells = []
        for name in names:
            mine = [r for r in rows if r["case"] == case and r["method"] == name]
            best = min((r for r in mine if r["status"] == "ok"), key=lambda r: r["error"], default=None)
            if best is None:
                cells.append(mine[0]["status"] if mine else "-")
                continue
            times = best["milliseconds"] / cheapest(rows, case, OURS, "warm", best["error"])
            cells.append(f"{best['error']:.0e} L, {best['milliseconds']:.2g} ms ({times:.2g})")
        lines.append(f"| {case} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def misjudged(rows: list[Row]) -> tuple[list[Row], list[Row]]:
    """Return the rows whose estimated error is over ten times too small, or too large, where the reference can tell."""
    known = [
        r
        for r in rows
        if r["method"].startswith("collocation") and REFERENCE * 10 < r["error"] < 0.01 and r["status"] == "ok"
    ]
    return (
        [r for r in known if r["estimated_error"] < 0.1 * r["error"]],
        [r for r in known if r["estimated_error"] > 10.0 * r["error"]],
    )


def draw(folder: Path, rows: list[Row]) -> None:
    """Draw error against time, a figure for each case; needs matplotlib."""
    try:
        from matplotlib import colormaps
        from matplotlib.figure import Figure
    except ImportError:
        print("Figures left out: matplotlib is not installed (the extra 'studies').")
        return
    methods = list(dict.fromkeys(r["method"] for r in rows))
    for case in dict.fromkeys(r["case"] for r in rows if np.isfinite(r["error"])):
        figure = Figure(figsize=(9.6, 5.0), layout="constrained")
        axes = figure.subplots()
        mine = [r for r in rows if r["case"] == case and 0 < r["error"] < SHOWN]
        for method, start in dict.fromkeys((r["method"], r["start"].split()[0].strip(",")) for r in mine):
            kept = sorted(
                (r["milliseconds"], r["error"]) for r in mine if r["method"] == method and r["start"].startswith(start)
            )
            mark = "o-" if start == "warm" else "s--"
            colour = colormaps["tab20"](methods.index(method) % 20)
            axes.loglog(*zip(*kept, strict=True), mark, label=f"{method}, {start}", color=colour, markersize=4)
        axes.set_xlabel("processor time a shape / ms (median, one thread)")
        axes.set_ylabel("largest error of the centreline / L")
        axes.set_title(case)
        axes.grid(visible=True, alpha=0.3)
        axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.01, 0.5))
        figure.savefig(folder / f"{case.replace(' ', '_').replace(',', '')}.png", dpi=130)

"""A tornado chart: what moves a limit most, as bars around its margin. matplotlib, an extra ("studies")."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from harness_opt.report.colours import LESS, MORE
from harness_opt.studies.ranking import Effect

MOST_BARS = 14
INCHES_WIDE, INCHES_A_BAR, INCHES_AROUND = 8.0, 0.32, 1.4
DOTS = 130  # an inch


def draw(file: Path, effects: Sequence[Effect], title: str, unit: str) -> None:
    """Draw a tornado chart.

    Args:
        file: PNG or SVG to write.
        effects: the largest first; the others are left out.
        title: what the chart shows.
        unit: of the effects.
    """
    from matplotlib.figure import Figure

    shown = [effect for effect in effects[:MOST_BARS] if effect.size > 0]
    figure = Figure(figsize=(INCHES_WIDE, INCHES_AROUND + INCHES_A_BAR * max(len(shown), 1)), layout="constrained")
    axes = figure.subplots()
    heights = range(len(shown), 0, -1)
    for side, colour, words in ((-1.0, LESS, "less"), (1.0, MORE, "more")):
        widths = [side * effect.per_step * (effect.tolerance or 1.0) for effect in shown]
        axes.barh(heights, widths, color=colour, label=words, height=0.7)
    axes.set_yticks(heights, [f"{effect.key}  {_around(effect)}" for effect in shown], fontsize=8)
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_xlabel(f"change of the margin, {unit}")
    axes.set_title(title, fontsize=10)
    if shown:
        axes.legend(loc="lower right", fontsize=8, frameon=False)
    for edge in ("top", "right", "left"):
        axes.spines[edge].set_visible(False)
    axes.tick_params(axis="y", length=0)
    figure.savefig(file, dpi=DOTS)


def _around(effect: Effect) -> str:
    """Return by how much a quantity is changed."""
    return f"\u00b1{1.0 if effect.tolerance is None else effect.tolerance:.3g} {effect.step}"

"""What a redesign found, in sentences: where it began, what is in the way, what would do, what limits cost."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

# unit shown for a kind of limit, how many of them are one of the problem file's unit, and a step worth speaking of
UNITS = {
    "clearance": ("mm", 1e3, 1.0),
    "bend_radius": ("mm", 1e3, 1.0),
    "twist_deg_per_m": ("deg/m", 1.0, 10.0),
    "clamp_force": ("N", 1.0, 0.1),
    "clamp_moment": ("Nm", 1.0, 0.01),
}
LENGTH, ANGLE = ("mm", 1e3, 1.0), ("deg", 1.0, 1.0)  # of bounds
LEAST_BOUGHT = 0.05  # of what the best variable buys, in its unit: less is not worth saying
TRADES = 2  # variables named for each limit
SAVED = {"change": ("{:.2g} % of the change", 100.0), "length": ("{:.2g} mm of length", 1e3)}


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

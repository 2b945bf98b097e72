"""A result as one HTML file that needs no network: verdict, limits, curves, and the scene to turn and to scrub.

Jinja escapes every string of the user's; the page's own policy lets no script run but the one written into it.
"""

from __future__ import annotations

import base64
import dataclasses
import datetime
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance.limits import all_limits, bending, most_urgent
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.files.summary import Summary, path_entry
from harness_opt.files.whole_folder import write_whole
from harness_opt.files.write import problem_text
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_at_a_time
from harness_opt.parts.scene import Scene, load_scene
from harness_opt.report import charts, colours, viewpoint
from harness_opt.report import page_rows as report_words
from harness_opt.report.data_sheet import clip_rows, data_sheets, sheet_rows
from harness_opt.report.page_rows import input_tables
from harness_opt.report.scene_data import part_data, scene_data, view_data
from harness_opt.report.summary import summary as summarise

if TYPE_CHECKING:
    from harness_opt.design.result import Redesign

Json = dict[str, Any]

FILE = "report.html"
SMALL, MARGIN = (320, 200), 8  # of a notebook's picture, pixels
SHADES = 5  # moments of the motion that are drawn, the last one darkest
ROWS = 8  # limits that are told, worst first
TONES = {"good": "#14794a", "bad": "#b3141c", "warn": "#8a5a00"}
MOST_NAMES = 12  # of parts that are all named to begin with
NAMES_TOLD = 5  # of parts, among the facts
SCRIPTS = ("geometry.js", "view.js", "overlay.js", "stage.js", "page.js")  # in the order they are read


@dataclass(frozen=True, eq=False)
class Report:
    """All that a report shows and that takes time to find; made once for each result.

    Args:
        result: of a simulation or a redesign.
        measured: clearances of its motion.
        given: the motion of the design given and its clearances, where a redesign changed it.
        data: for the page's script.
        cable_charts: of each cable, laid out.
        curve_numbers: of each chart the numbers of its curves in ``data``, by name.
    """

    result: Motion | Redesign
    measured: ClearanceResult
    given: tuple[Motion, ClearanceResult] | None
    data: Json
    cable_charts: list[Json]
    curve_numbers: list[dict[str, int]]

    @property
    def motion(self) -> Motion:
        """The motion that the report is about."""
        return self.result if isinstance(self.result, Motion) else self.result.motion


def prepare(result: Motion | Redesign, measured: ClearanceResult | None = None, scene: Scene | None = None) -> Report:
    """Return what a report of ``result`` shows.

    Args:
        result: of a simulation or a redesign.
        measured: clearances of a simulated motion; None measures them. A redesign brings its own.
        scene: its parts; None loads them.

    Raises:
        ProblemError: a mesh that cannot be read any more.
    """
    motion = result if isinstance(result, Motion) else result.motion
    scene = load_scene(motion.problem) if scene is None else scene
    given = None
    if isinstance(result, Motion):
        measured = measured or measure(motion.problem, scene, motion.motion, motion.cables)
    else:
        measured, before = result.clearances, result.motion_before
        if len(before.motion):
            given = (before, measure(before.problem, scene, before.motion, before.cables))
    data: Json = {"motion": report_words.plain(motion.motion)}
    if not len(motion.motion):
        return Report(result, measured, None, data, [], [])
    found = {name: list(charts.charts(motion, measured, name, given)) for name in motion.cables}
    laid_out: list[Json] = []
    numbers: list[dict[str, int]] = []
    curves: list[list[float | None]] = []
    for name, several in found.items():
        snaps = [snap.motion for snap in motion.snaps if snap.cable == name]
        laid_out.append({"name": name, "first": len(numbers), "charts": [charts.drawn(one, snaps) for one in several]})
        for chart in several:
            numbers.append({series: len(curves) + k for k, series in enumerate(chart.series)})
            curves += [report_words.plain(values) for values in chart.series.values()]
    data |= {"curves": curves, "chart": {"width": charts.WIDTH, "left": charts.LEFT, "right": charts.RIGHT}}
    data |= _stage(motion, measured, given, scene)
    return Report(result, measured, given, data, laid_out, numbers)


def _stage(
    motion: Motion, measured: ClearanceResult, given: tuple[Motion, ClearanceResult] | None, scene: Scene
) -> Json:
    """Return what the scene is drawn from."""
    results = [(motion, measured)] if given is None else [given, (motion, measured)]
    share = 1.0 / len(results)
    scenes = [scene_data(one, scene, clearances, share) for one, clearances in results]
    titles = [""] if given is None else ["Before", "After"]
    for entry, title in zip(scenes, titles, strict=True):
        entry |= {"title": title, "colours": colours.CABLES}
    worst = []
    for one, clearances in results:
        rows = all_limits(one.problem, one, clearances)
        frame = most_urgent(one.problem, rows).frame if rows else _most_bent(one)
        worst.append(float(one.motion[frame]))
    return {
        "scenes": scenes,
        "parts": part_data(motion.problem, scene),
        "view": view_data([one for one, _ in results], scene),
        "scales": {mode: dataclasses.asdict(key) for mode, key in colours.keys(results).items()},
        "ramp": colours.RAMP,
        "palette": {"states": [None, colours.SHORT, colours.TOUCHES], "axes": colours.AXES, "sleeve": colours.SLEEVE},
        "path": path_entry(motion.problem.moments),
        "worst": worst[0],
        "begin": worst[0],
    }


def _most_bent(motion: Motion) -> int:
    """Return the frame with the smallest bend radius."""
    return int(np.argmax(np.max([bending(cable).max(axis=1) for cable in motion.cables.values()], axis=0)))


# --- the page ------------------------------------------------------------------------------------------


def html(report: Report, summary: Summary, texts: Mapping[str, str] | None = None) -> str:
    """Return the page.

    Args:
        report: as :func:`prepare` gave it.
        summary: of the same result.
        texts: problem files to show, by name; None shows the one that was read.
    """
    motion, data = report.motion, dict(report.data)
    if len(motion.motion):
        curves = {
            name: {chart.title: chart.series for chart in (one.chart for one in row["charts"])}
            for name, row in ((row["name"], row) for row in report.cable_charts)
        }
        data["rows"] = report_words.live_rows(motion, report.measured, summary["limits"], curves)
    verdict, tone = report_words.verdict(summary)
    shown, held = report_words.limit_groups(summary)
    return page(
        "report.html.jinja",
        data,
        title=_title(summary),
        subtitle="Redesign of a cable harness" if summary["command"] == "redesign" else "Simulation of a cable harness",
        verdict=verdict,
        tone=tone,
        conclusion=report_words.conclusion(summary),
        facts=_facts(motion, summary),
        limits=shown,
        held=held,
        inputs=list(input_tables(motion.problem)),
        most_names=MOST_NAMES,
        variables=report_words.variable_rows(summary),
        redesign_words=list(report_words.redesign_words(summary)),
        before_after=report_words.before_after(summary),
        cable_charts=report.cable_charts if len(motion.motion) > 1 else [],
        curve_numbers=report.curve_numbers,
        chart_note=" Yellow: a snap to another shape." if motion.snaps else "",
        frame={"width": charts.WIDTH, "height": charts.HEIGHT, "left": charts.LEFT, "right": charts.RIGHT,
               "top": charts.TOP, "bottom": charts.BOTTOM},
        moments=[(charts.place(at), f"{100 * at:.0f}") for at in (0.0, 0.25, 0.5, 0.75, 1.0)],
        modes=_modes(report.measured),
        cables=list(motion.cables),
        colours=colours.CABLES,
        scene_notes=list(_scene_notes(data)),
        sheets=sheet_rows(motion, data_sheets(motion)) if len(motion.motion) else None,
        clips=clip_rows(motion) if len(motion.motion) else None,
        notes=list(report_words.notes(summary)),
        texts=list((texts or _texts(report)).items()),
        footer=_footer(summary),
    )  # fmt: skip


def page(template: str, data: Json, **content: Any) -> str:
    """Return a page that needs nothing else.

    Args:
        template: name of the file that it is made of.
        data: for its script.
        content: what the template asks for beside.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.filters["short"] = lambda value: f"{value:g}"
    style, script = _asset("report.css"), "\n".join(_asset(name) for name in SCRIPTS)
    hashes = {"style_hash": _hash(style), "script_hash": _hash(script)}
    return environment.get_template(template).render(data=data, style=style, script=script, **hashes, **content)


def _title(summary: Summary) -> str:
    """Return the title of the page: of a redesign that found anything it says so."""
    problem = summary["problem"]
    title = problem["title"] or Path(problem["file"] or "A problem without title").stem
    return f"{title}: redesigned" if summary["command"] == "redesign" and summary["frames"] else title


def _asset(name: str) -> str:
    """Return the text of a file that the page is made of."""
    return resources.files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """Return what a content security policy calls ``text`` by."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _modes(measured: ClearanceResult) -> list[tuple[str, str]]:
    modes = [("limits", "Limits"), ("clearance", "Clearance"), ("bend", "Bend radius"), ("twist", "Twist")]
    return [mode for mode in modes if measured.pairs or mode[0] != "clearance"]


def _facts(motion: Motion, summary: Summary) -> list[tuple[str, str]]:
    problem = motion.problem
    lengths = ", ".join(f"{1e3 * run.cable.length:.1f} mm" for run in problem.cables.values())
    return [
        ("Frames solved", f"{summary['frames']}"),
        ("Cables" if len(problem.cables) > 1 else "Cable", ", ".join(problem.cables)),
        ("Length", lengths),
        ("Parts", _some(list(problem.parts))),
        ("Snaps", f"{len({(snap['cable'], snap['motion']) for snap in summary['snaps']}) or 'none'}"),
        ("Computed in", f"{summary['timing']['total']:.1f} s"),
    ]


def _some(names: list[str]) -> str:
    """Return names in words, and how many there are where these are too many."""
    if len(names) <= NAMES_TOLD:
        return ", ".join(names) or "none"
    return f"{len(names)}: {', '.join(names[:NAMES_TOLD])}, ..."


def _scene_notes(data: Json) -> list[str]:
    """Return what the scene does not show of what was computed, a sentence each."""
    if "scenes" not in data:
        return []
    notes = ["Drag to turn, shift-drag to move, click and scroll to zoom; arrow keys step from frame to frame."]
    for entry in data["scenes"]:
        if len(entry["frames"]) < entry["solved"]:
            which = f"{entry['title']}: " if entry["title"] else ""
            notes.append(f"{which}{len(entry['frames'])} of the {entry['solved']} solved frames are drawn here.")
    coarse = [part["name"] for part in data["parts"] if part["triangles"] < 0.9 * part["triangles_of"]]
    if coarse:
        which = ", ".join(coarse) if len(coarse) <= NAMES_TOLD else f"{len(coarse)} of the parts"
        notes.append(f"Drawn with fewer triangles than were measured against: {which}.")
    return notes


def _texts(report: Report) -> dict[str, str]:
    """Return the problem file that the result was asked of."""
    result = report.result
    return texts_of(result.problem if isinstance(result, Motion) else result.original)


def texts_of(problem: Problem) -> dict[str, str]:
    """Return the problem file as it was read, or as it would be written where it is gone or changed, by name."""
    if problem.file is None:
        return {"Problem": problem_text(problem, Path.cwd() / "problem.toml")[0]}
    try:
        content = problem.file.read_bytes()
    except OSError:
        content = b""
    if hashlib.sha256(content).hexdigest() == problem.sha256:
        return {str(problem.file.name): content.decode("utf-8")}
    return {f"{problem.file.name} (as it was understood)": problem_text(problem, problem.file)[0]}


def _footer(summary: Summary) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in summary["versions"].items())
    file, sha = summary["problem"]["file"], summary["problem"]["sha256"]
    source = f" From {Path(file).name}, SHA-256 {sha}." if file else ""
    seconds = ", ".join(f"{phase} {value:.1f} s" for phase, value in summary["timing"].items() if value)
    return f"Written {datetime.date.today().isoformat()} by {versions}.{source} Time: {seconds}."


def write_page(report: Report, summary: Summary, folder: Path) -> str:
    """Write the page into ``folder``, with the redesigned problem file that lies there, and return its name."""
    texts = _texts(report)
    redesigned = folder / "redesigned.toml"
    if redesigned.is_file():
        texts["redesigned.toml"] = redesigned.read_text(encoding="utf-8")
    # "replace": bytes of file names that are no text
    (folder / FILE).write_text(html(report, summary, texts), encoding="utf-8", errors="replace")
    return FILE


@one_at_a_time
def write_report(result: Motion | Redesign, file: str | Path) -> Path:
    """Write the report of a result as one HTML file that needs no network, and return its path.

    Args:
        result: of a simulation or a redesign.
        file: to write; its folder must be there.

    Raises:
        ProblemError: a mesh that cannot be read any more.
        OSError: the file cannot be written.
    """
    report = prepare(result)
    content = summarise(result, report.measured)
    if isinstance(result, Motion):
        texts = None
    else:
        texts = _texts(report) | {"redesigned.toml": problem_text(result.problem, Path(file).resolve())[0]}
    write_whole(Path(file), html(report, content, texts).encode("utf-8", "replace"))
    return Path(file)


# --- in a notebook -------------------------------------------------------------------------------------


def for_notebook(result: Motion | Redesign) -> str:
    """Return ``result`` as HTML; its clearances are measured where it is a motion."""
    motion = result if isinstance(result, Motion) else result.motion
    content = summarise(result)
    words, tone = report_words.verdict(content)
    title = escape(motion.problem.title or "Motion")
    groups, held = report_words.limit_groups(content)
    cells = [row for rows in (*groups, *held) for row in rows]
    lines = "".join(
        f"<tr><td>{escape(row['label'])}</td><td>{escape(row['cable'])}</td><td>{escape(row['against'])}</td>"
        f"<td>{row['worst']}</td><td>{row['margin']}</td><td>{report_words.HOLDS[row['holds']][1]}</td></tr>"
        for row in cells[:ROWS]
    )
    more = f"<p>{len(cells) - ROWS} more limits</p>" if len(cells) > ROWS else ""
    head = "<tr><th>limit</th><th>cable</th><th>against</th><th>worst</th><th>margin</th><th>holds</th></tr>"
    table = f"<table>{head}{lines}</table>{more}" if cells else ""
    return f"<div><b>{title}</b>: <b style='color:{TONES[tone]}'>{escape(words)}</b>{_picture(motion)}{table}</div>"


def _picture(motion: Motion) -> str:
    """Return the cables at a few moments as SVG, seen across the plane of their motion; nothing without frames."""
    if not len(motion.motion):
        return ""
    positions = [cable.position for cable in motion.cables.values()]
    right, up, _ = viewpoint.axes(viewpoint.plane_normal(positions), viewpoint.ASIDE, 1.0)
    flat = [np.stack([at @ right, -(at @ up)], axis=-1) for at in positions]
    every = np.vstack([at.reshape(-1, 2) for at in flat])
    low, size = every.min(axis=0), np.ptp(every, axis=0)
    room = np.array(SMALL) - 2 * MARGIN
    scale = float(np.min(room / np.maximum(size, 1e-12 + 1e-9 * float(size.max()))))
    frames = np.unique(np.linspace(0, len(motion.motion) - 1, SHADES).round().astype(int))
    lines = [
        _line(MARGIN + scale * (at[frame] - low), colours.CABLES[number % len(colours.CABLES)], (k + 1) / len(frames))
        for number, at in enumerate(flat)
        for k, frame in enumerate(frames)
    ]
    told = escape(f"from {motion.problem.moments.words(0.0)} to {motion.problem.moments.words(1.0)}")
    return f"<br><svg width='{SMALL[0]}' height='{SMALL[1]}' role='img'><title>{told}</title>{''.join(lines)}</svg>"


def _line(points: Array, colour: str, share: float) -> str:
    told = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f"<polyline points='{told}' fill='none' stroke='{colour}' stroke-width='2' opacity='{share:.2f}'/>"

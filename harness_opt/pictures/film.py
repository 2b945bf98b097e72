"""A film of a motion, beside its pictures: the frames of a window drawn off-screen, as H.264 in an MP4 file."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance.limits import all_limits, most_urgent
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.errors import HarnessError
from harness_opt.model.results import Motion
from harness_opt.parts.scene import load_scene
from harness_opt.pictures.stills import still_names, write_pictures
from harness_opt.pictures.window import Window

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from harness_opt.design.result import Redesign
    from harness_opt.model.results import LimitResult
    from harness_opt.motion.follower import Progress
    from harness_opt.numerics.rotations import Array
    from harness_opt.parts.scene import Scene

    Picture = NDArray[np.uint8]

FILE = "motion.mp4"
SIZE = (960, 540)  # pixels, both even, as H.264 wants them
RATE = 25  # pictures a second
MOST_PICTURES = 150  # drawn; a longer film shows some of them for longer
LEAST_SECONDS, MOST_SECONDS = 2.0, 12.0  # that a film lasts
HOLD = 0.6  # s, that the ends and the worst moment stand still
QUALITY = "23"  # constant rate factor of H.264: the encoder's own default


def write_pictures_and_film(
    result: Motion | Redesign,
    folder: Path,
    clearances: ClearanceResult | None = None,
    *,
    pictures: bool = True,
    film: bool = True,
    progress: Progress | None = None,
) -> list[str]:
    """Write the pictures of a result and, where it moves, a film of it; return their names.

    Args:
        result: of a simulation or a redesign, whose new design is filmed.
        folder: made where it is missing.
        clearances: of a simulated motion; None measures them. A redesign brings its own.
        pictures, film: which of them to draw.
        progress: called with a word, how many are drawn, and how many there will be, the film's counted among them.

    Raises:
        HarnessError: pyvista, OpenGL or PyAV is missing; one line with the remedy.
        ProblemError: a mesh that cannot be read.
    """
    motion = result if isinstance(result, Motion) else result.motion
    filmed = film and len(motion.motion) > 1
    scene, rows = load_scene(motion.problem), _rows(result, clearances) if filmed else ()
    shown = moments(motion, _worst(motion, rows)) if filmed else np.zeros(0)
    total = len(still_names(result)) * pictures + len(_distinct(motion, shown))
    done = itertools.count(1)

    def drawn() -> None:
        if progress is not None:
            progress("pictures", next(done), total)

    names = write_pictures(result, folder, clearances, drawn) if pictures else []
    return [*names, write_film(motion, scene, rows, Path(folder), drawn)] if filmed else names


def _rows(result: Motion | Redesign, clearances: ClearanceResult | None) -> Sequence[LimitResult]:
    """Return the limits of the motion that is filmed."""
    if not isinstance(result, Motion):
        return result.limits
    found = clearances or measure(result.problem, load_scene(result.problem), result.motion, result.cables)
    return all_limits(result.problem, result, found)


def _worst(motion: Motion, rows: Sequence[LimitResult]) -> float:
    """Return the moment, 0 to 1, at which a film stands still."""
    return float(motion.motion[most_urgent(motion.problem, rows).frame]) if rows else 0.0


def _distinct(motion: Motion, shown: Array) -> list[int]:
    """Return the frames that a film of the moments ``shown`` draws, one after the other."""
    frames = [int(np.argmin(np.abs(motion.motion - moment))) for moment in shown]
    return [frame for frame, _ in itertools.groupby(frames)]


def write_film(
    motion: Motion,
    scene: Scene,
    rows: Sequence[LimitResult],
    folder: Path,
    drawn: Callable[[], None] = lambda: None,
) -> str:
    """Write a film of ``motion`` into ``folder`` and return its name.

    It lasts as long as the motion does, within 2 to 12 s, stands still at both ends and at the worst moment, and is
    drawn frame by frame: every picture is a solved one.

    Args:
        motion: with more than one frame.
        scene: its parts.
        rows: its limits.
        folder: to write in.
        drawn: called after each picture that was drawn for it.

    Raises:
        HarnessError: pyvista, OpenGL or PyAV is missing; one line.
    """
    try:
        import av
    except ImportError as error:
        raise HarnessError('found no PyAV, expected the extra "harness-opt[pictures]"') from error
    worst = _worst(motion, rows)
    window = Window(motion, worst, scene=scene, off_screen=True, size=SIZE)
    try:
        with av.open(str(folder / FILE), "w") as container:
            stream: Any = container.add_stream("libx264", rate=RATE, options={"crf": QUALITY})
            stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
            stream.time_base = Fraction(1, RATE)
            for number, picture in enumerate(_pictures(window, moments(motion, worst), drawn)):
                shot = av.VideoFrame.from_ndarray(picture, format="rgb24")
                shot.pts = number
                container.mux(stream.encode(shot))
            container.mux(stream.encode())
    finally:
        window.plotter.close()
    return FILE


def moments(motion: Motion, worst: float) -> Array:
    """Return the moments, 0 to 1, that the pictures of a film show, one every 1/25 s."""
    seconds = float(np.clip(motion.problem.duration, LEAST_SECONDS, MOST_SECONDS))
    count = max(2, round(seconds * RATE))
    drawn = np.linspace(0.0, 1.0, min(count, MOST_PICTURES))
    playing = drawn[np.rint(np.linspace(0, len(drawn) - 1, count)).astype(int)]
    stills = np.full(round(HOLD * RATE), 1.0)
    before, after = playing[playing < worst], playing[playing >= worst]
    at_worst = stills * worst if 0.0 < worst < 1.0 else stills[:0]
    return np.concatenate([0.0 * stills, before, at_worst, after, stills])


def _pictures(window: Window, shown: Array, drawn: Callable[[], None]) -> Iterator[Picture]:
    """Give the picture (height, width, 3) of each moment; one that shows the same frame is not drawn again."""
    frame, picture = -1, np.zeros((0, 0, 3), dtype=np.uint8)
    for moment in shown:
        wanted = window.views[-1].nearest(float(moment))
        if wanted != frame:
            window.go(float(moment))
            frame, picture = wanted, window.picture().astype(np.uint8)
            drawn()
        yield picture

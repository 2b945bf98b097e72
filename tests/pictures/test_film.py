"""Films: they show the motion, and hold still where it matters."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from harness_opt.errors import HarnessError
from harness_opt.parts.scene import load_scene
from harness_opt.pictures import film as animation


def test_film_shows_the_motion(pyvista, two_cables, tmp_path):
    av = pytest.importorskip("av", reason="av (the extra 'pictures') is not installed")
    found = animation.write_pictures_and_film(two_cables, tmp_path)
    assert found == ["worst.png", "motion.mp4"]
    with av.open(str(tmp_path / "motion.mp4")) as film:
        stream = film.streams.video[0]
        assert (stream.codec_context.name, stream.width, stream.height) == ("h264", *animation.SIZE)
        shots = [shot.to_ndarray(format="rgb24").astype(int) for shot in film.decode(video=0)]
    seconds = len(shots) / animation.RATE
    assert 2.0 <= seconds <= 6.0, "a motion of a second is shown in two, and held still at its ends"
    for shot in (shots[0], shots[len(shots) // 2], shots[-1]):
        assert 0.3 < np.mean(np.all(shot > 250, axis=-1)) < 0.98, "white around, and something on it"
    assert np.mean(np.abs(shots[0] - shots[-1]) > 40) > 0.01, "it moves"
    assert np.mean(np.abs(shots[0] - shots[5]) > 40) < 0.001, "it is held still at the start"


@pytest.mark.parametrize("worst", [0.0, 0.37, 1.0])
def test_moments_of_a_film_go_on_and_stop_at_the_worst(two_cables, worst):
    shown = animation.moments(two_cables, worst)
    assert shown[0] == 0.0 and shown[-1] == 1.0 and np.all(np.diff(shown) >= 0)
    assert np.sum(shown == worst) >= animation.HOLD * animation.RATE
    assert np.diff(shown).max() < 0.05


def test_what_stands_still_has_no_film(pyvista, two_cables, tmp_path):
    one = replace(
        two_cables, motion=two_cables.motion[:1], cables={n: c.frames(slice(1)) for n, c in two_cables.cables.items()}
    )
    assert animation.write_pictures_and_film(one, tmp_path) == ["worst.png"]


def test_without_a_way_to_film_one_line_names_the_remedy(pyvista, two_cables, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(HarnessError, match=r'found no PyAV, expected the extra "harness-opt\[pictures\]"'):
        animation.write_film(two_cables, load_scene(two_cables.problem), (), tmp_path)

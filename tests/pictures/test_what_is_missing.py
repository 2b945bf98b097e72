"""Where a screen, OpenGL, pyvista or a result is missing, one line says so."""

from __future__ import annotations

import json
import sys

import pytest

from harness_opt.errors import HarnessError
from harness_opt.pictures import opengl
from harness_opt.pictures import stills as pictures

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="windows come without X11 elsewhere")


@linux
@pytest.mark.parametrize("display", [None, ":9999"])
def test_without_a_screen_one_line_says_so(pyvista, folder, monkeypatch, capfd, display):
    monkeypatch.delenv("DISPLAY", raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(HarnessError, match="found no display to open a window on") as caught:
        pictures.show(folder)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@linux
def test_without_opengl_one_line_names_the_remedy(pyvista, two_cables, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv(opengl.WINDOW_VARIABLE, raising=False)
    monkeypatch.setattr(opengl, "_loads", lambda library: False)
    with pytest.raises(HarnessError, match=r"found no OpenGL .* apt-get install libegl1") as caught:
        pictures.write_pictures(two_cables, tmp_path)
    assert "\n" not in str(caught.value)
    assert not any(tmp_path.iterdir())


def test_without_pyvista_one_line_names_the_remedy(two_cables, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(HarnessError, match=r'found no pyvista, expected the extra "harness-opt\[pictures\]"'):
        pictures.write_pictures(two_cables, tmp_path)


def test_a_folder_without_a_result_is_named(folder, tmp_path):
    with pytest.raises(HarnessError, match="nowhere: found no result of harness-opt"):
        pictures.show(tmp_path / "nowhere")
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps({key: summary[key] for key in ("command", "versions")}))
    with pytest.raises(HarnessError, match="result: found a damaged result"):
        pictures.show(folder)
    (folder / "summary.json").write_text("{}")
    with pytest.raises(HarnessError, match="result: found no result of harness-opt"):
        pictures.show(folder)
    (folder / "summary.json").write_text(json.dumps(summary | {"limits": []}))
    (folder / "used" / "problem.toml").unlink()
    with pytest.raises(HarnessError, match=r"found no file used/problem\.toml, expected the problem and the parts"):
        pictures.show(folder)

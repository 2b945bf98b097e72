"""What all tests may ask for."""

from __future__ import annotations

import os
import signal
from pathlib import Path

# workers share the cores, and BLAS reads this as it is loaded; the package holds itself to one thread too
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
import trimesh

pytest.register_assert_rewrite("oracles")
# whoever starts the tests in the background has them ignore Ctrl-C, and all that they start
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def rng():
    return np.random.default_rng(20240611)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the mesh that the problem file of ``oracles.problem_files`` names, and with two that are none."""
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((60, 40, 30)).export(tmp_path / "meshes" / "housing.stl")
    (tmp_path / "meshes" / "empty.stl").touch()
    (tmp_path / "meshes" / "housing.step").write_text("ISO-10303-21;")
    return tmp_path


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A working folder of its own."""
    monkeypatch.chdir(tmp_path)
    return tmp_path

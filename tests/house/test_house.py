"""The house itself: its checkers are content, imports point down, and what is light stays light."""

from __future__ import annotations

import ast
import importlib.util
import pkgutil
import subprocess
import sys
import tomllib

import pytest

import harness_opt
from oracles.problems import ROOT

PACKAGE = ROOT / "harness_opt"
MOST_FILES, MOST_LINES = 15, 400  # of a room, besides __init__.py; of a file
HEAVY = {"casadi", "scipy", "trimesh", "coal", "pyvista", "vtkmodules"}
ROOMS = sorted(room.name for room in pkgutil.iter_modules(harness_opt.__path__) if room.name != "__main__")
# lint-imports can't be run by -m
LINT_IMPORTS = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports())"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run this Python in the project's folder."""
    return subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)


def imported(*arguments: str) -> set[str]:
    """Return the names of all packages that a run of Python imports."""
    done = run("-X", "importtime", *arguments)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("import time:")]
    return {line.rpartition("|")[2].strip().partition(".")[0] for line in lines}


# --- checkers -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("package", "arguments"),
    [
        pytest.param("ruff", ("-m", "ruff", "check", "."), id="ruff check"),
        pytest.param("ruff", ("-m", "ruff", "format", "--check", "."), id="ruff format"),
        pytest.param("mypy", ("-m", "mypy"), id="mypy"),
        pytest.param("importlinter", ("-c", LINT_IMPORTS), id="lint-imports"),
    ],
)
def test_checker_is_content(package, arguments):
    if not importlib.util.find_spec(package):
        pytest.skip(f"{package} (the extra 'test') is not installed")
    done = run(*arguments)
    assert done.returncode == 0, done.stdout + done.stderr


# --- rooms ------------------------------------------------------------------------------------------------


def test_every_room_has_a_place_in_the_contract_of_imports():
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = [layer for rule in contract["contracts"] if rule["type"] == "layers" for layer in rule["layers"]]
    named = {name.strip() for layer in layers for name in layer.split("|")}
    folders = {file.parent.name for file in PACKAGE.glob("*/__init__.py")}
    assert set(ROOMS) <= named
    assert folders == set(ROOMS) - {file.stem for file in PACKAGE.glob("*.py")}


@pytest.mark.parametrize("room", sorted(file.parent.name for file in PACKAGE.glob("*/__init__.py")))
def test_a_room_has_few_files(room):
    files = sorted(file.name for file in (PACKAGE / room).rglob("*.py") if file.name != "__init__.py")
    assert len(files) <= MOST_FILES, files


@pytest.mark.parametrize("folder", ["harness_opt", "tests"])
def test_files_are_short(folder):
    lines = {file: file.read_text(encoding="utf-8").count("\n") for file in sorted((ROOT / folder).rglob("*.py"))}
    assert {str(file.relative_to(ROOT)): count for file, count in lines.items() if count > MOST_LINES} == {}


def test_no_test_imports_from_another():
    """What tests share is in ``tests/oracles``."""
    for file in sorted((ROOT / "tests").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [name.name for name in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.rpartition(".")[2].startswith("test_")], file


# --- what is imported -----------------------------------------------------------------------------------


def test_the_measure_of_imports_sees_them():
    assert "casadi" in imported("-c", "import harness_opt.rod.equations")


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("-c", "import harness_opt"), id="import"),
        pytest.param(("-m", "harness_opt", "schema"), id="schema"),
        pytest.param(("-m", "harness_opt", "--help"), id="help"),
    ],
)
def test_light_commands_import_nothing_heavy(arguments):
    found = imported(*arguments)
    assert "harness_opt" in found
    assert not found & HEAVY


def test_a_check_of_a_scene_with_binary_meshes_imports_no_reader_of_others():
    found = imported("-m", "harness_opt", "check", str(ROOT / "problems" / "lift_arm" / "lift_arm.toml"))
    assert "harness_opt" in found
    assert not found & {"trimesh", "casadi", "pyvista", "vtkmodules"}


# --- public names ---------------------------------------------------------------------------------------


def test_no_room_is_called_like_a_public_name():
    assert set(ROOMS).isdisjoint(harness_opt.__all__)


@pytest.mark.parametrize("names_first", [True, False], ids=["names first", "rooms first"])
def test_public_names_resolve_in_any_order(names_first):
    """Importing a room binds its name in the package, where it must hide no public name."""
    names = "[getattr(ho, name) for name in ho.__all__]"
    rooms = "[importlib.import_module(f'harness_opt.{room}') for room in rooms]"
    steps = [names, rooms] if names_first else [rooms, names]
    done = run(
        "-c",
        f"import importlib, types; import harness_opt as ho; rooms = {ROOMS!r}; {'; '.join(steps)};"
        "assert not [name for name in ho.__all__ if isinstance(getattr(ho, name), types.ModuleType)];"
        "assert callable(ho.equilibrium) and callable(ho.simulate) and callable(ho.redesign);"
        "assert set(ho.__all__) == set(dir(ho)) and len(ho.__all__) > 40",
    )
    assert done.returncode == 0, done.stderr


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nothing"):
        _ = harness_opt.nothing

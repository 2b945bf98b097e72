"""Functions compiled by the system's C compiler: the same results, kept safely, and never needed."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import platformdirs
import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.files.stored_results import read_results
from harness_opt.numerics import machine_code, rotations
from harness_opt.rod.boundary import case
from harness_opt.rod.collocation import collocation
from harness_opt.rod.energy_chain import Chain
from oracles.equations import KINDS, bound, named, setup
from oracles.flap import FLAP, put
from oracles.problems import PROBLEMS, shipped
from oracles.reference import G, cable, ends
from oracles.studies import Here

DOWN = np.array([0.0, 0.0, -G])
ROUNDING = 1e-13  # relative: the C library's functions may round another way than casadi's


@pytest.fixture
def cached(tmp_path, monkeypatch) -> Path:
    """An empty cache folder, and nothing remembered of other tests."""
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda *_, **__: tmp_path / "cache")
    machine_code._try_out.cache_clear()
    yield tmp_path / "cache" / "machine_code"
    machine_code._try_out.cache_clear()


@pytest.fixture
def compiler(cached):
    try:
        with ho.compiled():
            pass
    except ho.CompilerError as error:
        pytest.skip(f"nothing can be compiled here: {error}")


# --- the same results -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    """A cache folder for all tests that compare."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(platformdirs, "user_cache_path", lambda *_, **__: folder)
        try:
            with ho.compiled():
                pass
        except ho.CompilerError as error:
            pytest.skip(f"nothing can be compiled here: {error}")
        yield


def both_ways(evaluate):
    """Return what ``evaluate`` gives interpreted, and as machine code."""
    plain = evaluate()
    with ho.compiled():
        return plain, evaluate()


@pytest.mark.parametrize("loaded", [False, True], ids=["weightless", "loaded"])
@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_equations_are_the_same_to_rounding(machine, kind, loaded):
    given, x = setup(kind, loaded)

    def evaluate():
        equations = bound(given)
        turns = {name: np.eye(3) for name in ("gap", "start_turn", "end_turn", "rest", "load")}
        return equations.residual(x), equations.linearise(x)[1].toarray(), equations.rates(x, **turns)

    for plain, fast in zip(*both_ways(evaluate), strict=True):
        np.testing.assert_allclose(fast, plain, rtol=0, atol=ROUNDING * np.max(np.abs(plain)))


@pytest.mark.parametrize("exact", [False, True])
def test_energies_are_the_same_to_rounding(machine, exact):
    start, end = ends("clamped_3d_weight_30")
    posed = case(cable("clamped_3d_weight_30"), start, end, DOWN)
    rng = np.random.default_rng(3)

    def evaluate():
        chain = Chain(posed.section, posed.load, posed.boundary, np.linspace(0.0, 1.0, 5), exact=exact)
        expansion = chain.expand(q, np.array([1.0, -2.0, 3.0]))
        return chain.energy(q)[0], chain.energy(q)[1], expansion.gradient, expansion.constraint, expansion.entries

    q = rotations.normalise(np.array([1.0, 0.0, 0.0, 0.0]) + np.cumsum(0.1 * rng.normal(size=(13, 4)), axis=0))
    for plain, fast in zip(*both_ways(evaluate), strict=True):
        np.testing.assert_allclose(fast, plain, rtol=0, atol=ROUNDING * np.max(np.abs(plain)))


@pytest.mark.parametrize("name", ["clamped_3d_weight_30", "clamped_elastica_060", "twist_rig_080_180deg"])
def test_a_cold_start_comes_to_the_same_shape(machine, name):
    plain, fast = both_ways(lambda: ho.equilibrium(cable(name), *ends(name), DOWN, bow=(0, 0.1, 1)))
    assert fast.stable == plain.stable
    np.testing.assert_allclose(fast.position, plain.position, rtol=0, atol=1e-8)


def test_a_motion_is_the_same(machine):
    def evaluate():
        problem = shipped("lift_arm")
        return ho.simulate(problem).cables["lead"]

    plain, fast = both_ways(evaluate)
    np.testing.assert_allclose(fast.position, plain.position, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(fast.stable, plain.stable)


def test_machine_code_is_used_where_it_is_wanted_and_there_alone(machine):
    before = collocation(4, 5, True)
    with ho.compiled():
        assert machine_code.wanted()
        assert collocation(4, 5, True) is not before
    assert not machine_code.wanted()
    assert collocation(4, 5, True) is before


# --- what is kept ---------------------------------------------------------------------------------------


def square() -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("square", [x], [x * x])


def test_what_is_compiled_is_kept_and_not_compiled_again(compiler, cached, monkeypatch):
    assert float(machine_code.built(square())(3.0)) == 9.0
    (kept,) = cached.glob("square-*")
    monkeypatch.setattr(machine_code, "_compile", lambda *_: pytest.fail("compiled again"))
    assert float(machine_code.built(square())(4.0)) == 16.0
    assert sorted(cached.glob("square-*")) == [kept]


def test_another_function_of_the_same_name_is_another_file(compiler, cached):
    x = ca.SX.sym("x")
    assert float(machine_code.built(square())(3.0)) == 9.0
    assert float(machine_code.built(ca.Function("square", [x], [x * x + 1.0]))(3.0)) == 10.0


def test_processes_that_compile_at_once_do_not_disturb_each_other(compiler, cached):
    code = (
        "import casadi as ca, platformdirs; from pathlib import Path; from harness_opt.numerics import machine_code;"
        f"platformdirs.user_cache_path = lambda *_, **__: Path({str(cached.parent)!r});"
        "x = ca.SX.sym('x'); print(float(machine_code.built(ca.Function('shared', [x], [ca.exp(x)]))(1.0)))"
    )
    running = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    for process in running:
        out, err = process.communicate(timeout=120)
        assert (process.returncode, err) == (0, "")
        assert float(out) == pytest.approx(np.e, rel=1e-15)
    assert len(list(cached.glob("shared-*"))) == 1
    assert not list(cached.glob("compiling-*"))


@pytest.mark.skipif(os.name != "posix", reason="rights of files are told another way here")
@pytest.mark.parametrize("place", ["folder itself", "folder above"])
def test_nothing_is_run_from_where_others_may_write(compiler, cached, place):
    open_to_all = cached if place == "folder itself" else cached.parent
    open_to_all.chmod(0o777)
    machine_code._try_out.cache_clear()
    with pytest.raises(ho.CompilerError, match=f"^{open_to_all}: others may write here"), ho.compiled():
        pass


@pytest.mark.skipif(os.name != "posix", reason="rights of files are told another way here")
def test_the_cache_is_made_for_its_user_alone(compiler, cached):
    assert stat.S_IMODE(cached.stat().st_mode) == 0o700


# --- where nothing can be compiled ----------------------------------------------------------------------


@pytest.fixture
def no_compiler(cached, monkeypatch):
    monkeypatch.setattr(machine_code.shutil, "which", lambda _name: None)
    machine_code._compiler.cache_clear()
    yield
    machine_code._compiler.cache_clear()


def test_python_is_told_that_there_is_no_compiler(no_compiler):
    expected = "no C compiler was found on the PATH: looked for cc, gcc, clang"
    with pytest.raises(ho.CompilerError, match=expected), ho.compiled():
        pass
    assert not machine_code.wanted()


def test_the_command_line_says_so_and_does_without(no_compiler, here, capsys):
    assert main(["simulate", put(FLAP), "--compile", "-q", "--no-pictures"]) == 0
    assert "--compile: no C compiler was found" in capsys.readouterr().err
    assert read_results("results/flap").summary["status"] == "ok"


def test_a_compiler_that_fails_is_quoted(cached, tmp_path, monkeypatch):
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\n[ \"$1\" = --version ] && echo 1.0 && exit 0\necho 'math.h: not found' >&2; exit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(machine_code.shutil, "which", lambda _name: str(broken))
    machine_code._compiler.cache_clear()
    try:
        with pytest.raises(ho.CompilerError, match=r"math\.h: not found"), ho.compiled():
            pass
        assert not list(cached.glob("compiling-*"))
    finally:
        machine_code._compiler.cache_clear()


# --- commands -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("asked", [True, False])
@pytest.mark.parametrize("command", ["simulate", "redesign", "study"])
def test_commands_compile_where_asked(compiler, here, monkeypatch, command, asked):
    wanted = []

    def stand_in(*_: object) -> int:
        wanted.append(machine_code.wanted())
        return 0

    monkeypatch.setattr("harness_opt.cli.commands.run", stand_in)
    monkeypatch.setattr("harness_opt.cli.study.run_study", stand_in)
    assert main([command, put(FLAP), *(["--compile"] if asked else [])]) == 0
    assert wanted == [asked]
    assert not machine_code.wanted()


def test_workers_of_a_study_compile_too(machine):
    problem = PROBLEMS / "lift_arm" / "lift_arm.toml"
    plain, fast = both_ways(lambda: next(ho.study(problem, [{"cables.lead.length": 0.43}], executor=Here())))
    assert (fast.key, fast.status) == (plain.key, plain.status)
    assert fast.margins == pytest.approx(plain.margins, rel=1e-6)

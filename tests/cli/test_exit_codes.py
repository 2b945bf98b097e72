"""Each exit code of each command is reached; and the time limit, which ends a run with one of them."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness_opt.clearance.witnesses import STOPPED
from harness_opt.cli.commands import main
from harness_opt.cli.interrupts import Interrupts
from harness_opt.design import redesign as outer_loop
from harness_opt.design import search as design_search
from harness_opt.errors import HarnessError, SolveError, Status
from harness_opt.files.stored_results import read_results
from harness_opt.model.results import Motion
from harness_opt.motion import between_frames
from harness_opt.motion import simulate as motion
from harness_opt.report import summary as report
from oracles.flap import FLAP, HIT, PLAIN, WALLED, put, stand_in, strict
from oracles.problems import shipped

Patch = pytest.MonkeyPatch
Preparation = Callable[[Patch], list[str]]


def interrupting(*_: object, **__: object) -> None:
    signal.raise_signal(signal.SIGINT)
    time.sleep(1.0)  # somewhere in it the signal arrives
    raise AssertionError("still running")


def interrupted(target: str, *arguments: str) -> Preparation:
    def prepare(patch: Patch) -> list[str]:
        patch.setattr(target, interrupting)
        return list(arguments)

    return prepare


def given(*arguments: str, text: str = FLAP) -> Preparation:
    def prepare(_: Patch) -> list[str]:
        put(text)
        return list(arguments)

    return prepare


def solved(*arguments: str) -> Preparation:
    """Have a result in ``out``."""

    def prepare(_: Patch) -> list[str]:
        assert main(["simulate", put(FLAP), *PLAIN, "-q", "-o", "out"]) == 0
        return list(arguments)

    return prepare


def not_found(command: str) -> Preparation:
    def prepare(patch: Patch) -> list[str]:
        def fail(problem: object, **_: object) -> None:
            raise SolveError("cable lead, frame 0: none", Status.NO_START, Motion(problem, np.zeros(0), {}))

        room = motion if command == "simulate" else outer_loop
        patch.setattr(room, command, fail)
        return [command, put(HIT), *PLAIN]

    return prepare


def shown(show: Callable[..., None]) -> Preparation:
    def prepare(patch: Patch) -> list[str]:
        arguments = solved("show", "out")(patch)
        patch.setitem(sys.modules, "harness_opt.pictures.stills", stand_in(show=show))
        patch.setattr("harness_opt.pictures.stills", sys.modules["harness_opt.pictures.stills"], raising=False)
        return arguments

    return prepare


def no_display(*_: object) -> None:
    raise RuntimeError("no display")


def varied(text: str, length: float, broken: bool = False) -> Preparation:
    """Have a study of one variant; with ``broken``, workers that come to nothing."""

    def prepare(patch: Patch) -> list[str]:
        put(text)
        head = 'schema = 1\nproblem = "flap.toml"\nmethod = "list"\n[[variants]]\n'
        put(f'{head}"cables.lead.length" = {length}\n', "study.toml")
        if broken:

            def lose(*_: object) -> None:
                raise HarnessError("workers: found none, expected one")

            patch.setattr("harness_opt.studies.study.run", lose)
        return ["study", "study.toml", "--workers", "1"]

    return prepare


def insensitive(patch: Patch) -> list[str]:
    def fail(*_: object) -> None:
        raise SolveError("cable lead, frame 0: none", Status.NO_START)

    patch.setattr("harness_opt.design.key_derivatives.linear", fail)
    return ["sensitivity", put(FLAP)]


CODES: dict[tuple[str, int], Preparation] = {
    ("check", 0): given("check", "flap.toml"),
    ("check", 2): given("check", "flap.toml", text="schema = 2"),
    ("check", 130): interrupted("harness_opt.files.read.read_problem", "check", "flap.toml"),
    ("simulate", 0): given("simulate", "flap.toml", *PLAIN),
    ("simulate", 1): given("simulate", "flap.toml", *PLAIN, text=HIT),
    ("simulate", 2): given("simulate", "flap.toml", "-o", "."),
    ("simulate", 3): not_found("simulate"),
    ("simulate", 130): interrupted("harness_opt.files.read.read_problem", "simulate", "flap.toml"),
    ("redesign", 0): given("redesign", "flap.toml", *PLAIN, text=HIT),
    ("redesign", 1): given("redesign", "flap.toml", *PLAIN, text=WALLED),
    ("redesign", 2): given("redesign", "flap.toml", *PLAIN, text=FLAP.partition("[design.variables]")[0]),
    ("redesign", 3): not_found("redesign"),
    ("redesign", 130): interrupted("harness_opt.files.read.read_problem", "redesign", "flap.toml"),
    ("study", 0): varied(FLAP, 0.3),
    ("study", 1): varied(HIT, 0.3),
    ("study", 2): given("study", "flap.toml"),
    ("study", 3): varied(FLAP, 0.3, broken=True),
    ("study", 130): interrupted("harness_opt.studies.study_file.read_study", "study", "study.toml"),
    ("sensitivity", 0): given("sensitivity", "flap.toml"),
    ("sensitivity", 2): given("sensitivity", "flap.toml", text="schema = 2"),
    ("sensitivity", 3): insensitive,
    ("sensitivity", 130): interrupted("harness_opt.files.read.content_of", "sensitivity", "flap.toml"),
    ("show", 0): shown(lambda *_: None),
    ("show", 2): shown(no_display),
    ("show", 130): shown(interrupting),
    ("export", 0): solved("export", "out", "--to", "csv"),
    ("export", 2): given("export", "out", "--to", "csv"),
    ("export", 130): interrupted("harness_opt.files.stored_results.read_results", "export", "out", "--to", "csv"),
    ("new", 0): given("new", "other"),
    ("new", 2): given("new", "flap"),
    ("new", 130): interrupted("harness_opt.cli.template.write_template", "new", "other"),
    ("schema", 0): given("schema"),
    ("schema", 2): given("schema", "flap.toml"),
    ("schema", 130): interrupted("harness_opt.files.read.schema", "schema"),
    ("completion", 0): given("completion", "bash"),
    ("completion", 2): given("completion", "tcsh"),
    ("completion", 130): interrupted("click.shell_completion.get_completion_class", "completion", "bash"),
}


@pytest.mark.parametrize(("command", "code"), CODES)
def test_every_code_of_every_command(here, capsys, monkeypatch, command, code):
    arguments = CODES[command, code](monkeypatch)
    assert arguments[0] == command
    capsys.readouterr()
    assert main(arguments) == code
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err
    assert err if code in (2, 130) else out + err or command == "show"


# --- the time limit ------------------------------------------------------------------------------------

LONG = HIT.replace("spatial_step = 0.01", "spatial_step = 1e-4")  # some five hundred frames


def late_after(frames: int, patch: pytest.MonkeyPatch) -> None:
    """Have the time be up after so many frames of a simulation."""
    simulate = motion.simulate

    def timed(problem, *, progress, **options):
        def told(name: str, done: int, total: int) -> None:
            patch.setattr(Interrupts, "late", done >= frames)
            progress(name, done, total)

        return simulate(problem, progress=told, **options)

    patch.setattr(Interrupts, "late", False)
    patch.setattr(motion, "simulate", timed)


def test_a_time_limit_keeps_what_is_solved_by_then(here, capsys, monkeypatch):
    late_after(7, monkeypatch)
    assert main(["simulate", put(LONG), *PLAIN, "--json", "--time-limit", "1000"]) == 3
    out, err = capsys.readouterr()
    content = strict(out)
    assert (content["status"], content["reason"]) == ("unsolved", "time_limit")
    assert "the time limit was reached, 1000 s; try a longer --time-limit" in content["message"]
    stored = read_results("results/flap")
    assert stored.summary == content and len(stored.motion) == content["frames"] == 7
    assert "Traceback" not in err


def test_a_part_of_a_motion_takes_no_whole_result_s_place(here, capsys, monkeypatch):
    assert main(["simulate", put(FLAP), *PLAIN, "-q"]) == 0
    before = Path("results/flap/summary.json").read_bytes()
    put(LONG)
    for frames in (7, 9):
        with monkeypatch.context() as patch:
            late_after(frames, patch)
            assert main(["simulate", "flap.toml", *PLAIN, "--time-limit", "1000"]) == 3
        assert "Results: results/flap-interrupted" in capsys.readouterr().out
        assert Path("results/flap/summary.json").read_bytes() == before
        assert len(read_results("results/flap-interrupted").motion) == frames
    assert sorted(os.listdir("results")) == ["flap", "flap-interrupted"]


def test_a_real_clock(here):
    begin = time.monotonic()
    put(HIT.replace("spatial_step = 0.01", "spatial_step = 1e-5"))  # five thousand frames take longer
    assert main(["simulate", "flap.toml", *PLAIN, "-q", "--time-limit", "1"]) == 3
    assert time.monotonic() - begin < 20.0


def test_a_time_limit_of_a_redesign_keeps_the_best_design(here, capsys, monkeypatch):
    """The search is stopped where a design has been met: it is written, not verified, and the code is 3."""
    descend = design_search.descend

    def late(*given):
        monkeypatch.setattr(Interrupts, "late", True)
        return descend(*given)

    monkeypatch.setattr(design_search, "descend", late)
    monkeypatch.setattr(Interrupts, "late", False)
    assert main(["redesign", put(HIT), *PLAIN, "--json", "--time-limit", "1000"]) == 3
    content = strict(capsys.readouterr().out)
    assert (content["status"], content["reason"]) == ("unsolved", "time_limit")
    assert Path("results/flap/redesigned.toml").is_file()
    assert main(["check", "results/flap/redesigned.toml"]) == 0


@pytest.mark.parametrize("command", ["simulate", "redesign"])
def test_a_time_limit_before_the_first_frame_leaves_the_earlier_result(here, capsys, command):
    assert main([command, put(HIT), *PLAIN, "-q"]) in (0, 1)
    before = Path("results/flap/summary.json").read_bytes()
    assert main([command, "flap.toml", *PLAIN, "--time-limit", "1e-9"]) == 3
    assert "Nothing was written." in capsys.readouterr().out
    assert Path("results/flap/summary.json").read_bytes() == before


def test_certificates_end_with_the_time_and_say_so(here, capsys, monkeypatch):
    """All frames are solved, so there is a verdict; what was not looked at between them is not certified."""
    solve, calls = between_frames.BetweenFrames.__call__, []

    def late(self, cable, values):
        calls.append(cable)
        monkeypatch.setattr(Interrupts, "late", True)
        return solve(self, cable, values)

    monkeypatch.setattr(between_frames.BetweenFrames, "__call__", late)
    monkeypatch.setattr(Interrupts, "late", False)
    assert main(["simulate", put(FLAP), "--json", "--time-limit", "1000"]) == 1, "not certain is no yes"
    assert calls
    content = strict(capsys.readouterr().out)
    assert content["status"] == "uncertain"
    rows = [row for row in content["limits"] if row["name"] == "clearance"]
    assert rows and not any(row["certified"] for row in rows)
    assert {row["reason"] for row in rows} == {STOPPED}
    assert sorted(os.listdir("results/flap")) == ["motion.npz", "summary.json", "used"], "no time for a report"


def test_a_solve_that_never_comes_to_a_safe_point_is_cut_off(here, monkeypatch):
    def endless(*_: object, **__: object) -> None:
        while True:
            time.sleep(0.01)

    monkeypatch.setattr("harness_opt.cli.interrupts.LEAST_GRACE", 0.1)
    monkeypatch.setattr(motion, "simulate", endless)
    begin = time.monotonic()
    assert main(["simulate", put(FLAP), *PLAIN, "--time-limit", "0.1"]) == 3
    assert time.monotonic() - begin < 5.0
    assert os.listdir() == ["flap.toml"]
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0), "nothing rings later"
    assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL


def test_pictures_are_cut_off_too(here, monkeypatch):
    def endless(*_: object, **__: object) -> None:
        while True:
            time.sleep(0.01)

    monkeypatch.setattr("harness_opt.cli.interrupts.LEAST_GRACE", 0.1)
    monkeypatch.setitem(sys.modules, "harness_opt.pictures.film", stand_in(write_pictures_and_film=endless))
    assert main(["simulate", put(FLAP), "-q", "--pictures", "--time-limit", "4"]) == 0
    stored = read_results("results/flap").summary
    assert (stored["status"], stored["left_out"][-1]) == ("ok", "pictures")
    assert os.listdir("results") == ["flap"]


def test_no_exception_is_raised_inside_casadi():
    """What is raised inside a call of CasADi comes out of it as another error: the cut waits until it is through."""
    import casadi

    x = casadi.SX.sym("x", 200)
    function = casadi.Function("f", [x], [casadi.sum1(casadi.sin(casadi.mtimes(x, x.T)))])
    values = np.arange(200.0)
    with Interrupts(print, seconds=-1.0) as interrupts:
        for k in range(10):
            interrupts._grace = 1e-3 * (1 + k)
            with pytest.raises(KeyboardInterrupt), interrupts.cut_off():
                while True:
                    function(values)
                    sum(range(10_000))


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "soon"])
def test_time_limits_that_cannot_be(here, limit):
    assert main(["simulate", put(FLAP), "--time-limit", limit]) == 2


def test_a_progress_may_stop_a_motion_from_python():
    def stop(_name: str, done: int, _total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    found = motion.simulate(shipped("lift_arm"), progress=stop, throw=False)
    assert found.status is Status.INTERRUPTED and len(found.motion) == 3
    assert report.summary(found)["status"] == "unsolved"

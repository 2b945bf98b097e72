"""The command line around a run: pictures, windows, exports, new files, completion, colours, progress, help."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from harness_opt.cli import commands as cli
from harness_opt.cli import streams
from harness_opt.cli.commands import main
from harness_opt.cli.interrupts import Interrupts
from harness_opt.cli.progress import progress_for
from harness_opt.cli.run import Voice
from harness_opt.errors import HarnessError
from harness_opt.files.read import read_problem
from harness_opt.files.stored_results import read_results
from harness_opt.motion.follower import Progress
from harness_opt.report import result_files
from oracles.flap import FLAP, HIT, PLAIN, WALLED, environment, put, run, stand_in, strict

# --- pictures and show ---------------------------------------------------------------------------------


def test_pictures_are_drawn_where_they_are_asked_for(here, capsys, monkeypatch):
    asked: list[tuple[bool, bool]] = []

    def draw(
        result: object, folder: Path, clearances: object, pictures: bool, film: bool, progress: Progress
    ) -> list[str]:
        assert clearances is not None
        asked.append((pictures, film))
        progress("pictures", 1, 1)
        (folder / "worst.png").write_bytes(b"PNG")
        return ["worst.png"]

    monkeypatch.setitem(sys.modules, "harness_opt.pictures.film", stand_in(write_pictures_and_film=draw))
    assert main(["simulate", put(FLAP)]) == 0
    assert sorted(os.listdir("results/flap")) == ["motion.npz", "report.html", "summary.json", "used"]
    for options in (["--pictures"], ["--film"], ["--pictures", "--film"]):
        assert main(["simulate", put(FLAP), *options]) == 0
    names = ["motion.npz", "report.html", "summary.json", "used", "worst.png"]
    assert sorted(os.listdir("results/flap")) == names, "added to the report, in one step"
    stored = read_results("results/flap").summary
    assert "pictures" not in stored["left_out"]
    assert stored["files"] == names
    assert asked == [(True, False), (False, True), (True, True)]
    assert "pictures: 1 of 1\n" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ImportError("No module named 'pyvista'"), "No module named 'pyvista'; try pip install"),
        (RuntimeError("bad GL\nat line 3"), "bad GL; try pip install"),
        (HarnessError("pictures: found no OpenGL: install it"), "found no OpenGL: install it\n"),
    ],
)
def test_pictures_that_fail_change_nothing_else(here, capsys, monkeypatch, error, words):
    def draw(*_: object, **__: object) -> list[str]:
        raise error

    monkeypatch.setitem(sys.modules, "harness_opt.pictures.film", stand_in(write_pictures_and_film=draw))
    assert main(["simulate", put(HIT), "--pictures"]) == 1
    out, err = capsys.readouterr()
    assert err.splitlines()[-1].startswith("Pictures left out: ")
    assert words in err
    assert "VIOLATED" in out
    names = ["motion.npz", "report.html", "summary.json", "used"]
    assert sorted(os.listdir("results/flap")) == names, "the report needs none"
    assert "other cables." in Path("results/flap/report.html").read_text(encoding="utf-8")


def test_no_pictures_room_at_all(here, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "harness_opt.pictures.film", None)
    assert main(["simulate", put(FLAP), "--film"]) == 0
    assert 'pip install "harness-opt[pictures]"' in capsys.readouterr().err


def test_show(here, capsys, monkeypatch):
    assert main(["simulate", put(FLAP), *PLAIN, "-q"]) == 0
    shown: list[Path] = []
    monkeypatch.setitem(sys.modules, "harness_opt.pictures.stills", stand_in(show=shown.append))
    monkeypatch.setattr("harness_opt.pictures.stills", sys.modules["harness_opt.pictures.stills"], raising=False)
    assert main(["show", "results/flap"]) == 0
    assert shown == [Path("results/flap")]

    def fail(*_: object) -> None:
        raise RuntimeError("no display")

    monkeypatch.setattr(sys.modules["harness_opt.pictures.stills"], "show", fail)
    assert main(["show", "results/flap"]) == 2
    assert "No window can be shown: no display" in capsys.readouterr().err


# --- the rest ------------------------------------------------------------------------------------------


def test_schema(capsys):
    assert main(["schema"]) == 0
    assert strict(capsys.readouterr().out)["title"] == "Problem file of harness-opt"


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], ["--version"]])
def test_help(capsys, arguments):
    assert main(arguments) == 0
    assert "harness-opt" in capsys.readouterr().out


@pytest.mark.parametrize("command", sorted(cli.commands.commands))
def test_every_command_has_an_example(capsys, command):
    assert main([command, "--help"]) == 0
    assert f"harness-opt {command}" in capsys.readouterr().out.partition("Options:")[0].partition("\n")[2]


def test_a_new_problem_runs_and_can_be_redeemed(here, capsys):
    assert main(["new", "my 'cable'"]) == 0
    file = "my 'cable'.toml"
    assert f"harness-opt check {file}" in capsys.readouterr().out
    assert read_problem(file).title == "my 'cable'"
    assert main(["check", file]) == 0
    assert main(["redesign", file, *PLAIN]) == 0
    out = capsys.readouterr().out
    assert "\nNext: harness-opt simulate results/my 'cable'/redesigned.toml\n" in out
    before = Path(file).read_bytes()
    assert main(["new", file]) == 2
    assert "expected a new one" in capsys.readouterr().err
    assert Path(file).read_bytes() == before
    assert main(["new", "nowhere/file"]) == 2
    assert "nowhere/file.toml: found no way to write it" in capsys.readouterr().err


def test_what_to_do_next(here, capsys):
    assert main(["simulate", put(HIT), *PLAIN]) == 1
    assert "\nNext: harness-opt redesign flap.toml\n" in capsys.readouterr().out
    assert main(["simulate", put(FLAP), *PLAIN]) == 0
    out = capsys.readouterr().out
    assert f"Results: results/flap{os.sep}\n" in out
    assert "Next: " not in out
    assert main(["redesign", put(WALLED), *PLAIN]) == 1
    assert "Next: widen bounds in [design.variables]" in capsys.readouterr().out


def test_the_report_is_named(here, capsys):
    assert main(["simulate", put(FLAP)]) == 0
    assert "Report: results/flap/report.html\n" in capsys.readouterr().out


def test_colours_only_where_they_are_wanted(here):
    put(FLAP)
    plain = run("simulate", "flap.toml", *PLAIN, cwd=here).stdout
    assert "\x1b" not in plain
    assert streams.coloured("margin OK\nmargin VIOLATED\nOK is a name") == (
        "margin\x1b[32m OK\x1b[0m\nmargin\x1b[31m\x1b[1m VIOLATED\x1b[0m\nOK is a name"
    )


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
@pytest.mark.parametrize("no_color", [False, True])
def test_a_terminal_gets_colours_unless_told_not_to(here, no_color):
    import pty

    put(HIT)
    ours, theirs = pty.openpty()
    variables = {**environment(), "TERM": "xterm"} | ({"NO_COLOR": "1"} if no_color else {})
    command = [sys.executable, "-m", "harness_opt", "simulate", "flap.toml", *PLAIN]
    process = subprocess.Popen(command, cwd=here, env=variables, stdin=theirs, stdout=theirs, stderr=subprocess.DEVNULL)
    os.close(theirs)
    shown = b""
    while True:
        try:
            piece = os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
        if not piece:
            break
        shown += piece
    os.close(ours)
    assert process.wait() == 1
    assert (b"\x1b[31m" in shown) is not no_color
    assert b"VIOLATED" in shown


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion(here, capsys, shell):
    assert main(["completion", shell]) == 0
    assert f"_HARNESS_OPT_COMPLETE={shell}_complete" in capsys.readouterr().out
    variables = {
        **environment(),
        "_HARNESS_OPT_COMPLETE": "bash_complete",
        "COMP_WORDS": "harness-opt exp",
        "COMP_CWORD": "1",
    }
    command = [sys.executable, "-m", "harness_opt"]
    done = subprocess.run(command, env=variables, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == ["plain,explain", "plain,export"]


def test_export(here, capsys):
    assert main(["simulate", put(FLAP), *PLAIN, "-q"]) == 0
    assert main(["export", "results/flap", "--to", "csv", "--to", "gltf"]) == 0
    assert capsys.readouterr().out.splitlines()[0].startswith("results/flap/export/lead.csv: ")
    assert sorted(os.listdir("results/flap/export")) == ["lead.csv", "motion.glb"]
    assert main(["export", "results/flap", "--to", "csv", "-o", "elsewhere"]) == 0
    assert os.listdir("elsewhere") == ["lead.csv"]
    assert main(["simulate", put(FLAP), *PLAIN, "-q"]) == 0
    assert "export" not in os.listdir("results/flap"), "what was exported of an earlier result goes with it"


def test_export_that_cannot_be(here, capsys, monkeypatch):
    assert main(["export", "nowhere", "--to", "csv"]) == 2
    assert "nowhere: found no result" in capsys.readouterr().err
    assert main(["export", "nowhere", "--to", "vrml"]) == 2
    assert "'paraview'" in capsys.readouterr().err
    assert main(["simulate", put(FLAP), *PLAIN, "-q"]) == 0
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    assert main(["export", "results/flap", "--to", "stl"]) == 2
    assert 'Nothing exported to stl: found no manifold3d, expected the extra "harness-opt[meshes]"' in (
        capsys.readouterr().err
    )


def test_progress_tells_the_time_left(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    stream = io.StringIO()
    with Interrupts(print) as interrupts, progress_for(interrupts, stream) as progress:
        for done in (2, 12, 22):
            progress("lead", done, 52)
            clock[0] += 10.0
    assert stream.getvalue().splitlines() == [
        "lead: 2 of 52",
        "lead: 12 of 52, about 40 s left",
        "lead: 22 of 52, about 30 s left",
    ]


def test_several_cables_have_one_estimate(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    stream = io.StringIO()
    with Interrupts(print) as interrupts, progress_for(interrupts, stream) as progress:
        told = progress.solving(["lead", "earth"])
        for name, done in (("lead", 5), ("lead", 10), ("earth", 5)):
            told(name, done, 10)
            clock[0] += 10.0
        progress.tell("certifying clearances", 1, 3)
    assert stream.getvalue().splitlines() == [
        "solving lead: 5 of 20",
        "solving lead: 10 of 20, about 20 s left",
        "solving earth: 15 of 20, about 10 s left",
        "certifying clearances: 1 of 3",
    ]


def test_designs_are_counted(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    stream = io.StringIO()
    with Interrupts(print) as interrupts, progress_for(interrupts, stream) as progress:
        told = progress.designs()
        for name, done in (("a", 2), ("a", 9), ("b", 2), ("b", 9), ("a", 2), ("b", 2), ("a", 1)):
            told(name, done, 9)
            clock[0] += 10.0
    assert stream.getvalue().splitlines() == [
        f"looking at design {number}: {done} of 9"
        for number, done in ((1, 2), (1, 9), (1, 2), (1, 9), (2, 2), (2, 2), (3, 1))
    ], "frames of one of many designs say nothing of the end"


def test_a_terminal_gets_a_bar(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("NO_COLOR", "1")
    stream = Terminal()
    with Interrupts(print) as interrupts, progress_for(interrupts, stream) as progress:
        progress("[lead]", 1, 2)
    assert "[lead]" in stream.getvalue()
    assert "1/2" in stream.getvalue()


def test_the_verdict_stands_before_anything_is_written(here, monkeypatch):
    said: list[str] = []
    monkeypatch.setattr(cli, "VOICE", Voice(said.append, lambda *_: None, lambda _: None))
    write = result_files.write_results

    def late(*arguments: object, **options: object) -> object:
        assert "1 of 3 limits violated" in " ".join(said[-1].split()), "told, and nothing written yet"
        assert not Path("results").exists()
        return write(*arguments, **options)

    monkeypatch.setattr(result_files, "write_results", late)
    assert main(["simulate", put(HIT)]) == 1
    assert said[-1].startswith("Results: ")


def test_the_command_line_alone_is_light(here):
    program = (
        "import sys, harness_opt.cli.commands\n"
        "print(*sorted({'numpy', 'scipy', 'casadi', 'pydantic', 'rich', 'trimesh'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""

"""Stores that are damaged or no study's: refused by name, or the row is run again; nothing in them is run."""

from __future__ import annotations

import json
import os
import sqlite3
import time
from pathlib import Path

import pytest

from harness_opt import study
from harness_opt.cli.commands import main
from harness_opt.errors import ProblemError
from harness_opt.studies import store as stores
from harness_opt.studies.store import APPLICATION, LAYOUT, TABLES, Store
from harness_opt.studies.study import plan
from oracles.flap import FLAP, put
from oracles.studies import Here

VALUES = {"cables.lead.length": 0.31}
HEAD = f"PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {LAYOUT};"
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"


def made(script: str, name: str = "kept.sqlite") -> Path:
    with sqlite3.connect(name) as database:
        database.executescript(HEAD + script)
    database.close()
    return Path(name)


FOREIGN = {
    "a view": f"CREATE VIEW variants AS {ENDLESS} SELECT i AS key, 'ok' AS status, '' AS result FROM n",
    "other columns": "CREATE TABLE variants (key, status, result)",
    "computed columns": "CREATE TABLE variants (key, status, result AS (hex(zeroblob(500000000))))",
    "a trigger": f"{TABLES}; CREATE TRIGGER t AFTER INSERT ON variants BEGIN DELETE FROM variants; END",
    "a view beside": f"{TABLES}; CREATE VIEW v AS {ENDLESS} SELECT i FROM n",
    "an index": f"{TABLES}; CREATE INDEX i ON variants (status)",
    "a virtual table": "CREATE VIRTUAL TABLE variants USING fts5(key, status, result)",
    "nothing": "CREATE TABLE other (x)",
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_is_no_study_s_is_refused_at_once(here, kind):
    file = made(FOREIGN[kind])
    before, begin = file.read_bytes(), time.monotonic()
    with pytest.raises(ProblemError, match=r"^kept\.sqlite: found no way to use it \(a database of something else\)"):
        Store(file)
    assert time.monotonic() - begin < 5
    assert file.read_bytes() == before


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_pipe_is_not_waited_for(here):
    os.mkfifo("kept.sqlite")
    with pytest.raises(ProblemError, match=r"kept\.sqlite: found no way to use it \(a folder or a device\)"):
        Store(Path("kept.sqlite"))


def good() -> dict:
    """The row of a variant as a study writes it."""
    with Store(Path("kept.sqlite")) as store:
        store.keep(study("flap.toml", [VALUES], executor=Here()))
        text = store._connection.execute("SELECT result FROM variants").fetchone()[0]
    return json.loads(text)


SPOILT = {
    "NaN": lambda row: json.dumps(row | {"worst_margin": float("nan")}),
    "infinite": lambda row: json.dumps(row | {"seconds": float("inf")}),
    "a text for a number": lambda row: json.dumps(row | {"worst_margin": "0.5"}),
    "a number for a text": lambda row: json.dumps(row | {"reason": 3}),
    "a list for a table": lambda row: json.dumps(row | {"margins": [1, 2]}),
    "texts in a table": lambda row: json.dumps(row | {"margins": {"clearance.lead.ball": "0.1"}}),
    "no status of ours": lambda row: json.dumps(row | {"status": "splendid"}),
    "a limit without margin": lambda row: json.dumps(row | {"worst_margin": None}),
    "truth for a number": lambda row: json.dumps(row | {"frames": True}),
    "less than nothing": lambda row: json.dumps(row | {"frames": -1}),
    "another key": lambda row: json.dumps(row | {"key": "0" * 64}),
    "too many fields": lambda row: json.dumps(row | {"more": 1}),
    "too few": lambda row: json.dumps({"number": 0}),
    "no table": lambda row: "[]",
    "no JSON": lambda row: "{",
    "deep": lambda row: "[" * 100_000,
    "nothing": lambda row: "",
    "a number": lambda row: 5,
    "bytes": lambda row: b"\xff\xfe\x00",
}


@pytest.mark.parametrize("kind", SPOILT)
def test_a_row_that_no_study_wrote_is_run_again(here, kind):
    put(FLAP)
    row = good()
    spoilt = SPOILT[kind](row)
    with sqlite3.connect("kept.sqlite") as database:
        database.execute("UPDATE variants SET result = ?", (spoilt,))
    database.close()
    executor = Here()
    (found,) = study("flap.toml", [VALUES], executor=executor, store="kept.sqlite")
    assert executor.count == 1
    assert found.margins == row["margins"]
    with Store(Path("kept.sqlite")) as store:  # and mended
        assert set(store.found(plan("flap.toml", [VALUES]).keys)) == {found.key}


def test_a_row_that_is_no_text_to_sqlite_is_run_again(here):
    put(FLAP)
    good()
    with sqlite3.connect("kept.sqlite") as database:
        database.execute("UPDATE variants SET result = CAST(x'fffe7b' AS TEXT)")
    database.close()
    executor = Here()
    list(study("flap.toml", [VALUES], executor=executor, store="kept.sqlite"))
    assert executor.count == 1


@pytest.mark.parametrize("place", range(100, 12_000, 700))
def test_damage_anywhere_is_told_or_the_row_run_again(here, place):
    put(FLAP)
    put('schema = 1\nproblem = "flap.toml"\nmethod = "grid"\n[vary]\n"cables.lead.length" = [0.3]\n', "study.toml")
    good()
    folder = Path("results/study")
    folder.mkdir(parents=True)
    content = bytearray(Path("kept.sqlite").read_bytes())
    content[place : place + 64] = b"\xa5" * len(content[place : place + 64])
    (folder / "study.sqlite").write_bytes(content)
    code = main(["study", "study.toml", "--workers", "1", "-q"])
    assert code in (0, 2)


def test_damage_is_told_with_the_name_of_the_file(here, capsys):
    put(FLAP)
    put('schema = 1\nproblem = "flap.toml"\nmethod = "grid"\n[vary]\n"cables.lead.length" = [0.3]\n', "study.toml")
    good()
    folder = Path("results/study")
    folder.mkdir(parents=True)
    content = Path("kept.sqlite").read_bytes()
    (folder / "study.sqlite").write_bytes(content[:4096] + b"\xff" * (len(content) - 4096))
    assert main(["study", "study.toml", "--workers", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == (
        "results/study/study.sqlite: found no way to use it (database disk image is malformed), "
        "expected a file of a study, or none"
    )


def test_no_query_is_without_an_end(here, monkeypatch):
    put(FLAP)
    good()
    monkeypatch.setattr(stores, "LONGEST", 0.2)
    with Store(Path("kept.sqlite")) as store:
        monkeypatch.setattr(
            Store, "_rows", lambda self, _: self._connection.execute(f"{ENDLESS} SELECT max(i), 1 FROM n")
        )
        begin = time.monotonic()
        with pytest.raises(ProblemError, match=r"kept\.sqlite: found no end of reading it in 0\.2 s"):
            store.found(["x"])
    assert time.monotonic() - begin < 5

"""What a study has found so far, in an SQLite file: killed at any moment, it goes on from there.

One row a variant, by the sha256 of all that its result depends on, so a changed problem finds no old rows. The file is
held by one study at a time, and a row counts once it is committed.
"""

from __future__ import annotations

import dataclasses
import json
import sqlite3
from collections.abc import Iterable, Mapping
from pathlib import Path

from harness_opt.errors import ProblemError
from harness_opt.studies.variant import LOST, VariantResult

APPLICATION = 0x686F7374  # "host": marks the file as ours (sqlite.org/pragma.html#pragma_application_id)
LAYOUT = 1  # version of the tables below
WAIT = 2.0  # s for another study to let go of the file
AT_ONCE = 500  # keys asked for in one query; SQLite's own limit was 999 variables for long
TABLES = """
CREATE TABLE variants (
    key TEXT PRIMARY KEY,
    status TEXT NOT NULL,
    worst_limit TEXT,
    worst_margin REAL,
    seconds REAL NOT NULL,
    result TEXT NOT NULL
) WITHOUT ROWID
"""


class Store:
    """A file of finished variants; a context manager.

    Args:
        file: made where it is missing; None keeps them in memory.

    Raises:
        ProblemError: another study is using it, it is no store, or it can't be written.
    """

    def __init__(self, file: Path | None):
        self.file = file
        try:
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
            # any thread: results come from those of an executor
            self._connection = sqlite3.connect(file or ":memory:", timeout=WAIT, isolation_level=None)
            try:
                self._open()
            except BaseException:
                self.close()
                raise
        except (OSError, sqlite3.Error) as error:
            busy = "locked" in str(error)
            found = "a study that is running" if busy else f"no way to use it ({error})"
            expected = "it ended" if busy else "a file of a study, or none"
            raise ProblemError(f"{file}: found {found}, expected {expected}") from error

    def _open(self) -> None:
        run = self._connection.execute
        run("PRAGMA locking_mode = EXCLUSIVE")  # let go of by a process that dies, too
        run("BEGIN EXCLUSIVE")
        application, layout = (run(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version"))
        empty = not run("SELECT count(*) FROM sqlite_schema").fetchone()[0]
        if empty:
            run(f"PRAGMA application_id = {APPLICATION}")
            run(f"PRAGMA user_version = {LAYOUT}")
            run(TABLES)
        elif (application, layout) != (APPLICATION, LAYOUT):
            run("ROLLBACK")
            raise sqlite3.DatabaseError("a database of something else")
        run("COMMIT")

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()

    def found(self, keys: Iterable[str]) -> dict[str, VariantResult]:
        """Return what is known of ``keys``; what its worker was lost with is not, and is worth another try."""
        asked, known = list(keys), {}
        for first in range(0, len(asked), AT_ONCE):
            some = asked[first : first + AT_ONCE]
            marks = ", ".join("?" * len(some))
            query = f"SELECT key, result FROM variants WHERE status != ? AND key IN ({marks})"
            for key, text in self._connection.execute(query, (LOST, *some)):
                known[key] = VariantResult(**json.loads(text))
        return known

    def keep(self, results: Iterable[VariantResult]) -> None:
        """Add ``results``, all or none.

        Raises:
            ProblemError: the disk refuses.
        """
        rows = [(r.key, r.status, r.worst_limit, r.worst_margin, r.seconds, _text(r)) for r in results]
        try:
            self._connection.execute("BEGIN")
            self._connection.executemany("INSERT OR REPLACE INTO variants VALUES (?, ?, ?, ?, ?, ?)", rows)
            self._connection.execute("COMMIT")
        except sqlite3.Error as error:
            raise ProblemError(f"{self.file}: found no way to write it ({error}), expected one") from error


def _text(result: VariantResult) -> str:
    """Return a result as strict JSON."""
    content = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    return json.dumps({k: dict(v) if isinstance(v, Mapping) else v for k, v in content.items()}, allow_nan=False)

"""What a study has found so far, in an SQLite file: killed at any moment, it goes on from there.

One row a variant, by the sha256 of all that its result depends on, so a changed problem finds no old rows. The file is
held by one study at a time, and a row counts once it is committed.

Files come from elsewhere, too: one that holds anything but the table below is refused, before it is asked anything that
would run what it holds; a row that no study wrote is not known, and its variant runs again.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from harness_opt.errors import ProblemError
from harness_opt.studies.variant import LOST, STATUSES, VariantResult

APPLICATION = 0x686F7374  # "host": marks the file as ours (sqlite.org/pragma.html#pragma_application_id)
LAYOUT = 1  # version of the tables below
WAIT = 2.0  # s for another study to let go of the file
LONGEST = 60.0  # s of one query: a million rows take ten
STEPS = 100_000  # of SQLite's machine between two looks at the clock
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
                if file.exists() and not file.is_file():  # a pipe would be waited for
                    raise OSError("a folder or a device")
            # any thread: results come from those of an executor
            self._connection = sqlite3.connect(file or ":memory:", timeout=WAIT, isolation_level=None)
            try:
                self._open()
            except BaseException:
                self.close()
                raise
        except (OSError, sqlite3.Error) as error:
            raise self._refusal(error) from error

    def _open(self) -> None:
        run = self._connection.execute
        self._end = time.monotonic() + LONGEST
        self._connection.set_progress_handler(lambda: time.monotonic() > self._end, STEPS)
        self._connection.text_factory = bytes  # what is no UTF-8 is a row like any other that no study wrote
        run("PRAGMA trusted_schema = OFF")
        run("PRAGMA locking_mode = EXCLUSIVE")  # let go of by a process that dies, too
        run("BEGIN EXCLUSIVE")
        application, layout = (run(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version"))
        empty = not run("SELECT count(*) FROM sqlite_schema").fetchone()[0]
        if empty:
            run(f"PRAGMA application_id = {APPLICATION}")
            run(f"PRAGMA user_version = {LAYOUT}")
            run(TABLES)
        elif (application, layout) != (APPLICATION, LAYOUT) or not self._is_ours():
            run("ROLLBACK")
            raise sqlite3.DatabaseError("a database of something else")
        run("COMMIT")

    def _is_ours(self) -> bool:
        """Return whether the file holds the table of :data:`TABLES` and nothing else: no view, trigger or index."""
        held = self._connection.execute("SELECT type, name, sql FROM sqlite_schema").fetchmany(2)
        made = [(b"table", b"variants", " ".join(TABLES.split()).encode())]
        return [(kind, name, b" ".join((sql or b"").split())) for kind, name, sql in held] == made

    def _refusal(self, error: Exception) -> ProblemError:
        """Return the error for a file that cannot be used."""
        busy = "locked" in str(error)
        slow = "interrupted" in str(error)
        found = f"no end of reading it in {LONGEST:g} s" if slow else f"no way to use it ({error})"
        found = "a study that is running" if busy else found
        expected = "it ended" if busy else "a file of a study, or none"
        return ProblemError(f"{self.file}: found {found}, expected {expected}")

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()

    def found(self, keys: Iterable[str]) -> dict[str, VariantResult]:
        """Return what is known of ``keys``; what its worker was lost with is not, and is worth another try.

        Raises:
            ProblemError: the file is damaged.
        """
        asked, known = list(keys), {}
        try:
            for first in range(0, len(asked), AT_ONCE):
                self._end = time.monotonic() + LONGEST
                for key, text in self._rows(asked[first : first + AT_ONCE]):
                    result = _result(key, text)
                    if result is not None and result.status != LOST:
                        known[result.key] = result
        except sqlite3.Error as error:
            raise self._refusal(error) from error
        return known

    def _rows(self, keys: list[str]) -> Iterator[tuple[Any, Any]]:
        marks = ", ".join("?" * len(keys))
        yield from self._connection.execute(f"SELECT key, result FROM variants WHERE key IN ({marks})", keys)

    def keep(self, results: Iterable[VariantResult]) -> None:
        """Add ``results``, all or none.

        Raises:
            ProblemError: the disk refuses.
        """
        rows = [(r.key, r.status, r.worst_limit, r.worst_margin, r.seconds, _text(r)) for r in results]
        self._end = time.monotonic() + LONGEST
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


def _result(key: Any, text: Any) -> VariantResult | None:
    """Return the result that a row holds; None where no study wrote it."""
    try:
        content = json.loads(text, parse_constant=_refuse)
        result = VariantResult(**content)
    except (ValueError, TypeError, RecursionError):
        return None
    return result if _sound(result) and key == result.key.encode() else None


def _refuse(name: str) -> None:
    raise ValueError(name)  # NaN or Infinity, which strict JSON has none of


def _sound(result: VariantResult) -> bool:
    """Return whether a result that was read has the types of one that was made, and numbers that are finite."""
    texts = all(isinstance(text, str) for text in (result.key, result.status, result.reason))
    counts = all(type(count) is int and count >= 0 for count in (result.number, result.frames, result.snaps))
    limit = result.worst_limit is None and result.worst_margin is None
    limit = limit or (isinstance(result.worst_limit, str) and _finite(result.worst_margin))
    tables = all(
        isinstance(table, dict) and all(map(_finite, table.values()))
        for table in (result.margins, result.worst, result.after)
    )
    plain = texts and counts and isinstance(result.values, dict) and isinstance(result.stable, bool)
    return plain and limit and tables and _finite(result.seconds) and result.status in STATUSES


def _finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)

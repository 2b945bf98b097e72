"""Does a run that is killed leave anything that looks finished and is not?

    python scripts/checks/kill.py --kills 50
    python scripts/checks/kill.py --kills 4 --seed 3

``simulate`` and ``redesign`` are killed (SIGKILL, which nobody can catch) at random moments, half of them while the
result folder is being written: as soon as a hidden folder appears beside the target, and up to a tenth of a second
later. Half of the runs find an earlier result in their place. Afterwards the folder has to be the earlier result to the
last byte, a new one that reads back whole, or absent; and the next run has to clear away what is hidden beside it.
"""

from __future__ import annotations

import argparse
import collections
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOON = 0.1  # s after a hidden folder appears
POLL = 5e-4  # s between two looks
LONGEST = 120.0  # s that a run may take
PROBLEM = Path(__file__).with_name("flap.toml")  # violated, and redeemed by more length
# the report is written, and then pictures are left out for want of pyvista: three chances to be caught writing
CODE = "import sys; sys.modules['pyvista'] = None; from harness_opt.cli.commands import main; sys.exit(main())"


def started(command: str, folder: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start ``command`` in ``folder``."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-c", CODE, command, "flap.toml", "-o", "out/result", "-q", *options],
        cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def content(folder: Path) -> dict[str, str]:
    """Return the digests of all files in ``folder``, by name; nothing where it is absent."""
    return {
        file.relative_to(folder).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


def hidden(folder: Path) -> list[str]:
    """Return the names of what is hidden in ``folder``."""
    return [entry.name for entry in folder.iterdir() if entry.name.startswith(".")] if folder.is_dir() else []


def killed(command: str, folder: Path, dice: random.Random, whole: float) -> str:
    """Kill a run of ``command`` at a random moment; return whether its result is "old", "new" or "absent".

    Args:
        command: to run.
        folder: to run it in.
        dice: for the moment.
        whole: s that a run takes if nobody kills it.

    Raises:
        RuntimeError: the result is none of these.
    """
    from harness_opt.errors import HarnessError
    from harness_opt.files.stored_results import read_results

    result = folder / "out" / "result"
    before, old_hidden = content(result), set(hidden(result.parent))
    process = started(command, folder)
    if dice.random() < 0.5:
        end = time.monotonic() + dice.uniform(0.0, whole)
        while time.monotonic() < end and process.poll() is None:
            time.sleep(POLL)
    else:
        wait = dice.randrange(3)  # which of the times that it writes
        seen: set[str] = set()
        while process.poll() is None:
            now = set(hidden(result.parent)) - old_hidden
            if now - seen and not wait:
                break
            wait -= len(now - seen)
            seen = now
            time.sleep(POLL)
        time.sleep(dice.uniform(0.0, SOON))
    process.send_signal(signal.SIGKILL)
    process.wait(LONGEST)
    after = content(result)
    if not result.exists():
        if before:
            raise RuntimeError(f"{command}: the earlier result is gone")
        return "absent"
    if after == before:
        return "old"
    try:
        stored = read_results(result)
    except HarnessError as error:
        raise RuntimeError(f"{command}: {error}") from error
    if set(stored.summary["files"]) != {name.partition("/")[0] for name in after}:
        raise RuntimeError(f"{command}: {sorted(after)} are not {stored.summary['files']}")
    return "new"


def main() -> int:
    """Kill runs and print how they ended."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50, help="of each command")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    dice = random.Random(given.seed)
    sys.path.insert(0, str(ROOT))
    for command in ("simulate", "redesign"):
        ends: collections.Counter[str] = collections.Counter()
        left = 0
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            shutil.copy(PROBLEM, folder / "flap.toml")
            begin = time.monotonic()
            started(command, folder).wait(LONGEST)
            whole = time.monotonic() - begin
            for _ in range(given.kills):
                if dice.random() < 0.5 and (folder / "out").is_dir():
                    (folder / "out").rename(folder / f"out{time.monotonic_ns()}")
                ends[killed(command, folder, dice, whole)] += 1
                left += bool(hidden(folder / "out"))
            started(command, folder).wait(LONGEST)
            if hidden(folder / "out"):
                raise RuntimeError(f"{command}: the next run left {hidden(folder / 'out')}")
        words = ", ".join(f"{count} {end}" for end, count in sorted(ends.items()))
        print(f"{command}: killed {given.kills} times within {whole:.1f} s: {words}; {left} left something hidden")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Run the pages of the documentation and put what their commands print today in the place of what they show.

python scripts/docs/refresh.py [PAGE ...]   all pages with console blocks, where none is named
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from oracles.pages import RUN, Reader, blocks, commands_of, pages  # noqa: E402


def main() -> None:
    """Refresh the pages that are named."""
    for page in [Path(name).resolve() for name in sys.argv[1:]] or pages():
        if any(block.language == "console" for block in blocks(page)):
            refresh(page)


def refresh(page: Path) -> None:
    """Run a page and write what its commands print."""
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        reader = Reader(Path(folder))
        reader.prepare(page)
        cursor = 0  # what is before it is done: two blocks may show the same
        for block in (block for block in blocks(page) if block.language in RUN):
            if block.language != "console" or "not run" in block.asked or "\n...\n" in block.text:
                reader.do(block)
                continue
            commands = [command for command, _ in commands_of(block.text)]
            codes = [0] * (len(commands) - 1) + [int(block.asked.get("exit", 0))]
            new = "".join(
                f"$ {command}\n{reader.command(command, code)}" for command, code in zip(commands, codes, strict=True)
            )
            new = new.rstrip("\n") + "\n"
            place = text.index(f"```console\n{block.text}", cursor) + len("```console\n")
            text = text[:place] + new + text[place + len(block.text) :]
            cursor = place + len(new)
    page.write_text(text, encoding="utf-8")
    print(page.relative_to(ROOT))


if __name__ == "__main__":
    main()

"""A real browser without a screen, for tests of pages: skipped with a reason where none is to be had."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# WebGL in software: machines that run tests have no graphics card
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
# the canvas as pixels: counts of colours, and the centre of those that are neither grey nor pale
PIXELS = """() => {
  const canvas = document.querySelector('#canvas'), copy = document.createElement('canvas');
  Object.assign(copy, { width: canvas.width, height: canvas.height });
  const context = copy.getContext('2d');
  context.drawImage(canvas, 0, 0);
  const bytes = context.getImageData(0, 0, copy.width, copy.height).data, colours = new Set();
  let vivid = 0, x = 0, y = 0;
  for (let i = 0; i < bytes.length; i += 4) {
    const [r, g, b] = [bytes[i], bytes[i + 1], bytes[i + 2]];
    colours.add((r << 16) | (g << 8) | b);
    if (Math.max(r, g, b) - Math.min(r, g, b) < 60) continue;
    vivid++;
    x += (i / 4) % copy.width;
    y += Math.floor(i / 4 / copy.width);
  }
  return { colours: colours.size, vivid, x: x / vivid, y: y / vivid, width: copy.width, height: copy.height };
}"""


@dataclass
class Page:
    """A page that was opened, and all it said and asked for."""

    page: Any
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def pixels(self) -> dict[str, float]:
        """Return what is on the canvas."""
        return self.page.evaluate(PIXELS)

    def choose(self, selector: str) -> None:
        """Click a control that is drawn over by its words, and wait for the next picture."""
        self.page.evaluate("selector => document.querySelector(selector).click()", selector)
        self.settle()

    def slide(self, moment: float) -> None:
        """Move the slider as a hand does."""
        move = """moment => { const slider = document.querySelector('#slider'); slider.value = moment;
          slider.dispatchEvent(new Event('input', { bubbles: true })); }"""
        self.page.evaluate(move, moment)
        self.settle()

    def settle(self) -> None:
        """Wait until two pictures have been drawn."""
        self.page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


@contextmanager
def opened(file: Path, **options: Any) -> Iterator[Page]:
    """Open ``file`` in a browser; what the page says on its console and asks of the network is kept."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright (the extra 'test') is not installed")
    program = next((found for name in NAMES if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no browser was found, of {', '.join(NAMES)} (Debian: apt-get install chromium)")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=ARGUMENTS)
        try:
            view = Page(browser.new_page(viewport={"width": 1200, "height": 900}, **options))
            view.page.on("console", lambda message: view.said.append(f"{message.type}: {message.text}"))
            view.page.on("pageerror", lambda error: view.said.append(str(error)))
            view.page.on("dialog", lambda dialog: view.said.append(f"dialog: {dialog.message}"))
            view.page.on("request", lambda request: view.asked.append(request.url))
            view.page.goto(file.as_uri())
            view.settle()
            yield view
        finally:
            browser.close()


def looked_through(file: Path, motion: np.ndarray, *, parts: bool) -> None:
    """Use the controls of the report ``file`` as a reader does, and hold what is to be seen against ``motion`` (P,)."""
    with opened(file) as view:
        assert view.pixels()["colours"] > 100, "the canvas is not blank"
        view.choose("input[name=ghosts]")
        view.choose("input[name=witness]")
        if parts:
            before = view.page.evaluate("document.querySelector('#canvas').toDataURL()")
            view.choose("input[name=parts][value=none]")
            assert view.page.evaluate("document.querySelector('#canvas').toDataURL()") != before
        centres = []
        for moment in motion[[0, len(motion) // 4, -1]]:
            view.slide(moment)
            shown = view.pixels()
            assert shown["vivid"] > 300, "the cable is to be seen"
            told = float(re.search(r"([\d.]+) %", view.page.inner_text("#moment"))[1])
            assert told == pytest.approx(100 * moment, abs=3), "the nearest frame, percent"
            centres.append((shown["x"], shown["y"]))
        assert np.ptp(centres, axis=0).max() > 5, "the slider moves the cable, pixels"
        for mode in ("clearance", "bend", "twist"):
            if view.page.locator(f"input[name=mode][value={mode}]").count():
                view.choose(f"input[name=mode][value={mode}]")
                assert view.page.is_visible("#ramp")
        assert view.said == []
        assert view.asked == [file.as_uri()]

"""The picture of a report in README.md: what does the page that a redesign writes look like in a browser?

Needs Chromium and the package playwright (the extra "test"). Writes problems/lift_arm/report.png.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import harness_opt as ho
from harness_opt.report.html_page import prepare, write_page
from harness_opt.report.summary import summary

FOLDER = Path(__file__).resolve().parents[2] / "problems" / "lift_arm"
SIZE = {"width": 1140, "height": 960}
# WebGL in software, so that the picture is the same everywhere
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


def main() -> None:
    """Redesign the lift arm, open the report, and take its picture."""
    from playwright.sync_api import sync_playwright

    design = ho.redesign(ho.read_problem(FOLDER / "lift_arm.toml"))
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        file = Path(folder) / write_page(prepare(design), summary(design), Path(folder))
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        page = browser.new_page(viewport=SIZE)
        page.goto(file.as_uri())
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        page.screenshot(path=FOLDER / "report.png")
        browser.close()
    print(FOLDER / "report.png")


if __name__ == "__main__":
    main()

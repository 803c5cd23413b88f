#!/usr/bin/env python
"""Draw the pictures of boards and of the report that the docs show, from the committed records.

python scripts/draw_report.py                # frontiers, and hard cases case by case
python scripts/draw_report.py --screenshots  # also the report in Chromium; needs playwright
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import click

from tactibench import api

ROOT = Path(__file__).resolve().parents[1]
BOARD, IMAGES = ROOT / "leaderboards", ROOT / "docs" / "images"
HARD = "stability"
"""The protocol of the hard cases."""
CURVES = ("superpose", "vgnn", "unet", "pins", "cnn", "mixture")
"""Models whose errors are shown case by case: a panel holds six."""
SHOTS = {"report-wide": (1280, 1650, "#glance"), "report-phone": (390, 1400, "#exp2")}
"""Name -> width and height of the window, px, and the section at its top."""


def draw_boards() -> None:
    """Draw the frontiers and the hard cases."""
    for name in ("exp1", "exp2", "exp3"):
        api.plot("frontier", name, board=BOARD).save(IMAGES / f"frontier-{name}.png")
    api.plot("stability", HARD, board=BOARD, rows=list(CURVES)).save(
        IMAGES / "stability-errors.png"
    )


def take_screenshots() -> None:
    """Take pictures of the report of the boards in Chromium, of a wide window and of a phone."""
    from playwright.sync_api import sync_playwright

    from tactibench.report import gather, report_page

    path = os.environ.get("TACTIBENCH_CHROMIUM") or shutil.which("chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page = Path(folder) / "report.html"
        page.write_text(report_page(gather(None, BOARD)), "utf-8")
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        for name, (width, height, top) in SHOTS.items():
            tab = browser.new_page(viewport={"width": width, "height": height})
            tab.goto(page.as_uri())
            tab.wait_for_selector("html[data-ready]", state="attached")
            if top != "#glance":
                tab.locator(top).evaluate("section => section.scrollIntoView()")
            tab.screenshot(path=IMAGES / f"{name}.png")
        browser.close()


@click.command()
@click.option("--screenshots", is_flag=True, help="Also show the report in Chromium.")
def main(*, screenshots: bool) -> None:
    """Draw the pictures of boards and of the report."""
    draw_boards()
    if screenshots:
        take_screenshots()


if __name__ == "__main__":
    main()

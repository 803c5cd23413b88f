"""Record `tactibench demo` as an animated picture: docs/images/demo.gif.

    python scripts/record_demo.py [--models superpose,kernel] [--out docs/images/demo.gif]

This is a real session in headless Chromium: a mouse drags one tip, presses deeper, adds a second
tip, and takes another sensor instance. It needs `pip install "tactibench[browser]"`, a Chromium,
and weights in the cache.
"""

from __future__ import annotations

import io
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from PIL import Image
from PIL.ImageColor import getrgb

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "shared"))

MOST_BYTES = 1_500_000
WIDTH = 800
"""Width of the picture, px: as the README shows it."""
ACCENTS = ("#ff7a1a", "#2ecc71", "#b3261e", "#0b5c97", "#ffffff", "#000000")
"""Colours of small marks, which a palette by area would leave out."""
FRAME_MS = 125


def session(page: Any) -> Iterator[None]:
    """Move the mouse and yield at every step, so that a picture can be taken."""
    box = page.locator("#dome canvas").bounding_box()

    def at(x_mm: float, y_mm: float) -> tuple[float, float]:
        return tuple(
            box[low] + box[size] * (value / 12.8 + 1) / 2
            for low, size, value in (("x", "width", x_mm), ("y", "height", y_mm))
        )

    page.mouse.move(*at(4, 0))
    page.mouse.down()
    for k in range(24):  # one circle
        turn = 2 * math.pi * k / 24
        page.mouse.move(*at(4 * math.cos(turn), 4 * math.sin(turn)))
        yield
    for k in range(8):  # to the left, and deeper
        page.mouse.move(*at(4 - k, 0))
        page.mouse.wheel(0, -100)
        yield
    page.mouse.up()
    page.keyboard.down("Shift")  # a second tip, which comes nearer
    page.mouse.move(*at(6, 5))
    page.mouse.down()
    page.keyboard.up("Shift")
    for k in range(10):
        page.mouse.move(*at(6 - 0.25 * k, 5 - 0.5 * k))
        yield
    page.mouse.up()
    for instance in (0, 3, 3, 3, 7, 7, 7, 0, 0):  # other sensors of the same make
        page.locator("input[name=instance]").fill(str(instance))
        yield


def pictures(url: str) -> list[Image.Image]:
    """Return one picture for each step of a session, each taken after its answer was shown."""
    from browser import chromium
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1180, "height": 600}, color_scheme="light")
        page.goto(url)
        page.wait_for_function("() => document.documentElement.dataset.ready && state.last")
        shots = []
        for _ in session(page):
            page.wait_for_function("() => !state.busy && !state.changed")
            shots.append(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
        browser.close()
    return shots


@click.command()
@click.option("--models", default="superpose,kernel", show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    default=ROOT / "docs" / "images" / "demo.gif",
)
def main(models: str, out: Path) -> None:
    """Record a session and write it as a GIF."""
    from demo_page import demo_page

    with demo_page(models.split(",")) as (url, _):
        shots = pictures(url)
    small = [
        shot.resize((WIDTH, shot.height * WIDTH // shot.width), Image.Resampling.LANCZOS)
        for shot in shots
    ]
    # One palette for all, so that colours do not flicker, and no dither, which would not compress.
    sample = Image.new("RGB", (WIDTH, small[0].height * 3))
    for k, number in enumerate((0, len(small) // 2, len(small) - 1)):
        sample.paste(small[number], (0, k * small[0].height))
    by_area = sample.quantize(256 - len(ACCENTS)).getpalette()
    assert by_area is not None  # noqa: S101 - quantize makes pictures with a palette
    commonest = by_area[: 3 * (256 - len(ACCENTS))]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*commonest, *(value for name in ACCENTS for value in getrgb(name))])
    frames = [shot.quantize(palette=palette, dither=Image.Dither.NONE) for shot in small]
    frames[0].save(
        out, save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, optimize=True
    )
    size = out.stat().st_size
    click.echo(f"{out}: {len(frames)} pictures, {size / 1e6:.2f} MB")
    if size > MOST_BYTES:
        raise click.ClickException(f"a README's picture may have {MOST_BYTES / 1e6} MB")


if __name__ == "__main__":
    main()

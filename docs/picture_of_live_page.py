"""The picture of the live page: a simulated run of the door, as Chromium shows it."""

from __future__ import annotations

import io
import shutil
import sys

from picture_style import PICTURES
from PIL import Image
from playwright.sync_api import sync_playwright

_ARGUMENTS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_PANELS = ("log", "progress", "image", "curve", "part")


def draw_live_page(url: str) -> None:
    """Draw a run that is served: ``http://127.0.0.1:8765/#run=NAME``."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(_ARGUMENTS)
        )
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(url)
        for name in _PANELS:
            page.wait_for_selector(f"body[data-{name}]", timeout=60_000)
        page.wait_for_timeout(500)
        shown = io.BytesIO(page.screenshot())
        browser.close()
    with Image.open(shown) as image:
        few = image.convert("RGB").quantize(
            256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
        )
    few.save(PICTURES / "live.png", optimize=True)


if __name__ == "__main__":
    draw_live_page(sys.argv[1])

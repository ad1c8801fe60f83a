"""How long the live page takes to draw a finished run, and how much it loads.

In headless Chromium with a software renderer, without anything in its cache. The page is drawn when
part, image, curve, progress and log are, and the part can be turned when plotly.js has drawn it
again; times are counted from the start of the navigation.
"""

import shutil
import statistics

from playwright.sync_api import Browser, sync_playwright

ARGUMENTS = (
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
_PANELS = ("log", "progress", "image", "curve", "part")
_WAIT_MS = 60_000
_LOADED = """() => performance.getEntriesByType("resource").concat(
  performance.getEntriesByType("navigation")).reduce((sum, each) => sum + each.transferSize, 0)"""
_DRAWN = """(names) => Math.max(...names.map((name) =>
  performance.getEntriesByName(name)[0].startTime))"""


def measure_page(url: str, repeats: int = 5) -> dict[str, float]:
    """Return the median time to draw a page, and what it loads.

    Parameters
    ----------
    url : str
        The page's, with a finished run named in its fragment: ``http://…/#run=NAME``.
    repeats : int
        Visits, each with an empty cache.

    Returns
    -------
    dict
        ``page_load_s``, ``part_turnable_s`` and ``page_bytes_mb``, MB of 10⁶ bytes as transferred.
    """
    executable = shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        msg = "Chromium is needed: apt-get install chromium"
        raise FileNotFoundError(msg)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=list(ARGUMENTS))
        visits = [_visit(browser, url) for _ in range(repeats)]
        browser.close()
    drawn, turnable, sizes = zip(*visits, strict=True)
    return {
        "page_load_s": statistics.median(drawn),
        "part_turnable_s": statistics.median(turnable),
        "page_bytes_mb": max(sizes) / 1e6,
    }


def _visit(browser: Browser, url: str) -> tuple[float, float, float]:
    """Return the s until the page is drawn and the part can be turned, and the bytes loaded."""
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    page = context.new_page()
    page.goto(url)
    for name in (*_PANELS, "turnable"):
        page.wait_for_selector(f"body[data-{name}]", timeout=_WAIT_MS)
    drawn_s, turnable_s = (
        float(page.evaluate(_DRAWN, list(names))) / 1000.0 for names in (_PANELS, ["turnable"])
    )
    size = float(page.evaluate(_LOADED))
    context.close()
    return drawn_s, turnable_s, size

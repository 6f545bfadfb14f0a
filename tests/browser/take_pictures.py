"""`make pictures`: the page as the README shows it, taken anew in Chromium while `make demo` records.

What is on them is what the study's own virtual sensors and interpreters give. Takes some four minutes; look at the
pictures in docs/images before they are committed.
"""

import re
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from demo_process import ROOT, Demo
from gui_browser import ARGUMENTS, chromium_path
from playwright.sync_api import Browser, ViewportSize, expect, sync_playwright

IMAGES = ROOT / "docs" / "images"
BEGINS_S = 120.0
RECORDED = re.compile(r"0:01:1\d")
"""Short-term features are there by then, and of the nine modalities' minute a muscle, a blink and a response."""
RECORDED_WITHIN_S = 120.0


class Shot(NamedTuple):
    """A picture of the page during a study; scale: pixels of the picture for each of the page."""

    study: str
    file_name: str
    theme: str
    size: ViewportSize
    scale: float


SHOTS = (
    Shot("demo", "gui-dark.png", "dark", {"width": 1280, "height": 800}, 1.5),
    Shot("demo", "gui-light.png", "light", {"width": 1280, "height": 800}, 1.5),
    Shot("nine-modalities", "gui-nine-modalities.png", "dark", {"width": 1920, "height": 1800}, 1.0),
)


def main() -> int:
    """Take them all; 1 where there is no browser."""
    path = chromium_path()
    if path is None:
        print("no Chromium: install the Debian package `chromium`", file=sys.stderr)
        return 1
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        for study in dict.fromkeys(shot.study for shot in SHOTS):
            _take(browser, study)
        browser.close()
    return 0


def _take(browser: Browser, study: str) -> None:
    print(f"{study}: begins ...", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        demo = Demo(Path(folder), "--study", study)
        try:
            demo.until(" records, into ", BEGINS_S)
            address = re.search(r"the page: +(\S+)", "\n".join(demo.lines))
            assert address, demo.lines
            for shot in (shot for shot in SHOTS if shot.study == study):
                _shoot(browser, address[1], shot)
        finally:
            demo.end()


def _shoot(browser: Browser, address: str, shot: Shot) -> None:
    """Wait for a minute of recording, choose the first signal, and take the picture."""
    context = browser.new_context(viewport=shot.size, device_scale_factor=shot.scale, color_scheme=shot.theme)
    page = context.new_page()
    page.goto(address)
    expect(page.locator("#recording")).to_have_text(RECORDED, timeout=RECORDED_WITHIN_S * 1000)
    page.locator("#lanes .lane").first.click()
    page.mouse.move(0, 0)  # or a line through all signals follows it
    expect(page.locator("#details")).to_contain_text("quality")
    page.screenshot(path=str(IMAGES / shot.file_name))
    print(f"{shot.study}: docs/images/{shot.file_name}", flush=True)
    context.close()


if __name__ == "__main__":
    sys.exit(main())

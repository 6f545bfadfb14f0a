"""The report of a session on a phone."""

import pytest
from playwright.sync_api import Browser
from sense4hri_report.streams_page import stream_table
from sense4hri_report.style import STYLE

STREAM = {"stream": "p1/accelerometer/verity_1", "kind": "raw", "verdict": "complete", "required": True}
LINES = """(link) => {
    const tops = new Set([...link.getClientRects()].map((line) => Math.round(line.top)));
    return tops.size;
}"""


@pytest.mark.parametrize("width", [360, 1280])
def test_the_name_of_a_stream_can_be_read(chromium: Browser, width: int) -> None:
    """It is broken once at most, not letter by letter; the rest of the table is scrolled to."""
    page = chromium.new_page(viewport={"width": width, "height": 800})
    page.set_content(f"<style>{STYLE}</style><main>{stream_table({'streams': [STREAM]})}</main>")
    assert page.locator("td a").evaluate(LINES) <= 2
    assert page.evaluate("() => document.documentElement.scrollWidth") == width
    page.close()

"""The real Chromium of tests that look at a page."""

import shutil
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect, sync_playwright
from processes import DEADLINE_S

ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]

expect.set_options(timeout=DEADLINE_S * 1000)  # a page shows it in moments; on a busy machine it is ten times as slow


def chromium_path() -> str | None:
    """Return the browser of this machine, None where there is none."""
    return next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
    )


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """A browser; skipped where none is installed."""
    path = chromium_path()
    if path is None:
        pytest.skip("no Chromium: install the Debian package `chromium`")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS, timeout=DEADLINE_S * 1000)
        yield browser
        browser.close()

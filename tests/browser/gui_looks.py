"""How a page looks: pictures of it, and what axe-core finds."""

from axe_playwright_python.sync_playwright import Axe
from gui_stage import ROOT
from playwright.sync_api import Page

SCREENSHOTS = ROOT / "build" / "screenshots"


def picture(page: Page, name: str) -> None:
    """Keep a picture to be looked at."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(SCREENSHOTS / f"{name}.png"))


def violations(page: Page) -> list[str]:
    """What axe-core finds, one line for each element."""
    found = Axe().run(page).response["violations"]
    return [f"{one['id']}: {node['target']} {node['failureSummary']}" for one in found for node in one["nodes"]]

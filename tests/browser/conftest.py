"""A real Chromium, a real web-gui process and a study of third-party nodes."""

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page
from processes import claimed_domain

sys.path.insert(0, str(Path(__file__).parent))

from gui_browser import chromium as chromium  # a fixture of every test of this folder
from gui_stage import START_S, Stage, environment


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """A folder and a ROS domain of the module's own."""
    with claimed_domain() as domain:
        made = Stage(tmp_path_factory.mktemp("browser"), environment(domain))
        yield made
        made.close()


@pytest.fixture
def new_page(chromium: Browser) -> Iterator[Callable[..., Page]]:
    """Return open(address, theme, size) -> Page; every page must end without an error of its own."""
    contexts, errors, requests = [], [], []

    def open_page(address: str, theme: str = "dark", size: tuple[int, int] = (1280, 800)) -> Page:
        context = chromium.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme=theme)
        context.set_default_timeout(START_S * 1000)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(f"{error.message}\n{error.stack}"))
        page.on("request", lambda request: requests.append(request.url))
        page.on("websocket", lambda socket: requests.append(socket.url))
        page.goto(address)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not errors
    assert [url for url in requests if not re.match(r"(http|ws)://127\.0\.0\.1:", url)] == []

"""The page before strangers: what they do wrong is told, nothing of theirs stops it, and a crowd is shown."""

import asyncio
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from processes import poll
from sense4hri.chunk import Chunk
from sense4hri.crowd import FEW
from sense4hri.names import StreamName
from web_gui.config import Config
from web_gui.model import Study
from web_gui.server import Site, serve
from web_gui.stream import Info

sys.path.insert(0, str(Path(__file__).parent))

from gui_stage import ROOT, START_S, Stage

pytestmark = pytest.mark.usefixtures("chromium")
SCREENSHOTS = ROOT / "build" / "screenshots"
OpenPage = Callable[..., Page]
PEOPLE, RATE_HZ = 200, 50.0


def test_a_stranger_is_told_what_it_does_wrong_and_stops_nothing(stage: Stage, new_page: OpenPage) -> None:
    """Names, types, quality, sizes and numbers: a sentence each; the best-effort stream is drawn, the page stays up."""
    gui, address = stage.gui()
    stranger = stage.start("stranger", str(Path(__file__).with_name("stranger.py")), stdin=-1)
    page = new_page(address)
    page.wait_for_function("() => globalThis.sense4hri?.lanes.lanes.get('p1/eda/shimmer_1')?.line.newest > 0")
    page.keyboard.press("l")
    for words in (
        "stranger publishes /humans/physiological/p1/ecg/Shimmer_1/raw, which nobody reads: sensor_id 'Shimmer_1'",
        "stranger publishes /humans/physiological/p1/eda/shimmer_1/raw, best effort",
        "stranger publishes /humans/physiological/p1/ppg/shimmer_1/raw, whose type std_msgs/msg/String",
        re.compile("/p1/emg/shimmer_1/raw: .* messages of stranger are left out"),
        re.compile("/p1/eda/shimmer_1/clock: .* messages of stranger are left out"),
        re.compile("/study/markers: .* messages of .*stranger.* are left out"),
    ):
        expect(page.locator("#log .sentence", has_text=words).first).to_be_attached()
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(SCREENSHOTS / "strangers-log.png"))
    page.keyboard.press("Escape")
    page.screenshot(path=str(SCREENSHOTS / "strangers.png"))
    assert page.title() == "Sense4HRI"
    frames = page.evaluate("() => globalThis.sense4hri.lanes.frames")
    page.wait_for_function("(before) => globalThis.sense4hri.lanes.frames > before + 60", arg=frames)
    expect(page.locator("#disconnected")).to_be_hidden()
    stranger.stop()
    gone = page.locator("#log .sentence", has_text="/ppg/shimmer_1/raw")
    expect(gone.locator("xpath=../*[contains(., 'over after')]").first).to_be_attached()
    assert gui.stop() == 0
    assert "Traceback" not in gui.log.read_text()


def test_every_silent_stream_of_a_process_with_many_is_shown(stage: Stage, new_page: OpenPage) -> None:
    """Though no service makes anything of it before it speaks."""
    _, address = stage.gui()
    flood = str(ROOT / "tests" / "bench" / "flood_publisher.py")
    stranger = stage.start("flood", flood, str(FEW + 2), "0", "100", "3600")
    page = new_page(address)
    for number in range(FEW + 2):
        expect(page.get_by_text(f"x / flood_{number}: waiting").first).to_be_visible()
    stranger.stop()


@pytest.fixture
def crowd() -> Iterator[str]:
    """The address of a page of two hundred people with three streams each, without ROS."""
    told, ended = threading.Event(), threading.Event()
    address: list[str] = []

    async def run() -> None:
        site, config = Site(Study(30.0), Config(port=0)), Config(port=0)
        runner, port = await serve(site, config)
        address.append(f"http://127.0.0.1:{port}")
        told.set()
        streams = [
            site.page.study.stream(StreamName(f"p{number}", kind, f"s_{number}"), time.time_ns())
            for number in range(PEOPLE)
            for kind in ("ecg", "ppg", "eda")
        ]
        for stream in streams:
            stream.learn(Info(RATE_HZ, "uV", {}))
        turn = 0
        while not ended.is_set():
            now_ns, turn = time.time_ns(), turn + 1
            for stream in streams:
                stream.raw(Chunk(("a",), np.sin(np.arange(25.0) + turn)[:, None], None, now_ns), now_ns)
            site.page.tick()
            await asyncio.sleep(0.5)
        await runner.cleanup()

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    assert told.wait(START_S)
    yield address[0]
    ended.set()
    thread.join()


def test_two_hundred_people_are_shown_and_whoever_is_in_sight_is_drawn(crowd: str, new_page: OpenPage) -> None:
    """Every one has a lane and a card; of the first and, after scrolling there, of the last the signal is drawn."""
    page = new_page(crowd)
    page.wait_for_function(f"() => document.querySelectorAll('#lanes .lane').length === {3 * PEOPLE}")
    assert page.locator("#participants .card").count() == PEOPLE
    drawn = "(key) => globalThis.sense4hri.lanes.lanes.get(key).line.newest > 0"
    page.wait_for_function(drawn, arg="p0/ecg/s_0")
    assert len(page.evaluate("() => globalThis.sense4hri.lanes.asked.map((lane) => lane.key)")) < 60
    page.locator("#lanes .lane").last.scroll_into_view_if_needed()
    page.wait_for_function(drawn, arg="p199/eda/s_199")
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(SCREENSHOTS / "crowd.png"))
    poll(lambda: page.locator("#disconnected").is_hidden(), "connected")

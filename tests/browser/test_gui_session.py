"""A session from the page: what is missing, recording, markers by key, stop, report; with the real coordinator."""

import json
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect
from processes import poll

sys.path.insert(0, str(Path(__file__).parent))

from gui_stage import ROOT, START_S, Process, Stage

pytestmark = pytest.mark.usefixtures("chromium")
SCREENSHOTS = ROOT / "build" / "screenshots"
CLOCKS_S = 0.001  # what Chromium itself loses between the time of day and its event clock
USEFUL_S = 0.5  # on any machine; on an idle one it is a hundredth of that
OpenPage = Callable[..., Page]
# the browser's clock is an hour and a bit ahead and everything the page can ask it agrees
SHIFTED_CLOCK = """{
    const shift = 4000123.4, now = performance.now.bind(performance), date = Date.now.bind(Date);
    performance.now = () => now() + shift;
    Date.now = () => date() + shift;
    const stamp = Object.getOwnPropertyDescriptor(Event.prototype, 'timeStamp').get;
    Object.defineProperty(Event.prototype, 'timeStamp', { get() { return stamp.call(this) + shift; } });
}"""


@dataclass
class Lab:
    """Web-gui, the real session-coordinator, a study and a recorder."""

    address: str
    gui: Process
    study: Process
    recorder: Process
    recordings: Path

    def markers(self, name: str = "") -> list[dict]:
        """What the recorder heard on /study/markers, or what it heard of this name."""
        heard = self.recordings / "markers.jsonl"
        found = [json.loads(line) for line in heard.read_text().splitlines()] if heard.exists() else []
        return [marker for marker in found if marker["name"] == name or not name]


@pytest.fixture(scope="module")
def lab(stage: Stage, chromium: object) -> Iterator[Lab]:
    """All of it, on the module's ROS domain."""
    recordings = stage.folder / "recordings"
    recordings.mkdir()
    gui, address = stage.gui(recordings=str(recordings))
    study = stage.study()
    script = str(Path(__file__).with_name("fake_recorder.py"))
    recorder = stage.start("recorder", script, str(recordings), stdin=-1)
    state = f"state_file:={stage.folder}/session.json"
    stage.start("coordinator", "-m", "session_coordinator", "--ros-args", "-p", state, "-p", "answer_timeout_s:=10.0")
    yield Lab(address, gui, study, recorder, recordings)
    for process in (study, recorder):
        process.tell("quit")
        process.stop()
    assert gui.stop() == 0


@pytest.fixture
def page(new_page: OpenPage, lab: Lab) -> Page:
    """The page with all streams, ready to start."""
    page = new_page(lab.address)
    page.wait_for_function("() => document.querySelectorAll('#lanes .lane').length === 7")
    expect(page.locator("#session-button")).to_be_enabled()
    return page


def start(page: Page, task: str) -> None:
    """Fill the dialog by keyboard and send it."""
    page.keyboard.press("g")
    page.locator("#start-study").fill("demo")
    page.locator("#start-task").fill(task)
    expect(page.locator("#start-streams input:checked")).to_have_count(7)
    page.locator("#start-warmup").check()


def picture(page: Page, name: str) -> None:
    """Keep a picture in both themes."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    for theme in ("dark", "light"):
        page.emulate_media(color_scheme=theme)
        page.wait_for_function("(theme) => document.documentElement.dataset.theme === theme", arg=theme)
        page.screenshot(path=str(SCREENSHOTS / f"session-{name}-{theme}.png"))


def test_a_session_from_start_to_report(page: Page, lab: Lab) -> None:
    """What is missing is named until it is there; it records, which is said once, takes a note, stops, and reports."""
    lab.study.tell("cut verity_2")
    expect(page.get_by_role("button", name="verity_2: lost", exact=True)).to_be_visible()
    start(page, "rest <b>1</b>")
    preflight = page.locator("#preflight li[data-kind=bad]")
    expect(preflight.filter(has_text="p2 / ppg / verity_2")).to_contain_text("lost→ switch")
    expect(page.locator("#preflight li[data-kind=ok]").filter(has_text="p1 / ecg / h10_1")).to_contain_text(
        "battery 84 %"
    )
    expect(page.locator("#preflight-sum")).to_have_text(re.compile(r"\d of \d+ not in order"))
    picture(page, "start")
    page.locator("#start-study").press("Enter")
    missing = page.locator("#checks li[data-kind=bad]")
    expect(missing.filter(has_text="recorder")).to_contain_text("the disk is not mounted")
    expect(missing.filter(has_text="p2 / ppg / verity_2")).to_contain_text("stale")
    expect(page.locator("#checks li[data-kind=ok]").filter(has_text="p1 / ecg / h10_1")).to_be_visible()
    picture(page, "preparing")
    lab.recorder.tell("ready")
    expect(missing.filter(has_text="recorder")).to_have_count(0)
    lab.study.tell("resume verity_2")
    said = page.locator("#session-said")
    expect(page.locator("#recording")).to_have_text(re.compile(r"^● REC p1, p2 00:0\d:\d\d$"))
    expect(said).to_have_text(re.compile(r"^s\d+T\d+ · rest <b>1</b>$"))
    counts = re.compile(r"^\d[\d\s]* messages · 0 lost · 41 GB free · 312 min left$")
    expect(page.locator("#recorder")).to_have_text(counts)
    told = " ".join(page.locator(".status, .session-line").all_inner_texts())
    assert len(re.findall(r"(?i)\brec(ording)?\b", told)) == 1, told
    page.keyboard.press("Shift+C")
    page.keyboard.press("n")
    page.locator("#note-text").fill("<i>subject coughs</i>")
    page.keyboard.press("Enter")
    page.wait_for_function(
        "() => globalThis.sense4hri.lanes.markers.some((m) => m.name === 'note' && m.value === '<i>subject coughs</i>')"
    )
    expect(page.locator("#marker-said")).to_contain_text("note: <i>subject coughs</i> ±")
    picture(page, "recording")
    page.keyboard.press("g")
    expect(page.locator("#stop-what")).to_contain_text("is being recorded")
    page.locator("#stop-send").press("Enter")
    expect(said).to_contain_text("complete")
    report = page.locator("#report")
    expect(report).to_be_visible()
    picture(page, "done")
    with page.context.expect_page() as opened:
        report.press("Enter")
    assert opened.value.locator("h1").inner_text().endswith("is complete")
    assert opened.value.title() == "Report"


def test_rec_goes_with_the_recorder(page: Page, lab: Lab) -> None:
    """Where the recorder stands still a sentence says so and there is no REC; both go when it goes on."""
    lab.recorder.tell("ready")
    start(page, "without a recorder")
    page.locator("#start-study").press("Enter")
    chip = page.locator("#recording")
    expect(chip).to_have_text(re.compile("^● REC"))
    lab.recorder.popen.send_signal(signal.SIGSTOP)
    stopped_s = time.monotonic()
    try:
        sentence = page.locator(".problem .sentence", has_text="the recorder has said nothing for")
        expect(sentence).to_be_visible()
        print(f"told {time.monotonic() - stopped_s:.1f} s after the recorder stood still")
        expect(chip).to_have_text(re.compile(r"^▲ REC NOT CONFIRMED 00:0\d:\d\d$"))
        expect(page.locator("#recorder")).to_have_text("the recorder says nothing")
        picture(page, "recorder-silent")
    finally:
        lab.recorder.popen.send_signal(signal.SIGCONT)
    expect(chip).to_have_text(re.compile("^● REC"))
    expect(sentence).to_have_count(0)
    page.keyboard.press("g")
    page.locator("#stop-send").press("Enter")
    expect(page.locator("#session-button")).to_have_text("Start a session… g")


def test_a_marker_is_stamped_when_the_key_goes_down(chromium: Browser, lab: Lab, page: Page) -> None:
    """Within the uncertainty it carries, also of a browser whose clock is an hour off; not when it is handled."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800})
    context.add_init_script(SHIFTED_CLOCK)
    context.set_default_timeout(START_S * 1000)
    shifted = context.new_page()
    shifted.goto(lab.address)
    for one, key, name in ((page, "s", "stimulus"), (shifted, "r", "response")):
        one.wait_for_function("() => globalThis.sense4hri.clock.pings.length >= 5 && document.querySelector('.lane')")
        one.locator("#marker-human").select_option("p2")
        one.locator("#marker-human").focus()  # where the choice leaves it; its letters are markers all the same
        pressed_s = press_ten_times(one, key)
        markers = poll(lambda name=name: len(found := lab.markers(name)) >= 10 and found, "ten markers")
        for marker, truth_s in zip(markers, pressed_s, strict=True):
            assert (marker["source"], marker["human_id"]) == ("web-gui", "p2")
            assert 0 < marker["uncertainty_s"] < USEFUL_S
            assert abs(marker["at_ns"] / 1e9 - truth_s) <= marker["uncertainty_s"] + CLOCKS_S
    context.close()


def press_ten_times(page: Page, key: str) -> list[float]:
    """Press a key; the event waits for up to half a second before the page handles it. Return the times of day, s."""
    keyboard = page.context.new_cdp_session(page)
    pressed_s = []
    for i in range(10):
        pressed_s.append(time.time() - 0.05 * i)
        event = {"key": key, "code": f"Key{key.upper()}", "text": key, "timestamp": pressed_s[-1]}
        keyboard.send("Input.dispatchKeyEvent", {"type": "keyDown", **event})
        keyboard.send("Input.dispatchKeyEvent", {"type": "keyUp", **event})
    return pressed_s


def test_a_refused_start_and_a_failed_one_say_why(page: Page, lab: Lab) -> None:
    """The coordinator's words stand in the dialog; who did not answer stands in red; typing sets no marker."""
    before = len(lab.markers())
    start(page, "bcs rymn")
    page.locator("#start-metadata").fill("{room: 2}")
    page.locator("#start-send").press("Enter")
    expect(page.locator("#start-said")).to_contain_text("Metadata is no JSON")
    page.locator("#start-metadata").fill('{"room": "2.07"}')
    page.locator("#start-session").fill("a/b")
    page.locator("#start-send").press("Enter")
    expect(page.locator("#start-said")).to_contain_text("session_id is 'a/b', which is no id")
    page.locator("#start-session").fill("")
    lab.recorder.tell("silent")
    poll(lambda: "is silent" in lab.recorder.log.read_text(), "the recorder is silent")
    page.locator("#start-send").press("Enter")
    expect(page.locator("#session-said")).to_contain_text("did not answer within 10 s: recorder")
    expect(page.locator("#checks li[data-kind=bad]")).to_contain_text(["recorder"])
    picture(page, "failed")
    expect(page.locator("#session-button")).to_have_text("Start a session… g")
    assert len(lab.markers()) == before


def test_everything_has_a_name_and_fits_a_tablet(page: Page) -> None:
    """Every control of the bar and the dialogs is named for a screen reader, and nothing is wider than the screen."""
    nameless = """() => [...document.querySelectorAll('button, input, select, textarea, a, dialog')].filter((e) =>
        !(e.ariaLabel || e.labels?.length || e.textContent.trim() || e.title)).map((e) => e.id)"""
    assert page.evaluate(nameless) == []
    for width, height in ((1024, 768), (768, 1024)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
        for marker in page.locator("#marker-buttons button").all():
            box = marker.bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width
        picture(page, f"{width}x{height}")
    page.keyboard.press("g")
    picture(page, "start-tablet")
    page.keyboard.press("Escape")
    expect(page.locator("#start")).to_be_hidden()

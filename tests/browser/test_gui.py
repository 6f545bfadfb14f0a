"""The page in a real browser, before a study of third-party nodes on real DDS."""

import base64
import json
import os
import re
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from processes import claimed_domain, poll

sys.path.insert(0, str(Path(__file__).parent))

import synthetic_signals as signals
from gui_stage import ROOT, START_S, Process, Stage

pytestmark = pytest.mark.usefixtures("chromium")  # without a browser nothing is started
SCREENSHOTS = ROOT / "build" / "screenshots"
OpenPage = Callable[..., Page]
LANE = "globalThis.sense4hri.lanes.lanes.get(key)"


@pytest.fixture(scope="module")
def gui(stage: Stage, chromium: object) -> Iterator[tuple[Process, str]]:
    """One web-gui for the module."""
    process, address = stage.gui()
    yield process, address
    assert process.stop() == 0


@pytest.fixture(scope="module")
def study(stage: Stage, gui: object) -> Iterator[Process]:
    """Two participants with a strap and an armband each."""
    process = stage.study()
    yield process
    process.tell("quit")
    process.stop()


@pytest.fixture
def page(new_page: OpenPage, gui: tuple[Process, str], study: Process) -> Page:
    """The page with all seven lanes drawn."""
    return streaming(new_page(gui[1]))


def streaming(page: Page) -> Page:
    """Wait until every lane has a signal and both participants a heart rate."""
    state = """() => ({
        lanes: [...(globalThis.sense4hri?.lanes.lanes.values() ?? [])]
            .map((l) => [l.key, l.stream.unit, l.stream.status, l.line.end - l.line.start]),
        rates: [...document.querySelectorAll('.rate')].map((e) => e.textContent),
    })"""
    found: dict = {}

    def ready() -> bool:
        found.update(page.evaluate(state))
        lanes, rates = found["lanes"], found["rates"]
        drawn = all(unit and status == "streaming" and points > 100 for _, unit, status, points in lanes)
        return len(lanes) == 7 and drawn and len(rates) == 2 and all(rate.isdigit() for rate in rates)

    poll(ready, lambda: f"seven lanes and two heart rates; {found}")
    return page


def paused(page: Page, key: str) -> str:
    """Pause and return the picture of a lane, once all samples and events up to the right edge are there."""
    page.keyboard.press("Space")
    page.wait_for_function(f"(key) => {LANE}.line.newest > globalThis.sense4hri.lanes.endMs - 50", arg=key)
    pictures = [""]

    def stands_still() -> bool:
        page.wait_for_timeout(1300)  # events are published once a second
        pictures.append(lane_pixels(page, key))
        return pictures[-1] == pictures[-2]

    poll(stands_still, "a still picture")
    return pictures[-1]


def lane_pixels(page: Page, key: str) -> str:
    """The canvas of a lane as data."""
    return page.evaluate(f"(key) => {LANE}.canvas.toDataURL()", key)


def test_the_signals_of_both_participants_move(page: Page) -> None:
    """Every lane's picture changes while its sensor streams."""
    keys = page.evaluate("() => [...globalThis.sense4hri.lanes.lanes.keys()]")
    assert sorted({key.split("/")[0] for key in keys}) == ["p1", "p2"]
    before = {key: lane_pixels(page, key) for key in keys}
    poll(lambda: all(lane_pixels(page, key) != before[key] for key in keys), "movement in every lane")
    rates = page.locator(".rate").all_inner_texts()
    assert rates == ["72", "64"]
    expect(page.locator(".state-word")).to_have_text(["calm relaxed", "calm relaxed"])


@pytest.mark.parametrize(("human", "rate_bpm"), [("p1", 72.0), ("p2", 64.0)])
def test_beats_stand_at_their_known_times_within_a_pixel(page: Page, human: str, rate_bpm: float) -> None:
    """Both the R peak in the drawn line and its mark are where the heart beat, on the page's time axis."""
    key = f"{human}/ecg/h10_{human[1]}"
    page.wait_for_function(f"(key) => {LANE}.marks.length >= 6", arg=key)
    found = page.evaluate(
        f"""(key) => {{
            const lane = {LANE}, line = lane.line, peaks = [];
            for (let i = line.start + 1; i < line.end - 1; i++) {{
                const v = line.high[0];
                if (v[i] > 600 && v[i] >= v[i - 1] && v[i] > v[i + 1]) peaks.push(line.times[i]);
            }}
            return {{ peaks, events: lane.marks.map((m) => m.from), perMs: lane.penPerMs }};
        }}""",
        key,
    )
    pixel_s = 1 / found["perMs"] / 1000
    for times_ms, tolerance_s in ((found["events"], pixel_s), (found["peaks"], max(pixel_s, 0.5 / 130 + 0.001))):
        times_s = np.array(times_ms) / 1000
        assert len(times_s) >= 5
        known = signals.beats(times_s[0] - 2, times_s[-1] + 2, rate_bpm)
        assert np.abs(known[:, None] - times_s).min(0).max() <= tolerance_s


def test_a_beat_is_drawn_where_the_axis_says(page: Page) -> None:
    """On the paused canvas the signal's ink is high up at the beat's pixel, and not beside it."""
    page.wait_for_function(f"(key) => {LANE}.marks.length >= 8", arg="p1/ecg/h10_1")
    paused(page, "p1/ecg/h10_1")
    found = page.evaluate(
        f"""(key) => {{
            const lane = {LANE}, canvas = lane.canvas, c = canvas.getContext('2d');
            const right = globalThis.sense4hri.lanes.endMs, width = globalThis.sense4hri.lanes.width;
            const {{ factor, offset }} = lane.vertical(0, {{ ratio: 1 }});
            const y = Math.round(offset + factor * 800);
            const oldest = Math.max(right - 9000, lane.line.times[lane.line.start] + 100);
            const beats = lane.marks.map((m) => m.from).filter((t) => t > oldest && t < right - 100);
            const ink = (x) => [-3, -2, -1, 0, 1, 2, 3].map((d) => c.getImageData(x + d, y, 1, 1).data)
                .findIndex((p) => p[1] > 120 && p[1] > p[0] + 40);
            return beats.map((t) => {{
                const x = Math.floor(width - (right - t) * lane.penPerMs);
                return [ink(x), ink(x + 12), ink(x - 12)];
            }});
        }}""",
        "p1/ecg/h10_1",
    )
    assert len(found) >= 5
    for here, after, before in found:
        assert here >= 0
        assert (after, before) == (-1, -1)


def test_it_fits_every_screen_in_both_themes(page: Page) -> None:
    """Nothing is wider than the screen, nothing essential outside of it; pictures are kept to be looked at."""
    shown_s = f"(key) => ({LANE}?.line.newest - {LANE}?.line.times[{LANE}.line.start]) / 1000"
    poll(lambda: page.evaluate(shown_s, "p1/ecg/h10_1") > 9, "a full window")
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    for width, height in ((1280, 800), (1024, 768), (768, 1024)):
        page.set_viewport_size({"width": width, "height": height})
        for theme in ("dark", "light"):
            page.emulate_media(color_scheme=theme)
            page.wait_for_function("(theme) => document.documentElement.dataset.theme === theme", arg=theme)
            poll(lambda: page.evaluate(shown_s, "p1/ecg/h10_1") > 9, "a full window")
            assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
            for selector in ("#recording", "#clock", ".rate", ".state", "#lanes .lane", "#details h2", "#strip canvas"):
                box = page.locator(selector).first.bounding_box()
                assert box is not None, selector
                assert box["x"] >= 0, selector
                assert box["x"] + box["width"] <= width, selector
                assert box["y"] + box["height"] <= height, selector
            page.screenshot(path=str(SCREENSHOTS / f"gui-{theme}-{width}x{height}.png"))


def test_a_cut_sensor_shows_its_hole_and_its_return(page: Page, study: Process) -> None:
    """Hatched while nothing comes, and a sentence; afterwards the gap keeps its length and the sentence goes."""
    key = "p2/ppg/verity_2"
    hatched = f"""(key) => {{
        const lane = {LANE}, canvas = lane.canvas, c = canvas.getContext('2d');
        const data = c.getImageData(canvas.width - 180, 30, 60, canvas.height - 40).data;
        let brown = 0;
        for (let i = 0; i < data.length; i += 4) if (data[i + 3] > 200 && data[i] > data[i + 2] + 10) brown++;
        return brown / (data.length / 4);
    }}"""
    poll(lambda: page.evaluate(hatched, key) == 0, "no hatching")
    study.tell("cut verity_2")
    told = re.compile(r"p2 / verity_2: no data for \d+ s, reconnecting.*link timed out")
    lost = page.locator("#problems").get_by_text(told)
    lost.wait_for()
    poll(lambda: page.evaluate(hatched, key) > 0.9, "the hatching")
    expect(page.get_by_role("button", name="verity_2: lost", exact=True)).to_have_count(1)
    other = lane_pixels(page, "p1/ecg/h10_1")
    study.tell("resume verity_2")
    page.wait_for_function(f"(key) => {LANE}.gaps.some(([a, b]) => b - a > 1000)", arg=key)
    over = page.locator(".problem[data-kind=over]", has_text="p2 / verity_2")
    expect(over).to_have_text(re.compile(r"over after [\d.]+ (s|min)"))
    expect(page.locator("#announce")).to_contain_text("over: p2 / verity_2")
    lost.wait_for(state="hidden")
    assert lane_pixels(page, "p1/ecg/h10_1") != other
    page.keyboard.press("l")
    expect(page.locator("#log li", has_text="verity_2").first).to_be_visible()


def test_a_marker_crosses_all_lanes(page: Page, study: Process) -> None:
    """The marker's line is in every lane at the same pixel."""
    study.tell("marker condition_start")
    page.wait_for_function("() => globalThis.sense4hri.lanes.markers.some((m) => m.name === 'condition_start')")
    columns = """() => [...globalThis.sense4hri.lanes.lanes.values()].map((lane) => {
        const c = lane.canvas.getContext('2d'), row = c.getImageData(0, 0, lane.canvas.width, lane.canvas.height);
        const found = [];
        for (let x = 0; x < row.width; x++) {
            let hits = 0;
            for (let y = 0; y < row.height; y++) {
                const i = 4 * (y * row.width + x);
                const [red, green, blue] = row.data.subarray(i, i + 3);
                if (red > 220 && green > 140 && green < 220 && blue < 130) hits++;
            }
            if (hits > row.height / 3) found.push(x);
        }
        return found;
    })"""
    poll(lambda: set.intersection(*map(set, page.evaluate(columns))), "the marker at one pixel of every lane")


def test_text_from_the_graph_stays_text(page: Page) -> None:
    """A sensor whose model is markup is shown with its markup as characters; nothing of it runs."""
    expect(page.locator("#details")).to_contain_text("<img src=x onerror=")
    assert page.title() == "Sense4HRI"
    assert page.evaluate("() => document.querySelectorAll('img').length") == 2


def test_a_sensor_type_nobody_knows_is_shown_like_any_other(page: Page) -> None:
    """The glove of a third party has its lane, its unit, a row per finger and the colour of the others."""
    lane = page.locator('.lane[data-key="p2/flexion/glove_1"]')
    assert "flexion" in lane.inner_text()
    assert "%" in lane.inner_text()
    rows, colour = page.evaluate(f"(key) => [{LANE}.rows, {LANE}.penColour]", "p2/flexion/glove_1")
    assert rows == 2
    assert colour == page.evaluate(
        "() => getComputedStyle(document.documentElement).getPropertyValue('--other').trim()"
    )


def test_a_missing_value_tells_its_reason_to_everyone(page: Page) -> None:
    """`–` can be focused, its reason is shown and is the name that a screen reader says."""
    missing = page.locator("#details .missing").first
    assert missing.inner_text() == "–"
    missing.focus()
    assert page.locator("#tip").inner_text() == "needs 120 s, has 43 s"
    assert missing.get_attribute("aria-label") == "not available: needs 120 s, has 43 s"


def test_a_clock_of_another_epoch_is_told_as_that(page: Page) -> None:
    """A device that counts from the day it was made is no clock that goes wrong by 38 years."""
    shown = "async (seconds) => (await import('/js/format.js')).offset(seconds)"
    told = "other epoch (13843 d)"
    assert page.evaluate(shown, 13843 * 86400) == told
    assert page.evaluate(shown, -2 * 86400) == "−48.0 h"


def test_everything_can_be_done_with_keys(page: Page) -> None:
    """Window, pause, scrolling, choosing, theme and help have keys; every button has a name."""
    state = "() => { const l = globalThis.sense4hri.lanes; return [l.windowMs, l.endMs]; }"
    page.keyboard.press("3")
    assert page.evaluate(state) == [30_000, None]
    page.keyboard.press("1")
    assert page.evaluate(state) == [5000, None]
    page.keyboard.press("Space")
    _, paused = page.evaluate(state)
    assert paused is not None
    page.keyboard.press("ArrowLeft")
    assert page.evaluate(state)[1] == pytest.approx(paused - 1000)
    assert page.locator("#pause").get_attribute("aria-pressed") == "true"
    page.keyboard.press("End")
    assert page.evaluate(state)[1] is None
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    assert page.locator(".lane:has([aria-current])").get_attribute("data-key") == "p1/accelerometer/h10_1"
    page.keyboard.press("t")
    assert page.evaluate("() => document.documentElement.dataset.theme") == "light"
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.keyboard.press("Escape")
    nameless = (
        "() => [...document.querySelectorAll('button')].filter((b) => !(b.ariaLabel || b.textContent.trim())).length"
    )
    assert page.evaluate(nameless) == 0


def test_a_paused_page_stands_still_and_shows_the_past(page: Page) -> None:
    """Pause freezes the picture; scrolling back shows earlier samples."""
    key = "p1/ecg/h10_1"
    still = paused(page, key)
    page.wait_for_timeout(700)
    assert lane_pixels(page, key) == still
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    page.wait_for_function(f"(key) => {LANE}.line.newest <= globalThis.sense4hri.lanes.endMs", arg=key)
    assert lane_pixels(page, key) != still


def test_a_slow_browser_costs_no_memory_and_nobody_else_waits(page: Page, gui: tuple[Process, str]) -> None:
    """A client that never reads is held back at a few frames while the page beside it stays live."""
    port = int(gui[1].rpartition(":")[2])
    sockets = [silent_client(port) for _ in range(5)]
    before = resident_mb(gui[0].popen.pid)
    drawn = page.evaluate("() => globalThis.sense4hri.lanes.frames")
    page.wait_for_timeout(6000)
    assert resident_mb(gui[0].popen.pid) - before < 8
    assert page.evaluate("() => globalThis.sense4hri.lanes.frames") > drawn
    page.wait_for_function(f"() => globalThis.sense4hri.lanes.frames > {drawn} + 30")
    for connection in sockets:
        connection.close()


def test_malformed_requests_leave_the_page_alive(page: Page, gui: tuple[Process, str]) -> None:
    """Bytes that are no HTTP, foreign hosts and broken WebSocket frames are refused; the process goes on."""
    port = int(gui[1].rpartition(":")[2])
    assert b" 400 " in answer(port, b"\x16\x03\x01\x00garbage\r\n\r\n")
    assert b" 403 " in answer(port, b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n")
    assert b" 400 " in answer(port, b"GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    broken = silent_client(port)
    broken.sendall(b"\xff\xff\xff\xff" * 100)
    broken.close()
    frames = page.evaluate("() => globalThis.sense4hri.lanes.frames")
    page.wait_for_function(f"() => globalThis.sense4hri.lanes.frames > {frames} + 10")
    assert gui[0].popen.poll() is None


def test_the_page_dims_beside_a_server_that_is_stopped(new_page: OpenPage, stage: Stage, study: Process) -> None:
    """SIGSTOP leaves the connection open and silent: dimmed within seconds all the same, and back after SIGCONT."""
    process, address = stage.gui(name="stopped")
    page = streaming(new_page(address))
    process.popen.send_signal(signal.SIGSTOP)
    page.get_by_text(re.compile(r"No connection to the server; last data [3-9][\d.]* s ago")).wait_for(timeout=30_000)
    process.popen.send_signal(signal.SIGCONT)
    page.wait_for_function("() => !document.body.classList.contains('offline')", timeout=40_000)
    streaming(page)
    assert process.stop() == 0


def test_the_page_dims_without_its_server_and_comes_back_by_itself(
    new_page: OpenPage, stage: Stage, study: Process
) -> None:
    """Server gone: dimmed, with the age of the last data; server back: signals move again, untouched."""
    process, address = stage.gui(name="second")
    page = streaming(new_page(address))
    assert process.stop() == 0
    page.get_by_text(re.compile(r"No connection to the server; last data [\d.]+ s ago")).wait_for()
    page.wait_for_function("() => document.body.classList.contains('offline')")
    still = lane_pixels(page, "p1/ecg/h10_1")
    process, _ = stage.gui(port=int(address.rpartition(":")[2]), name="second")
    page.wait_for_function("() => !document.body.classList.contains('offline')")
    streaming(page)
    moved = (
        f"([key, still]) => {{ const lane = {LANE}; return lane !== undefined && lane.canvas.toDataURL() !== still }}"
    )
    page.wait_for_function(moved, arg=["p1/ecg/h10_1", still])  # a new server knows no lane at first
    assert process.stop() == 0


def test_before_anything_is_connected_the_page_says_what_to_start(new_page: OpenPage, stage: Stage) -> None:
    """An empty graph is no empty page."""
    with claimed_domain() as empty:
        elsewhere = Stage(stage.folder, {**stage.environment, "ROS_DOMAIN_ID": str(empty)}, stage.processes)
        process, address = elsewhere.gui(name="alone")
        page = new_page(address)
        page.get_by_text("Nothing is connected yet").wait_for()
        assert page.locator("#empty pre").inner_text() == "make demo"
        assert page.locator("#session-said").inner_text().startswith("No session-coordinator on the graph")
        assert page.locator("#session-button").is_disabled()
        assert process.stop() == 0


def test_a_port_that_is_taken_ends_with_status_78(gui: tuple[Process, str], stage: Stage) -> None:
    """One line names the port."""
    port = gui[1].rpartition(":")[2]
    process = stage.start("taken", "-m", "web_gui", "--ros-args", "-p", f"port:={port}")
    assert process.popen.wait(START_S) == 78
    assert f"port {port}" in process.log.read_text().splitlines()[-1]


def silent_client(port: int) -> socket.socket:
    """A WebSocket that asks for signals and never reads a byte."""
    connection = socket.create_connection(("127.0.0.1", port))
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    key = base64.b64encode(os.urandom(16)).decode()
    connection.sendall(
        f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    lanes = [{"stream": f"p{i}/{kind}"} for i in (1, 2) for kind in (f"ecg/h10_{i}", f"ppg/verity_{i}")]
    text = json.dumps({"type": "view", "view": 1, "columns": 4000, "window_s": 30, "lanes": lanes}).encode()
    connection.sendall(bytes([0x81, 0x80 | 126]) + len(text).to_bytes(2, "big") + bytes(4) + text)
    return connection


def answer(port: int, request: bytes) -> bytes:
    """The first bytes that answer a request."""
    with socket.create_connection(("127.0.0.1", port), timeout=START_S) as connection:
        connection.sendall(request)
        return connection.recv(200)


def resident_mb(pid: int) -> float:
    """Memory of a process in MB."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", status).group(1)) / 1024

"""Ways to use the page: side by side, the past, drag and keys, a phone, a screen reader (axe-core); without ROS."""

import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect
from processes import poll
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from web_gui.axis import Axis
from web_gui.stream import Info

sys.path.insert(0, str(Path(__file__).parent))

from gui_lab import HEALTH, Lab
from gui_stage import ROOT

pytestmark = pytest.mark.usefixtures("chromium")
SCREENSHOTS = ROOT / "build" / "screenshots"
OpenPage = Callable[..., Page]
RATE_HZ = 100.0


class Four(Lab):
    """Four people with a strap and a cap each, one battery low."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of everybody's signal end at a time."""
        for number in range(1, 5):
            for kind, channels in (("ecg", ("ecg",)), ("eeg", ("Fp1", "Fp2", "F3", "F4", "C3", "C4", "P3", "P4"))):
                stream = self.study.stream(StreamName(f"p{number}", kind, f"{kind}_{number}"), at_ns)
                if stream.info is None:
                    stream.learn(Info(RATE_HZ, "uV", {}))
                times_s = at_ns / 1e9 + np.arange(-round(seconds * RATE_HZ) + 1, 1) / RATE_HZ
                wave = 400 * np.sin(2 * np.pi * np.outer(times_s % 3600, 1 + np.arange(len(channels)) / 4))
                stream.raw(Chunk(channels, wave, None, at_ns), at_ns)
                battery = 12.0 if (number, kind) == (2, "ecg") else 80.0
                stream.take_health(HEALTH | {"battery_percent": battery}, at_ns)


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    """One for the module."""
    with Four() as lab:
        yield lab


def streaming(page: Page) -> Page:
    """Wait for all lanes; those in sight are drawn."""
    page.wait_for_function("() => globalThis.sense4hri?.lanes.lanes.size === 8")
    page.wait_for_function("() => globalThis.sense4hri.lanes.asked[0]?.line.newest > 0")
    return page


def picture(page: Page, name: str) -> None:
    """Keep a picture to be looked at."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(SCREENSHOTS / f"ways-{name}.png"))


def violations(page: Page) -> list[str]:
    """What axe-core finds, one line for each element."""
    found = Axe().run(page).response["violations"]
    return [f"{one['id']}: {node['target']} {node['failureSummary']}" for one in found for node in one["nodes"]]


@pytest.mark.parametrize(("theme", "size"), [("dark", (1280, 800)), ("light", (1280, 800)), ("dark", (360, 740))])
def test_axe_finds_nothing(lab: Lab, new_page: OpenPage, theme: str, size: tuple[int, int]) -> None:
    """On the page with an alert, with all keys shown, and before a session, in both themes and on a phone."""
    page = streaming(new_page(lab.address, theme, size))
    expect(page.locator(".problem").first).to_be_visible()
    assert violations(page) == []
    for key, dialog in (("?", "#help"), ("l", "#log"), ("g", "#start")):
        page.keyboard.press(key)
        expect(page.locator(dialog)).to_be_visible()
        assert violations(page) == []
        picture(page, f"{dialog[1:]}-{theme}-{size[0]}")
        page.keyboard.press("Escape")
        expect(page.locator(dialog)).to_be_hidden()


def test_nothing_is_wider_than_a_phone(lab: Lab, new_page: OpenPage) -> None:
    """At 360 px the page scrolls down alone, and who walks to a participant sees heart rate, sensors and signal."""
    page = streaming(new_page(lab.address, "light", (360, 740)))
    assert page.evaluate("() => document.documentElement.scrollWidth") == 360
    picture(page, "phone-top")
    for selector in (".problem", "#participants .card", "#lanes .lane", "#past input", "#details h2", "#strip canvas"):
        page.locator(selector).first.scroll_into_view_if_needed()
        box = page.locator(selector).first.bounding_box()
        assert box is not None, selector
        assert box["x"] >= 0, selector
        assert selector == "#participants .card" or box["x"] + box["width"] <= 360, selector
    page.locator("#lanes").scroll_into_view_if_needed()
    picture(page, "phone-signals")
    page.locator("#details").scroll_into_view_if_needed()
    picture(page, "phone-details")


LABELS = """async ([low, high]) => {
    const { axis, GUTTER } = await import("/js/gutter.js"), { Scale } = await import("/js/scale.js");
    const c = document.createElement("canvas").getContext("2d"), said = [];
    const width = (label, most) => Math.min(c.measureText(label).width, most ?? Infinity);
    c.fillText = (label, x, y, most) => { said.push([label, width(label, most), GUTTER - 6]); };
    const scale = Object.assign(new Scale(), { low, high }), factor = -50 / (high - low);
    const lane = { many: false, ruler: scale, plotHeight: 60, line: { channels: 1 }, quality: () => null,
        vertical: () => ({ factor, offset: 55 - factor * low }), rowBox: () => ({ top: 5, height: 50 }) };
    axis({ c, lane, pen: { width: 0, ratio: 1, colours: { font: "sans-serif" } } });
    return said;
}"""


@pytest.mark.parametrize(
    ("low", "high", "lowest"),
    [
        (-1.1e12, 1.1e12, "−1000G"),
        (8_388_580, 8_388_612, "8388.59k"),
        (-187_520, -187_480, "−187.50k"),
        (-220, 220, "−200"),
        (1_699_999_945, 1_700_000_055, "−50"),
    ],
)
def test_a_label_of_the_axis_is_never_cut_off(
    lab: Lab, new_page: OpenPage, low: float, high: float, lowest: str
) -> None:
    """However large the values: a number whose end nobody sees is another number."""
    said = streaming(new_page(lab.address)).evaluate(LABELS, [low, high])
    assert said[0][0] == lowest
    assert all(width <= room for _, width, room in said), said


def test_participants_stand_side_by_side(lab: Lab, new_page: OpenPage) -> None:
    """Two and four columns by key; all have one width and are drawn; it is kept over a reload."""
    page = streaming(new_page(lab.address))
    for columns in (2, 4):
        page.keyboard.press("o")
        expect(page.locator("#columns")).to_have_text(f"▥ {columns}")
        boxes = [group.bounding_box() for group in page.locator("#lanes .group").all()]
        assert len({round(box["x"]) for box in boxes if box}) == columns
        assert len({round(box["width"]) for box in boxes if box}) == 1
        drawn = "() => globalThis.sense4hri.lanes.asked.every((lane) => lane.line.newest > 0 && lane.drawable)"
        page.wait_for_function(drawn)
        picture(page, f"columns-{columns}")
    page.reload()
    expect(page.locator("#columns")).to_have_text("▥ 4")


def test_the_past_is_scrolled_while_signals_go_on(lab: Lab, new_page: OpenPage) -> None:
    """By slider and keys: what was 40 s ago is drawn, the server goes on receiving, End is now again."""
    page = streaming(new_page(lab.address))
    slider = page.locator("#scrub")
    slider.fill("-40")
    expect(page.locator("#scrub-said")).to_have_text("40 s ago")
    end_ms = page.evaluate("() => globalThis.sense4hri.lanes.endMs")
    shown = "(end) => { const l = globalThis.sense4hri.lanes.asked[0].line; return Math.abs(l.newest - end) < 1000 }"
    page.wait_for_function(shown, arg=end_ms)
    before = lab.study.streams[StreamName("p1", "ecg", "ecg_1")].raw_at_ns
    poll(lambda: lab.study.streams[StreamName("p1", "ecg", "ecg_1")].raw_at_ns > before + 10**9, "signals that go on")
    page.locator("#lanes .lane-pick").first.focus()
    page.keyboard.press("PageUp")
    assert page.evaluate("() => globalThis.sense4hri.lanes.endMs") == pytest.approx(end_ms - 10_000, abs=1)
    picture(page, "past")
    page.keyboard.press("End")
    expect(page.locator("#scrub-said")).to_have_text("now")


def test_a_sensor_is_given_by_drag_and_by_keyboard(lab: Lab, new_page: OpenPage) -> None:
    """Dropped on a participant it is ordered at once; with the keyboard it is the sensor in focus that is asked for."""
    page = streaming(new_page(lab.address))
    grip = page.locator("#participants li", has=page.locator("[data-sensor=ecg_1]")).locator(".grip")
    grip.drag_to(page.locator("#participants .card[aria-label='participant p2']"))
    poll(lambda: ("ecg_1", "p2") in lab.desk.assigned, lambda: f"the order; {lab.desk.assigned}")
    expect(page.locator(".wearer .said")).to_have_text("ecg_1 is assigned to p2")
    page.locator("[data-sensor=eeg_2]").focus()
    page.keyboard.press("w")
    expect(page.locator("#wearer")).to_be_focused()
    expect(page.locator("#details h2")).to_contain_text("eeg_2")
    page.locator("#wearer").select_option("p3")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    poll(lambda: ("eeg_2", "p3") in lab.desk.assigned, lambda: f"the order; {lab.desk.assigned}")


def test_whatever_has_the_keyboard_shows_it(lab: Lab, new_page: OpenPage) -> None:
    """Tab goes from the header over what is wrong and the participants to signals and details, always visibly."""
    page = streaming(new_page(lab.address))
    where = """() => {
        const e = document.activeElement, style = getComputedStyle(e);
        return [e.closest("header, #session, #problems, nav, #signals, aside, footer")?.id
            || e.closest("header, nav, aside, footer")?.localName || "skip", style.outlineStyle !== "none"];
    }"""
    order: list[str] = []
    for _ in range(120):
        page.keyboard.press("Tab")
        place, visible = page.evaluate(where)
        assert visible, place
        if not order or order[-1] != place:
            order.append(place)
        if place == "details":
            break
    assert order == ["skip", "header", "session", "problems", "nav", "signals", "details"]


def test_who_dismisses_by_key_stays_where_they_are(lab: Lab, new_page: OpenPage) -> None:
    """The next sentence has the focus, and after the last one the signals."""
    page = streaming(new_page(lab.address))
    expect(page.locator(".problem").first).to_be_visible()
    focused = "() => document.activeElement.className || document.activeElement.id"
    for _ in range(40):
        if page.locator("#problems").is_hidden():
            break
        page.locator(".dismiss").first.press("Enter")
        assert page.evaluate(focused) in ("dismiss", "lanes")
    assert page.evaluate(focused) == "lanes"


def test_metadata_arrive_as_they_were_typed(lab: Lab, new_page: OpenPage) -> None:
    """Numbers of any length and names that stand twice are the coordinator's to judge; the note comes beside."""
    page = streaming(new_page(lab.address))
    page.keyboard.press("g")
    page.locator("#start-study").fill("demo")
    said = page.locator("#start-said")
    for typed, note, wanted in (
        ('{"subject": 12345678901234567890, "gain": 1e999}', "", '{"subject": 12345678901234567890, "gain": 1e999}'),
        ('{"a": 1, "a": 2}', 'x "y"', '{"a": 1, "a": 2, "note": "x \\"y\\""}'),
        ("{ }", "alone", '{"note": "alone"}'),
        ("", "", ""),
    ):
        page.locator("#start-metadata").fill(typed)
        page.locator("#start-note").fill(note)
        before = len(lab.desk.started)
        page.locator("#start-send").click()
        poll(lambda before=before: len(lab.desk.started) > before, "the order")
        assert lab.desk.started[-1].metadata_json == wanted
        expect(said).to_have_text("not here")
    for size in (40_000, 70_000):
        page.locator("#start-metadata").fill(json.dumps({"a": size * "x"}))
        page.locator("#start-send").click()
        expect(said).to_contain_text("at most 32768 characters" if size == 40_000 else "too much text")
        expect(page.locator("#disconnected")).to_be_hidden()


def test_a_participant_whom_nobody_knows_is_not_in_order(lab: Lab, new_page: OpenPage) -> None:
    """A name that is typed amiss is seen before the session begins, not in its recording."""
    page = streaming(new_page(lab.address))
    page.keyboard.press("g")
    strange = page.locator("#preflight li[data-kind=bad]").filter(has_text="participant")
    expect(page.locator("#preflight-sum")).to_contain_text("not in order")
    expect(strange).to_have_count(0)
    page.locator("#start-more-humans").fill("p3, p33 p33")
    expect(strange).to_have_count(1)
    expect(strange).to_contain_text("participant p33no sensor has been seen→ look how the name is written")
    page.locator("#start-more-humans").fill("p3")
    expect(strange).to_have_count(0)


def test_what_somebody_else_has_stopped_is_not_asked_about(lab: Lab, new_page: OpenPage) -> None:
    """The question goes with its session, and the next one is not stopped by it."""
    page = streaming(new_page(lab.address))
    running = {"session_id": "s1", "start_at": lab.site.page.now_ns()}
    lab.study.session.take_state(running | {"phase": 1})
    expect(page.locator("#session-button")).to_contain_text("Cancel the start")
    page.keyboard.press("g")
    expect(page.locator("#stop-what")).to_have_text("Session s1 has not begun yet.")
    lab.study.session.take_state(running | {"phase": 2})
    expect(page.locator("#stop-what")).to_have_text("Session s1 runs, but no recorder is heard: nothing is recorded.")
    lab.study.session.take_state({"phase": 0, "detail": "session 's1': complete"})
    expect(page.locator("#stop")).to_be_hidden()
    expect(page.locator("#session-said")).to_have_text(re.compile("^session 's1': complete"))


def test_how_long_is_recorded_is_not_told_by_the_sensors(
    lab: Lab, new_page: OpenPage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where all that arrives is stamped an hour ago the session has begun when the coordinator says."""
    now_ns, behind = lab.site.page.now_ns(), Axis()
    behind.saw(now_ns - 3600 * 10**9, now_ns + 60 * 10**9)  # and plays for 90 s more
    monkeypatch.setattr(lab.study, "axis", behind)
    page = new_page(lab.address)
    expect(page.locator("#replay")).to_contain_text("replay of")
    lab.study.session.take_state({"session_id": "s1", "start_at": now_ns, "phase": 2})
    try:
        expect(page.locator("#session-said")).to_have_text(re.compile(r"00:0[0-2]:\d\d · s1"))
        expect(page.locator("#recording")).to_have_text(re.compile(r"REC NOT CONFIRMED|00:0[0-2]:\d\d"))
    finally:
        lab.study.session.take_state({})


@pytest.mark.parametrize(("key", "code"), [("s", "KeyS"), ("S", "KeyS"), ("σ", "KeyS"), ("ы", "KeyS")])
def test_a_marker_key_is_its_place_on_a_keyboard_without_latin_letters(
    lab: Lab, new_page: OpenPage, key: str, code: str
) -> None:
    """A Greek or a Russian one; Caps Lock changes nothing."""
    page = streaming(new_page(lab.address))
    page.wait_for_function("() => globalThis.sense4hri.clock.pings.length > 0")
    page.evaluate(
        "([key, code]) => document.body.dispatchEvent(new KeyboardEvent('keydown', { key, code, bubbles: true }))",
        [key, code],
    )
    expect(page.locator("#marker-said")).to_contain_text("stimulus ±")


SLEEPER = """{
    globalThis.asleepMs = 0;
    const now = performance.now.bind(performance);
    performance.now = () => now() - globalThis.asleepMs;
    const stamp = Object.getOwnPropertyDescriptor(Event.prototype, 'timeStamp').get;
    Object.defineProperty(Event.prototype, 'timeStamp', { get() { return stamp.call(this) - globalThis.asleepMs; } });
}"""
WAKE_AND_PRESS = """() => {
    globalThis.asleepMs = 12000;
    document.body.dispatchEvent(new KeyboardEvent('keydown', { key: 's', code: 'KeyS', bubbles: true }));
}"""


def test_a_marker_pressed_as_the_computer_wakes_has_no_time_of_before(lab: Lab, new_page: OpenPage) -> None:
    """A page's clock stands still in sleep: until the host's is known anew no marker is set, and the page says so."""
    page = new_page(lab.address)
    page.add_init_script(SLEEPER)
    page.reload()
    streaming(page).wait_for_function("() => globalThis.sense4hri.clock.pings.length > 0")
    lab.desk.pressed.clear()
    page.evaluate(WAKE_AND_PRESS)
    said = page.locator("#marker-said")
    expect(said).to_have_text("the server's clock is being compared, press again: marker stimulus is not set")
    page.wait_for_function("() => globalThis.sense4hri.clock.at(performance.now()) !== null")
    pressed_ns = lab.site.page.now_ns()
    page.keyboard.press("s")
    expect(said).to_contain_text("stimulus ±")
    (press,) = lab.desk.pressed
    assert 0 <= press.at_ns - pressed_ns + press.uncertainty_s * 1e9 < 10e9


class Eight(Lab):
    """Eight people with a strap and an armband each; the strap of p3 is off the skin, p7 has no heart rate."""

    STREAMS = (
        ("ecg", "h10", "uV", ("ecg",)),
        ("accelerometer", "h10", "m/s^2", ("x", "y", "z")),
        ("ppg", "verity", "counts", ("ppg_0", "ambient")),
        ("accelerometer", "verity", "m/s^2", ("x", "y", "z")),
    )

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of everybody's signal end at a time."""
        times_s = at_ns / 1e9 + np.arange(-round(seconds * RATE_HZ) + 1, 1) / RATE_HZ
        for number in range(1, 9):
            for kind, sensor, unit, channels in self.STREAMS:
                stream = self.study.stream(StreamName(f"p{number}", kind, f"{sensor}_{number}"), at_ns)
                if stream.info is None:
                    stream.learn(Info(RATE_HZ, unit, {}))
                wave = 400 * np.sin(2 * np.pi * np.outer(times_s % 3600, 1 + np.arange(len(channels)) / 4))
                stream.raw(Chunk(channels, wave, None, at_ns), at_ns)
                off = 0.0 if (number, sensor) == (3, "h10") else 1.0
                stream.take_health(HEALTH | {"battery_percent": 80.0, "contact": off}, at_ns)
                if kind != "accelerometer":
                    stream.take_features(self.features(number), at_ns)
            told = {"state": "calm_relaxed", "confidence": 0.8, "expression": "neutral", "reasons": []}
            self.study.take_state(f"p{number}", told, at_ns)

    def features(self, number: int) -> dict[str, object]:
        """Return what the interpreters say of somebody."""
        if number == 7:
            return {"heart_rate_bpm": float("nan"), "signal_quality": 0.9, "reasons": ["needs 10 s, has 4 s"]}
        return {"heart_rate_bpm": 60.0 + number, "signal_quality": 0.9, "reasons": []}


@pytest.fixture(scope="module")
def eight() -> Iterator[Lab]:
    """One for the module."""
    with Eight() as lab:
        yield lab


CUT_OFF = """(selector) => [...document.querySelectorAll(selector)].filter((element) => {
    const box = element.getBoundingClientRect(), at = document.elementFromPoint(box.x + box.width / 2, box.bottom - 2);
    return !(box.height > 0 && box.bottom <= innerHeight && at && (element.contains(at) || at.contains(element)));
}).map((element) => element.closest("[data-human], [data-key]").getAttribute("aria-label") ?? element.dataset.key)"""


def compact(page: Page, lanes: int = 32) -> Page:
    """Wait until those in sight are drawn, and what is wrong is told."""
    page.wait_for_function("(many) => globalThis.sense4hri?.lanes.lanes.size === many", arg=lanes)
    page.wait_for_function("() => globalThis.sense4hri.lanes.asked[0]?.line.newest > 0")
    expect(page.locator(".card[data-human=p3] .wrong")).to_contain_text("⚠ h10_3: ")
    return page


def test_of_eight_participants_all_are_in_sight(eight: Lab, new_page: OpenPage) -> None:
    """At 1600x1000 each one's name, rate, state, sensors, what is wrong in words, and signals, without scrolling."""
    page = compact(new_page(eight.address, size=(1600, 1000)))
    expect(page.locator("#density")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#participants .card")).to_have_count(8)
    picture(page, "eight-1600")
    for part in ("h2", ".rate", ".state", ".sensors button"):
        assert page.evaluate(CUT_OFF, f"#participants .card {part}") == []
    assert page.evaluate(CUT_OFF, "#lanes .lane") == []
    expect(page.locator(".card[data-human=p7] .wrong")).to_contain_text("⚠ no heart rate: needs 10 s, has 4 s")
    expect(page.locator(".card[data-human=p1] .wrong")).to_be_hidden()
    assert violations(page) == []


def test_the_full_card_is_a_click_away_and_all_of_them_a_key(eight: Lab, new_page: OpenPage) -> None:
    """What the reader chose is kept over a reload, and so are the columns of either way."""
    page = compact(new_page(eight.address, size=(1600, 1000)))
    card = page.locator(".card[data-human=p2]")
    expect(card.locator(".grip").first).to_be_hidden()
    card.locator(".opener").focus()
    page.keyboard.press("Enter")
    expect(card.locator(".opener")).to_have_attribute("aria-expanded", "true")
    expect(card.locator(".grip").first).to_be_visible()
    picture(page, "eight-opened")
    page.keyboard.press("v")
    expect(page.locator("#density")).to_have_attribute("aria-pressed", "false")
    expect(page.locator("#columns")).to_have_text("▥ 1")
    expect(page.locator(".card[data-human=p1] .grip").first).to_be_visible()
    page.reload()
    expect(page.locator("#density")).to_have_attribute("aria-pressed", "false")
    page.locator("#density").click()
    expect(page.locator("#columns")).to_have_text("▥ 2")


@pytest.mark.parametrize(("theme", "size"), [("light", (1280, 800)), ("dark", (1024, 768)), ("light", (390, 844))])
def test_eight_participants_on_smaller_screens(
    eight: Lab, new_page: OpenPage, theme: str, size: tuple[int, int]
) -> None:
    """Nothing is wider than the screen, and axe-core finds nothing."""
    page = compact(new_page(eight.address, theme, size))
    assert page.evaluate("() => document.documentElement.scrollWidth") == size[0]
    picture(page, f"eight-{size[0]}")
    assert violations(page) == []


class Offset(Lab):
    """A sensor of raw counts that lie around 1.7e9."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        stream = self.study.stream(StreamName("p1", "flexion", "glove_1"), at_ns)
        if stream.info is None:
            stream.learn(Info(RATE_HZ, "counts", {}))
        times_s = at_ns / 1e9 + np.arange(-round(seconds * RATE_HZ) + 1, 1) / RATE_HZ
        stream.raw(Chunk(("bend",), 1.7e9 + 50 * np.sin(2 * np.pi * times_s % 3600)[:, None], None, at_ns), at_ns)


def test_a_small_signal_on_a_huge_offset_is_seen(new_page: OpenPage) -> None:
    """±50 around 1.7e9 fill the lane; the axis counts from a round value that the lane's title names."""
    with Offset() as lab:
        page = new_page(lab.address)
        page.wait_for_function("() => globalThis.sense4hri?.lanes.asked[0]?.drawable")
        expect(page.locator(".lane-label")).to_contain_text("counts · axis + 1700000000 counts")
        low, high = page.evaluate(
            "() => { const { ruler } = sense4hri.lanes.asked[0]; return [ruler.low, ruler.high]; }"
        )
        assert low == pytest.approx(1.7e9 - 62, abs=3)
        assert high == pytest.approx(1.7e9 + 62, abs=3)
        values = page.evaluate(
            "() => { const { line } = sense4hri.lanes.asked[0]; return [...line.low[0].slice(0, 90)]; }"
        )
        assert len(set(values)) > 45
        picture(page, "offset")


class Wide(Lab):
    """A cap of one channel more than a lane shows."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        stream = self.study.stream(StreamName("p1", "eeg", "cap_1"), at_ns)
        if stream.info is None:
            stream.learn(Info(RATE_HZ, "uV", {}))
        wave = np.zeros((round(seconds * RATE_HZ), 256))
        stream.raw(Chunk(tuple(f"E{channel}" for channel in range(256)), wave, None, at_ns), at_ns)


def test_a_lane_says_of_how_many_channels_it_shows_how_many(new_page: OpenPage) -> None:
    """A cap of 256 is not called one of 255."""
    with Wide() as lab:
        expect(new_page(lab.address).locator(".lane-open")).to_have_text("▸ 255 of 256 channels")


class Gone(Lab):
    """A sensor that has said nothing for half a minute."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time, until there is nothing more."""
        stream = self.study.stream(StreamName("p1", "flexion", "glove_1"), at_ns)
        if stream.info is None:
            stream.learn(Info(RATE_HZ, "%", {}))
        if stream.history is None or stream.history.samples_total < 30 * RATE_HZ:
            stream.raw(Chunk(("bend",), np.sin(np.arange(100.0))[:, None], None, at_ns), at_ns)


HATCHED = """(colour) => {
    const { canvas } = sense4hri.lanes.lanes.values().next().value;
    const at = canvas.getContext("2d").getImageData(Math.round(canvas.width / 3), 0, 1, canvas.height).data;
    const c = document.createElement("canvas").getContext("2d");
    c.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(colour);
    c.fillRect(0, 0, 1, 1);
    const [r, g, b] = c.getImageData(0, 0, 1, 1).data;
    const pixels = Array.from({ length: at.length / 4 }, (_, i) => at.slice(4 * i, 4 * i + 3).join());
    return pixels.includes(`${r},${g},${b}`);
}"""


def test_a_sensor_that_was_lost_before_the_page_was_opened_has_its_hole(new_page: OpenPage) -> None:
    """Nothing of it is in the window: the lane is hatched all the same, not just empty."""
    with Gone() as lab:
        page = new_page(lab.address)
        page.wait_for_function("() => sense4hri?.lanes.lanes.size === 1")
        page.wait_for_function(HATCHED, arg="--hole", timeout=20_000)
        picture(page, "gone")


def test_one_participant_has_all_columns(new_page: OpenPage) -> None:
    """Where nobody stands beside somebody no half of the page stays empty."""
    with Offset() as alone:
        page = new_page(alone.address)
        page.wait_for_function("() => sense4hri?.lanes.lanes.size === 1")
        page.keyboard.press("v")
        expect(page.locator("#columns")).to_have_text("▥ 2")
        widths = page.evaluate("() => ['#lanes', '.group'].map((s) => document.querySelector(s).clientWidth)")
        assert widths[0] == widths[1]
        expect(page.locator(".lane-label")).to_contain_text("lines 50 counts apart")


class Nobody(Lab):
    """A study without sensors."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Nothing streams."""


def test_the_time_is_the_hosts_also_where_nothing_streams(new_page: OpenPage) -> None:
    """A browser whose clock is an hour ahead shows what the study's machine says."""
    with Nobody() as lab:
        page = new_page(lab.address)
        page.add_init_script("{ const now = Date.now.bind(Date); Date.now = () => now() + 3600e3; }")
        page.reload()
        expect(page.locator("#empty h2")).to_be_visible()
        expect(page.locator("#past")).to_be_hidden()
        hour = "(ms) => String(new Date(ms).getHours()).padStart(2, '0')"
        now_ms = lab.site.page.now_ns() / 1e6
        hours = {page.evaluate(hour, now_ms + late_ms) for late_ms in (0, 60_000)}
        expect(page.locator("#clock")).to_have_text(re.compile(rf"^({'|'.join(sorted(hours))}):\d\d:\d\d$"))


SPOKEN = """() => {
    const alert = document.querySelector("#disconnected").cloneNode(true);
    alert.querySelectorAll("[aria-hidden=true]").forEach((part) => part.remove());
    return alert.textContent.trim();
}"""


def test_a_screen_reader_is_told_once_that_the_server_is_gone(new_page: OpenPage) -> None:
    """The age of the last data is counted for the eye alone."""
    with Four() as gone:
        page = streaming(new_page(gone.address))
    age = page.locator("#disconnected-age")
    expect(age).to_have_text(re.compile(r"; last data [\d.]+ s ago"))
    before, at_first = page.evaluate(SPOKEN), age.text_content() or ""
    expect(age).not_to_have_text(at_first)
    assert page.evaluate(SPOKEN) == before == "No connection to the server. Connecting again by itself."

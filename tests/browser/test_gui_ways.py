"""Ways to use the page: side by side, the past, drag and keys, a phone, a screen reader (axe-core); without ROS."""

import json
import re
import socket
import sys
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from processes import DEADLINE_S, poll
from sense4hri.names import StreamName
from web_gui.axis import Axis

sys.path.insert(0, str(Path(__file__).parent))

from gui_lab import HEALTH, Lab, waves
from gui_looks import picture, violations

pytestmark = pytest.mark.usefixtures("chromium")
OpenPage = Callable[..., Page]


class Four(Lab):
    """Four people with a strap and a cap each, one battery low."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of everybody's signal end at a time."""
        for number in range(1, 5):
            for kind, channels in (("ecg", ("ecg",)), ("eeg", ("Fp1", "Fp2", "F3", "F4", "C3", "C4", "P3", "P4"))):
                name = StreamName(f"p{number}", kind, f"{kind}_{number}")
                stream = self.give(name, "uV", channels, waves(at_ns, seconds, len(channels)), at_ns)
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
        picture(page, f"ways-{dialog[1:]}-{theme}-{size[0]}")
        page.keyboard.press("Escape")
        expect(page.locator(dialog)).to_be_hidden()


def test_nothing_is_wider_than_a_phone(lab: Lab, new_page: OpenPage) -> None:
    """At 360 px the page scrolls down alone, and who walks to a participant sees heart rate, sensors and signal."""
    page = streaming(new_page(lab.address, "light", (360, 740)))
    assert page.evaluate("() => document.documentElement.scrollWidth") == 360
    picture(page, "ways-phone-top")
    for selector in (".problem", "#participants .card", "#lanes .lane", "#past input", "#details h2", "#strip canvas"):
        page.locator(selector).first.scroll_into_view_if_needed()
        box = page.locator(selector).first.bounding_box()
        assert box is not None, selector
        assert box["x"] >= 0, selector
        assert selector == "#participants .card" or box["x"] + box["width"] <= 360, selector
    page.locator("#lanes").scroll_into_view_if_needed()
    picture(page, "ways-phone-signals")
    page.locator("#details").scroll_into_view_if_needed()
    picture(page, "ways-phone-details")


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
        picture(page, f"ways-columns-{columns}")
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
    picture(page, "ways-past")
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


def test_a_required_stream_whom_nobody_knows_is_not_in_order(lab: Lab, new_page: OpenPage) -> None:
    """A topic that is typed amiss neither; one that streams is judged as if ticked, a glob is the coordinator's."""
    page = streaming(new_page(lab.address))
    page.keyboard.press("g")
    page.locator("#start-streams input").first.uncheck()
    names = page.locator("#preflight .check-name").filter(has_text=" / ")
    expect(names).to_have_count(7)
    topic = "/humans/physiological/p1/{}/raw".format
    page.locator("#start-more-streams").fill(f"{topic('ecg/ecg_1')} {topic('ecg/egc_1')} {topic('ecg/*')} /tf")
    expect(names).to_have_count(9)
    strange = page.locator("#preflight li[data-kind=bad]").filter(has_text="no such stream has been seen")
    expect(strange).to_have_count(1)
    expect(strange.locator(".check-name")).to_have_text("p1 / ecg / egc_1")


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


def test_the_question_whether_to_stop_says_that_the_server_is_gone(new_page: OpenPage) -> None:
    """Whoever has it open sees that nothing is known of the session any more."""
    with Four() as gone:
        page = streaming(new_page(gone.address))
        gone.study.session.take_state({"session_id": "s1", "start_at": gone.site.page.now_ns(), "phase": 1})
        expect(page.locator("#session-button")).to_contain_text("Cancel the start")
        page.keyboard.press("g")
        expect(page.locator("#stop-what")).to_have_text("Session s1 has not begun yet.")
    gone_words = "No connection to the server: session s1 may go on, and cannot be stopped from here."
    expect(page.locator("#stop-what")).to_have_text(gone_words)


def test_how_long_is_recorded_is_not_told_by_the_sensors(
    lab: Lab, new_page: OpenPage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where all that arrives is stamped an hour ago the session has begun when the coordinator says."""
    now_ns, behind = lab.site.page.now_ns(), Axis(lab.study.clock.wall_ns)
    behind.saw(now_ns - 3600 * 10**9, now_ns + 60 * 10**9)  # and plays for 90 s more
    monkeypatch.setattr(lab.study, "axis", behind)
    page = new_page(lab.address)
    expect(page.locator("#replay")).to_contain_text("replay of")
    lab.study.session.take_state({"session_id": "s1", "start_at": now_ns, "phase": 2})
    try:
        expect(page.locator("#recording")).to_have_text(re.compile(r"REC.* 00:0[0-2]:\d\d$"))
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
    """A page's clock stands still in sleep: the press waits until the host's is known anew."""
    page = new_page(lab.address)
    page.add_init_script(SLEEPER)
    page.reload()
    streaming(page).wait_for_function("() => globalThis.sense4hri.clock.pings.length > 0")
    lab.desk.pressed.clear()
    before_ns = lab.site.page.now_ns()
    page.evaluate(WAKE_AND_PRESS)
    after_ns = lab.site.page.now_ns()
    expect(page.locator("#marker-said")).to_contain_text("stimulus ±")
    (press,) = lab.desk.pressed
    assert before_ns <= press.at_ns + press.uncertainty_s * 1e9
    assert press.at_ns - press.uncertainty_s * 1e9 <= after_ns


UNHEARD = """{
    globalThis.unheard = %s;
    const kept = ({ data }) => typeof data === "string" && globalThis.unheard.includes(JSON.parse(data).type);
    globalThis.WebSocket = class extends WebSocket {
        constructor(address) {
            super(address);
            this.addEventListener("message", (event) => { if (kept(event)) event.stopImmediatePropagation(); });
        }
    };
}"""


def deaf(page: Page, *kinds: str) -> Page:
    """Load the page anew; messages of these kinds do not reach it until `unheard` is empty."""
    page.add_init_script(UNHEARD % json.dumps(kinds))
    page.reload()
    return page


def test_a_marker_pressed_before_the_clock_is_known_has_the_time_of_the_press(lab: Lab, new_page: OpenPage) -> None:
    """It waits for the first answer to a ping, with or without a text; both are set, in their order."""
    page = streaming(deaf(new_page(lab.address), "pong"))
    lab.desk.pressed.clear()
    times_ns, said = [lab.site.page.now_ns()], page.locator("#marker-said")
    for key in "sn":
        page.keyboard.press(key)
        times_ns.append(lab.site.page.now_ns())
    page.locator("#note-text").fill("coughs")
    page.keyboard.press("Enter")
    expect(said).to_have_text("marker note: coughs waits until the server's clock is known")
    page.wait_for_function("(later) => performance.now() > later", arg=page.evaluate("() => performance.now() + 500"))
    assert lab.desk.pressed == []
    page.evaluate("() => { globalThis.unheard = []; }")
    expect(said).to_contain_text("note: coughs ±")
    assert [(one.name, one.value) for one in lab.desk.pressed] == [("stimulus", ""), ("note", "coughs")]
    for press, (before_ns, after_ns) in zip(lab.desk.pressed, pairwise(times_ns), strict=True):
        assert before_ns <= press.at_ns + press.uncertainty_s * 1e9
        assert press.at_ns - press.uncertainty_s * 1e9 <= after_ns


def test_a_marker_is_set_as_soon_as_the_page_has_its_keys(lab: Lab, new_page: OpenPage) -> None:
    """Also before it has heard of the study."""
    page = deaf(new_page(lab.address), "study")
    expect(page.locator("#marker-buttons [data-marker=stimulus]")).to_be_visible()
    lab.desk.pressed.clear()
    page.keyboard.press("s")
    poll(lambda: [one.name for one in lab.desk.pressed] == ["stimulus"], "the marker")


@pytest.mark.parametrize(
    ("then", "why"),
    [
        ("globalThis.asleepMs = 12000; globalThis.unheard = [];", "the server's clock is not known, press again"),
        ("globalThis.sense4hri.clock.connection.socket.close();", "no connection to the server"),
    ],
    ids=["sleeps", "disconnected"],
)
def test_a_marker_whose_time_never_gets_known_is_not_set(lab: Lab, new_page: OpenPage, then: str, why: str) -> None:
    """The computer sleeps before a ping is answered, or the connection is lost: the page says so."""
    page = new_page(lab.address)
    page.add_init_script(SLEEPER)
    streaming(deaf(page, "pong"))
    lab.desk.pressed.clear()
    page.keyboard.press("s")
    page.evaluate(f"() => {{ {then} }}")
    expect(page.locator("#marker-said")).to_have_text(f"{why}: marker stimulus is not set")
    assert lab.desk.pressed == []


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


def test_what_is_shown_stands_still_without_the_server(new_page: OpenPage) -> None:
    """However often it is tried for: nobody knows whether a signal has a hole meanwhile."""
    with Four() as gone:
        page = streaming(new_page(gone.address))
    tried = "() => performance.getEntriesByType('resource').filter((one) => one.name.endsWith('/ws')).length"
    expect(page.locator("#disconnected")).to_be_visible()
    before, tries = page.evaluate("() => sense4hri.lanes.now()"), page.evaluate(tried)
    page.wait_for_function(f"(tries) => ({tried})() > tries + 1", arg=tries)
    assert page.evaluate("() => sense4hri.lanes.now()") == before
    page.keyboard.press("g")
    expect(page.locator("#preflight li").first).to_contain_text("no connection to the server, all else is how it was")


def upgrade(listener: socket.socket) -> socket.socket:
    """The next connection that asks for a WebSocket; it gets no answer."""
    while True:
        connection, _ = listener.accept()
        connection.settimeout(DEADLINE_S)
        if b"Upgrade: websocket" in connection.recv(4096):
            return connection
        connection.close()


def test_a_server_that_does_not_answer_is_tried_again(new_page: OpenPage) -> None:
    """Where the way to it was cut while the page connected, another try goes through."""
    with Four() as gone:
        page = streaming(new_page(gone.address))
    with socket.create_server(("127.0.0.1", int(gone.address.rpartition(":")[2]))) as listener:
        listener.settimeout(DEADLINE_S)
        with upgrade(listener), upgrade(listener):
            expect(page.locator("#disconnected")).to_be_visible()


class Moving(Lab):
    """Straps of three people, of which one may be given to the second person."""

    def __init__(self) -> None:
        super().__init__()
        self.worn, self.state, self.why = {"h10_1": "p1", "h10_2": "p2", "h10_3": "p3"}, "calm_relaxed", "calm"
        self.extra: list[dict[str, object]] = []

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of everybody's signal end at a time, and tell how they are."""
        for sensor, human in self.worn.items():
            name = StreamName(human, "ecg", sensor)
            stream = self.give(name, "uV", ("ecg",), waves(at_ns, seconds, 1), at_ns)
            stream.take_health(HEALTH, at_ns)
            if self.extra:
                stream.take_features({"extra": self.extra, "reasons": []}, at_ns)
            self.study.take_state(human, {"state": self.state, "reasons": [self.why]}, at_ns)

    def give_to_second(self, sensor: str) -> None:
        """Let a strap move, and whoever wore it be gone."""
        before, self.worn[sensor] = self.worn[sensor], "p2"
        at_ns = self.site.page.now_ns()
        self.study.found(StreamName("p2", "ecg", sensor), at_ns)
        self.study.gone(StreamName(before, "ecg", sensor), at_ns)
        self.study.state_gone(before)


@pytest.fixture
def moving() -> Iterator[Moving]:
    """One for each test."""
    with Moving() as lab:
        yield lab


def three(page: Page) -> Page:
    """Wait for the lanes of three straps."""
    page.wait_for_function("() => globalThis.sense4hri?.lanes.lanes.size === 3")
    return page


def test_who_was_chosen_stays_chosen_where_they_vanish(moving: Moving, new_page: OpenPage) -> None:
    """A sensor is never given to whoever happens to be next in the list."""
    page = three(new_page(moving.address))
    page.locator("[data-sensor=h10_1]").click()
    page.locator("#wearer").select_option("p3")
    moving.give_to_second("h10_3")
    expect(page.locator("#participants .card")).to_have_count(2)
    expect(page.locator("#wearer")).to_have_value("p3")


def test_the_keyboard_stays_where_it_is_while_people_come_and_go(moving: Moving, new_page: OpenPage) -> None:
    """What stands behind somebody who vanishes moves up, and keeps the focus."""
    page = three(new_page(moving.address))
    page.locator("[data-sensor=h10_3]").focus()
    moving.give_to_second("h10_1")
    expect(page.locator("#participants .card")).to_have_count(2)
    expect(page.locator("[data-sensor=h10_3]")).to_be_focused()


def test_what_a_tooltip_tells_is_not_of_before(moving: Moving, new_page: OpenPage) -> None:
    """It follows what it explains for as long as it is shown."""
    page = three(new_page(moving.address))
    page.keyboard.press("Tab")
    page.locator(".card[data-human=p1] .state").focus()
    expect(page.locator("#tip")).to_have_text("calm")
    moving.why = "upset"
    expect(page.locator("#tip")).to_have_text("upset")


def test_a_sensor_that_vanishes_while_it_is_dragged_leaves_nothing_behind(moving: Moving, new_page: OpenPage) -> None:
    """Neither its name beside the pointer nor the places to drop it."""
    page = three(new_page(moving.address))
    page.locator(".card[data-human=p1] .grip").hover()
    page.mouse.down()
    page.mouse.move(600, 400, steps=3)
    expect(page.locator(".ghost")).to_be_visible()
    moving.give_to_second("h10_1")
    expect(page.locator("#participants .card")).to_have_count(2)
    page.mouse.up()
    expect(page.locator(".ghost")).to_be_hidden()
    expect(page.locator("#targets")).to_be_hidden()


@pytest.mark.parametrize("state", ["constructor", "toString", "of_somebody's_own"])
def test_a_state_of_any_name_has_the_sign_of_one_that_is_not_known(
    moving: Moving, new_page: OpenPage, state: str
) -> None:
    """Also where the browser itself knows something by that name."""
    page = three(new_page(moving.address))
    moving.state = state
    expect(page.locator(".card[data-human=p1] .state-word")).to_have_text(state.replace("_", " "))
    expect(page.locator(".card[data-human=p1] .state-sign")).to_have_text("?")


NEXT_MARKERS = """async () => {
    const { Markers } = await import("/js/markers.js");
    new Markers(null, null, () => {}).hello({ marker_keys: [{ key: "s", name: "start_of_trial" }] });
    return document.getElementById("marker-buttons").textContent;
}"""


def test_markers_are_those_of_the_server_that_is_connected(lab: Lab, new_page: OpenPage) -> None:
    """Where it was started anew with another marker on a key, button and key set the same one."""
    page = streaming(new_page(lab.address))
    expect(page.locator("#marker-buttons [data-marker=stimulus]")).to_be_visible()
    assert page.evaluate(NEXT_MARKERS) == "sstart of trial"


SPARK = """async (rates) => {
    const { Participants } = await import("/js/participants.js"), panel = new Participants(() => {}, null);
    panel.trend({ participants: [{ id: "p1", heart_rate: rates.map((rate, second) => [1000 * second, rate]) }] });
    return document.querySelector(".card[data-human=p1] .spark-line").getAttribute("d");
}"""


def test_the_small_line_of_the_heart_rate_has_its_holes(moving: Moving, new_page: OpenPage) -> None:
    """It is not drawn across them, and is gone where no heart rate is known any more."""
    page = three(new_page(moving.address))
    line = page.evaluate(SPARK, [70, 71, None, 72, 73])
    assert [part.count("L") for part in line.split("M")[1:]] == [1, 1]
    assert page.evaluate(SPARK, [None, None, None, None, 73]) is None


STRIP = """async (seconds) => {
    const { Strip } = await import("/js/strip.js"), strip = new Strip();
    strip.trend({ span_s: seconds, participants: [{ id: "p1", heart_rate: [], state: [], expression: [] }] });
    return [...strip.ticks.children].map((tick) => tick.textContent).concat(strip.rows.ariaLabel);
}"""


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (600, ["−10 min", "−8 min", "−6 min", "−4 min", "−2 min", "now", "The last 10 min of everybody"]),
        (60, ["−60 s", "−48 s", "−36 s", "−24 s", "−12 s", "now", "The last 60 s of everybody"]),
    ],
)
def test_the_strip_is_as_long_as_its_parameter_says(
    lab: Lab, new_page: OpenPage, seconds: int, said: list[str]
) -> None:
    """Its ticks and its name tell it."""
    assert new_page(lab.address).evaluate(STRIP, seconds) == said


def test_a_small_number_of_which_nothing_is_known_is_not_told_as_none(moving: Moving, new_page: OpenPage) -> None:
    """Of what an interpreter adds by itself the first two digits are shown, however small it is."""
    page = three(new_page(moving.address))
    told = {"tiny": -0.00034, "usual": 1.234}
    moving.extra = [{"name": name, "unit": "V", "values": [value]} for name, value in told.items()]
    expect(page.locator("#details tr", has_text="tiny").locator(".number").first).to_have_text("−0.00034")
    expect(page.locator("#details tr", has_text="usual").locator(".number").first).to_have_text("1.23")


def test_a_stop_that_was_refused_hides_not_that_it_records(lab: Lab, new_page: OpenPage) -> None:
    """The refusal stands beside the session's name, and how long is recorded at the top, until it goes on or ends."""
    page = streaming(new_page(lab.address))
    lab.study.session.take_state({"session_id": "s1", "start_at": lab.site.page.now_ns(), "phase": 2})
    expect(page.locator("#session-button")).to_contain_text("Stop")
    page.keyboard.press("g")
    page.locator("#stop-send").click()
    expect(page.locator("#session-said")).to_have_text("not here · s1")
    expect(page.locator("#recording")).to_have_text(re.compile(r"REC.* 00:0[0-2]:\d\d$"))
    lab.study.session.take_state({})
    expect(page.locator("#session-said")).not_to_contain_text("not here")


def test_long_names_cover_no_value(new_page: OpenPage) -> None:
    """Of a participant and a sensor with names of 63 characters heart rate and names stand beside each other."""
    lab = Moving()
    lab.worn = {"s" * 63: "p" * 63, "h10_2": "p2", "h10_3": "p3"}
    with lab:
        page = three(new_page(lab.address, size=(390, 844)))
        page.evaluate("() => document.getElementById('density').click()")
        card = page.locator(f".card[data-human={'p' * 63}]")
        boxes = [card.locator(part).bounding_box() for part in (".who", ".rate", ".name")]
        edges = [edge for box in boxes if box for edge in (box["x"], box["x"] + box["width"])]
        assert edges == sorted(edges)
        assert edges[-1] < 390
        assert page.locator("#marker-human").evaluate("(e) => e.clientWidth") < 200


def test_long_names_take_no_room_of_others(new_page: OpenPage) -> None:
    """No lane is much higher for a name, and before a session each name stands within its own box."""
    lab = Moving()
    lab.worn = {"s" * 63: "p" * 63, "h10_2": "p2", "h10_3": "p3"}
    with lab:
        page = three(new_page(lab.address))
        heights = page.locator("#lanes .group").evaluate_all("(groups) => groups.map((group) => group.clientHeight)")
        assert max(heights) < 140, heights
        page.keyboard.press("g")
        expect(page.locator("#preflight .check-name").filter(has_text="p" * 63)).to_be_visible()
        cut = "(boxes) => boxes.filter((box) => box.scrollWidth > box.clientWidth).map((box) => box.textContent)"
        assert page.locator("#start .boxes label, #preflight").evaluate_all(cut) == []


ENDS = """(dialog) => {
    const last = Math.max(...[...dialog.querySelectorAll('button')].map((one) => one.getBoundingClientRect().bottom));
    const below = dialog.getBoundingClientRect().top + dialog.scrollHeight - dialog.scrollTop - last;
    return [below, dialog.scrollWidth - dialog.clientWidth, dialog.scrollTop];
}"""


@pytest.mark.parametrize("size", [(1280, 900), (390, 844), (360, 740)])
def test_a_dialog_is_as_large_as_what_is_in_it(lab: Lab, new_page: OpenPage, size: tuple[int, int]) -> None:
    """It opens at its top, ends with its buttons and is never wider than it is seen."""
    page = streaming(new_page(lab.address, "dark", size))
    for key, dialog in (("?", "#help"), ("l", "#log"), ("g", "#start"), ("n", "#note")):
        page.keyboard.press(key)
        expect(page.locator(dialog)).to_be_visible()
        if dialog == "#start":  # a list that is scrolled
            page.locator("#start-more-humans").fill(" ".join(f"q{number}" for number in range(30)))
            expect(page.locator("#preflight li").filter(has_text="q29")).to_be_attached()
        below, beyond, scrolled = page.locator(dialog).evaluate(ENDS)
        assert below < 60, dialog
        assert beyond == 0, dialog
        assert scrolled == 0, dialog
        page.keyboard.press("Escape")
        expect(page.locator(dialog)).to_be_hidden()


CLOSED_AND_PRESSED = """(key) => {
    const typed = document.querySelector("#start-more-humans");
    document.querySelector("#start").close();
    typed.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
}"""


@pytest.mark.parametrize(("key", "dialog"), [("n", "#note"), ("?", "#help")])
def test_a_key_right_after_a_dialog_was_closed_is_an_order(lab: Lab, new_page: OpenPage, key: str, dialog: str) -> None:
    """Until the next picture is drawn the browser sends it to what was typed into there."""
    page = streaming(new_page(lab.address))
    page.keyboard.press("g")
    expect(page.locator("#start")).to_be_visible()
    page.locator("#start-more-humans").fill("q")
    page.evaluate(CLOSED_AND_PRESSED, key)
    expect(page.locator(dialog)).to_be_visible()
    page.keyboard.press("Escape")


def test_the_study_of_the_session_before_is_offered(new_page: OpenPage) -> None:
    """Whoever starts the next session of a study need not type its name once more."""
    with Four() as lab:
        page = streaming(new_page(lab.address))
        lab.study.session.take_state({"session_id": "s1", "study": "trust", "phase": 2})
        expect(page.locator("#study-name")).to_have_text("study “trust”")
        lab.study.session.take_state({})
        expect(page.locator("#session-button")).to_contain_text("Start")
        page.keyboard.press("g")
        expect(page.locator("#start-study")).to_have_value("trust")


SCALE = """async (rates) => {
    const { Strip } = await import("/js/strip.js"), strip = new Strip();
    const heart_rate = rates.map((rate, second) => [1000 * second, rate]);
    strip.trend({ span_s: 600, participants: [{ id: "p1", heart_rate, state: [], expression: [] }] });
    return strip.rows.querySelector(".strip-scale").textContent;
}"""


@pytest.mark.parametrize(
    ("rates", "said"), [([64, 82], "110\n50 bpm"), ([44.4, 131.6], "132\n44 bpm"), ([None], ""), ([], "")]
)
def test_the_heart_rate_of_the_last_minutes_has_an_axis(
    lab: Lab, new_page: OpenPage, rates: list[float | None], said: str
) -> None:
    """Its upper and lower end stand beside the line; without a heart rate there is none."""
    assert new_page(lab.address).evaluate(SCALE, rates) == said


def test_a_value_that_is_missing_stands_among_those_computed(moving: Moving, new_page: OpenPage) -> None:
    """Its `–` is not taken for the device's; a share has no unit, and what has one has it as the field writes it."""
    moving.extra = [
        {"name": name, "unit": unit, "values": [0.5]}
        for name, unit in (("missing_samples", "1"), ("saccade_rate", "1/min"), ("velocity", "deg/s"))
    ]
    page = three(new_page(moving.address))
    row = "#details tr"
    for name, unit in (("missing samples", ""), ("saccade rate", " /min"), ("velocity", " °/s")):
        expect(page.locator(row, has_text=name).locator(".unit")).to_have_text(unit, use_inner_text=False)
    stream = moving.study.streams[StreamName("p1", "ecg", "h10_1")]
    stream.take_reported({"heart_rate": 64.0}, moving.site.page.now_ns())
    expect(page.locator(row, has_text="heart rate").locator(".device")).to_have_text("64")
    missing = page.locator(row, has_text="SDNN").locator(".missing").bounding_box()
    device = page.locator(row, has_text="missing samples").locator(".device").bounding_box()
    assert missing is not None
    assert device is not None
    assert missing["x"] + missing["width"] <= device["x"] + 1


MARKED = """async () => {
    const { Strip } = await import("/js/strip.js"), strip = new Strip(), to = 600000;
    Object.assign(strip, { nowMs: to, markers: [{ at_ms: to / 2, human: "" }] });
    const calm = { id: "p9", heart_rate: [], state: [[0, to, "calm_relaxed"]], expression: [] };
    strip.trend({ span_s: to / 1000, participants: [calm] });
    const canvas = strip.rows.querySelector("canvas"), c = canvas.getContext("2d");
    const middle = Math.round(canvas.width / 2);
    const differs = (y) => [-1, 0, 1].some((dx) => {
        const [here, beside] = [middle + dx, middle + 40].map((x) => [...c.getImageData(x, y, 1, 1).data]);
        return here.join() !== beside.join();
    });
    return [differs(4), differs(canvas.height - 12)];
}"""


def test_a_marker_does_not_go_through_the_words_of_a_state(lab: Lab, new_page: OpenPage) -> None:
    """In the last minutes it stands below them."""
    assert streaming(new_page(lab.address)).evaluate(MARKED) == [False, True]

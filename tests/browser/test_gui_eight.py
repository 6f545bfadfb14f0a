"""Eight participants in sight at once: compact cards and lanes; without ROS."""

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from sense4hri.names import StreamName

sys.path.insert(0, str(Path(__file__).parent))

from gui_lab import HEALTH, Lab, waves
from gui_looks import picture, violations

pytestmark = pytest.mark.usefixtures("chromium")
OpenPage = Callable[..., Page]


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
        for number in range(1, 9):
            for kind, sensor, unit, channels in self.STREAMS:
                name = StreamName(f"p{number}", kind, f"{sensor}_{number}")
                stream = self.give(name, unit, channels, waves(at_ns, seconds, len(channels)), at_ns)
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
    picture(page, "ways-eight-1600")
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
    picture(page, "ways-eight-opened")
    page.keyboard.press("v")
    expect(page.locator("#density")).to_have_attribute("aria-pressed", "false")
    expect(page.locator("#columns")).to_have_text("▥ 1")
    expect(page.locator(".card[data-human=p1] .grip").first).to_be_visible()
    page.reload()
    expect(page.locator("#density")).to_have_attribute("aria-pressed", "false")
    page.locator("#density").click()
    expect(page.locator("#columns")).to_have_text("▥ 2")


def test_on_a_phone_a_sensor_that_is_tapped_shows_its_signal(eight: Lab, new_page: OpenPage) -> None:
    """The page scrolls to its lane, and the lanes do, so that all of it is seen."""
    page = compact(new_page(eight.address, "light", (390, 844)))
    for sensor, stream in (("verity_8", "p8/ppg/verity_8"), ("h10_2", "p2/ecg/h10_2")):
        page.locator(f"[data-sensor={sensor}]").click()
        expect(page.locator(f".lane[data-key='{stream}']")).to_be_in_viewport(ratio=0.99)
        picture(page, f"ways-eight-phone-{sensor}")


ROWS = """() => {
    const parts = [...document.querySelectorAll("header .status > *, header .tools > *")], rows = [];
    for (const box of parts.filter((part) => part.clientWidth).map((part) => part.getBoundingClientRect())) {
        if (!rows.some((row) => box.top < row.bottom && row.top < box.bottom)) rows.push(box);
    }
    const chips = [...document.querySelectorAll("header .chip")].filter((chip) => chip.scrollWidth > chip.clientWidth);
    return { rows: rows.length, cut: chips.map((chip) => chip.textContent) };
}"""


@pytest.mark.parametrize(("size", "rows"), [((1280, 800), 1), ((390, 844), 2)])
def test_the_header_leaves_the_room_to_the_signals(
    eight: Lab, new_page: OpenPage, size: tuple[int, int], rows: int
) -> None:
    """While it records eight people, with warnings: one row on a laptop, with the study's name, two on a phone."""
    page = compact(new_page(eight.address, "light", size))
    humans = [f"p{number}" for number in range(1, 9)]
    running = {"session_id": "s1", "study": "trust in robots", "phase": 2, "human_ids": humans}
    session = eight.study.session
    try:
        session.take_state(running | {"start_at": eight.site.page.now_ns()})
        expect(page.locator("#recording")).to_have_text(re.compile(r"REC.* 00:00:\d\d$"))
        expect(page.locator("#streams-ok")).to_have_text(re.compile(r"^32 of 32 .*ok .*warning"))
        picture(page, f"ways-eight-header-{size[0]}")
        told = page.evaluate(ROWS)
    finally:
        session.take_state({})
    assert told == {"rows": rows, "cut": []}
    assert page.evaluate("() => document.documentElement.scrollWidth") == size[0]


@pytest.mark.parametrize(("theme", "size"), [("light", (1280, 800)), ("dark", (1024, 768)), ("light", (390, 844))])
def test_eight_participants_on_smaller_screens(
    eight: Lab, new_page: OpenPage, theme: str, size: tuple[int, int]
) -> None:
    """Nothing is wider than the screen, and axe-core finds nothing."""
    page = compact(new_page(eight.address, theme, size))
    assert page.evaluate("() => document.documentElement.scrollWidth") == size[0]
    picture(page, f"ways-eight-{size[0]}")
    assert violations(page) == []

"""Each modality as its specialists draw it: marks at their known times, quality of each channel; without ROS."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect
from processes import poll

sys.path.insert(0, str(Path(__file__).parent))

import nine_modalities as known
from gui_looks import picture, violations
from gui_stage import START_S
from nine_lab import OF_HEART, Nine, key

pytestmark = pytest.mark.usefixtures("chromium")
LANE = "globalThis.sense4hri.lanes.lanes.get(key)"


@pytest.fixture(scope="module")
def page(chromium: Browser) -> Iterator[Page]:
    """One page of 30 s for all tests, tall enough that every lane is in sight, once each has its marks."""
    errors: list[str] = []
    with Nine() as lab:
        context = chromium.new_context(viewport={"width": 1280, "height": 1500}, color_scheme="dark")
        context.set_default_timeout(START_S * 1000)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(lab.address)
        page.wait_for_function("() => globalThis.sense4hri?.lanes.lanes.size === 11")
        page.keyboard.press("3")
        ready = "(l) => (l.marks.length > 3 || !l.stream.raw) && l.scales.every((scale) => scale.known && !scale.glide)"
        page.wait_for_function(f"() => [...globalThis.sense4hri.lanes.lanes.values()].every({ready})")
        page.keyboard.press("Space")
        page.wait_for_function("() => document.body.classList.contains('paused')")
        yield page
        context.close()
    assert errors == []


def marks(page: Page, sensor_type: str, name: str) -> list[dict[str, Any]]:
    """The marks of one name on a lane, times in s since the Unix epoch."""
    kinds, found = page.evaluate(f"(key) => [{LANE}.stream.drawn, {LANE}.marks]", key(sensor_type))
    own = [mark for mark in found if kinds[mark["kind"]]["name"] == name]
    return [mark | {"from": mark["from"] / 1000, "to": mark["to"] / 1000} for mark in own]


def ends(found: list[dict[str, Any]], end: str = "from") -> np.ndarray:
    return np.array([mark[end] for mark in found])


def on_time(found_s: np.ndarray, known_s: np.ndarray, least: int) -> bool:
    """Whether there are so many, each at one of the known times."""
    return len(found_s) >= least and bool(np.abs(known_s[:, None] - found_s).min(0).max() < 0.001)


def around(found_s: np.ndarray) -> tuple[float, float]:
    return float(found_s.min()) - 10, float(found_s.max()) + 10


@pytest.mark.parametrize(
    ("sensor_type", "name", "every_s", "after_s", "least"),
    [
        ("respiration", "breath", known.BREATH_EVERY_S, known.BREATH_AFTER_S, 6),
        ("eda", "SCR onset", known.SCR_EVERY_S, known.SCR_AFTER_S, 3),
        ("eda", "SCR peak", known.SCR_EVERY_S, known.SCR_AFTER_S + known.SCR_RISE_S, 3),
        ("eog", "greatest closure", known.BLINK_EVERY_S, known.BLINK_AFTER_S, 7),
        ("eog", "blink", known.BLINK_EVERY_S, known.BLINK_AFTER_S - known.BLINK_S / 2, 7),
        ("eog", "saccade", known.LOOK_S, 0.0, 50),
        ("eye_tracking", "fixation", known.LOOK_S, known.SACCADE_S, 50),
        ("eye_tracking", "blink", known.BLINK_EVERY_S, known.BLINK_AFTER_S - known.BLINK_S / 2, 7),
        ("pupillometry", "interpolated", known.BLINK_EVERY_S, known.BLINK_AFTER_S - known.BLINK_S / 2, 7),
    ],
)
def test_events_stand_at_their_known_times(
    page: Page, sensor_type: str, name: str, every_s: float, after_s: float, least: int
) -> None:
    """As many as happened in the window, each at its time, put from the device's clock on the page's axis."""
    found_s = ends(marks(page, sensor_type, name))
    assert on_time(found_s, known.every(every_s, after_s, *around(found_s)), least)
    assert len(set(found_s.round(2))) == len(found_s)


def test_bursts_are_shaded_from_onset_to_offset_in_the_row_of_their_muscle(page: Page) -> None:
    """Tinted inside the burst and nowhere else, beside the line of the signal; the other muscle's row is not."""
    bursts = marks(page, "emg", "burst")
    for channel, (after_s, long_s) in enumerate(known.BURSTS.values()):
        own = [burst for burst in bursts if burst["channel"] == channel][:-1]
        assert on_time(ends(own), known.every(known.BURST_EVERY_S, after_s, *around(ends(own))), 3)
        assert (ends(own, "to") - ends(own)).tolist() == pytest.approx([long_s] * len(own), abs=1e-3)
    tints = page.evaluate(
        f"""([key, burst]) => {{
            const lane = {LANE}, all = globalThis.sense4hri.lanes, c = lane.canvas.getContext('2d');
            const x = (s) => Math.round(all.width - (all.endMs - 1000 * s) * lane.penPerMs);
            const {{ height }} = lane.rowBox(0, {{ ratio: all.ratio }});
            const rows = [0, 1].map((row) => Math.round(lane.rowBox(row, {{ ratio: all.ratio }}).top + 0.04 * height));
            const red = (s, y) => c.getImageData(x(s), y, 1, 1).data[3];
            return rows.map((y) => [burst.from - 0.2, burst.from + 0.3, burst.to + 0.2].map((s) => red(s, y) > 30));
        }}""",
        [key("emg"), [burst for burst in bursts if burst["channel"] == 1][-2]],
    )
    assert tints == [[False, False, False], [False, True, False]]


def test_circles_stand_on_the_signal(page: Page) -> None:
    """The mark of a breath is as high as the signal at the end of an inspiration: at its greatest."""
    heights = page.evaluate(
        f"""(key) => {{
            const lane = {LANE}, all = globalThis.sense4hri.lanes, pen = {{ ratio: all.ratio, perMs: lane.penPerMs }};
            const {{ factor, offset }} = lane.vertical(0, pen);
            return lane.marks.map((m) => (lane.heightAt(m.from, 0, pen) - offset) / factor);
        }}""",
        key("respiration"),
    )
    seen = [height for height in heights if height is not None]
    assert len(seen) >= 6
    assert all(76 < height < 84 for height in seen)


def test_a_stream_without_samples_is_drawn_by_its_rate(page: Page) -> None:
    """Breathing from the ECG: below all signals, each second's breaths/min at its time, none where none was told."""
    keys, stream, points = page.evaluate(
        f"""(key) => {{
            const {{ line, stream }} = {LANE};
            const keys = [...document.querySelectorAll('.lane')].map((e) => e.dataset.key);
            const value = (i) => (Number.isNaN(line.low[0][i]) ? null : line.low[0][i]);
            const times = [...line.times.subarray(line.start, line.end)];
            return [keys, stream, times.map((ms, i) => [ms / 1000, value(line.start + i)])];
        }}""",
        OF_HEART,
    )
    assert keys[-1] == OF_HEART
    assert (stream["unit"], stream["qualities"], stream["raw"]) == ("breaths/min", [0.85], False)
    told = [(round(at_s), value) for at_s, value in points if abs(at_s - round(at_s)) < 0.002]
    assert len(told) >= 28
    assert {at_s % 20 for at_s, value in told if value is None} == {12, 13, 14}
    assert all(value == pytest.approx(known.rate_of_heart(at_s), abs=1e-3) for at_s, value in told if value is not None)


def test_the_tonic_line_is_inside_the_axis_of_the_conductance(page: Page) -> None:
    """One value a second, in uS, and the axis has room for it."""
    levels = [mark["x"] for mark in marks(page, "eda", "tonic level")]
    low, high = page.evaluate(f"(key) => [{LANE}.scales[0].low, {LANE}.scales[0].high]", key("eda"))
    assert len(levels) >= 25
    assert all(abs(level - known.TONIC_US) <= 0.31 and low < level < high for level in levels)


def test_thirty_two_channels_are_one_lane_that_opens(page: Page) -> None:
    """Folded they lie on each other; opened each has its row, its name and its quality; a key folds them again."""
    lane = page.locator(f".lane[data-key='{key('eeg')}']")
    opener, rows = lane.get_by_role("button", name="32 channels"), f"(key) => {LANE}.rows"
    folded = lane.bounding_box()
    assert folded is not None
    assert page.evaluate(rows, key("eeg")) == 1
    assert opener.get_attribute("aria-expanded") == "false"
    opener.click()
    assert page.evaluate(rows, key("eeg")) == 32
    opened = lane.bounding_box()
    assert opened is not None
    assert opened["height"] > folded["height"] + 200
    page.wait_for_function(f"(key) => {LANE}.canvas.height > 300", arg=key("eeg"))
    qualities = page.evaluate(f"(key) => [...Array(32).keys()].map((row) => {LANE}.quality(row))", key("eeg"))
    assert {name: q for name, q in zip(known.CAP, qualities, strict=True) if q < 0.8} == {"T7": 0.15, "O2": 0.62}
    picture(page, "nine-eeg-open")
    lane.locator(".lane-pick").click()
    page.keyboard.press("f")
    assert page.evaluate(rows, key("eeg")) == 1
    expect(lane.locator(".lane-note")).to_have_text("· poor: T7")
    assert "poor: T7" in (lane.locator(".lane-pick").get_attribute("aria-label") or "")


def test_bands_share_what_the_interpreter_told(page: Page) -> None:
    """Five values a second, beside them the newest shares, which sum up to the whole."""
    bands = {name: marks(page, "eeg", name) for name in "δθαβγ"}
    assert {len(found) for found in bands.values()} == {len(bands["α"])}
    assert all(mark["x"] == 30 for mark in bands["δ"])
    assert max(mark["x"] for mark in bands["α"]) > 55


def test_fixations_are_circles_where_somebody_looked(page: Page) -> None:
    """On the screen rectangle the middle of the newest circle is tinted, at its place in px."""
    newest = marks(page, "eye_tracking", "fixation")[-1]
    ((_, x, y),) = known.looks(newest["from"] - known.SACCADE_S - 0.01, newest["from"])
    assert (newest["x"], newest["y"]) == (pytest.approx(x, abs=0.1), pytest.approx(y, abs=0.1))
    ranges = page.evaluate(f"(key) => {LANE}.field.ranges", key("eye_tracking"))
    assert ranges[0][0] == ranges[1][0] == 0
    assert ranges[0][1] == 2000
    assert ranges[1][1] == 1000


def test_gaps_stay_gaps_while_the_eyes_are_shut(page: Page) -> None:
    """No sample of pupil or gaze is drawn within a blink."""
    for sensor_type in ("pupillometry", "eye_tracking"):
        drawn = page.evaluate(
            f"""(key) => {{
                const {{ line }} = {LANE}, found = [];
                for (let i = line.start; i < line.end; i++) {{
                    if (!Number.isNaN(line.low[0][i])) found.push(line.times[i] / 1000);
                }}
                return found;
            }}""",
            key(sensor_type),
        )
        assert len(drawn) > 500
        assert not known.closed(np.array(drawn)).any()


def test_marks_are_there_after_scrolling_back(page: Page) -> None:
    """The breaths of forty seconds ago stand at their times."""
    end_ms = page.evaluate("() => globalThis.sense4hri.lanes.endMs")
    page.keyboard.press("PageUp")
    page.wait_for_function(
        f"([key, end]) => {LANE}.marks.every((m) => m.from < end - 25000)", arg=[key("respiration"), end_ms]
    )
    found_s = ends(marks(page, "respiration", "breath"))
    assert on_time(found_s, known.every(known.BREATH_EVERY_S, known.BREATH_AFTER_S, *around(found_s)), 5)
    page.keyboard.press("PageDown")


def test_it_can_be_read_everywhere(page: Page) -> None:
    """In both themes and on a phone axe-core finds nothing, and nothing is wider than the screen; pictures are kept."""
    page.keyboard.press("End")
    page.keyboard.press("2")
    for theme, width in (("dark", 1280), ("light", 1280), ("dark", 360)):
        page.set_viewport_size({"width": width, "height": 1500})
        page.emulate_media(color_scheme=theme)
        poll(lambda: page.evaluate("() => globalThis.sense4hri.lanes.asked.every((l) => l.drawable)"), "all lanes")
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
        assert violations(page) == []
        if width < 500:
            page.locator("#lanes").scroll_into_view_if_needed()
        picture(page, f"nine-{theme}-{width}")


def test_nothing_is_outside_of_a_laptop(page: Page) -> None:
    """With more lanes than fit and nothing wrong to tell, time axis and strip are in sight; the lanes scroll."""
    page.emulate_media(color_scheme="dark")
    page.set_viewport_size({"width": 1280, "height": 800})

    def nothing_is_told() -> bool:
        page.keyboard.press("d")
        return page.locator("#problems").is_hidden()

    poll(nothing_is_told, "no sentence at the top")
    for selector in ("#axis", "#past", "#strip"):
        box = page.locator(selector).bounding_box()
        assert box is not None
        assert box["y"] + box["height"] <= 800, selector
    assert page.evaluate(
        "() => { const l = document.querySelector('#lanes'); return l.scrollHeight > l.clientHeight; }"
    )

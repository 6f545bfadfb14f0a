"""What a lane shows: a signal on a huge offset, of many channels some, a hole of before, its axis; without ROS."""

import sys
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from web_gui.stream import Info

sys.path.insert(0, str(Path(__file__).parent))

from gui_lab import RATE_HZ, Lab, waves
from gui_looks import picture

pytestmark = pytest.mark.usefixtures("chromium")
OpenPage = Callable[..., Page]
GLOVE = StreamName("p1", "flexion", "glove_1")
CAP, SKIN = StreamName("p1", "eeg", "cap_1"), StreamName("p1", "temperature", "skin_1")


class Offset(Lab):
    """A sensor of raw counts that lie around 1.7e9."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        self.give(GLOVE, "counts", ("bend",), 1.7e9 + waves(at_ns, seconds, 1) / 8, at_ns)


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    """One for the module."""
    with Offset() as lab:
        yield lab


def test_a_small_signal_on_a_huge_offset_is_seen(lab: Lab, new_page: OpenPage) -> None:
    """±50 around 1.7e9 fill the lane; the axis counts from a round value that the lane's title names."""
    page = new_page(lab.address)
    page.wait_for_function("() => globalThis.sense4hri?.lanes.asked[0]?.drawable")
    expect(page.locator(".lane-label")).to_contain_text("counts · axis + 1700000000 counts")
    low, high = page.evaluate("() => { const { ruler } = sense4hri.lanes.asked[0]; return [ruler.low, ruler.high]; }")
    assert low == pytest.approx(1.7e9 - 62, abs=3)
    assert high == pytest.approx(1.7e9 + 62, abs=3)
    values = page.evaluate("() => { const { line } = sense4hri.lanes.asked[0]; return [...line.low[0].slice(0, 90)]; }")
    assert len(set(values)) > 45
    picture(page, "lanes-offset")


class Wide(Lab):
    """A cap of one channel more than a lane shows."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        channels = tuple(f"E{channel}" for channel in range(256))
        self.give(StreamName("p1", "eeg", "cap_1"), "uV", channels, waves(at_ns, seconds, 256), at_ns)


def test_a_lane_says_of_how_many_channels_it_shows_how_many(new_page: OpenPage) -> None:
    """A cap of 256 is not called one of 255."""
    with Wide() as lab:
        expect(new_page(lab.address).locator(".lane-open")).to_have_text("▸ 255 of 256 channels")


class Gone(Lab):
    """A sensor that has said nothing for half a minute."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time, until there is nothing more."""
        history = self.study.stream(GLOVE, at_ns).history
        if history is None or history.samples_total < 30 * RATE_HZ:
            self.give(GLOVE, "%", ("bend",), waves(at_ns, seconds, 1), at_ns)


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
        page.wait_for_function(HATCHED, arg="--hole")
        picture(page, "lanes-gone")


def test_one_participant_has_all_columns(lab: Lab, new_page: OpenPage) -> None:
    """Where nobody stands beside somebody no half of the page stays empty."""
    page = new_page(lab.address)
    page.wait_for_function("() => sense4hri?.lanes.lanes.size === 1")
    page.keyboard.press("v")
    expect(page.locator("#columns")).to_have_text("▥ 2")
    widths = page.evaluate("() => ['#lanes', '.group'].map((s) => document.querySelector(s).clientWidth)")
    assert widths[0] == widths[1]
    expect(page.locator(".lane-label")).to_contain_text("lines 50 counts apart")


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
    said = new_page(lab.address).evaluate(LABELS, [low, high])
    assert said[0][0] == lowest
    assert all(width <= room for _, width, room in said), said


TICKS = """async ([seconds, width, live]) => {
    const { Lanes } = await import("/js/lanes.js"), c = document.createElement("canvas").getContext("2d"), said = [];
    c.fillText = (label, x) => {
        const wide = c.measureText(label).width, left = c.textAlign === "center" ? x - wide / 2 : x;
        said.push([label, left, left + wide]);
    };
    const pen = { width, ratio: 1, perMs: width / seconds / 1000, right: 0, colours: { font: "sans-serif" } };
    Lanes.prototype.drawTicks.call({ live }, pen, c, 0, seconds);
    return said;
}"""


@pytest.mark.parametrize("live", [True, False])
@pytest.mark.parametrize("seconds", [5, 10, 30])
def test_labels_of_the_time_axis_do_not_touch(lab: Lab, new_page: OpenPage, seconds: int, live: bool) -> None:
    """However narrow the column: numbers that touch are read as another."""
    page = new_page(lab.address)
    for width in range(120, 1300, 20):
        said = page.evaluate(TICKS, [seconds, width, live])
        assert said[-1][0] == f"−{seconds} s"
        assert all(right + 4 <= left for (_, left, _), (_, _, right) in pairwise(said)), (width, said)


class Dead(Lab):
    """A cap whose first electrode is not connected, or not any more."""

    dead, gain = True, 1.0

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        samples = self.gain * waves(at_ns, seconds, 9)
        if self.dead:
            samples[:, 0] = np.nan
        self.give(CAP, "uV", tuple(f"E{channel}" for channel in range(9)), samples, at_ns)


LISTEN = """{
    const draw = CanvasRenderingContext2D.prototype.fillText;
    globalThis.labels = new Set();
    CanvasRenderingContext2D.prototype.fillText = function (label, ...place) {
        labels.add(label);
        return draw.call(this, label, ...place);
    };
}"""


def test_channels_on_each_other_have_an_axis_also_where_the_first_is_dead(new_page: OpenPage) -> None:
    """Their height has its unit whichever of them has no number."""
    with Dead() as lab:
        page = new_page(lab.address)
        page.add_init_script(LISTEN)
        page.reload()
        page.wait_for_function("() => labels.has('400') && labels.has('−400')")


def test_the_height_that_channels_share_follows_them_also_where_the_first_dies(new_page: OpenPage) -> None:
    """The height that all rows share is not that of a channel without numbers."""
    lab = Dead()
    lab.dead = False
    with lab:
        page = new_page(lab.address)
        page.wait_for_function("() => globalThis.sense4hri?.lanes.asked[0]?.drawable")
        lab.dead = True
        silent = "() => { const { line } = sense4hri.lanes.asked[0]; return isNaN(line.low[0][line.start]) }"
        page.wait_for_function(silent)
        lab.gain = 20.0
        tall = "() => { const { ruler } = sense4hri.lanes.asked[0]; return ruler.high - ruler.low > 16000 * 0.9 }"
        page.wait_for_function(tall)


class Blank(Lab):
    """A glove that streams and has no number to tell, or not any more."""

    blank = True

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        self.give(GLOVE, "%", ("bend",), waves(at_ns, seconds, 1) * (np.nan if self.blank else 1.0), at_ns)


def test_a_lane_of_nothing_but_nan_says_why_it_is_empty(new_page: OpenPage) -> None:
    """Samples come and none is a number: that is another thing than no samples, and goes with the first number."""
    with Blank() as lab:
        page = new_page(lab.address)
        label, button = page.locator(".lane-label"), page.locator(".lane-pick")
        expect(label).to_contain_text("– every sample is NaN")
        expect(button).to_have_attribute("aria-label", "p1 flexion glove_1, streaming, every sample is NaN")
        page.add_init_script(LISTEN)
        page.reload()
        page.wait_for_function("() => labels.has('every sample is NaN')")  # where a low lane's title is cut off
        lab.blank = False
        expect(label).not_to_contain_text("NaN")


AREA = """async (value) => {
    const { FEET } = await import("/js/feet.js"), c = document.createElement("canvas").getContext("2d"), said = [];
    c.fillText = (label) => said.push(label);
    const lane = { stream: { unit: "m/s²" }, gaps: [] }, kind = { name: "intensity" };
    const pen = { width: 100, ratio: 1, colours: { font: "sans-serif" } }, x = (ms) => ms;
    const marks = [0, 1].map((second) => ({ from: 1000 * second, to: 1000 * second, x: value, y: NaN }));
    FEET.area.draw({ c, lane, pen, x, colour: "" }, [{ kind, marks }], { top: 0, height: 34 });
    return said.slice(1);
}"""


@pytest.mark.parametrize(("value", "top"), [(0.3, "0.5"), (70, "100"), (0, "1"), (-0.5, "1")])
def test_the_axis_of_an_area_has_numbers(lab: Lab, new_page: OpenPage, value: float, top: str) -> None:
    """Whatever somebody publishes as an intensity, also what is none."""
    assert new_page(lab.address).evaluate(AREA, value) == [top, "0"]


class Late(Lab):
    """A cap that streams before its rate is known, of which the number of channels may change."""

    channels = 16

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        names = tuple(f"E{channel}" for channel in range(self.channels))
        chunk = Chunk(names, waves(at_ns, seconds, self.channels), None, at_ns)
        self.study.stream(CAP, at_ns).raw(chunk, at_ns)


def test_channels_that_come_late_or_go_are_folded_like_those_there_before(new_page: OpenPage) -> None:
    """Sixteen lie on each other although the page was open before they were known; of four each has its row."""
    with Late() as lab:
        page = new_page(lab.address)
        page.wait_for_function("() => sense4hri?.lanes.lanes.size === 1")
        assert page.evaluate("() => [...sense4hri.lanes.lanes.values()][0].stream.shown.length") == 0
        lab.study.streams[CAP].learn(Info(RATE_HZ, "uV", {}))
        opener = page.locator(".lane-open")
        expect(opener).to_have_text("▸ 16 channels")
        lab.channels = 4
        expect(opener).to_be_hidden()
        page.wait_for_function("() => sense4hri.lanes.asked[0].rows === 4")


class Rare(Lab):
    """A glove, and a sensor that has said one number."""

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of the glove's signal end at a time, and once a sample of the other one, in sight."""
        self.give(GLOVE, "%", ("bend",), waves(at_ns, seconds, 1), at_ns)
        if seconds < 1 and not self.study.stream(SKIN, at_ns).raw_at_ns:
            self.give(SKIN, "degC", ("skin",), waves(at_ns, 1 / RATE_HZ, 1), at_ns)


ON_THE_SAMPLE = """() => {
    const { lanes } = sense4hri, lane = lanes.lanes.get("p1/temperature/skin_1");
    const box = lane.element.getBoundingClientRect();
    const back = (lanes.endMs - lane.line.newest) * (lanes.width / lanes.windowMs);
    return [box.left + (lanes.width - back) / lanes.ratio - 3, box.top + box.height / 2];
}"""


def test_a_lane_that_has_no_axis_yet_is_no_error_under_the_pointer(new_page: OpenPage) -> None:
    """One sample makes no axis; the pictures of all lanes go on."""
    with Rare() as lab:
        page = new_page(lab.address)
        page.wait_for_function("() => sense4hri?.lanes.lanes.get('p1/temperature/skin_1')?.line.newest > 0")
        page.keyboard.press("Space")
        page.mouse.move(*page.evaluate(ON_THE_SAMPLE))
        page.wait_for_function("() => sense4hri.lanes.pointer !== null")
        page.evaluate("() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")


class Simulated(Lab):
    """A sensor in a simulation that has just begun: its time is that of 1970."""

    begun_ns = 0

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        self.begun_ns = self.begun_ns or at_ns
        simulated_ns = at_ns - self.begun_ns + 10**9
        self.study.axis.saw(simulated_ns, at_ns)
        self.study.stream(GLOVE, at_ns).learn(Info(RATE_HZ, "%", {}))
        chunk = Chunk(("bend",), waves(at_ns, seconds, 1), None, simulated_ns)
        self.study.stream(GLOVE, at_ns).raw(chunk, at_ns)


def test_the_oldest_signal_of_a_simulation_that_has_just_begun_is_shown(new_page: OpenPage) -> None:
    """The time before its beginning is none: the page asks for the beginning, and keeps its connection."""
    with Simulated() as lab:
        page = new_page(lab.address)
        page.wait_for_function("() => sense4hri?.lanes.asked[0]?.line.newest < 1e6")
        page.keyboard.press("Home")
        before = page.evaluate("() => sense4hri.lanes.frames")
        page.wait_for_function("(before) => sense4hri.lanes.frames > before + 2", arg=before)
        expect(page.locator("#disconnected")).to_be_hidden()


class Slowed(Lab):
    """A sensor of yesterday, played at a tenth of its speed."""

    begun_ns = 0

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        self.begun_ns = self.begun_ns or at_ns
        played_ns = self.begun_ns - 86_400 * 10**9 + (at_ns - self.begun_ns) // 10
        self.study.axis.saw(played_ns, at_ns)
        stream = self.study.stream(GLOVE, at_ns)
        stream.learn(Info(RATE_HZ, "%", {}))
        stream.raw(Chunk(("bend",), waves(played_ns, seconds / 10, 1), None, played_ns), at_ns)


BACK_MS = """() => new Promise((done) => {
    let last = sense4hri.lanes.now(), back = 0, pictures = 0;
    requestAnimationFrame(function look() {
        const now = sense4hri.lanes.now();
        back = Math.max(back, last - now);
        last = now;
        if (++pictures < 150) requestAnimationFrame(look); else done(back);
    });
})"""


def test_the_edge_of_a_slow_replay_goes_on_as_slowly(new_page: OpenPage) -> None:
    """It does not run ahead at the pace of life, to be set back by half a second again and again."""
    with Slowed() as lab:
        page = new_page(lab.address)
        page.wait_for_function("() => globalThis.sense4hri?.lanes.asked[0]?.drawable")
        assert page.evaluate(BACK_MS) < 100


class Moved(Lab):
    """A strap with an accelerometer, of which somebody may compute the intensity."""

    intensity: float | None = None

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of its signal end at a time."""
        name = StreamName("p1", "accelerometer", "h10_1")
        stream = self.give(name, "m/s^2", ("x", "y", "z"), waves(at_ns, seconds, 3), at_ns)
        if self.intensity is not None:
            stream.take_features({"intensity_m_per_s2": self.intensity, "extra": [], "reasons": []}, at_ns)


def test_what_nobody_computes_takes_no_room(new_page: OpenPage) -> None:
    """Below an acceleration without an interpreter stands nothing; its intensity has a place as soon as it is told."""
    with Moved() as lab:
        page = new_page(lab.address)
        page.wait_for_function("() => globalThis.sense4hri?.lanes.asked[0]?.drawable")
        lane = page.locator(".lane")
        expect(lane).not_to_have_attribute("data-foot", "")
        lab.intensity = 0.3
        expect(lane).to_have_attribute("data-foot", "")


REACH = """async ([unit, ranges]) => {
    const { Field } = await import("/js/field.js"), field = new Field(unit);
    field.grow(ranges, []);
    return [field.reach(0), field.reach(1)];
}"""


@pytest.mark.parametrize(
    ("unit", "ranges", "said"),
    [
        ("°", [[-17, 12], [-9, 8]], ["x −20 to 20 °", "y 10 to −10 °"]),
        ("px", [[100, 1900], [50, 980]], ["x 0 to 2000 px", "y 0 to 1000 px"]),
        ("1", [[0.2, 0.9], [0.1, 0.8]], ["x 0 to 1", "y 0 to 1"]),
    ],
)
def test_the_field_of_the_gaze_says_how_far_it_reaches(
    lab: Lab, new_page: OpenPage, unit: str, ranges: list[list[float]], said: list[str]
) -> None:
    """From left to right and from its upper edge down: in degrees up is up, on a screen down counts."""
    assert new_page(lab.address).evaluate(REACH, [unit, ranges]) == said

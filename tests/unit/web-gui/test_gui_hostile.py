"""What strangers publish: shown as far as it can be, and nothing of it keeps a browser from its next message."""

import asyncio
import json
import math
import random
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from aiohttp import ClientSession, WSMsgType
from sense4hri.chunk import Chunk
from sense4hri.intake import LARGEST
from sense4hri.names import StreamName
from sense4hri.recorder_status import NAME, RecorderStatus
from sense4hri.stream_info import StreamInfo
from web_gui import history as history_module
from web_gui import model as model_module
from web_gui.config import Config
from web_gui.frames import decode, encode
from web_gui.history import History
from web_gui.intake import MOST_ITEMS, chunk_of, plain, shown
from web_gui.model import Study
from web_gui.problem_log import ProblemLog
from web_gui.problems import problems
from web_gui.server import Site, serve
from web_gui.snapshot import study_message, trend_message
from web_gui.stream import FRESH_NS, Info
from web_gui.view import LaneRequest, Request, View

S = 1_000_000_000
NOW = 1_700_000_000 * S
ECG = StreamName("p1", "ecg", "h10_1")
REALS = [LARGEST, -LARGEST, math.nan, 5e-324, 0.0]  # what the kit lets in
WHOLES = [0, 1, 255, -1, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1, -(2**63)]
TEXTS = [
    "",
    "x" * 1_000_000,
    "\u202egnp.exe",
    "\ud800",
    "\0\x15\x1b[31m",
    "<img src=x onerror=alert(1)>",
    "شريط 心電 ♥",
]
FIELDS = {
    "features": ["heart_rate_bpm", "rr_interval_ms", "signal_quality", "window_s"],
    "health": ["nominal_rate_hz", "measured_rate_hz", "battery_percent", "rssi_dbm", "contact", "latency_s"],
    "clock": ["skew_ppm", "uncertainty_s", "latency_s"],
}


class Message:
    """A ROS message as the page sees it."""

    def __init__(self, **fields):
        self.__dict__.update(fields)

    def get_fields_and_field_types(self):
        return dict.fromkeys(self.__dict__, "")


def stamp(chance):
    return SimpleNamespace(sec=chance.choice([0, -(2**31), 2**31 - 1, 1_700_000_000]), nanosec=2**32 - 1)


def features(chance, fields):
    extra = [Message(name=chance.choice(TEXTS), unit=chance.choice(TEXTS), values=np.array(chance.choices(REALS, k=5)))]
    given = {name: chance.choice(REALS) for name in fields}
    texts = {"reasons": chance.choices(TEXTS, k=30), "channel_name": chance.choice(TEXTS), "host": chance.choice(TEXTS)}
    events = {"peak_timestamps": [stamp(chance) for _ in range(20)], "rr_intervals_ms": np.array(REALS)}
    whole = {name: chance.choice(WHOLES) for name in ("lost_samples_total", "reconnects_total", "offset_ns")}
    whole["state"] = chance.choice([0, 2, 255])
    return Message(
        **given, **texts, **events, **whole, extra=extra * 100, segment=1, device_reference=stamp(chance),
        hrv=Message(window_s=chance.choice(REALS), rmssd_ms=chance.choice(REALS)),
    )  # fmt: skip


def assail(study, chance, now_ns):
    """One round of everything a stranger can send."""
    stream = study.stream(StreamName(chance.choice(["p1", "p2"]), chance.choice(["ecg", "ppg", "nose"]), "s_1"), now_ns)
    stream.learn(
        Info.of(StreamInfo(stream.name, chance.choice(REALS), chance.choice(TEXTS), parameters={"model": "m" * 10**6}))
    )
    samples = np.array([[chance.choice(REALS)] for _ in range(chance.randrange(1, 50))])
    stamps = chance.choice([None, -(2**31) * S, NOW, 2**31 * S]), chance.choice([0, NOW, -(2**31) * S, 2**31 * S])
    stream.raw(Chunk((shown(chance.choice(TEXTS)),), samples, *stamps), now_ns)
    study.axis.saw(stamps[1], now_ns)
    stream.take_features(plain(features(chance, FIELDS["features"])), now_ns)
    stream.take_health(plain(features(chance, FIELDS["health"])), now_ns)
    stream.take_clock(plain(features(chance, FIELDS["clock"])), now_ns)
    state = Message(state=chance.choice(TEXTS), confidence=chance.choice(REALS), heart_rate_bpm=chance.choice(REALS))
    study.take_state("p1", plain(state), now_ns)
    marker = Message(stamp_ns=stamps[1], name=chance.choice(TEXTS), value=chance.choice(TEXTS), human_id="p1")
    study.take_marker(plain(marker), now_ns)
    values = [
        SimpleNamespace(key=key, value=chance.choice([*TEXTS, "1e400", "9" * 400]))
        for key in ("messages", "minutes_left", "free_bytes", "directory")
    ]
    level, text = chance.choice([b"\0", b"\xff"]), chance.choice(TEXTS)
    told = SimpleNamespace(name=NAME, hardware_id=chance.choice(TEXTS), level=level, message=text, values=values)
    study.session.recorder.take(RecorderStatus.parse(told), now_ns)
    session = {name: chance.choices(TEXTS, k=9) for name in ("human_ids", "expected_services", "required_streams")}
    session |= {
        "waiting_for": chance.choices(TEXTS, k=9),
        "start_at": stamp(chance),
        "phase": chance.choice([0, 2, 255]),
    }
    study.session.take_state(plain(Message(**session)))


@pytest.mark.filterwarnings("ignore:overflow encountered")
@pytest.mark.parametrize("seed", range(4))
def test_whatever_is_published_the_page_can_be_told_of_it(seed):
    """Numbers as large as can be come through, texts are short; what is sent is JSON and frames that can be read."""
    study, log, chance = Study(), ProblemLog(), random.Random(seed)
    view = View(
        Request(
            1,
            500,
            10 * S,
            None,
            tuple(LaneRequest(StreamName(p, t, "s_1"), None) for p in ("p1", "p2") for t in ("ecg", "ppg", "nose")),
        )
    )
    for turn in range(60):
        now_ns = NOW + turn * S
        assail(study, chance, now_ns)
        study.tick(now_ns)
        log.update(problems(study, now_ns), now_ns)
        for message in (study_message(study, log, now_ns), trend_message(study)):
            assert len(json.dumps(message, allow_nan=False)) < 4_000_000
        decode(encode(view.frame(study, turn, now_ns)))


def test_a_number_that_nothing_measures_closes_no_connection():
    """One latency of 1e307 in a clock model: null on the page, and the connection goes on."""

    async def check():
        site = Site(Study(), Config(port=0))
        runner, port = await serve(site, Config(port=0))
        now_ns = site.page.now_ns()
        clock = {"device_reference": 0, "offset_ns": 0, "skew_ppm": 1e307, "uncertainty_s": 1e307, "latency_s": 1e307}
        site.page.study.stream(ECG, now_ns).take_clock(clock | {"segment": 1}, now_ns)
        try:
            async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
                studies = 0
                while studies < 3:
                    message = await socket.receive(10)
                    assert message.type is WSMsgType.TEXT
                    studies += json.loads(message.data)["type"] == "study"
        finally:
            await runner.cleanup()

    asyncio.run(check())


def test_hidden_characters_are_shown():
    """What turns the writing or rings a bell stands there by its number; scripts and joined letters are left alone."""
    assert shown("a\u202eb\x07\n\ud800") == "a\\u202eb\\u0007 \\ud800"
    for text in ("حلقه‌ای", "जाँच पट्टी", "心電図", "Ωμέγα ♥", "👩‍🔬"):
        assert shown(text) == text
    assert len(shown("x" * 10**6)) == 300


def test_lists_are_cut_and_depth_ends():
    """Neither a list of a million nor a message within messages without end is kept."""
    endless = Message()
    endless.__dict__["inner"] = endless
    assert plain(endless)["inner"]["inner"]
    assert len(plain(Message(values=np.zeros(10**6)))["values"]) == MOST_ITEMS


def raw(channels, samples, value=0.0):
    """A serialised PhysioRaw, its channels `000`, `001` ..."""
    body = struct.pack("<iII4siII", 5, 0, 1, b"\0\0\0\0", 5, 0, channels)
    for channel in range(channels):
        body += struct.pack("<I4sI", 4, b"%03x\0" % channel, samples)
        body += b"\0" * (-len(body) % 8) + np.full(samples, value).tobytes()
    return b"\0\1\0\0" + body


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (raw(1, 1_000_000), "1000000 values in one message"),
        (raw(2000, 1), "2000 channels in one message"),
        (raw(2, 10, 1e40), "a number beyond 1e\\+30"),
        (raw(0, 0), "channels of"),
        (raw(64, 1000)[:-1], "not a PhysioRaw"),
        (b"\0\1\0\0" + b"\xff" * 100, "PhysioRaw|channels"),
    ],
)
def test_a_raw_message_that_cannot_be_shown_is_refused_in_words(message, why):
    """Neither megabytes nor nonsense are kept; the kit tells them with the node's name."""
    with pytest.raises(ValueError, match=why):
        chunk_of(message)


def test_a_raw_message_is_read_from_its_bytes():
    """Names, stamps and samples are those that were sent."""
    chunk = chunk_of(raw(64, 1000, 2.5))
    names = tuple(f"{channel:03x}" for channel in range(64))
    assert (chunk.channels, chunk.received_ns, chunk.device_ns) == (names, 5 * S, 5 * S)
    assert np.array_equal(chunk.samples, np.full((1000, 64), 2.5))


def test_what_waits_for_a_rate_is_bounded_in_size():
    """A stream of which nothing is known keeps some megabytes, not two thousand messages of any size."""
    stream = Study().stream(ECG, NOW)
    for k in range(100):
        stream.raw(Chunk(("ecg",), np.zeros((100_000, 1)), None, NOW + k * S), NOW + k * S)
    assert stream.kept_bytes <= 8 * 600_000


def test_the_streams_that_take_most_memory_remember_less(monkeypatch):
    """All histories together stay within the limit; a small stream keeps all of its own."""
    monkeypatch.setattr(model_module, "MOST_BYTES", 20_000_000)
    study = Study()
    small = study.stream(ECG, NOW)
    small.learn(Info.of(StreamInfo(ECG, 10.0)))
    for k in range(100):
        small.raw(Chunk(("ecg",), np.zeros((10, 1)), None, NOW + k * S), NOW + k * S)
    for number in range(5):
        name = StreamName("p1", "eeg", f"cap_{number}")
        big = study.stream(name, NOW)
        big.learn(Info.of(StreamInfo(name, 100_000.0)))
        for k in range(10):
            big.raw(Chunk(("a",), np.zeros((50_000, 1)), None, NOW + k * S // 2), NOW)
    study.tick(NOW)
    assert sum(stream.kept_bytes for stream in study.streams.values()) <= 20_000_000
    assert small.history.samples_total == len(small.history.columns(0, NOW * 2, 1, [0]).times_ns) == 1000


def test_halving_a_history_keeps_its_newer_half():
    """What is left stands where it stood."""
    history = History(("a",), 1e6, device_time=False)
    stream = Study(1e6).stream(ECG, NOW)
    stream.history = history
    stream.learn(Info.of(StreamInfo(ECG, 10.0)))
    for k in range(500):
        stream.raw(Chunk(("a",), np.full((10, 1), float(k)), None, NOW + k * S), NOW + k * S)
    before = stream.history.columns(0, NOW * 2, 1, [0])
    stream.shrink()
    after = stream.history.columns(0, NOW * 2, 1, [0])
    assert np.array_equal(after.times_ns, before.times_ns[2500:])
    assert np.array_equal(after.low, before.low[2500:])
    assert history_module.FIRST_ROWS <= 2500


def test_who_leaves_is_forgotten():
    """500 strangers that have left keep a bounded number of rows and no memory; states and strips go with them."""
    study = Study()
    for number in range(500):
        name = StreamName(f"x{number}", "ecg", f"s_{number}")
        stream = study.stream(name, NOW)
        stream.learn(Info.of(StreamInfo(name, 100.0)))
        stream.raw(Chunk(("a",), np.zeros((10_000, 1)), None, NOW), NOW)
        study.take_state(f"x{number}", {"state": "unknown"}, NOW)
    study.tick(NOW)
    assert len(study.trends) == 500
    for number in range(500):
        study.gone(StreamName(f"x{number}", "ecg", f"s_{number}"), NOW)
        study.state_gone(f"x{number}")
    study.tick(NOW + FRESH_NS + 1)
    assert len(study.streams) <= 100
    assert len(study.trends) == len(study.humans()) == len(study.streams)
    assert sum(stream.kept_bytes for stream in study.streams.values()) <= 16_000_000
    assert study.states == {}


def test_a_flood_of_names_displaces_nobody_who_streams():
    """At most so many streams are known; the ones that have been silent longest make room."""
    study = Study()
    study.stream(ECG, NOW)
    for number in range(5000):
        study.stream(ECG, NOW + number).last_at_ns = NOW + number + 1
        study.stream(StreamName("x", "ecg", f"s_{number}"), NOW + number)
        study.take_state(f"x{number}", {}, NOW + number)
    assert ECG in study.streams
    assert len(study.streams) == model_module.MOST_STREAMS
    assert len(study.states) == model_module.MOST_PEOPLE

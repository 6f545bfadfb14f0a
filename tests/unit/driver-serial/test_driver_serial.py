"""driver-serial: every form of frame against what the emulator sampled; garbage, losses, wraps, resets."""

import asyncio
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from driver_serial.config import SerialConfig
from driver_serial.description import Counter, parse
from driver_serial.device import Board, Losses
from driver_serial.protocol import Frames, unstuffed
from plugged import let_go, plugged, until_unplugged, wakes_per_message
from sense4hri import wire
from sense4hri.chunk import Break
from sense4hri.device import Declared, Item, Samples
from sense4hri.errors import FrameError
from sense4hri.holes import Holes, one_by_one
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import SECOND_NS
from sensor_bench.board.firmware import Sketch, cobs
from sensor_bench.wired import Frames as Air
from serial_board import COUNTER, FORMS, STREAMS, STUDY, TIME, numbers, of, pieces, played, sketch


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_every_sample_once(form: str) -> None:
    """In pieces cut anywhere: all samples, scaled, in order, at the board's own times, across a wrap of its clock."""
    device = sketch(form, first_tick=2**32 - 5000)
    items = played(FORMS[form] + TIME + STREAMS, pieces(device, 20.0, np.random.default_rng(3)))
    eda = of(items, "eda")
    values = np.concatenate([item.chunk.samples[:, 0] for item in eda])
    np.testing.assert_allclose(values, numbers(0, 1001, 50)[: len(values)])
    assert len(values) > 990
    times_ns = np.concatenate([item.times_ns for item in eda])
    assert set(np.diff(times_ns).tolist()) == {20_000_000}
    assert [item for item in items if isinstance(item, FrameError)] == []
    assert of(items, "ppg")[0].chunk.channels == ("finger",)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", range(3))
def test_spoilt_and_lost_frames_are_counted(form: str, seed: int) -> None:
    """1 % of frames lost and bits wrong here and there: no exception, and came + counted is what was sampled."""
    random, air = np.random.default_rng(seed), Air(seed, loss=0.01)
    chunks = pieces(sketch(form, air), 60.0, random)
    spoilt = 0
    for i, (at_s, octets) in enumerate(chunks):
        if octets and form in ("struct", "cobs", "pairs") and 0 < i < 290 and random.random() < 0.05:
            at = int(random.integers(len(octets)))
            chunks[i] = at_s, octets[:at] + bytes([octets[at] ^ 1 << int(random.integers(7))]) + octets[at + 1 :]
            spoilt += 1
    items = played(FORMS[form] + COUNTER + STREAMS, chunks)
    came = sum(len(item.chunk.samples) for item in of(items, "eda"))
    counted = sum(item.lost or 0 for item in of(items, "eda"))
    ends = 3001 - came - counted  # lost before the first or after the last, and what waits for a message
    assert 0 <= ends <= 10
    assert air.counts["eda"].samples_lost <= counted + ends
    assert counted <= air.counts["eda"].samples_lost + 2 * spoilt
    values = np.concatenate([item.chunk.samples[:, 0] for item in of(items, "eda")])
    assert np.all((np.diff(values) > 0) | (values[1:] < 1))


def test_a_board_that_is_reset_begins_anew() -> None:
    """Its new, small time is passed on at once; its count is no loss of two hundred samples."""
    first, second = sketch("csv"), sketch("csv")
    chunks = [(at / 10, first.send(at / 10)) for at in range(1, 301)]
    chunks += [(30 + at / 10, second.send(at / 10)) for at in range(1, 51)]
    items = played(FORMS["csv"] + TIME + STREAMS, chunks)
    times_ns = np.concatenate([item.times_ns for item in of(items, "eda")])
    back = np.flatnonzero(np.diff(times_ns) < 0)
    assert len(back) == 1
    assert times_ns[back[0] + 1] < SECOND_NS


@pytest.mark.parametrize(
    ("unit", "sent", "read_ns"),
    [
        ("s", b"12.020", 12_020_000_000),
        ("ms", b"12.5", 12_500_000),
        ("us", b"4294967295.25", 4_294_967_295_250),
        ("ns", b"4294967295", 4_294_967_295),
    ],
)
def test_a_time_may_have_a_fraction(unit: str, sent: bytes, read_ns: int) -> None:
    """Seconds with decimals are read to the ns, whole ticks exactly."""
    text = FORMS["csv"] + f"time: {{field: t, unit: {unit}}}\n" + STREAMS
    items = played(text, [(1.0, (sent + b",0,1,1,1\n") * 6)])
    assert {item.chunk.device_ns for item in of(items, "eda")} == {read_ns}


@pytest.mark.parametrize(
    "line",
    [
        b'{"t": 1, "gsr": ' + b"[" * 3000 + b"}",
        b'{"t": 1, "gsr": 1' + b"0" * 400 + b', "ppg": 1}',
        b'{"t": 1' + b"0" * 400 + b', "gsr": 1, "ppg": 1}',
        b'{"t": 9300000000000000, "gsr": 1, "ppg": 1}',
        b'{"t": 2147483648000000, "gsr": 1, "ppg": 1}',
        b'{"t": Infinity, "gsr": 1, "ppg": 1}',
        b'{"t": NaN, "gsr": 1, "ppg": 1}',
        b'{"t": -0.5, "gsr": 1, "ppg": 1}',
    ],
)
def test_no_line_ends_the_driver(line: bytes) -> None:
    """Brackets without end, numbers that nothing holds and times that no stamp holds are frame errors."""
    right = b'{"t": 5, "gsr": 1, "ppg": 1}\n'
    text = FORMS["json"] + "time: {field: t, unit: us, bits: 64}\n" + STREAMS
    items = played(text, [(1.0, right * 5 + line + b"\n" + right * 5)])
    assert [type(item) for item in items if not isinstance(item, Samples)] == [FrameError]
    assert sum(len(item.chunk.samples) for item in of(items, "eda")) == 10


@pytest.mark.parametrize("value", ["Infinity", "-1e999", "1e31"])
def test_a_number_that_no_message_may_hold_costs_its_own_frame_only(value: str) -> None:
    """Everybody refuses a message with one, its neighbours too; NaN is a sample that could not be taken."""
    values = ["1"] * 5 + [value, "NaN"] + ["1"] * 13
    lines = [f'{{"n": {i}, "gsr": 1, "ppg": {each}}}\n' for i, each in enumerate(values)]
    items = played(FORMS["json"] + COUNTER + STREAMS, [(1.0, "".join(lines).encode())])
    assert sum(isinstance(item, FrameError) for item in items) == 1
    for name in ("eda", "ppg"):
        (told,) = of(items, name)
        assert len(wire.chunk_of(wire.octets_of(told.chunk, "b_1")).samples) == 19
        assert told.lost == 1


def test_without_time_and_count_nobody_knows_of_losses() -> None:
    """No device time is made up, and what is lost is unknown, not 0."""
    items = played(FORMS["json"] + STREAMS, [(1.0, sketch("json").send(1.0))])
    (samples,) = of(items, "eda")
    assert (samples.lost, samples.times_ns, samples.chunk.device_ns) == (None, None, None)


@pytest.mark.parametrize("line", ["512", "gsr:512"])
@pytest.mark.parametrize(("more", "believed"), [("", False), ("checksum: sum8\n", False), ('start: "s"\n', True)])
def test_the_rest_of_a_line_is_no_sample(line: str, more: str, believed: bool) -> None:
    """Connected within `512`: the `12` that is left is no value, unless the board sends whole lines from `start` on."""
    text = ("format: pairs\n" if ":" in line else "format: csv\nfields: [gsr]\n") + more + STREAMS.partition("  ppg")[0]
    check = f"*{sum(line.encode()) & 0xFF:02x}" if "sum8" in more else ""
    octets = (line.replace("512", "12") + check + "\n" + (line + check + "\n") * 9).encode()
    values = np.concatenate([item.chunk.samples[:, 0] for item in of(played(text, [(1.0, octets)]), "eda")])
    assert values.tolist() == pytest.approx([0.12] * believed + [5.12] * 9)


def test_a_sentence_of_nmea_is_checked_from_behind_its_dollar() -> None:
    """`$GPGGA,...*47` is the standard's own example; its first field is a name, and a spoilt digit is told."""
    sentence = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"
    text = f"format: csv\nchecksum: nmea\nfields: [{', '.join('_' * 8)}, gsr, {', '.join('_' * 6)}]\n"
    text += STREAMS.partition("  ppg")[0]
    items = played(text, [(1.0, 9 * sentence + sentence.replace(b"0.9", b"0.8"))])
    values = np.concatenate([item.chunk.samples[:, 0] for item in of(items, "eda")])
    assert values.tolist() == pytest.approx([0.009] * 9)
    assert [str(item).partition(" (")[0] for item in items if isinstance(item, FrameError)] == ["wrong checksum"]


@pytest.mark.parametrize("value", ['"512"', "[512]", '{"raw": 512}', "true", "false"])
def test_a_wanted_field_of_json_that_is_no_number_is_told(value: str) -> None:
    """A text that looks like a number is an error that names it, and no silence; what nobody wants may be a text."""
    text = '{"t": 1, "gsr": 5, "mood": "fine"}\n{"t": 2, "gsr": VALUE}\n'.replace("VALUE", value)
    items = played(FORMS["json"] + TIME + STREAMS, [(1.0, text.encode())])
    assert [str(item).partition(" (")[0] for item in items if isinstance(item, FrameError)] == ["'gsr' is no number"]


@pytest.mark.parametrize("line", ["1_0", "gsr:1_0"])
def test_a_spoilt_digit_is_told(line: str) -> None:
    """`1_0` is no number that a board writes; to Python it is 10."""
    text = ("format: pairs\n" if ":" in line else "format: csv\nfields: [gsr]\n") + STREAMS.partition("  ppg")[0]
    items = played(text, [(1.0, f"{line}\n{line}\n".encode())])
    assert [str(item).partition(" (")[0] for item in items] == ["'1_0' is no number"]


def test_a_pair_that_nobody_wants_may_be_a_text() -> None:
    """A state beside the values refuses no line; a wanted value that is a text does, and a piece that is no pair."""
    text = "format: pairs\n" + STREAMS.partition("  ppg")[0]
    items = played(text, [(1.0, b"st:OK,gsr:512\n" * 7 + b"st:OK,gsr:off\nOK,gsr:512\n")])
    values = np.concatenate([item.chunk.samples[:, 0] for item in of(items, "eda")])
    assert values.tolist() == pytest.approx([5.12] * 6)
    errors = [str(item).partition(" (")[0] for item in items if isinstance(item, FrameError)]
    assert errors == ["'off' is no number", "'OK' is no name:value"]


def test_lines_without_all_fields_are_samples_of_the_other_streams() -> None:
    """A slow sensor beside a fast one: each line feeds the streams whose fields it has."""
    octets = b"".join(b'{"ppg": %d%s}\n' % (i, b', "gsr": 500' if i % 10 == 0 else b"") for i in range(100))
    items = played(FORMS["json"] + STREAMS, [(2.0, octets)])
    assert {name: sum(len(item.chunk.samples) for item in of(items, name)) for name in ("eda", "ppg")} == {
        "eda": 10,
        "ppg": 100,
    }


@pytest.mark.parametrize(("bits", "most"), [(8, 127), (4, 7), (16, 32767)])
def test_a_count_tells_losses_of_less_than_half_a_round(bits: int, most: int) -> None:
    """One more looks like a reset, and is no loss."""
    losses = Losses(Counter("n", bits))
    assert [losses.before({"n": n}) for n in (0, most + 1)] == [0, most]
    assert losses.before({"n": 2 * most + 3}) == 0


def test_a_count_may_have_a_sign() -> None:
    """An `i8` counts from 127 on to -128: three frames are missing before -124, and three before -120."""
    losses = Losses(Counter("n", 8))
    assert [losses.before({"n": n}) for n in (126, 127, -128, -124, -120)] == [0, 0, 0, 3, 3]


def test_losses_are_known_of_streams_in_every_frame_only() -> None:
    """Twenty frames are lost: twenty samples of the stream that each of them fed, of the slow one nobody knows."""
    lines = [b'{"n": %d, "ppg": 1%s}\n' % (i, b', "gsr": 5' if i % 10 == 0 else b"") for i in range(100)]
    items = played(FORMS["json"] + COUNTER + STREAMS, [(2.0, b"".join(lines[:35] + lines[55:]))])
    assert {name: [item.lost for item in of(items, name)] for name in ("eda", "ppg")} == {"eda": [None], "ppg": [20]}


@pytest.mark.parametrize(("counter", "lost"), [(COUNTER, {3}), ("", {None})])
def test_losses_of_an_irregular_stream_are_the_counter_s(counter: str, lost: set[int | None]) -> None:
    """Its times tell nothing of them: with a count they are known, without one they are not."""
    streams = STREAMS.replace("rate_hz: 50", "rate_hz: 0")
    octets = b'{"t": 5, "n": 1, "gsr": 1}\n{"t": 900, "n": 5, "gsr": 1}\n'
    assert {item.lost for item in of(played(FORMS["json"] + TIME + counter + streams, [(1.0, octets)]), "eda")} == lost


def test_a_count_tells_losses_beside_a_time_that_jitters() -> None:
    """At 50 Hz `t` strays by 8 ms, which hides single frames from the kit: the board has counted them."""
    rng = np.random.default_rng(1)
    kept = np.flatnonzero((rng.random(3000) > 0.02) | (np.arange(3000) < 50))
    lines = [b'{"t": %d, "n": %d, "gsr": 1}\n' % (i * 20 + rng.integers(9), i % 256) for i in kept]
    chunks = [(i / 50, line) for i, line in zip(kept, lines, strict=True)]
    eda = of(played(FORMS["json"] + TIME + COUNTER + STREAMS, chunks), "eda")
    assert all(item.times_ns is not None for item in eda)
    assert sum(item.lost or 0 for item in eda) == kept[-1] + 1 - len(kept)


def test_ticks_as_long_as_a_sample_tell_no_losses() -> None:
    """`millis()` at 1000 Hz, samples that jitter by 0.1 ms: steps of 0, 1 and 2 ticks, and nothing is lost."""
    ticks = np.arange(1, 10_001) + np.random.default_rng(1).normal(0.0, 0.1, 10_000)
    lines = [(i / 1000, b'{"t": %d, "gsr": 1}\n' % tick) for i, tick in enumerate(ticks.astype(int).tolist())]
    clock, holes = SampleClock(1000.0), Holes(1000.0)
    for item in of(played(FORMS["json"] + TIME + STREAMS.replace("rate_hz: 50", "rate_hz: 1000"), lines), "eda"):
        for chunk in [item.chunk] if item.times_ns is None else holes.cut(item.chunk, item.times_ns):
            clock.place(chunk)
    assert (clock.lost_samples_total, clock.duplicates_total) == (0, 0)


def test_a_count_that_begins_anew_with_the_clock_is_no_loss() -> None:
    """Reset at 200: to a count of 8 bits alone 55 frames are missing, which its time knows better."""
    first = [(i / 50, b'{"t": %d, "n": %d, "gsr": 1}\n' % (10**6 + i * 20, i)) for i in range(201)]
    second = [(10 + i / 50, b'{"t": %d, "n": %d, "gsr": 1}\n' % (i * 20, i)) for i in range(50)]
    items = played(FORMS["json"] + TIME + COUNTER + STREAMS, first + second)
    assert {item.lost for item in of(items, "eda")} == {0}


@pytest.mark.parametrize("time", ["-1", "Infinity", "null"])
def test_a_refused_time_hides_no_losses(time: str) -> None:
    """Three lines lost, then one whose time cannot be: four samples are missing before the one behind it."""
    streams = STREAMS.replace("rate_hz: 50", "rate_hz: 0")
    lines = '{"t": 5, "n": 1, "gsr": 1}', f'{{"t": {time}, "n": 5, "gsr": 1}}', '{"t": 905, "n": 6, "gsr": 1}'
    octets = "\n".join([*lines, ""]).encode()
    items = played(FORMS["json"] + TIME + COUNTER + streams, [(1.0, octets)])
    assert sum(item.lost or 0 for item in of(items, "eda")) == 4


def test_irregular_samples_of_one_read_follow_each_other() -> None:
    """Three lines in one read: no two at the same time, which would look like a reset."""
    streams = STREAMS.replace("rate_hz: 50", "rate_hz: 0")
    octets = b"".join(b'{"gsr": %d}\n' % each for each in range(3))
    clock = SampleClock(0.0)
    (item,) = of(played(FORMS["json"] + streams, [(1.0, octets)]), "eda")
    assert [clock.place(each).break_ for each in one_by_one(item.chunk, item.times_ns)] == [Break.FIRST, None, None]


def test_irregular_samples_have_times_of_their_own() -> None:
    """Those of the board, two in one tick among them; a frame of the next read comes after all of this one."""
    streams = STREAMS.replace("rate_hz: 50", "rate_hz: 0")
    octets = [b"".join(b'{"t": %d, "gsr": 1}\n' % each for each in ticks) for ticks in ((5, 5, 905), (1000,))]
    items = of(played(FORMS["json"] + TIME + streams, [(1.0, each) for each in octets]), "eda")
    chunks = [each for item in items for each in one_by_one(item.chunk, item.times_ns)]
    assert [each.device_ns // 10**6 for each in chunks] == [5, 5, 905, 1000]
    assert np.diff([each.received_ns for each in chunks]).tolist() == [1, 1, 1]


@pytest.mark.parametrize(("unit", "again_ns"), [("ms", 1_000_000), ("us", 1_000)])
def test_the_clock_goes_on_while_its_description_does(tmp_path: Path, unit: str, again_ns: int) -> None:
    """A description that was edited while the board was away is the one its times are read by."""
    text = FORMS["csv"] + TIME + STREAMS
    config = SerialConfig(sensor_id="b_1", port=f"{tmp_path}/b", board=f"{tmp_path}/board.yaml")
    board = Board(config, {})

    async def step_ns(content: str) -> int:
        Path(config.board).write_text(content)
        async with plugged(tmp_path / "b", sketch("csv")) as link:
            stream = board.stream()
            found = [await anext(stream) for _ in range(3)][-1]
            await stream.aclose()
            await let_go(link)
        assert isinstance(found, Samples)
        assert found.times_ns is not None
        return int(found.times_ns[1] - found.times_ns[0])

    assert asyncio.run(step_ns(text)) == 20_000_000
    before = board._clock
    assert asyncio.run(step_ns(text.replace("unit: ms", f"unit: {unit}"))) == 20 * again_ns
    assert (board._clock is before) == (unit == "ms")


def test_a_board_that_was_not_stopped_is_found_in_the_middle_of_a_line(tmp_path: Path) -> None:
    """The link broke, so it goes on sending: what comes first once it is back is the rest of a line."""
    config = SerialConfig(sensor_id="b_1", port=f"{tmp_path}/b", board=f"{tmp_path}/board.yaml")
    Path(config.board).write_text('format: csv\nfields: [gsr]\nstart: "s"\n' + STREAMS.partition("  ppg")[0])
    board = Board(config, {})

    async def first_value(octets: bytes) -> float:
        behind = SimpleNamespace(receive=lambda *_: b"", send=lambda _: octets)
        async with plugged(tmp_path / "b", behind) as link:
            stream = board.stream()
            found = await anext(item async for item in stream if isinstance(item, Samples))
            await stream.aclose()
            await let_go(link)
        return float(found.chunk.samples[0, 0])

    assert asyncio.run(first_value(b"512\n" * 5)) == pytest.approx(5.12)
    assert asyncio.run(first_value(b"12\n" + b"512\n" * 5)) == pytest.approx(5.12)


@pytest.mark.parametrize("form", FORMS)
def test_garbage_is_told_and_passed_over(form: str) -> None:
    """Bytes that are no frame, however many, are errors; the frames after them are taken."""
    random = np.random.default_rng(5)
    frames, buffer = Frames(parse(FORMS[form] + STREAMS)), bytearray(random.bytes(20_000) + b"\n\0")
    first = list(frames.take(buffer))
    assert any(isinstance(each, FrameError) for each in first)
    buffer += sketch(form).send(2.0)
    found = [each for each in frames.take(buffer) if not isinstance(each, FrameError)]
    assert len(found) >= 98
    assert found[-1]["gsr"] == 100


@pytest.mark.parametrize("more", ["", 'start: "s"\n'])
@pytest.mark.parametrize("form", ["csv", "pairs"])
def test_the_rest_of_what_was_too_long_is_no_sample(form: str, more: str) -> None:
    """Garbage ends within a line: what is left of it after the garbage was told of may look like a whole one."""
    name, fields = ("gsr:", "") if form == "pairs" else ("", "fields: [gsr]\n")
    frames = Frames(parse(f"format: {form}\n" + fields + more + STREAMS.partition("  ppg")[0]))
    whole = f"{name}5\n".encode()
    pieces = (whole * 2, b"\xff" * 5000, f"{name}12\n".encode() + whole)
    found = [each for piece in pieces for each in frames.take(bytearray(piece))]
    assert [each for each in found if not isinstance(each, FrameError)] == [{"gsr": 5.0}] * (2 + bool(more))
    assert len(found) == 3 + bool(more)


def test_cobs_of_long_stretches() -> None:
    """254 bytes without a zero have a length of their own that means none."""
    assert unstuffed(bytes([255, *range(1, 255), 2, 255])) == bytes(range(1, 256))
    assert unstuffed(cobs(sketch("cobs").sample(7))[:-1])[:4] == (140).to_bytes(4, "little")
    with pytest.raises(ValueError, match="COBS"):
        unstuffed(b"\x05\x01")


def test_the_whole_driver_starts_and_stops_its_board(tmp_path: Path) -> None:
    """With the study's own description: declared, started by `s`, stopped by `x` when the driver ends."""
    measures = {"eda": numbers, "breath": numbers, "pulse": numbers}
    device = Sketch(measures, Air(1), 0.0)
    config = SerialConfig(sensor_id="b_1", port=f"{tmp_path}/b", board=str(STUDY))

    async def drive() -> list[Item]:
        async with plugged(tmp_path / "b", device) as link:
            items, stream = [], Board(config, {}).stream()
            while sum(isinstance(each, Samples) for each in items) < 6:
                items.append(await anext(stream))
            await stream.aclose()
            await let_go(link)
        return items

    items = asyncio.run(drive())
    (declared,) = [each for each in items if isinstance(each, Declared)]
    assert {name: stream.unit for name, stream in declared.streams.items()} == {
        "eda": "uS",
        "respiration": "a.u.",
        "ppg": "counts",
    }
    assert device.send(1e3) == b""


@pytest.mark.parametrize("form", FORMS)
def test_the_event_loop_is_woken_once_for_a_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str) -> None:
    """What a board sends every few milliseconds is handed on once it makes a message, however long its lines are."""
    config = SerialConfig(sensor_id="b_1", port=f"{tmp_path}/b", board=f"{tmp_path}/board.yaml")
    Path(config.board).write_text(FORMS[form] + TIME + STREAMS)

    async def drive() -> float:
        async with plugged(tmp_path / "b", sketch(form)):
            return await wakes_per_message(monkeypatch, Board(config, {}).stream(), "eda")

    assert asyncio.run(drive()) < 1.5


def test_what_a_board_sent_before_it_was_unplugged_is_handed_on(tmp_path: Path) -> None:
    """Up to its last whole line, also where there were too few for a message."""
    config = SerialConfig(sensor_id="b_1", port=f"{tmp_path}/b", board=f"{tmp_path}/board.yaml")
    Path(config.board).write_text(FORMS["csv"] + TIME + STREAMS)
    items, sent = asyncio.run(until_unplugged(tmp_path / "b", sketch("csv"), Board(config, {}).stream()))
    (*_, last, _) = sent.split(b"\n")
    assert of(items, "eda")[-1].times_ns.tolist()[-1] == 1_000_000 * int(last.split(b",")[0])


def test_a_physiokit_board_played_from_its_own_recording(shared_data: Path) -> None:
    """Lines as a real PhysioKit board sent them: every sample, at the board's own times; the header is no sample."""
    (file, *_) = sorted((shared_data / "multimodal" / "physiokit").glob("P11_*.csv"))
    lines = file.read_bytes().splitlines(keepends=True)
    text = (
        "{format: csv, fields: [gsr, belt, ppg, ear, t, _], time: {field: t}, streams: {"
        "eda: {rate_hz: 250, unit: counts, range: [0, 4095], bits: 12, channels: {eda: {field: gsr}}}, "
        "ppg: {rate_hz: 250, unit: counts, range: [0, 4095], bits: 12, channels: {f: {field: ppg}, e: {field: ear}}}}}"
    )
    blocks = [b"".join(lines[begin : begin + 25]) for begin in range(0, 5001, 25)]
    items = played(text, [(number / 10, block) for number, block in enumerate(blocks)])
    recorded = np.genfromtxt(file, delimiter=",", skip_header=1, usecols=(0, 4), max_rows=5100)
    eda = of(items, "eda")
    values = np.concatenate([item.chunk.samples[:, 0] for item in eda])
    times_ns = np.concatenate([item.times_ns for item in eda])
    assert len(values) >= 4970
    np.testing.assert_array_equal(values, recorded[: len(values), 0])
    np.testing.assert_array_equal(times_ns, recorded[: len(values), 1] * 1e6)
    assert of(items, "ppg")[0].chunk.samples.shape[1] == 2

"""driver-lsl against real liblsl outlets of sensor-bench: clocks of other machines, reboots, a recording of one."""

import asyncio
import os
import subprocess
import time
from contextlib import aclosing
from pathlib import Path

import numpy as np
import pylsl
import pytest
from driver_lsl.config import LslConfig
from driver_lsl.device import LslDevice
from lsl_session import SESSION
from processes import poll
from sense4hri import lsl, lsl_inlets
from sense4hri.device import ClockMeasurement, Declared, Marked, Samples
from sense4hri.errors import DeviceLost
from sensor_bench.clock import HostClock
from sensor_bench.lsl.kind import LslKeys, make
from sensor_bench.room import Room
from sensor_bench.signals.hearts import Heart

XDF = Path(__file__).resolve().parents[3] / "shared/data/xdf/clock_resets.xdf"
ENOUGH_S = 30.0


def may_have_clocks():
    """True where a process may be given a clock of its own."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    return subprocess.run(["unshare", *user, "--time", "true"], capture_output=True, check=False).returncode == 0


needs_clocks = pytest.mark.skipif(not may_have_clocks(), reason="no right to a time namespace here")


def sender(model, **keys):
    """Return a sender of the bench, alone in its room."""
    host = HostClock()
    room = Room({"p1": None}, 1, host, host.now_ns(), None, None, {"p1": Heart(1)})
    return make(room, LslKeys(sensor="lsl_1", model=model, participant="p1", session=SESSION, **keys))


def device(*outlets, **more):
    return LslDevice(LslConfig(sensor_id="lsl_1", outlets=outlets, session=SESSION, **more), {})


def is_back(items):
    return of(DeviceLost, items) and isinstance(items[-1], ClockMeasurement)


async def until(lsl_device, enough):
    """Return what the device yields until enough(items) holds, through losses, as the kit would; each with its time."""
    items, deadline = [], time.monotonic() + ENOUGH_S
    while time.monotonic() < deadline:
        try:
            async with (
                aclosing(lsl_device.stream()) as stream,
                asyncio.timeout_at(asyncio.get_running_loop().time() + ENOUGH_S),
            ):
                async for item in stream:
                    items.append(item)
                    if enough(items):
                        return items
        except DeviceLost as err:
            items.append(err)
    raise AssertionError(f"not within {ENOUGH_S:g} s; {items[-3:]}")


def of(kind, items):
    return [item for item in items if isinstance(item, kind)]


@needs_clocks
def test_the_clock_of_another_machine_is_measured_both_ways():
    """Its clock is a day ahead: the offset is known to half a millisecond, and events have the wall clock's time."""

    async def play():
        outlets = sender("LslEeg", name="EEG", clock_ahead_s=86_400.0)
        await outlets.start()
        wanted = device("name='EEG'", "name='EEG Markers'")
        items = await until(wanted, lambda got: len(of(ClockMeasurement, got)) >= 2 and of(Marked, got))
        await outlets.stop()
        return items, outlets

    items, outlets = asyncio.run(play())
    wall_ns = time.time_ns() - time.monotonic_ns()
    for measured in of(ClockMeasurement, items):
        assert abs(measured.offset_ns - (wall_ns - round(outlets.ahead_s * 1e9))) < 500_000
        assert 0 < measured.uncertainty_s < 0.01
    (declared,) = of(Declared, items)
    assert declared.streams["eeg"].unit == "uV"
    for marked in of(Marked, items):
        assert marked.name == "stimulus"
        assert abs(marked.event_ns - marked.device_ns - (wall_ns - round(outlets.ahead_s * 1e9))) < 500_000


@needs_clocks
def test_a_machine_that_was_started_again_is_found_under_its_new_uid_with_its_new_clock():
    """The device time is the new machine's, and so is the offset; how soon, `tests/bench/bench_lsl.py` measures."""

    async def play():
        outlets = sender("LslEcg", clock_ahead_s=3600.0)
        await outlets.start()
        wanted, before = device("type='ECG'"), outlets.ahead_s
        first = await until(wanted, lambda got: len(of(Samples, got)) > 20)
        await outlets.restart(100.0)
        second = await until(wanted, lambda got: of(ClockMeasurement, got))
        await outlets.stop()
        return first, second, before, outlets.ahead_s

    first, second, before, after = asyncio.run(play())
    ages_s = [
        (items[-1].chunk.device_ns - items[-1].chunk.received_ns) * 1e-9
        for items in (of(Samples, first), of(Samples, second))
    ]
    assert ages_s[1] - ages_s[0] == pytest.approx(after - before, abs=1.0)


def test_the_streams_heard_are_named_where_several_fit():
    """Two outlets fit a type: nobody guesses, and the reason lists both."""

    async def play():
        outlets = sender("LslEeg", name="Two")
        await outlets.start()
        try:
            with pytest.raises(
                DeviceLost, match=r"several streams fit .*'Two Markers'.*'Two'|several .*'Two'.*'Two Markers'"
            ):
                async with aclosing(device("starts-with(name,'Two')").stream()) as stream:
                    await anext(stream)
        finally:
            await outlets.stop()

    asyncio.run(play())


@pytest.mark.parametrize("times", range(3))
def test_our_own_echoes_do_not_hide_how_many_streams_fit(times):
    """A look ends at two streams: with echoes among them one of two amplifiers was taken, or none seen."""
    sources = [*(f"{lsl.OURS}{number}" for number in range(6)), "sn-1", "sn-2"]
    outlets = [pylsl.StreamOutlet(pylsl.StreamInfo("Amp", "Echoed", 1, 100, pylsl.cf_float32, one)) for one in sources]
    with pytest.raises(DeviceLost, match=r"several streams fit .*'sn-1'.*'sn-2'"):
        next(lsl_inlets._found("type='Echoed'"))
    with pytest.raises(DeviceLost, match=f"several streams fit .*{lsl.OURS}"):
        next(lsl_inlets._found(f"type='Echoed' and starts-with(source_id,'{lsl.OURS}')"))
    del outlets


def test_what_a_program_sends_before_it_ends_is_taken(monkeypatch):
    """It sends its last values and says so, and closes once they are across: all of it is there before the loss is."""
    outlets = [
        pylsl.StreamOutlet(pylsl.StreamInfo("Ends", *kind))
        for kind in (("ECG", 1, 100, pylsl.cf_float32, "ends-1"), ("Markers", 1, 0, pylsl.cf_string, "ends-2"))
    ]
    across, pulled = [], lsl_inlets._pulled

    def noted(number, inlet):
        for news in pulled(number, inlet):
            across.append(news)
            yield news

    monkeypatch.setattr(lsl_inlets, "_pulled", noted)

    def all_across():
        samples = sum(len(news.samples) for news in across if isinstance(news, lsl_inlets.Pulled))
        return samples == 50 and any(isinstance(news, lsl_inlets.Told) for news in across)

    def send(numbers):
        for number in numbers:
            outlets[0].push_sample([float(number)])

    def end():
        send(range(1, 50))
        outlets[1].push_sample(["end"])
        poll(all_across, "what was sent is taken from the inlets")
        outlets.clear()

    async def listen(items):
        async with aclosing(device("type='ECG'", "type='Markers'", frame_s=1.0).stream()) as stream:
            async for item in stream:
                items.append(item)
                if isinstance(item, Declared):
                    send(range(1))
                elif isinstance(item, Samples) and outlets:
                    await asyncio.to_thread(end)

    items = []
    with pytest.raises(DeviceLost, match="outlet is gone"):
        asyncio.run(listen(items))
    assert [each.name for each in of(Marked, items)] == ["end"]
    assert np.concatenate([each.chunk.samples[:, 0] for each in of(Samples, items)]).tolist() == list(range(50))


def test_a_stream_whose_rate_is_no_number_is_told():
    """liblsl writes it as no other liblsl reads it: nothing is known of the stream, not even its channels."""

    async def first():
        async with aclosing(device("name='Odd'").stream()) as stream:
            await anext(stream)

    outlet = pylsl.StreamOutlet(pylsl.StreamInfo("Odd", "EEG", 1, np.nan, pylsl.cf_float32, "odd-1"))
    with pytest.raises(DeviceLost, match="a stream whose description cannot be read"):
        asyncio.run(first())
    del outlet


@needs_clocks
@pytest.mark.skipif(not XDF.exists(), reason="the recordings of ../shared/data are not here")
def test_a_recorded_sender_that_rebooted_is_followed():
    """A BioSemi's stream from an XDF: stamps of 653 thousand seconds, then its machine restarts and counts anew."""

    async def play():
        outlets = sender("LslRecording", file=str(XDF), start_s=133.0)
        await outlets.start()
        items = await until(device("name='BioSemi'"), is_back)
        await outlets.stop()
        return items

    items = asyncio.run(play())
    stamps_s = np.array([item.chunk.device_ns * 1e-9 for item in of(Samples, items)])
    assert stamps_s.max() > 653_000
    assert stamps_s[-1] < 1000
    offsets_s = [item.offset_ns * 1e-9 for item in of(ClockMeasurement, items)]
    assert max(offsets_s) - min(offsets_s) > 600_000

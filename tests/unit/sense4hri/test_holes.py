"""Frames with a hole inside, and what a study may say of a stream."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sense4hri.chunk import Break, Chunk
from sense4hri.device import Stream, check_rate, check_stream
from sense4hri.errors import ConfigError
from sense4hri.holes import Holes
from sense4hri.sample_clock import SampleClock

FS_HZ = 100.0
PERIOD_NS = 10_000_000
EDA = Stream(16.0, "uS", 0.0, 100.0, 16, ("eda",))


def frame(numbers: list[int]) -> tuple[Chunk, np.ndarray]:
    """Samples that carry their number, and the device time of each."""
    times_ns = 10**12 + np.array(numbers, np.int64) * PERIOD_NS
    return Chunk(("x",), np.array(numbers, float)[:, None], int(times_ns[-1]), 5), times_ns


def numbers_of(chunk: Chunk) -> list[int]:
    return [int(value) for value in chunk.samples[:, 0]]


def test_a_frame_without_a_hole_stays_whole() -> None:
    """Nothing is cut where nothing is missing, not even with stamps that jitter by a third of a period."""
    holes = Holes(FS_HZ)
    for first in (0, 50, 100):
        chunk, times_ns = frame(list(range(first, first + 50)))
        times_ns = times_ns + np.where(np.arange(50) % 2, PERIOD_NS // 6, -PERIOD_NS // 6)
        (whole,) = holes.cut(chunk, times_ns)
        assert (whole.samples.tolist(), whole.device_ns) == (chunk.samples.tolist(), int(times_ns[-1]))


def test_a_hole_inside_a_frame_is_cut_out() -> None:
    """Every part is stamped with its own last sample, and with the receipt of the frame."""
    parts = Holes(FS_HZ).cut(*frame([0, 1, 2, 5, 6]))
    assert [numbers_of(part) for part in parts] == [[0, 1, 2], [5, 6]]
    assert [part.device_ns for part in parts] == [10**12 + 2 * PERIOD_NS, 10**12 + 6 * PERIOD_NS]
    assert {part.received_ns for part in parts} == {5}


def test_a_clock_that_goes_back_inside_a_frame_is_cut() -> None:
    """A device that restarts in the middle of a frame has two epochs, not one stretched sample."""
    parts = Holes(FS_HZ).cut(*frame([98, 99, 0, 1]))
    assert [numbers_of(part) for part in parts] == [[98, 99], [0, 1]]


@given(st.sets(st.integers(1, 298), max_size=12), st.integers(1, 70))
def test_every_lost_sample_is_counted_and_no_other_is_moved(missing: set[int], size: int) -> None:
    """Whichever samples are missing and however the rest is framed: each has its own time, each loss is counted."""
    numbers = [number for number in range(300) if number not in missing]
    holes, clock, lost = Holes(FS_HZ), SampleClock(FS_HZ), 0
    for at in range(0, len(numbers), size):
        for part in holes.cut(*frame(numbers[at : at + size])):
            timed = clock.place(part)
            lost += timed.lost
            assert timed.break_ in (None, Break.FIRST, Break.GAP)
            expected = 10**12 + np.array(numbers_of(part)) * PERIOD_NS
            assert np.array_equal(timed.times_ns, expected)
    assert lost == len(missing)


def test_times_and_samples_belong_together() -> None:
    """A driver that gives another number of times than of samples has made a mistake."""
    chunk, times_ns = frame([1, 2, 3])
    with pytest.raises(ValueError, match="2 times of 3 samples"):
        Holes(FS_HZ).cut(chunk, times_ns[1:])
    with pytest.raises(ValueError, match="rate above 0"):
        Holes(0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"unit": "mV"}, "parameter 'eda.unit' is 'mV', the driver sends uS"),
        ({"channel_names": ("a", "b")}, "parameter 'eda.channel_names' must name 1 channels"),
        ({"channel_names": ("x" * 257,)}, "parameter 'eda.channel_names': a name of 257 characters, 'xxxx"),
        ({"sampling_frequency_hz": -1.0}, "parameter 'eda.sampling_frequency_hz' is -1"),
        ({"sampling_frequency_hz": float("nan")}, "parameter 'eda.sampling_frequency_hz' is nan"),
    ],
)
def test_what_a_study_must_not_say_of_a_stream(changes: dict, message: str) -> None:
    """Unit and number of channels are the driver's; the message names the parameter."""
    with pytest.raises(ConfigError, match=re.escape(message)):
        check_stream("eda", EDA, dataclasses.replace(EDA, **changes))


def test_what_a_study_may_say_of_a_stream() -> None:
    """Channels may have other names, range and resolution other values."""
    check_stream("eda", EDA, dataclasses.replace(EDA, channel_names=("left hand",), range_max=40.0, resolution_bits=12))


def test_a_unit_that_is_not_canonical_is_refused() -> None:
    """A driver that sends millivolts does not start; a unit of no scale, or a sensor type nobody knows, does."""
    for unit in ("mV", ""):
        wrong = dataclasses.replace(EDA, unit=unit)
        with pytest.raises(ConfigError, match=re.escape(f"parameter 'ecg.unit': unit {unit!r} of ecg: the canonical")):
            check_stream("ecg", wrong, wrong)
    counts = dataclasses.replace(EDA, unit="counts")
    check_stream("ecg", counts, counts)
    check_stream("grip", wrong, wrong)


def test_a_unit_the_device_does_not_tell_is_the_study_s() -> None:
    """Where the device names no unit, the study's is taken; without one the driver does not start."""
    silent = dataclasses.replace(EDA, unit="")
    check_stream("eda", silent, EDA)
    with pytest.raises(ConfigError, match=r"parameter 'eda\.unit'"):
        check_stream("eda", silent, silent)


def test_a_rate_far_from_what_the_device_says() -> None:
    """A study may correct a rate that is a little wrong, not turn it into another."""
    check_rate("eda", EDA, dataclasses.replace(EDA, sampling_frequency_hz=15.6))
    with pytest.raises(ConfigError, match=r"parameter 'eda\.sampling_frequency_hz' is 32, the device has 16"):
        check_rate("eda", EDA, dataclasses.replace(EDA, sampling_frequency_hz=32.0))

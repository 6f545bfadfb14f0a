"""driver-file: what is played when, over and over."""

import numpy as np
import pytest
from driver_file.config import FileConfig
from driver_file.device import Tape
from driver_file.protocol import Recorded
from sense4hri.chunk import Break
from sense4hri.device import Marked, Samples, Stream
from sense4hri.errors import ConfigError
from sense4hri.holes import one_by_one
from sense4hri.sample_clock import SampleClock
from sense4hri.signal_files.content import Event

MS = 1_000_000
NOW_NS = 5_000_000_000


def recorded(sensor_type, fs_hz, times_ms):
    times_ns = np.asarray(times_ms, np.int64) * MS
    return Recorded(
        sensor_type, Stream(fs_hz, "uV", 0, 0, 0, ("a",)), times_ns, np.arange(len(times_ns))[:, None] * 1.0
    )


def config(**more):
    return FileConfig(sensor_id="file_1", file="x", **more)


def played(tape, frames):
    return [item for frame in range(frames) for item in tape.items(frame, NOW_NS)]


def alone(tape):
    """The samples of the first frame one by one, as the kit publishes irregular ones."""
    return [chunk for item in played(tape, 1) for chunk in one_by_one(item.chunk, item.times_ns)]


def test_every_sample_once_through_all_rounds():
    """Three rounds of a second with frames of 70 ms: no sample twice, none missing, the clock goes on."""
    tape = Tape([recorded("ecg", 100, np.arange(1000, 2000, 10))], (), config(frame_s=0.07))
    items = played(tape, 43)
    times_ns = np.concatenate([item.times_ns for item in items])
    np.testing.assert_array_equal(np.diff(times_ns), 10 * MS)
    values = np.concatenate([item.chunk.samples[:, 0] for item in items])
    np.testing.assert_array_equal(values, np.arange(len(values)) % 100)
    assert len(values) > 300
    assert all(item.chunk.device_ns == item.times_ns[-1] for item in items)


def test_streams_of_two_rates_stay_together():
    """What was sampled at the same time is played at the same time, also in the second round."""
    tape = Tape(
        [recorded("ecg", 100, np.arange(1000, 2000, 10)), recorded("eda", 4, np.arange(1000, 2000, 250))], (), config()
    )
    last = {}
    for item in played(tape, 20):
        last[item.sensor_type] = item.chunk.device_ns
        assert last["ecg"] - last.get("eda", last["ecg"]) < 350 * MS
    assert last == {"ecg": 2990 * MS, "eda": 2750 * MS}


def test_irregular_samples_are_messages_of_their_own_with_their_own_times():
    """Times of no rate are kept as they are, for the kit makes one message a sample; one that goes back stays."""
    tape = Tape([recorded("eye_tracking", 0, [1000, 1004, 1030, 1020, 1090])], (), config())
    assert [each.device_ns // MS for each in alone(tape)] == [1000, 1004, 1030, 1020, 1090]


@pytest.mark.parametrize(("fs_hz", "begun_ms"), [(100, 5_000_000), (100, 3000), (0, 5_000_000)])
def test_a_clock_that_begins_anew_in_the_file_is_not_waited_for(fs_hz, begun_ms):
    """Half a second before and after: all is played within a second, in order, by its own times."""
    times_ms = [*np.arange(begun_ms, begun_ms + 500, 10), *np.arange(10, 510, 10)]
    tape = Tape([recorded("ecg", fs_hz, times_ms)], (), config(frame_s=0.1))
    counts = [sum(len(item.chunk.samples) for item in tape.items(frame, NOW_NS)) for frame in range(10)]
    assert (tape.frames, counts) == (10, [10] * 10)
    values = np.concatenate([item.chunk.samples[:, 0] for item in played(tape, 10)])
    np.testing.assert_array_equal(values, np.arange(100))
    assert played(tape, 10)[-1].chunk.device_ns == times_ms[-1] * MS


def test_irregular_samples_of_one_time_follow_each_other():
    """A batch that its recorder stamped once, as LSL and phones do, is no reset of the device for its readers."""
    tape = Tape([recorded("eda", 0, [1000, 1000, 1000, 1070, 1070])], (), config())
    clock = SampleClock(0.0)
    placed = [clock.place(each) for each in alone(tape)]
    assert [each.break_ for each in placed] == [Break.FIRST, None, None, None, None]
    assert [int(each.times_ns[0]) - 1000 * MS for each in placed] == [0, 1, 2, 70 * MS, 70 * MS + 1]


def test_a_file_that_begins_at_zero_is_moved_because_zero_means_no_time():
    """Everything in it by the same whole second, its events too."""
    tape = Tape([recorded("ecg", 100, np.arange(0, 1000, 10))], (Event(500 * MS, "cue", "7"),), config())
    items = played(tape, 10)
    assert min(item.times_ns[0] for item in items if isinstance(item, Samples)) == 1000 * MS
    assert [(item.device_ns, item.name, item.value) for item in items if isinstance(item, Marked)] == [
        (1500 * MS, "cue", "7")
    ]


def test_an_event_is_told_with_the_time_it_happened():
    """Its stamp lies as long before the frame's receipt as it lies before its end, at double speed half of that."""
    tape = Tape([recorded("ecg", 100, np.arange(1000, 2000, 10))], (Event(1040 * MS, "cue", ""),), config(speed=2))
    (marked,) = [item for item in played(tape, 1) if isinstance(item, Marked)]
    assert marked.event_ns == NOW_NS - 30 * MS


def test_a_part_of_the_file():
    """start_s and duration_s cut the same piece out of every stream."""
    streams = [recorded("ecg", 100, np.arange(1000, 5000, 10)), recorded("eda", 4, np.arange(1000, 5000, 250))]
    tape = Tape(streams, (), config(start_s=1, duration_s=2))
    assert [(len(each.times_ns), each.times_ns[0] // MS) for each in tape.recorded] == [(200, 2000), (8, 2000)]
    assert tape.frames == 20
    with pytest.raises(ConfigError, match="start_s"):
        Tape(streams, (), config(start_s=100))


def test_an_event_before_the_seam_is_told_with_the_time_it_happened():
    """Of a frame that holds the end of one round and the beginning of the next."""
    tape = Tape([recorded("ecg", 100, np.arange(1000, 1950, 10))], (Event(1930 * MS, "cue", ""),), config())
    (marked,) = [item for item in tape.items(9, NOW_NS) if isinstance(item, Marked)]
    assert marked.event_ns == NOW_NS - 70 * MS


def test_events_outside_the_samples_are_named():
    """What is not played because no sample was taken then is no secret; what lies in the samples is played."""
    events = tuple(Event(at * MS, f"at {at}") for at in (900, 1000, 1999, *range(2000, 2006)))
    tape = Tape([recorded("ecg", 100, np.arange(1000, 2000, 10))], events, config())
    assert [item.name for item in played(tape, 10) if isinstance(item, Marked)] == ["at 1000", "at 1999"]
    assert tape.unheard == "at 900, at 2000, at 2001, at 2002, at 2003 and 2 more"

"""driver-file as a process: a recording on the graph is the recording in the file."""

import numpy as np
import pytest
import signal_file_makers as make
from ears import Ears
from processes import poll
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import Marker, PhysioRaw

SECONDS = 2
ECG, EDA = np.arange(250 * SECONDS) - 200, np.arange(4 * SECONDS)


@pytest.fixture
def recording(tmp_path):
    return make.edf(tmp_path / "a.edf", {"ECG": (250, "mV", ECG), "EDA": (4, "uS", EDA)}, [(0.5, "stimulus")])


def play(start, file, **more):
    return start("driver_file", sensor_id="file_1", human_id="p1", file=str(file), **more)


def heard(ears, sensor_type):
    return ears.hear(PhysioRaw, StreamName("p1", sensor_type, "file_1").topic("raw"), qos.RAW)


def samples(messages):
    return np.concatenate([message.channels[0].samples for message in messages])


def test_a_recording_is_played_with_its_times_units_and_markers(start, opened, recording, tmp_path):
    """Every sample once and in order, as long as anybody listens, on the file's clock."""
    hidden = recording.rename(tmp_path / "hidden")
    process = play(start, recording)
    poll(lambda: "is not there" in process.log(), "the driver waits for the file")
    ears = opened(Ears())
    ecg, eda, markers = heard(ears, "ecg"), heard(ears, "eda"), ears.hear(Marker, "/study/markers", qos.MARKERS)
    hidden.rename(recording)
    ears.until(lambda: len(eda) >= 10 and len(ecg) >= 25 and markers, "more than one round of the file")
    for messages, whole, factor in ((ecg, ECG, 1000.0), (eda, EDA, 1.0)):
        got = samples(messages)
        first = round(got[0] / factor) - int(whole[0])
        np.testing.assert_allclose(got, factor * whole[(first + np.arange(len(got))) % len(whole)])
    last = ecg[-1]
    place = round((to_ns(last.device_timestamp) - make.START_NS) * 250e-9)
    assert last.channels[0].samples[-1] == pytest.approx(1000.0 * ECG[place % len(ECG)])
    assert (markers[0].name, markers[0].source, markers[0].human_id) == ("stimulus", "file_1", "p1")
    assert (to_ns(markers[0].device_timestamp) - make.START_NS) % (SECONDS * 10**9) == 500_000_000
    assert process.stop() == 0


def test_a_recording_that_ends_is_a_sensor_that_is_lost(start, recording):
    """Without loop it is played once; the driver says so and stays."""
    process = play(start, recording, loop=False, speed=10.0)
    poll(lambda: "a.edf has ended" in process.log(), "the file has ended")
    assert process.stop() == 0


def test_a_column_that_is_not_there_ends_the_driver(start, recording):
    """Status 78, and one line with the file, the column and those that are there."""
    process = play(start, recording, streams=["emg: Biceps"])
    assert process.wait() == 78
    assert "a.edf has no column 'Biceps'; there are ECG; EDA" in process.log()

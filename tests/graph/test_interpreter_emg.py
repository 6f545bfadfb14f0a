"""interpreter-emg as a process, fed by a driver that is not ours, on a private ROS domain."""

from pathlib import Path

import numpy as np
import pytest
from ears import EPOCH_NS, RECEIVED_NS, ThirdPartyDriver
from emg_signals import muscle
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import set_time, to_ns
from sense4hri_msgs.msg import EMG, Marker

FS_HZ, FRAME, HELD_S = 500.0, 250, 0.6
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-emg" / "config" / "default.yaml"
EFFORT, WORK = (5.0, 8.0), (12.0, 14.0)
BOTH = {
    "biceps": muscle(20, FS_HZ, [EFFORT], 200.0, seed=1) + muscle(20, FS_HZ, [WORK], 100.0, 0.0, seed=2),
    "triceps": muscle(20, FS_HZ, [], seed=3),
}


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """A greatest effort of the biceps, then work at half of it; the triceps rests."""
    at = np.round(times_s * FS_HZ).astype(int)
    return {name: samples[at] for name, samples in BOTH.items()}


def test_work_and_effort_of_a_muscle_on_the_graph(start, opened):
    """Without parameters: onsets and offsets of the muscle that works, and half of the effort after a marker `mvc`."""
    process = start("interpreter_emg")
    sensor = opened(ThirdPartyDriver(StreamName("p1", "emg", "cuff_1"), EMG, wave, FS_HZ, FRAME, "uV"))
    sensor.until_heard(device=False)
    markers = sensor.node.create_publisher(Marker, "/study/markers", qos.MARKERS)
    sensor.until(markers.get_subscription_count, "the service takes markers")
    marker = Marker(human_id="p1", name="mvc", value="biceps", source="test")
    set_time(marker.header.stamp, RECEIVED_NS + round(4.1e9))
    markers.publish(marker)
    sensor.play(17, held_s=HELD_S)
    assert list(sensor.features[-1].channel_names) == ["biceps", "triceps"]
    onsets_s = [(to_ns(t) - EPOCH_NS) / 1e9 for message in sensor.features for t in message.onset_timestamps]
    offsets_s = [(to_ns(t) - EPOCH_NS) / 1e9 for message in sensor.features for t in message.offset_timestamps]
    np.testing.assert_allclose(onsets_s, [EFFORT[0], WORK[0]], atol=0.1)
    np.testing.assert_allclose(offsets_s, [EFFORT[1], WORK[1]], atol=0.2)
    assert {name for message in sensor.features for name in message.onset_channels} == {"biceps"}
    working = [m for m in sensor.features if 13 <= (to_ns(m.device_timestamp) - EPOCH_NS) / 1e9 < 14]
    assert working[0].mvc_percent[0] == pytest.approx(45, abs=10)
    assert np.isnan(working[0].mvc_percent[1])
    assert list(working[0].active) == [True, False]
    assert working[0].signal_quality > 0.8
    assert process.stop() == 0


def test_the_defaults_file_and_a_wrong_parameter(start, opened):
    """The shipped file starts the service; thresholds that contradict each other end it with 78 and one line."""
    process = start("interpreter_emg", "--ros-args", "--params-file", str(DEFAULTS))
    sensor = opened(ThirdPartyDriver(StreamName("p1", "emg", "cuff_1"), EMG, wave, FS_HZ, FRAME, "uV"))
    sensor.until_heard(device=False)
    assert process.stop() == 0
    wrong = start("interpreter_emg", onset_ratio=1.5, offset_ratio=1.6)
    assert wrong.wait() == 78
    assert "offset_ratio" in wrong.log()

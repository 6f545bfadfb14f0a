"""interpreter-eda as a process, fed by a driver that is not ours, on a private ROS domain."""

from pathlib import Path

import numpy as np
import pytest
from ears import EPOCH_NS, ThirdPartyDriver
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import EDA

FS_HZ, FRAME, EVERY_S = 25.0, 25, 15.0
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-eda" / "config" / "default.yaml"


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """Skin at 8 uS that responds with 0.5 uS every 15 s, for the first time 1 s after it begins."""
    after_s = (times_s - 1.0) % EVERY_S
    response = (np.exp(-after_s / 4.0) - np.exp(-after_s / 0.6)) / 0.64
    return {"eda": 8.0 + 0.002 * times_s + 0.5 * response}


def test_responses_of_every_sensor_on_the_graph(start, opened):
    """One process without parameters serves two participants: responses at their times, each told once, and a level."""
    process = start("interpreter_eda")
    one = opened(ThirdPartyDriver(StreamName("p1", "eda", "skin_1"), EDA, wave, FS_HZ, FRAME, "uS"))
    other = opened(ThirdPartyDriver(StreamName("p2", "eda", "skin_2"), EDA, wave, FS_HZ, FRAME, "uS", beside=one))
    for sensor in (one, other):
        sensor.until_heard(device=False)
    for sensor in (one, other):
        sensor.play(50)
        last = sensor.features[-1]
        assert last.header.frame_id == sensor.stream.sensor_id
        assert last.scr_count == 4
        assert 8.0 < last.tonic_us < 8.2
        assert last.signal_quality > 0.9
        peaks_s = [(to_ns(t) - EPOCH_NS) / 1e9 for message in sensor.features for t in message.scr_peak_timestamps]
        np.testing.assert_allclose(peaks_s, [2.5, 17.5, 32.5, 47.5], atol=0.4)
        amplitudes = [a for message in sensor.features for a in message.scr_amplitudes_us]
        assert amplitudes == pytest.approx([0.5] * 4, rel=0.2)
    assert process.stop() == 0


def test_the_defaults_file_and_a_wrong_parameter(start, opened):
    """The shipped file starts the service; a parameter out of range ends it with 78 and one line that names it."""
    process = start("interpreter_eda", "--ros-args", "--params-file", str(DEFAULTS))
    sensor = opened(ThirdPartyDriver(StreamName("p1", "eda", "skin_1"), EDA, wave, FS_HZ, FRAME, "uS"))
    sensor.until_heard(device=False)
    assert process.stop() == 0
    wrong = start("interpreter_eda", scr_threshold_us=0.0)
    assert wrong.wait() == 78
    assert "scr_threshold_us" in wrong.log()

"""interpreter-ppg as a process, fed by a driver that is not ours, on a private ROS domain."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ears import EPOCH_NS, RECEIVED_NS, ThirdPartyDriver
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import PPG

FS_HZ, FRAME, PERIOD_S = 55.0, 36, 0.83
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-ppg" / "config" / "default.yaml"


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """Counts of an optical sensor: reflectance, so upside down; a pulse in one of the four channels only."""
    phase = times_s % PERIOD_S
    pulse = np.exp(-(((phase - 0.25) / 0.11) ** 2)) + 0.3 * np.exp(-(((phase - 0.52) / 0.15) ** 2))
    noise = np.random.default_rng(round(times_s[0] * FS_HZ)).normal(0, 4000, (2, len(times_s)))
    dark = np.full(len(times_s), -600.0)
    return {"ppg_0": 3e5 + noise[0], "ppg_1": 3e5 - 4000 * pulse, "ppg_2": 3e5 + noise[1], "ambient": dark}


@pytest.fixture
def sensors(opened: Callable[[Any], Any]) -> list[ThirdPartyDriver]:
    """One on each of two participants."""
    first, second = StreamName("p1", "ppg", "band_1"), StreamName("p2", "ppg", "band_2")
    one = opened(ThirdPartyDriver(first, PPG, wave, FS_HZ, FRAME, "counts"))
    return [one, opened(ThirdPartyDriver(second, PPG, wave, FS_HZ, FRAME, "counts", beside=one))]


def test_features_of_every_sensor_on_the_graph(start, sensors):
    """One process without parameters serves two participants: pulses at their times, rate, channel, difference."""
    process = start("interpreter_ppg")
    for sensor in sensors:
        sensor.until_heard()
    for sensor in sensors:
        sensor.play(45, heart_rate=70.0)
    for sensor in sensors:
        last = sensor.features[-1]
        assert last.header.frame_id == sensor.stream.sensor_id
        assert to_ns(last.header.stamp) - RECEIVED_NS >= to_ns(last.device_timestamp) - EPOCH_NS
        assert last.window_s == 10.0
        assert last.channel_name == "ppg_1"
        assert last.heart_rate_bpm == pytest.approx(60 / PERIOD_S, abs=0.1)
        assert last.device_heart_rate_difference_bpm == pytest.approx(60 / PERIOD_S - 70, abs=0.1)
        assert last.signal_quality > 0.95
        assert last.pulse_amplitude == pytest.approx(4000, rel=0.1)
        assert last.hrv.rmssd_ms < 3
        assert np.isnan(last.hrv.sdnn_ms)
        times_s = np.array([to_ns(t) - EPOCH_NS for message in sensor.features for t in message.peak_timestamps]) / 1e9
        rr_ms = np.concatenate([message.rr_intervals_ms for message in sensor.features])
        assert len(times_s) == len(rr_ms) > 48
        np.testing.assert_allclose(np.diff(times_s)[5:], PERIOD_S, atol=0.005)
        rise_s = 0.25 - 0.11 / np.sqrt(2)
        np.testing.assert_allclose((times_s % PERIOD_S)[5:], rise_s, atol=0.02)
    assert process.stop() == 0


def test_the_defaults_file_and_a_wrong_parameter(start, sensors):
    """The shipped file starts the service; a parameter out of range ends it with 78 and one line that names it."""
    process = start("interpreter_ppg", "--ros-args", "--params-file", str(DEFAULTS))
    sensors[0].until_heard()
    assert process.stop() == 0
    wrong = start("interpreter_ppg", polarity="sideways")
    assert wrong.wait() == 78
    assert "polarity" in wrong.log()

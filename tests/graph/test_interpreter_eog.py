"""interpreter-eog as a process, fed by drivers that are not ours, on a private ROS domain."""

from pathlib import Path

import numpy as np
import pytest
from ears import EPOCH_NS, ThirdPartyDriver
from eog_signals import lid, step
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import EOG

FS_HZ, FRAME, EVERY_S = 100.0, 50, 4.0
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-eog" / "config" / "default.yaml"


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """A blink of 200 uV every 4 s, and 2 s later eyes that go 100 uV to the right, then back, in turn."""
    after_s = times_s % (2 * EVERY_S)
    gaze = 100.0 * (step(after_s, 3.0) - step(after_s, 3.0 + EVERY_S))
    return {"heog": gaze, "veog": 200.0 * lid(times_s % EVERY_S, 1.0)}


def test_blinks_and_saccades_of_every_sensor_on_the_graph(start, opened):
    """One process without parameters serves two participants: each blink and saccade once, at its time."""
    process = start("interpreter_eog")
    one = opened(ThirdPartyDriver(StreamName("p1", "eog", "eyes_1"), EOG, wave, FS_HZ, FRAME, "uV"))
    other = opened(ThirdPartyDriver(StreamName("p2", "eog", "eyes_2"), EOG, wave, FS_HZ, FRAME, "uV", beside=one))
    for sensor in (one, other):
        sensor.until_heard(device=False)
    for sensor in (one, other):
        sensor.play(18)
        last = sensor.features[-1]
        assert last.header.frame_id == sensor.stream.sensor_id
        assert last.signal_quality > 0.9
        blinks_s, saccades_s = (
            [(to_ns(t) - EPOCH_NS) / 1e9 for message in sensor.features for t in getattr(message, field)]
            for field in ("blink_timestamps", "saccade_timestamps")
        )
        np.testing.assert_allclose(blinks_s, [1.0, 5.0, 9.0, 13.0], atol=0.05)
        np.testing.assert_allclose(saccades_s, [3.0, 7.0, 11.0, 15.0], atol=0.05)
        amplitudes = [a for message in sensor.features for a in message.saccade_amplitudes_uv]
        assert amplitudes == pytest.approx([100.0, -100.0] * 2, rel=0.1)
    assert process.stop() == 0


def test_the_defaults_file_and_a_wrong_parameter(start, opened):
    """The shipped file starts the service; a parameter out of range ends it with 78 and one line that names it."""
    process = start("interpreter_eog", "--ros-args", "--params-file", str(DEFAULTS))
    sensor = opened(ThirdPartyDriver(StreamName("p1", "eog", "eyes_1"), EOG, wave, FS_HZ, FRAME, "uV"))
    sensor.until_heard(device=False)
    assert process.stop() == 0
    wrong = start("interpreter_eog", least_blink_uv=0.0)
    assert wrong.wait() == 78
    assert "least_blink_uv" in wrong.log()

"""interpreter-eye-tracking as a process, fed by a driver that is not ours, on a private ROS domain."""

from pathlib import Path

import numpy as np
from ears import EPOCH_NS, ThirdPartyDriver
from gaze import looking
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import EyeTracking

FS_HZ, FRAME = 125.0, 125
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-eye-tracking" / "config" / "default.yaml"
GAZE, ONSETS_S = looking(FS_HZ, [(-8.0, -4.0), (6.0, 5.0), (0.0, 0.0)] * 15)
GAZE[1000:1020] = np.nan
PX_PER_DEG = 40.0


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """Gaze of 15 s that jumps between three places, 40 px a degree, and a blink at 8 s."""
    at = np.rint(times_s * FS_HZ).astype(int) % len(GAZE)
    return {"gaze_x": 640 + PX_PER_DEG * GAZE[at, 0], "gaze_y": 512 + PX_PER_DEG * GAZE[at, 1]}


def test_events_of_every_tracker_on_the_graph(start, opened):
    """One process without parameters serves two participants: saccades and a blink at their times, each told once."""
    process = start("interpreter_eye_tracking")
    one = opened(ThirdPartyDriver(StreamName("p1", "eye_tracking", "eye_1"), EyeTracking, wave, FS_HZ, FRAME, "px"))
    name = StreamName("p2", "eye_tracking", "eye_2")
    other = opened(ThirdPartyDriver(name, EyeTracking, wave, FS_HZ, FRAME, "px", beside=one))
    for sensor in (one, other):
        sensor.until_heard(device=False)
    for sensor in (one, other):
        sensor.play(12)
        last = sensor.features[-1]
        assert last.header.frame_id == sensor.stream.sensor_id
        assert last.signal_quality > 0.9
        assert np.isnan(last.saccade_amplitude_deg)
        assert any("uncalibrated" in reason for reason in last.reasons)
        onsets = [(to_ns(t) - EPOCH_NS) / 1e9 for message in sensor.features for t in message.saccade_timestamps]
        true_s = [at_s for at_s in ONSETS_S if at_s < 10 and abs(at_s - 8.08) > 0.2]
        assert all(np.abs(np.array(onsets) - at_s).min() < 0.02 for at_s in true_s)
        assert (np.diff(onsets) > 0).all()
        blinks = [(to_ns(t) - EPOCH_NS) / 1e9 for message in sensor.features for t in message.blink_timestamps]
        np.testing.assert_allclose(blinks, [8.0], atol=0.01)
        for message in sensor.features:
            where = next(feature for feature in message.extra if feature.name == "fixation_x")
            assert len(where.values) == len(message.fixation_timestamps)
    assert process.stop() == 0


def test_the_defaults_file_and_wrong_parameters(start, opened, tmp_path):
    """The shipped file starts the service; an absent file of areas ends it with 78 and a line that names it."""
    process = start("interpreter_eye_tracking", "--ros-args", "--params-file", str(DEFAULTS))
    sensor = opened(ThirdPartyDriver(StreamName("p1", "eye_tracking", "eye_1"), EyeTracking, wave, FS_HZ, FRAME, "px"))
    sensor.until_heard(device=False)
    assert process.stop() == 0
    wrong = start("interpreter_eye_tracking", areas_file=str(tmp_path / "absent.yaml"))
    assert wrong.wait() == 78
    assert "areas_file" in wrong.log()

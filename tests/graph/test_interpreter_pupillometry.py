"""interpreter-pupillometry as a process, fed by a driver that is not ours, on a private ROS domain."""

from pathlib import Path

import numpy as np
import pytest
from ears import ThirdPartyDriver
from gaze import extra_of, pupils
from sense4hri.names import StreamName
from sense4hri_msgs.msg import Pupillometry

FS_HZ, FRAME = 125.0, 125
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-pupillometry" / "config" / "default.yaml"
SIZES = pupils(FS_HZ, 60, [(20.0, 25.0, 0.4)], [5.0, 15.5])


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """Pupils of 3 mm that dilate by 0.4 mm after 20 s, and two blinks."""
    at = np.rint(times_s * FS_HZ).astype(int) % len(SIZES)
    return {"diameter_left": SIZES[at, 0], "diameter_right": SIZES[at, 1]}


def test_sizes_of_every_pupil_on_the_graph(start, opened):
    """One process without parameters serves two participants: size, change, and each blink drawn through once."""
    process = start("interpreter_pupillometry")
    one = opened(ThirdPartyDriver(StreamName("p1", "pupillometry", "eye_1"), Pupillometry, wave, FS_HZ, FRAME, "mm"))
    name = StreamName("p2", "pupillometry", "eye_2")
    other = opened(ThirdPartyDriver(name, Pupillometry, wave, FS_HZ, FRAME, "mm", beside=one))
    for sensor in (one, other):
        sensor.until_heard(device=False)
    for sensor in (one, other):
        sensor.play(24, held_s=1.0)
        last = sensor.features[-1]
        assert last.header.frame_id == sensor.stream.sensor_id
        assert last.unit == "mm"
        assert last.diameter == pytest.approx(3.4, abs=0.02)
        assert last.change == pytest.approx(0.4, rel=0.04)
        assert last.signal_quality > 0.9
        assert sum(len(extra_of(message, "interpolated_begin_s")) for message in sensor.features) == 2
    assert process.stop() == 0


def test_the_defaults_file_and_a_wrong_parameter(start, opened):
    """The shipped file starts the service; a parameter out of range ends it with 78 and one line that names it."""
    process = start("interpreter_pupillometry", "--ros-args", "--params-file", str(DEFAULTS))
    sensor = opened(ThirdPartyDriver(StreamName("p1", "pupillometry", "eye_1"), Pupillometry, wave, FS_HZ, FRAME, "mm"))
    sensor.until_heard(device=False)
    assert process.stop() == 0
    wrong = start("interpreter_pupillometry", longest_gap_s=0.0)
    assert wrong.wait() == 78
    assert "longest_gap_s" in wrong.log()

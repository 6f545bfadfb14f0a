"""interpreter-respiration as a process, fed by a driver that is not ours, on a private ROS domain."""

from pathlib import Path

import numpy as np
import pytest
from breathing_signals import chest, ecg
from ears import EPOCH_NS, ThirdPartyDriver
from rclpy.node import Node
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import Respiration

FS_HZ, FRAME, PERIOD_S = 25.0, 25, 4.0
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-respiration" / "config" / "default.yaml"


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """A belt of 2 N at 15 breaths per min; each ends its inspiration 2 s after it began."""
    return {"respiration": 5.0 - np.cos(2 * np.pi * times_s / PERIOD_S)}


def test_breaths_of_every_sensor_on_the_graph(start, opened):
    """One process without parameters serves two participants: breaths at their times, each once, and the rate."""
    process = start("interpreter_respiration")
    first, second = StreamName("p1", "respiration", "belt_1"), StreamName("p2", "respiration", "belt_2")
    one = opened(ThirdPartyDriver(first, Respiration, wave, FS_HZ, FRAME, "N"))
    other = opened(ThirdPartyDriver(second, Respiration, wave, FS_HZ, FRAME, "N", beside=one))
    for sensor in (one, other):
        sensor.until_heard(device=False)
    for sensor in (one, other):
        sensor.play(40)
        last = sensor.features[-1]
        assert last.header.frame_id == sensor.stream.sensor_id
        assert last.breaths_per_min == pytest.approx(60 / PERIOD_S, rel=0.02)
        assert last.amplitude == pytest.approx(2.0, rel=0.1)
        assert last.signal_quality > 0.9
        told_s = [(to_ns(t) - EPOCH_NS) / 1e9 for message in sensor.features for t in message.breath_timestamps]
        assert len(told_s) >= 6
        np.testing.assert_allclose(np.diff(told_s), PERIOD_S, atol=0.2)
        np.testing.assert_allclose(np.array(told_s) % PERIOD_S, PERIOD_S / 2, atol=0.2)
    assert process.stop() == 0


def know_each_other(*nodes: Node) -> None:
    """Give nodes of one name the parameters of all: whoever asks for them by that name is answered by any."""
    declared = {name: value for node in nodes for name, value in node.get_parameters_by_prefix("").items()}
    for node in nodes:
        for name, parameter in declared.items():
            if not node.has_parameter(name):
                node.declare_parameter(name, parameter.value)


def test_a_chest_strap_breathes_as_well(start, opened):
    """From ECG and acceleration of one strap come two streams of respiration, named by it and by what they are from."""
    process = start("interpreter_respiration")
    kinds = {"ecg": (ecg(60, 130.0)[:, None], ("ecg",), "uV"), "accelerometer": (chest(60, 130.0), "xyz", "m/s^2")}
    strap = {}
    for kind, (samples, names, unit) in kinds.items():
        played = lambda times_s, samples=samples, names=names: {  # noqa: E731
            name: np.ascontiguousarray(samples[np.round(times_s * 130).astype(int), k]) for k, name in enumerate(names)
        }
        name, beside = StreamName("p1", kind, "h10_1"), next(iter(strap.values()), None)
        arguments = name, Respiration, played, 130.0, 65, unit
        strap[kind] = opened(ThirdPartyDriver(*arguments, beside=beside, publishes="respiration"))
    know_each_other(*(sensor.node for sensor in strap.values()))
    for sensor in strap.values():
        sensor.until_heard(device=False)
    for kind, sensor in strap.items():
        sensor.play(50)
        last = sensor.features[-1]
        assert last.header.frame_id == f"h10_1_{kind}"
        assert last.breaths_per_min == pytest.approx(15.0, abs=0.5)
        assert f"source_{kind}_h10_1" in [feature.name for feature in last.extra]
    assert process.stop() == 0


def test_the_defaults_file_and_a_wrong_parameter(start, opened):
    """The shipped file starts the service; a parameter out of range ends it with 78 and one line that names it."""
    process = start("interpreter_respiration", "--ros-args", "--params-file", str(DEFAULTS))
    stream = StreamName("p1", "respiration", "belt_1")
    opened(ThirdPartyDriver(stream, Respiration, wave, FS_HZ, FRAME, "N")).until_heard(device=False)
    assert process.stop() == 0
    wrong = start("interpreter_respiration", window_s=1.0)
    assert wrong.wait() == 78
    assert "window_s" in wrong.log()

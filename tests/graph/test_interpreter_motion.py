"""interpreter-motion as a process, and what the acceleration of a device does to the quality of its other streams."""

from pathlib import Path

import numpy as np
import pytest
from breathing_signals import belt
from ears import ThirdPartyDriver
from sense4hri.names import StreamName
from sense4hri_msgs.msg import PPG, Motion, Respiration
from walking import GRAVITY, acceleration

FS_HZ, FRAME, PERIOD_S = 50.0, 25, 0.83
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-motion" / "config" / "default.yaml"
WALK = acceleration(60, FS_HZ, [(0, 60, 60 / PERIOD_S)])
STILL = acceleration(60, FS_HZ)


def axes(samples: np.ndarray, times_s: np.ndarray) -> dict[str, np.ndarray]:
    """The samples at these times, by their axes."""
    at = np.round(times_s * FS_HZ).astype(int)
    return {name: samples[at, i] for i, name in enumerate("xyz")}


def walking(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """Steps at the rate of the pulse."""
    return axes(WALK, times_s)


def still(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """Standing."""
    return axes(STILL, times_s)


def lightly(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """The same steps in g."""
    return {name: samples / GRAVITY for name, samples in walking(times_s).items()}


def pulse(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """A clean pulse, reflected."""
    phase = times_s % PERIOD_S
    return {
        "ppg_0": 3e5 - 4000 * (np.exp(-(((phase - 0.25) / 0.11) ** 2)) + 0.3 * np.exp(-(((phase - 0.52) / 0.15) ** 2)))
    }


def test_steps_and_intensity_on_the_graph(start, opened):
    """One process without parameters: one wearer walks at the rate of a pulse, the other stands."""
    process = start("interpreter_motion")
    one = opened(ThirdPartyDriver(StreamName("p1", "accelerometer", "belt_1"), Motion, walking, FS_HZ, FRAME, "m/s^2"))
    name = StreamName("p2", "accelerometer", "belt_2")
    other = opened(ThirdPartyDriver(name, Motion, still, FS_HZ, FRAME, "m/s^2", beside=one))
    for sensor in (one, other):
        sensor.until_heard(device=False)
    for sensor in (one, other):
        sensor.play(20)
    assert one.features[-1].step_rate_per_min == pytest.approx(60 / PERIOD_S, rel=0.03)
    assert one.features[-1].extra[0].values[0] == pytest.approx(17 / PERIOD_S, abs=2)
    assert one.features[-1].intensity_m_per_s2 > 1.5
    assert other.features[-1].step_rate_per_min == 0
    assert other.features[-1].intensity_m_per_s2 < 0.2
    assert other.features[-1].signal_quality > 0.9
    assert process.stop() == 0


def a_walker_and_another(opened, kind, message, signal, unit):
    """Two devices with the same signal and an accelerometer each: of one who walks, and of one who stands."""
    moving, resting = ("accelerometer", "m/s^2", walking), ("accelerometer", "m/s^2", still)
    name, other = StreamName("p1", kind, "worn_1"), StreamName("p2", kind, "worn_2")
    walker = opened(ThirdPartyDriver(name, message, signal, FS_HZ, FRAME, unit, also=moving))
    return walker, opened(ThirdPartyDriver(other, message, signal, FS_HZ, FRAME, unit, beside=walker, also=resting))


def test_the_acceleration_of_a_device_lowers_the_quality_of_its_pulse(start, opened):
    """Two devices, one clean pulse: below 0.7 where the wearer walks at its rate, above 0.9 where he stands."""
    process = start("interpreter_ppg")
    one, other = a_walker_and_another(opened, "ppg", PPG, pulse, "counts")
    for sensor in (one, other):
        sensor.until_heard()
    for sensor in (one, other):
        sensor.play(20)
    assert one.features[-1].signal_quality < 0.7
    assert other.features[-1].signal_quality > 0.9
    assert one.features[-1].heart_rate_bpm == pytest.approx(60 / PERIOD_S, abs=0.5)
    assert process.stop() == 0


def breaths(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """A belt of somebody who breathes 20 times a minute, with noise."""
    noise = np.random.default_rng(1).normal(0, 0.5, round(60 * FS_HZ))
    return {"respiration": belt(times_s, 20.0) + noise[np.round(times_s * FS_HZ).astype(int)]}


def test_the_acceleration_of_a_device_lowers_the_quality_of_its_belt(start, opened):
    """Two devices, one and the same breaths: of the wearer who walks the quality is the square of the other's."""
    process = start("interpreter_respiration")
    one, other = a_walker_and_another(opened, "respiration", Respiration, breaths, "a.u.")
    for sensor in (one, other):
        sensor.until_heard(device=False)
    for sensor in (one, other):
        sensor.play(30)
    assert 0.6 < other.features[-1].signal_quality < 0.98
    assert one.features[-1].signal_quality == pytest.approx(other.features[-1].signal_quality ** 2, rel=0.01)
    assert one.features[-1].breaths_per_min == pytest.approx(20, abs=0.5)
    assert process.stop() == 0


def test_a_unit_that_is_none_of_acceleration(start, opened):
    """Acceleration in g: features all the same, steps told, intensity NaN, and the sentence that says why."""
    process = start("interpreter_motion", "--ros-args", "--params-file", str(DEFAULTS))
    name = StreamName("p1", "accelerometer", "belt_1")
    in_g = opened(ThirdPartyDriver(name, Motion, lightly, FS_HZ, FRAME, "g"))
    in_g.until_heard(device=False)
    in_g.play(12)
    assert np.isnan(in_g.features[-1].intensity_m_per_s2)
    assert any("unit" in reason for reason in in_g.features[-1].reasons)
    assert process.stop() == 0
    wrong = start("interpreter_motion", upright_axis="sideways")
    assert wrong.wait() == 78
    assert "upright_axis" in wrong.log()

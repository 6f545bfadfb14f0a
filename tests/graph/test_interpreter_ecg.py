"""interpreter-ecg as a process, fed by drivers that are not ours, on a private ROS domain."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ears import EPOCH_NS, RECEIVED_NS, ThirdPartyDriver
from processes import Process
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import ECG

FS_HZ, FRAME, PERIOD_S = 130.0, 73, 0.75
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-ecg" / "config" / "default.yaml"


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """An ECG in uV whose R peaks are at k * PERIOD_S + 0.5 s."""
    phase_s = (times_s - 0.5 + PERIOD_S / 2) % PERIOD_S - PERIOD_S / 2
    return {"ecg": 1000 * np.exp(-0.5 * (phase_s / 0.012) ** 2) + 200 * np.exp(-0.5 * ((phase_s - 0.25) / 0.05) ** 2)}


@pytest.fixture
def strap(opened: Callable[[Any], Any]) -> Callable[[str, str], ThirdPartyDriver]:
    """strap(human_id, sensor_id) puts a chest strap on somebody."""
    straps: list[ThirdPartyDriver] = []

    def make(human_id: str, sensor_id: str) -> ThirdPartyDriver:
        name, beside = StreamName(human_id, "ecg", sensor_id), straps[0] if straps else None
        straps.append(opened(ThirdPartyDriver(name, ECG, wave, FS_HZ, FRAME, "uV", beside)))
        return straps[-1]

    return make


@pytest.fixture
def service(start: Callable[..., Process]) -> Process:
    """The service with its default parameters."""
    return start("interpreter_ecg", "--ros-args", "--params-file", str(DEFAULTS))


def test_features_of_a_foreign_strap(service, strap) -> None:
    """A driver in nobody's books gets its beats, rate, variability and difference, and the service ends cleanly."""
    worn = strap("p1", "bar_1")
    worn.until_heard()
    worn.play(25)
    worn.report(82.0)
    worn.play(12)
    last = worn.features[-1]
    assert last.header.frame_id == "bar_1"
    assert to_ns(last.header.stamp) - to_ns(last.device_timestamp) == pytest.approx(RECEIVED_NS - EPOCH_NS, abs=6e8)
    assert last.heart_rate_bpm == pytest.approx(80.0, abs=0.1)
    assert last.rr_interval_ms == pytest.approx(750.0, abs=1)
    assert last.signal_quality > 0.95
    assert last.hrv.rmssd_ms < 1
    assert np.isnan(last.hrv.sdnn_ms)
    assert any("sdnn_ms needs 120 s" in reason for reason in last.reasons)
    assert last.extra[0].name == "r_amplitude"
    assert last.extra[0].values[0] == pytest.approx(1000, rel=0.1)
    differences = [message.device_heart_rate_difference_bpm for message in worn.features]
    assert np.nanmin(differences) == pytest.approx(-2.0, abs=0.2)
    peaks_ns = [to_ns(time) - EPOCH_NS for message in worn.features for time in message.peak_timestamps]
    truth_ns = [round((0.5 + k * PERIOD_S) * 1e9) for k in range(len(peaks_ns))]
    assert np.abs(np.array(peaks_ns) - truth_ns).max() < 1e6
    assert service.stop() == 0


def test_streams_come_and_move(service, strap) -> None:
    """A second participant is served while the first goes on; a strap that changes hands starts afresh."""
    first = strap("p1", "bar_1")
    first.until_heard()
    first.play(6)
    second = strap("p2", "bar_2")
    second.until_heard()
    second.play(6)
    first.play(3)
    assert first.features[-1].hrv.window_s > 7
    first.wear("Ada")
    first.until_heard()
    first.play(6)
    assert first.features[0].hrv.window_s < 2
    assert second.features[-1].heart_rate_bpm == pytest.approx(80, abs=0.5)


@pytest.mark.parametrize(("parameter", "value"), [("window_s", -1.0), ("hrv_min_quality", "high")])
def test_wrong_parameter(start, parameter, value) -> None:
    """A parameter that cannot be ends the service with 78 and one line that names it."""
    process = start("interpreter_ecg", **{parameter: value})
    assert process.wait() == 78
    assert parameter in process.log()

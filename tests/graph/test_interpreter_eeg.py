"""interpreter-eeg as a process, fed by a driver that is not ours, on a private ROS domain."""

from pathlib import Path

import numpy as np
import pytest
from ears import ThirdPartyDriver
from sense4hri.names import StreamName
from sense4hri_msgs.msg import EEG

FS_HZ, FRAME = 256.0, 32
NAMES = ("AF7", "AF8", "TP9", "TP10")
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-eeg" / "config" / "default.yaml"


def wave(times_s: np.ndarray) -> dict[str, np.ndarray]:
    """Alpha of 10 uV at 10 Hz, at AF8 of 20 uV, over slower waves; TP9 hangs loose and gives nothing."""
    alpha = np.sin(2 * np.pi * 10 * times_s)
    slow = 8 * np.sin(2 * np.pi * 2.5 * times_s) + 4 * np.sin(2 * np.pi * 6 * times_s)
    amplitudes = (10.0, 20.0, 0.0, 10.0)
    return {name: a * alpha + slow * (a > 0) for name, a in zip(NAMES, amplitudes, strict=True)}


def test_band_powers_of_every_cap_on_the_graph(start, opened):
    """One process without parameters serves two participants: powers by channel, asymmetry, the bad channel by name."""
    process = start("interpreter_eeg")
    one = opened(ThirdPartyDriver(StreamName("p1", "eeg", "cap_1"), EEG, wave, FS_HZ, FRAME, "uV"))
    other = opened(ThirdPartyDriver(StreamName("p2", "eeg", "cap_2"), EEG, wave, FS_HZ, FRAME, "uV", beside=one))
    for sensor in (one, other):
        sensor.until_heard(device=False)
    for sensor in (one, other):
        sensor.play(8)
        last = sensor.features[-1]
        assert last.header.frame_id == sensor.stream.sensor_id
        assert tuple(last.channel_names) == NAMES
        np.testing.assert_allclose(last.alpha_uv2, [50.0, 200.0, np.nan, 50.0], rtol=0.05)
        assert last.frontal_alpha_asymmetry == pytest.approx(np.log(4), abs=0.05)
        assert list(last.channel_quality)[2] == 0
        assert "bad channels (flat): TP9" in last.reasons
        shares = {feature.name: feature.values for feature in last.extra}
        assert len(shares["relative_alpha"]) == len(NAMES)
        assert shares["alpha_peak"][0] == pytest.approx(10.0, abs=0.1)
    assert process.stop() == 0


def test_the_defaults_file_and_a_wrong_parameter(start, opened):
    """The shipped file starts the service; a parameter out of range ends it with 78 and one line that names it."""
    process = start("interpreter_eeg", "--ros-args", "--params-file", str(DEFAULTS))
    sensor = opened(ThirdPartyDriver(StreamName("p1", "eeg", "cap_1"), EEG, wave, FS_HZ, FRAME, "uV"))
    sensor.until_heard(device=False)
    assert process.stop() == 0
    wrong = start("interpreter_eeg", reference="ear")
    assert wrong.wait() == 78
    assert "reference" in wrong.log()

"""The minute of nine modalities that every clone has is the one that the bench makes, and is what its truth says."""

import json
from pathlib import Path

import numpy as np
import pytest
from sense4hri.signal_files.wfdb import open_wfdb
from sensor_bench.signals import nine

FOLDER = Path(__file__).resolve().parents[3] / "compose" / "studies" / "nine-modalities"


@pytest.fixture(scope="module")
def body():
    """Every signal of the record by name, as the driver reads it: rate in Hz and values."""
    found = {}
    for signal in open_wfdb(FOLDER / "body.hea"):
        fs_hz, _, values = signal.read(tuple(range(len(signal.channels))))
        found |= {name: (fs_hz, values[:, number]) for number, name in enumerate(signal.channels)}
    return found


def test_the_files_are_what_the_bench_writes(tmp_path):
    """Counts within one step, because the last digit is the processor's; table, header and truth as they are."""
    nine.write(tmp_path)
    made, kept = (np.fromfile(folder / "body.dat", "<i2").astype(int) for folder in (tmp_path, FOLDER))
    assert np.abs(made - kept).max() <= 1
    for name in ("body.hea", "truth.json"):
        assert (tmp_path / name).read_text() == (FOLDER / name).read_text()
    tables = [np.genfromtxt(folder / "gaze.csv", delimiter=",", skip_header=1) for folder in (tmp_path, FOLDER)]
    np.testing.assert_allclose(*tables, atol=0.0011)


def test_no_signal_leaves_the_range_of_the_record(body):
    """Nothing is clipped on its way into 16 bits."""
    for name, track in nine.tracks().items():
        fs_hz, values = body[name]
        assert fs_hz == track.per_s
        assert np.abs(values - track.values).max() <= 0.6 / track.gain, name


def test_the_truth_is_in_the_signals(body):
    """R peaks are the highest points near their times, and breathe as the chest does; muscles, alpha at the back."""
    truth = json.loads((FOLDER / "truth.json").read_text())
    fs_hz, ecg = body["ecg"]
    for at_s in truth["r_peaks_s"][1:-1]:
        near = round(at_s * fs_hz) + np.arange(-50, 51)
        assert abs(near[np.argmax(ecg[near])] / fs_hz - at_s) < 0.01
    assert breaths_per_min(ecg[np.rint(np.array(truth["r_peaks_s"]) * fs_hz).astype(int)]) == 15
    assert breaths_per_min(body["acc_z"][1]) == truth["breaths_per_min"] == 15
    fs_hz, emg = body["biceps"]
    times_s = np.arange(len(emg)) / fs_hz
    active = np.any([(times_s > begin) & (times_s < end) for begin, end in truth["emg_bursts_s"]], axis=0)
    assert emg[active].std() > 15 * emg[~active].std()
    spectrum = np.abs(np.fft.rfft(body["O1"][1]))
    assert np.argmax(spectrum) / truth["seconds"] == pytest.approx(truth["alpha_hz"], abs=0.3)


def breaths_per_min(values):
    """Return the strongest swing of a minute that is slower than a step and no drift."""
    return 2 + int(np.argmax(np.abs(np.fft.rfft(values))[2:31]))


def test_the_minute_has_no_seam(body):
    """Played over and over, the last sample and the first are no further apart than any two others, noise aside."""
    for name, (_, values) in body.items():
        steps = np.abs(np.diff(values))
        assert abs(values[0] - values[-1]) <= 1.5 * steps.max(), name

"""Real recordings are read losslessly, and played at the device's rate."""

import numpy as np
import pytest
import signal_file_makers as make
from sense4hri.signal_files.content import UnreadableFileError
from sense4hri.signal_files.wfdb import open_wfdb
from sensor_bench.signals.detection import is_plausible
from sensor_bench.signals.playback import PlaybackSource, RecordedHeart, resampled
from sensor_bench.signals.recordings import Playback, Recording, found_in, load


@pytest.mark.parametrize("record", ["100", "104", "231"])
@pytest.mark.parametrize("signal", [0, 1])
def test_wfdb_records_are_read_as_wfdb_reads_them(shared_data, record, signal):
    """Format 212 of the MIT-BIH records: every sample equals wfdb's, in uV."""
    wfdb = pytest.importorskip("wfdb")
    path = shared_data / "ecg" / "mitdb" / record
    expected = wfdb.rdrecord(str(path)).p_signal[:, signal]
    recording = load(Playback(f"{path}.hea", column=str(signal)), "ecg")
    assert recording.fs_hz == 360
    np.testing.assert_allclose(recording.values[:, 0], expected * 1000, atol=1e-9)


def test_a_signal_with_several_samples_per_frame(shared_data):
    """In a MIMIC record the ECG has four samples per frame: 500 Hz beside 125 Hz."""
    wfdb = pytest.importorskip("wfdb")
    path = shared_data / "multimodal" / "mimicdb" / "03700181"
    record = wfdb.rdrecord(str(path), smooth_frames=False)
    expected = record.e_p_signal[0]
    recording = load(Playback(f"{path}.hea"), "ecg")
    assert recording.fs_hz == 500
    np.testing.assert_allclose(recording.values[:, 0], expected * 1000, atol=1e-6)


def test_a_signal_written_later_than_those_beside_it(shared_data):
    """In the same record the respiration is four frames behind; brought back, nothing is known of the last four."""
    wfdb = pytest.importorskip("wfdb")
    path = shared_data / "multimodal" / "mimicdb" / "03700181"
    expected = wfdb.rdrecord(str(path), smooth_frames=False).e_p_signal[2]
    signal = next(each for each in open_wfdb(path) if "RESP" in each.channels)
    values = signal.read((signal.channels.index("RESP"),)).values[:, 0]
    np.testing.assert_allclose(values, expected, atol=1e-6)
    assert np.isnan(values[-4:]).all()
    assert not np.isnan(values[:-4]).any()


def test_a_wfdb_record_of_format_16_with_an_offset(tmp_path):
    """16-bit samples after 24 bytes, baseline and unit from the header; an absent sample repeats the last one."""
    counts = np.array([[0, 5], [100, 6], [-32768, 7], [300, 8], [400, 9]], dtype="<i2")
    (tmp_path / "r.mat").write_bytes(bytes(24) + counts.tobytes())
    (tmp_path / "r.hea").write_text(
        "r 2 5 5\nr.mat 16+24 100(50)/mV 16 0 0 0 0 II\nr.mat 16+24 1/NU 16 0 0 0 0 PLETH\n#x\n"
    )
    recording = load(Playback(str(tmp_path / "r.hea")), "ecg")
    assert recording.values[:, 0].tolist() == [-500, 500, 500, 2500, 3500]


def test_a_recording_with_a_gap_is_refused(tmp_path):
    """The bench would close it; segments that follow each other are one recording."""
    for name in ("r_1", "r_2"):
        make.segment(tmp_path, name, {"II": (10, "mV", [10, 20])})
    (tmp_path / "r.hea").write_text("r/2 1 4 4\nr_1 2\nr_2 2\n")
    assert load(Playback(str(tmp_path / "r.hea")), "ecg").values[:, 0].tolist() == [1000, 2000, 1000, 2000]
    (tmp_path / "r.hea").write_text("r/3 1 4 5\nr_1 2\n~ 1\nr_2 2\n")
    with pytest.raises(UnreadableFileError, match="has gaps: driver-file plays them, the bench does not"):
        load(Playback(str(tmp_path / "r.hea")), "ecg")


def test_polar_sensor_logger_exports_play_sample_by_sample(shared_data):
    """The PPG of a real Verity Sense goes onto the air as the counts in the file, all four channels."""
    path = shared_data / "polar" / "verity_sense" / "Polar_Sense_PPG.txt"
    recording = load(found_in(str(path))["ppg"], "ppg")
    assert recording.fs_hz == pytest.approx(54.75, abs=0.01)
    source = PlaybackSource(recording, 1.0, 4, 3, [55 * 0.9962])
    assert source.read(0, 2, 55 * 0.9962).tolist() == [[261545, 278928, 293066, -644], [261520, 279044, 293112, -624]]
    length = recording.values.shape[0]
    np.testing.assert_array_equal(source.read(length, 2, 55 * 0.9962), source.read(0, 2, 55 * 0.9962))


def test_plain_columns(tmp_path):
    """Comment lines, a header, empty cells, several separators; unit and gain scale the values."""
    file = tmp_path / "x.csv"
    file.write_text("# comment\ntime,ECG\n" + "".join(f"{i},{i / 10 if i != 3 else ''}\n" for i in range(20)))
    recording = load(Playback(str(file), fs_hz=10, column="ECG", unit="mV", gain=-1), "ecg")
    assert recording.values[:5, 0].tolist() == pytest.approx([0, -100, -200, -200, -400])
    file.write_text("\n".join(str(i) for i in range(20)))
    assert load(Playback(str(file), fs_hz=10), "ecg").values[:3, 0].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("stream", "header", "played"),
    [
        ("ecg", "time,ecg", [1.0]),
        ("ecg", "timestamp,resp,ECG II", [2.0]),
        ("ecg", "time,value", [1.0]),
        ("ecg", "a,b", [0.0]),
        ("ppg", "t,ecg,pleth,z", [2.0]),
        ("accelerometer", "time,x,y,z", [1.0, 2.0, 3.0]),
        ("accelerometer", "ACC_X,ACC_Y,ACC_Z,temp", [0.0, 1.0, 2.0]),
    ],
)
def test_the_column_that_is_played_where_none_is_named(tmp_path, stream, header, played):
    """The first that fits by its name, else the first that is no time; an accelerometer has three axes."""
    file, count = tmp_path / "a.csv", len(header.split(","))
    file.write_text(header + "\n" + (",".join(str(number) for number in range(count)) + "\n") * 50)
    unit = {"ecg": "uV", "ppg": "counts", "accelerometer": "g"}[stream]
    assert load(Playback(str(file), fs_hz=10, unit=unit), stream).values[7].tolist()[: len(played)] == played


def test_an_unknown_pulse_wave_is_fitted_to_the_sensors_range(shared_data):
    """A PPG in arbitrary units becomes counts as large as a Verity Sense's, upside down, with darkness beside it."""
    file = str(shared_data / "multimodal" / "neurokit" / "bio_resting_5min_100hz.csv")
    playback = found_in(file)["ppg"]
    values = load(playback, "ppg").values
    assert values.shape[1] == 4
    assert 200_000 < values[:, 0].min() < values[:, 0].max() < 300_000
    original = np.genfromtxt(file, delimiter=",", skip_header=1)[:, 1]
    assert np.corrcoef(original, values[:, 0])[0, 1] < -0.999


@pytest.mark.parametrize(
    ("name", "content", "playback", "reason"),
    [
        ("a.csv", "x,y\n1,2\n", {}, "fs_hz is needed"),
        ("a.csv", "", {"fs_hz": 10}, "no data"),
        ("a.csv", "x,y\n1,2\n", {"fs_hz": 10, "column": "z"}, "no column 'z'; there are x, y"),
        ("a.csv", "x,y\n1,2\nfoo,3\n", {"fs_hz": 10}, "line 3: column 'x' holds 'foo'"),
        ("a.csv", "1\n2\n", {"fs_hz": 100}, "only 2 samples"),
        ("a.csv", "ecg,b\n" + ",1\n" * 30, {"fs_hz": 10}, "no number in it to play as ecg"),
        ("a.csv", "1\n2\n", {"fs_hz": 1e6}, "not between 1 and 20000"),
        ("a.csv", "\n".join("1" * 30), {"fs_hz": 10, "unit": "bar"}, "unit 'bar' is none of uV, mV, V"),
        ("a.hea", "nonsense", {}, "not a WFDB header"),
        ("a.hea", "a 1 360\na.dat 212 200 11 0 0 0 0 I\n", {}, "a.dat"),
        ("a.hea", "a 0 360\n", {}, "no signals"),
    ],
)
def test_unreadable_files_are_named_with_the_reason(tmp_path, name, content, playback, reason):
    """What cannot be read is an UnreadableFileError with file and place."""
    (tmp_path / name).write_text(content)
    with pytest.raises(UnreadableFileError, match="a\\.") as caught:
        load(Playback(str(tmp_path / name), **playback), "ecg")
    assert reason in str(caught.value)


@pytest.mark.parametrize("name", ["a.edf", "a_100hz.csv"])
def test_a_binary_file_of_another_format_is_called_so(tmp_path, name):
    """It is not taken for text whose name lacks the rate, nor for a column whose first row is odd."""
    (tmp_path / name).write_bytes(b"0       X X X X".ljust(256) + bytes(512))
    with pytest.raises(UnreadableFileError, match=f"{name}: not WFDB, not a Polar Sensor Logger export"):
        found_in(str(tmp_path / name))


def test_resampling_keeps_the_signal():
    """A 1 Hz sine at 360 Hz, resampled to the rate of an H10, is that sine within half a percent."""
    fs_hz = 130.17
    sine = np.sin(2 * np.pi * np.arange(3600) / 360)[:, None] * 1000
    found = resampled(Recording(360, sine), fs_hz)[:, 0]
    expected = np.sin(2 * np.pi * np.arange(found.size) / fs_hz) * 1000
    assert np.abs(found - expected)[130:-130].max() < 5


def test_a_recorded_heart_repeats_with_its_recording():
    """Beats of later rounds are those of the first one, moved by the recording's length; RR spans the seam."""
    heart = RecordedHeart(np.array([0.5, 1.5, 2.4]), 3.0)
    assert [round(beat.time_s, 3) for beat in heart.beats(0, 6)] == [0.5, 1.5, 2.4, 3.5, 4.5, 5.4]
    assert [round(beat.rr_s, 3) for beat in heart.beats(3, 6)] == [1.1, 1.0, 0.9]
    assert heart.heart_rate_bpm == pytest.approx(60 / 0.95)
    with pytest.raises(UnreadableFileError, match="2 beats"):
        RecordedHeart(np.array([1.0, 2.0]), 3.0)


def test_values_beyond_the_sensors_range_are_clipped():
    """A recording larger than a frame can carry saturates, as a sensor does."""
    source = PlaybackSource(Recording(100, np.array([[1.0], [-1.0]] * 100)), 40_000, 3, 2, [100.0])
    assert source.read(0, 2, 100.0).tolist() == [[32767] * 3, [-32767] * 3]


@pytest.mark.parametrize(
    ("beats_s", "duration_s", "plausible"),
    [
        (np.arange(0, 60, 0.8), 60, True),
        (np.arange(0, 20, 0.8), 60, False),
        (np.arange(0, 60, 0.1), 60, False),
        (np.array([1.0, 2.0]), 2, False),
    ],
)
def test_only_a_rhythm_is_taken_for_a_heart(beats_s, duration_s, plausible):
    """25 to 240 beats per minute through at least half of the recording."""
    assert is_plausible(beats_s, duration_s) is plausible

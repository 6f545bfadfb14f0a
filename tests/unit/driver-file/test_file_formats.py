"""driver-file: each format, made small here, and real files of it held against the library of others that reads it."""

import re
import shutil
import zipfile

import fastavro
import numpy as np
import pytest
import signal_file_makers as make
from driver_file import transport
from driver_file.config import FileConfig
from driver_file.device import Tape
from sense4hri.device import Samples
from sense4hri.errors import ConfigError

ASC = """\
** a comment
MSG\t1000 TRIALID 7
START\t1000 \tLEFT\tRIGHT\tSAMPLES\tEVENTS
SAMPLES\tGAZE\tLEFT\tRIGHT\tRATE\t 500.00\tTRACKING\tCR
1000\t  512.0\t  384.0\t  900.0\t  513.0\t  385.0\t  910.0\t.....
1002\t  512.5\t  384.5\t  901.0\t  513.5\t  385.5\t  911.0\t.....
ESACC L  990 1002 12 1 1 2 2 0.1 50
1004\t   .\t   .\t    0.0\t  514.0\t  386.0\t  912.0\t.C...
MSG\t1005 stimulus on left
1020\t  512.0\t  384.0\t  905.0\t   .\t   .\t    0.0\t.....
"""


def read(file, *streams, **more):
    """Return the streams by sensor type, and the events."""
    recorded, content = transport.read(FileConfig(sensor_id="file_1", file=str(file), streams=streams, **more))
    return {each.sensor_type: each for each in recorded}, content.events


@pytest.mark.parametrize("kind", ["INT_16", "IEEE_FLOAT_32"])
@pytest.mark.parametrize("by_sample", [True, False])
def test_brainvision(tmp_path, kind, by_sample):
    """Integers and floats, in either order: resolution and unit of the header, its date, markers."""
    values = np.arange(60).reshape(20, 3) - 30
    streams, events = read(make.brainvision(tmp_path / "a", ("Fp1", "Cz", "Oz"), values, kind, by_sample))
    eeg = streams["eeg"]
    assert (eeg.stream.sampling_frequency_hz, eeg.stream.unit) == (500, "uV")
    assert eeg.stream.channel_names == ("Fp1", "Cz", "Oz")
    np.testing.assert_allclose(eeg.values, values * 0.5)
    assert eeg.times_ns[1] - make.START_NS == 2_000_000
    assert [(each.name, each.value, each.time_ns - make.START_NS) for each in events] == [
        ("S  7", "Stimulus", 4_000_000)
    ]


def biosemi(path, values, status):
    """Write a BDF of one record of a second, as BioSemi's ActiView lays it out: an electrode, and the triggers."""
    lines = [("Fp1", "Status"), ("", ""), ("uV", "Boolean"), (-262144, -8388608), (262143, 8388607), (-8388608,) * 2]
    widths = (16, 80, 8, 8, 8, 8, 8, 80, 8, 32)
    lines += [(8388607,) * 2, ("", "No filtering"), (len(values),) * 2, ("Reserved",) * 2]
    head = "".join(f"{each:<{width}}" for both, width in zip(lines, widths, strict=True) for each in both)
    main = f"{'p1':<80}{'':<80}06.05.2407.08.09{768:<8}{'24BIT':<44}{1:<8}{1:<8}{2:<4}"
    octets = b"".join(int(each).to_bytes(3, "little", signed=True) for each in (*values, *status))
    path.write_bytes(b"\xffBIOSEMI" + (main + head).encode() + octets)
    return path


def test_a_biosemi_recording_is_read_as_mne_reads_it(tmp_path):
    """24 bits with their signs, and each trigger when it began; the bits above the triggers are none of them."""
    mne = pytest.importorskip("mne")
    values = np.random.default_rng(1).integers(-(2**23), 2**23, 64)
    status = np.repeat([0x000000, 0x010007, 0x000007, 0x000000, -0x700000 + 0xFF, 0x000003, 0x000000, 0x01FF00], 8)
    file = biosemi(tmp_path / "a.bdf", values, status)
    raw = mne.io.read_raw_bdf(file, preload=True, verbose="error")
    streams, events = read(file)
    np.testing.assert_allclose(streams["eeg"].values[:, 0], raw.get_data("Fp1")[0] * 1e6, rtol=0, atol=1e-6)
    found = mne.find_events(raw, "Status", consecutive=True, mask=0xFFFF, mask_type="and", verbose="error")
    told = [(round((each.time_ns - make.START_NS) * 64 / 1e9), int(each.name)) for each in events]
    assert told == [(at, code) for at, _, code in found.tolist()] == [(8, 7), (32, 255), (40, 3), (56, 0xFF00)]


def test_a_brainvision_header_of_before_utf8(tmp_path):
    """Without a `Codepage` its text is of Windows: the micro sign is one, and the values are in uV."""
    file = make.brainvision(tmp_path / "a", ("Fp1", "Cz"), np.ones((20, 2)))
    text = file.read_text(encoding="utf-8").replace("Codepage=UTF-8\n", "")
    file.write_bytes(text.encode("cp1252"))
    assert read(file)[0]["eeg"].stream.unit == "uV"


def test_an_unknown_order_of_brainvision_samples_is_refused(tmp_path):
    """`multiplexed` in small letters is no other order: nobody plays samples of one channel as another's."""
    values = np.arange(60).reshape(20, 3) - 30
    file = make.brainvision(tmp_path / "a", ("Fp1", "Cz", "Oz"), values)
    text = file.read_text()
    file.write_text(text.replace("MULTIPLEXED", "multiplexed"))
    np.testing.assert_allclose(read(file)[0]["eeg"].values, values * 0.5)
    file.write_text(text.replace("MULTIPLEXED", "SHUFFLED"))
    with pytest.raises(ConfigError, match="DataOrientation SHUFFLED is neither MULTIPLEXED nor VECTORIZED"):
        read(file)


@pytest.mark.parametrize("points", ["", "DataPoints=20\n"])
def test_a_brainvision_file_that_is_cut_off_mixes_no_channels(tmp_path, points):
    """Channel after channel it is refused; sample by sample what is whole is played, and a note says how much."""
    values = np.arange(60).reshape(20, 3) - 30
    for by_sample in (True, False):
        file = make.brainvision(tmp_path / "a", ("Fp1", "Cz", "Oz"), values, "INT_16", by_sample)
        file.write_text(file.read_text(encoding="utf-8").replace("NumberOf", f"{points}NumberOf"), encoding="utf-8")
        np.testing.assert_allclose(read(file)[0]["eeg"].values, values * 0.5)
        data = file.with_suffix(".eeg")
        data.write_bytes(data.read_bytes()[: 96 if points else 100])  # of 48 values each channel might have a third
        if by_sample:
            recorded, content = transport.read(FileConfig(sensor_id="file_1", file=str(file)))
            np.testing.assert_allclose(recorded[0].values, values[:16] * 0.5)
            assert content.notes == (("it ends after 16 of its 20 samples",) if points else ())
        else:
            with pytest.raises(ConfigError, match=r"(48|50) values of 3 channels, .*: cut off, or of another header"):
                read(file)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("DataFormat=BINARY\nDataType=FREQUENCYDOMAIN", "DataType FREQUENCYDOMAIN is not read, only TIMEDOMAIN"),
        ("DataFormat=ASCII", "DataFormat ASCII is not read, only BINARY"),
    ],
)
def test_a_brainvision_file_of_spectra_or_text_is_refused(tmp_path, header, said):
    """Lines of a spectrum are not played as samples; text is told to be text."""
    file = make.brainvision(tmp_path / "a", ("Fp1", "Cz"), np.ones((20, 2)))
    text = file.read_text(encoding="utf-8").replace("DataFormat=BINARY", header)
    file.write_text(text.replace("[Binary Infos]\n", "[ASCII Infos]\n" if "ASCII" in header else "[Binary Infos]\n"))
    with pytest.raises(ConfigError, match=said):
        read(file)


def test_markers_of_a_brainvision_recording_that_are_not_there_are_missed(tmp_path):
    """The header names them; the samples are played from 0, and a note says what is lacking."""
    file = make.brainvision(tmp_path / "a", ("Fp1", "Cz"), np.ones((20, 2)))
    file.with_suffix(".vmrk").unlink()
    recorded, content = transport.read(FileConfig(sensor_id="file_1", file=str(file)))
    assert (recorded[0].times_ns[0], content.notes) == (0, ("a.vmrk is not there: neither markers nor a date",))


def test_a_brainvision_file_may_have_its_high_bytes_first(tmp_path):
    """`UseBigEndianOrder` of the header says so."""
    values = np.arange(60).reshape(20, 3) - 30
    file = make.brainvision(tmp_path / "a", ("Fp1", "Cz", "Oz"), values)
    file.with_suffix(".eeg").write_bytes(values.astype(">i2").tobytes())
    file.write_text(file.read_text().replace("BinaryFormat=INT_16", "BinaryFormat=INT_16\nUseBigEndianOrder=YES"))
    np.testing.assert_allclose(read(file)[0]["eeg"].values, values * 0.5)


@pytest.mark.parametrize(
    ("date", "gap_ms"), [("20240506070909000000", 60_000), ("20240506070809010000", 20), ("0", 20)]
)
def test_a_pause_of_a_brainvision_recording_is_a_gap(tmp_path, date, gap_ms):
    """Samples and markers after it have the date of their segment; a date within the samples before is no pause."""
    file = make.brainvision(tmp_path / "a", ("Fp1",), np.arange(20)[:, None])
    with file.with_suffix(".vmrk").open("a") as marks:
        marks.write(f"Mk3=New Segment,,11,1,0,{date}\nMk4=Stimulus,S  8,12,1,0\n")
    streams, events = read(file)
    times_ms = (streams["eeg"].times_ns - make.START_NS) // 1_000_000
    assert times_ms.tolist() == [*range(0, 20, 2), *range(gap_ms, gap_ms + 20, 2)]
    assert (events[1].time_ns - make.START_NS) // 1_000_000 == gap_ms + 2


def test_brainvision_is_read_as_mne_reads_it(tmp_path):
    """Every value of every channel."""
    mne = pytest.importorskip("mne")
    values = np.random.default_rng(1).integers(-3000, 3000, (200, 4))
    file = make.brainvision(tmp_path / "a", ("Fp1", "Cz", "Oz", "Pz"), values)
    expected = mne.io.read_raw_brainvision(file, verbose="error").get_data() * 1e6
    np.testing.assert_allclose(read(file)[0]["eeg"].values.T, expected, atol=1e-9)


def test_xdf(tmp_path):
    """A stream of numbers with its labels, unit and stamps, and a stream of words as events."""
    values = np.arange(40.0).reshape(20, 2)
    streams, events = read(make.xdf(tmp_path / "a.xdf", 100.0, ("Cz", "Oz"), values, [(10.05, "cue"), (10.1, "end")]))
    eeg = streams["eeg"]
    assert (eeg.stream.unit, eeg.stream.channel_names) == ("uV", ("Cz", "Oz"))
    assert eeg.stream.sampling_frequency_hz == pytest.approx(100)
    np.testing.assert_allclose(eeg.values, values)
    np.testing.assert_allclose(eeg.times_ns / 1e9, 10 + np.arange(20) / 100)
    assert [(each.time_ns / 1e9, each.name) for each in events] == [(10.05, "cue"), (10.1, "end")]


def test_what_of_an_xdf_is_not_played_is_told(tmp_path):
    """A stream that sent nothing is named; a marker whose first channel is empty has the next one's name."""
    file = make.xdf(tmp_path / "a.xdf", 250, ("Cz",), np.zeros((10, 1)), [])
    rows = [(10.01, b"\x01\x00\x01\x01x"), (10.02, b"\x01\x01a\x01\x01b"), (10.03, b"\x01\x00\x01\x00")]
    with file.open("ab") as more:
        more.write(make.xdf_stream(3, "ECG", 1, 130, "double64", "<desc></desc>", []))
        more.write(make.xdf_stream(4, "Markers", 2, 0, "string", "<desc></desc>", rows))
    _, content = transport.read(FileConfig(sensor_id="file_1", file=str(file)))
    assert [(each.name, each.value) for each in content.events] == [("x", ""), ("a", "b")]
    assert content.notes == ("without samples, left out: ECG",)


def test_markers_of_numbers_in_an_xdf_are_events(tmp_path):
    """As in driver-lsl: a stream without a rate whose type is one of markers, whatever its channels hold."""
    file = make.xdf(tmp_path / "a.xdf", 250, ("Cz",), np.zeros((10, 1)), [(10.5, "start")])
    codes = [(10.01, (7).to_bytes(4, "little")), (10.02, (0).to_bytes(4, "little"))]
    with file.open("ab") as more:
        more.write(make.xdf_stream(3, "Stim", 1, 0, "int32", "<desc></desc>", codes))
    _, events = read(file)
    assert [(each.name, each.time_ns // 1_000_000) for each in events] == [
        ("7", 10_010),
        ("0", 10_020),
        ("start", 10_500),
    ]


def test_what_an_amplifier_has_besides_electrodes_is_no_eeg_in_an_xdf(tmp_path):
    """As in driver-lsl: a sampled trigger has a stream of its own, a count of packets has none."""
    file = make.xdf(tmp_path / "a.xdf", 250, ("Cz",), np.zeros((10, 1)), [])
    labels = {"Fp1": "microvolts", "O2": "microvolts", "TRIGGER": "integer", "Packet count": ""}
    channels = "".join(f"<channel><label>{name}</label><unit>{unit}</unit></channel>" for name, unit in labels.items())
    samples = [(10 + i / 250, np.array([i, -i, 7, i], "<f8").tobytes()) for i in range(10)]
    desc = f"<desc><channels>{channels}</channels></desc>"
    file.write_bytes(b"XDF:" + make.xdf_stream(1, "EEG", len(labels), 250, "double64", desc, samples))
    streams, _ = read(file)
    assert {name: each.stream.channel_names for name, each in streams.items()} == {
        "eeg": ("Fp1", "O2"),
        "markers": ("TRIGGER",),
    }
    assert streams["eeg"].values[9].tolist() == [9, -9]
    assert set(streams["markers"].values[:, 0]) == {7}


def test_a_real_xdf_with_a_reboot_inside(shared_data):
    """Times are the recording computer's, across a reboot of the sender; the pause is a gap, no sample is lost."""
    streams, events = read(shared_data / "xdf" / "clock_resets.xdf", markers=True)
    eeg = streams["eeg"]
    assert (eeg.times_ns[[0, -1]] / 1e9).tolist() == pytest.approx([810.095, 1383.092], abs=1e-3)
    assert eeg.values.shape == (27815, 8)
    assert (events[0].time_ns / 1e9, events[-1].time_ns / 1e9) == pytest.approx((812.928, 1380.819), abs=1e-3)
    assert len(events) == 175
    assert 85 < eeg.stream.sampling_frequency_hz < 100


def test_eyelink(tmp_path):
    """Both pupils, the left eye's gaze, lost samples as NaN, the tracker's times with a gap, and its messages."""
    (tmp_path / "a.asc").write_text(ASC)
    streams, events = read(tmp_path / "a.asc")
    gaze, pupil = streams["eye_tracking"], streams["pupillometry"]
    assert (gaze.stream.unit, gaze.stream.channel_names) == ("px", ("gaze_x", "gaze_y"))
    assert (pupil.stream.unit, pupil.stream.channel_names) == ("a.u.", ("diameter_left", "diameter_right"))
    np.testing.assert_array_equal(gaze.values[:, 0], [512, 512.5, np.nan, 512])
    np.testing.assert_array_equal(pupil.values, [[900, 910], [901, 911], [np.nan, 912], [905, np.nan]])
    assert (gaze.times_ns // 1_000_000).tolist() == [1000, 1002, 1004, 1020]
    assert [(each.time_ns, each.name, each.value) for each in events] == [
        (1_000_000_000, "TRIALID", "7"),
        (1_005_000_000, "stimulus", "on left"),
    ]
    right, _ = read(tmp_path / "a.asc", "eye_tracking: gaze_x_right, gaze_y_right")
    np.testing.assert_array_equal(right["eye_tracking"].values[:, 1], [385, 385.5, 386, np.nan])


def test_an_eyelink_of_one_eye(tmp_path):
    """Three numbers a sample are one eye, the one that the header names."""
    (tmp_path / "a.asc").write_text(
        "SAMPLES\tGAZE\tRIGHT\tRATE\t1000.00\n10\t1.0\t2.0\t3.0\t...\n11\t1.0\t2.0\t4.0\t...\n"
    )
    streams, _ = read(tmp_path / "a.asc")
    assert streams["pupillometry"].stream.channel_names == ("diameter_right",)
    assert streams["pupillometry"].values[:, 0].tolist() == [3, 4]


@pytest.mark.parametrize("side", ["LEFT", "RIGHT"])
def test_velocity_and_resolution_of_one_eye_are_no_second_eye(tmp_path, side):
    """The header says which eyes there are, not the number of columns; gaze that is not in px is not said to be."""
    row = "10\t1.0\t2.0\t3.0\t0.1\t0.2\t26.0\t27.0\t...\n"
    (tmp_path / "a.asc").write_text(f"SAMPLES\tHREF\t{side}\tVEL\tRES\tRATE\t1000.00\n{row}{row.replace('10', '11')}")
    streams, _ = read(tmp_path / "a.asc")
    assert streams["pupillometry"].stream.channel_names == (f"diameter_{side.lower()}",)
    assert streams["pupillometry"].values.tolist() == [[3], [3]]
    assert streams["eye_tracking"].stream.unit == "a.u."


@pytest.mark.parametrize(
    ("row", "pupils"),
    [
        ("512.0 384.0 900.0 0.1 0.2 26.0 27.0 ...", [900]),
        ("512.0 384.0 900.0 ... 100.0 200.0 600.0 .............", [900]),
        ("512.0 384.0 900.0 IC. 100.0 200.0 600.0 .............", [900]),
        ("512.0 384.0 900.0 513.0 385.0 910.0 0.1 0.2 0.1 0.2 26.0 27.0 .C...", [900, 910]),
        ("512.0 384.0 900.0", [900]),
        ("512.0 384.0 900.0 513.0 385.0 910.0", [900, 910]),
    ],
)
def test_without_a_line_that_says_it_the_flags_tell_how_many_eyes_there_are(tmp_path, row, pupils):
    """Three signs of one eye, five of two, whatever else is measured; where there are no flags the numbers tell."""
    (tmp_path / "a.asc").write_text("".join(f"{at}\t{row}\n" for at in (1000, 1002, 1004)))
    assert read(tmp_path / "a.asc")[0]["pupillometry"].values.tolist() == [pupils] * 3


def test_an_eyelink_of_2000_hz(tmp_path):
    """With times of half ms and without: every sample has a time of its own, and a message its decimals."""
    head = "MSG\t1000.5 stimulus on\nSAMPLES\tGAZE\tLEFT\tRATE\t2000.00\tTRACKING\tCR\n"
    for times in (("1000.0", "1000.5", "1001.0", "1001.5"), ("1000", "1000", "1001", "1001")):
        file = tmp_path / "a.asc"
        file.write_text(head + "".join(f"{at}\t1.0\t2.0\t3.0\t...\n" for at in times))
        streams, events = read(file)
        assert streams["eye_tracking"].stream.sampling_frequency_hz == 2000
        assert (streams["eye_tracking"].times_ns // 500_000).tolist() == [2000, 2001, 2002, 2003]
        assert [(each.time_ns, each.name) for each in events] == [(1_000_500_000, "stimulus")]


def test_an_eyelink_that_changes_its_eyes_is_refused(tmp_path):
    """One stream cannot be the left eye first and both later."""
    (tmp_path / "a.asc").write_text(ASC + "SAMPLES\tGAZE\tLEFT\tRATE\t500\n1022\t1.0\t2.0\t3.0\t...\n")
    with pytest.raises(ConfigError, match=r"a\.asc: line 11: names no eye, or others than before"):
        read(tmp_path / "a.asc")


def test_an_odd_line_of_an_eyelink_file_is_named(tmp_path):
    """With the file, the number of the line and what it holds."""
    (tmp_path / "a.asc").write_text(ASC.replace("1002\t  512.5", "1002\t  oops"))
    with pytest.raises(ConfigError, match=r"a\.asc: line 6: '1002 oops .*' is no sample"):
        read(tmp_path / "a.asc")


def test_the_real_eyelink_recording_loses_its_blinks_and_nothing_else(shared_data):
    """561 samples of the left eye are NaN, those that the tracker's own blinks hold; 20465 samples of 500 Hz."""
    streams, _ = read(shared_data / "eye" / "eyelink" / "002_rlmw_samples_short.asc")
    assert streams["eye_tracking"].stream.sampling_frequency_hz == pytest.approx(500)
    assert len(streams["eye_tracking"].values) == 20465
    assert np.isnan(streams["pupillometry"].values[:, 0]).sum() == 561
    assert np.isnan(streams["eye_tracking"].values[:, 0]).sum() == 561


def e4(folder):
    folder.mkdir()
    (folder / "EDA.csv").write_text("1560279825.000000\n4.000000\n0.0\n0.5\n1.0\n")
    (folder / "ACC.csv").write_text("1560279826.0, 1560279826.0, 1560279826.0\n32.0, 32.0, 32.0\n64,0,-64\n0,64,0\n")
    (folder / "tags.csv").write_text("1560279826.50\n")
    return folder


def test_an_empatica_folder_and_its_zip_are_the_same(tmp_path):
    """Rates and UTC times of the files, acceleration of 64 steps a g, and tags as events."""
    folder = e4(tmp_path / "session")
    archive = shutil.make_archive(str(tmp_path / "session"), "zip", folder)
    for place in (folder, archive):
        streams, events = read(place)
        assert streams["accelerometer"].values[0].tolist() == pytest.approx([9.80665, 0, -9.80665])
        assert streams["accelerometer"].times_ns[0] - streams["eda"].times_ns[0] == 10**9
        assert (streams["eda"].stream.unit, streams["eda"].stream.sampling_frequency_hz) == ("uS", 4)
        assert [(each.time_ns, each.name) for each in events] == [(1_560_279_826_500_000_000, "tag")]


@pytest.mark.parametrize("text", ["", "\n", "1560279825.000000\n4.000000\n"])
def test_an_empty_file_of_an_empatica_is_named_and_the_others_are_read(tmp_path, text):
    """Without any line, or a time and a rate alone; where all are empty there is nothing to play."""
    folder = e4(tmp_path / "session")
    for name in ("TEMP.csv", "BVP.csv"):
        (folder / name).write_text(text)
    archive = shutil.make_archive(str(tmp_path / "session"), "zip", folder)
    for place in (folder, archive):
        recorded, content = transport.read(FileConfig(sensor_id="e4_1", file=str(place)))
        assert [each.sensor_type for each in recorded] == ["accelerometer", "eda"]
        assert content.notes == ("without samples, left out: BVP.csv (ppg), TEMP.csv (temperature)",)
    for name in ("EDA.csv", "ACC.csv"):
        (folder / name).write_text(text)
    with pytest.raises(ConfigError, match=r"session: no samples in ACC\.csv, BVP\.csv, EDA\.csv, TEMP\.csv"):
        read(folder)


def test_a_row_of_an_empatica_has_a_number_for_each_channel(tmp_path):
    """A decimal comma, as a spreadsheet leaves it, is no second column; a last row that was cut off is left out."""
    folder = e4(tmp_path / "session")
    with (folder / "ACC.csv").open("a") as file:
        file.write("1,2")
    assert len(read(folder)[0]["accelerometer"].values) == 2
    (folder / "TEMP.csv").write_text("1560279825,000000\n4,000000\n32,13\n32,15\n")
    with pytest.raises(ConfigError, match=r"TEMP\.csv: line 1: 2 numbers, not 1"):
        read(folder)


def test_a_zip_of_two_empatica_recordings_is_refused(tmp_path):
    """Signals of the one are not played beside those of the other."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("p1/EDA.csv", "1714979289.0\n4.0\n0.5\n")
        archive.writestr("p2/EDA.csv", "1714989289.0\n4.0\n0.7\n")
    with pytest.raises(ConfigError, match="several recordings"):
        read(tmp_path / "a.zip")


def test_a_zip_of_something_else_is_told(tmp_path):
    """No E4's files in it, or no zip at all."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("letter.txt", "hello")
    with pytest.raises(ConfigError, match=r"a\.zip: none of ACC\.csv"):
        read(tmp_path / "a.zip")
    (tmp_path / "b.zip").write_text("no zip")
    with pytest.raises(ConfigError, match=r"b\.zip"):
        read(tmp_path / "b.zip")


RANGES = {"physicalMin": -16.0, "physicalMax": 16.0, "digitalMin": -32768.0, "digitalMax": 32767.0}


@pytest.mark.parametrize(
    ("version", "imu", "g_per_count"), [((6, 4, 0), RANGES, 32 / 65535), ((6, 5, 0), {"conversionFactor": 0.5}, 0.5)]
)
def test_an_embrace_plus(tmp_path, version, imu, g_per_count):
    """Acceleration by the ranges or the factor of its schema, UTC in us, tags; a sensor that was off is left out."""
    counts = [[2048, 0], [0, -4096], [1, 2]]
    sensors = {"accelerometer": (64.0, counts), "eda": (4.0, [0.25, 0.5, 1.0]), "tags": [make.START_NS // 1000 + 1500]}
    streams, events = read(make.embrace_plus(tmp_path / "1-1_1714979289.avro", version, imu, **sensors))
    assert streams.keys() == {"accelerometer", "eda"}
    acceleration = streams["accelerometer"]
    assert acceleration.values == pytest.approx(np.transpose(counts) * g_per_count * 9.80665, rel=1e-6)
    assert (acceleration.times_ns - make.START_NS).tolist() == [0, 15_625_000]
    assert streams["eda"].values[:, 0].tolist() == [0.25, 0.5, 1.0]
    assert (streams["eda"].stream.unit, streams["eda"].stream.sampling_frequency_hz) == ("uS", 4)
    assert [(each.time_ns, each.name) for each in events] == [(make.START_NS + 1_500_000, "tag")]


def test_an_avro_file_of_nothing_is_told(tmp_path):
    """All sensors off, another program's record, no Avro at all."""
    with pytest.raises(ConfigError, match=r"off\.avro: nothing in accelerometer, bvp, eda, temperature"):
        read(make.embrace_plus(tmp_path / "off.avro", (6, 4, 0), RANGES))
    with (tmp_path / "other.avro").open("wb") as file:
        fastavro.writer(file, {"type": "record", "name": "A", "fields": []}, [{}])
    (tmp_path / "none.avro").write_text("no Avro")
    for name in ("other", "none"):
        with pytest.raises(ConfigError, match=rf"{name}\.avro: no Avro file of an EmbracePlus"):
            read(tmp_path / f"{name}.avro")


def test_the_real_e4(shared_data):
    """Four signals, each at its own rate, from the same second on."""
    streams, _ = read(shared_data / "e4" / "flirt")
    rates = {kind: each.stream.sampling_frequency_hz for kind, each in streams.items()}
    assert rates == {"accelerometer": 32, "ppg": 64, "eda": 4, "temperature": 4}
    assert {int(each.times_ns[0]) for each in streams.values()} == {1_560_279_825_000_000_000}


def test_a_real_polar_recording_keeps_the_sensors_stamps_to_the_nanosecond(shared_data):
    """They are more than a double holds; rates are those of the device's own clock."""
    streams, _ = read(shared_data / "polar" / "verity_sense" / "Polar_Sense_PPG.txt")
    assert streams["ppg"].times_ns[:2].tolist() == [704201975160879838, 704201975179146386]
    assert streams["ppg"].stream.sampling_frequency_hz == pytest.approx(54.75, abs=0.01)
    assert streams["ppg"].stream.channel_names == ("ppg_0", "ppg_1", "ppg_2", "ambient")


@pytest.mark.parametrize("record", ["mitdb/100", "../multimodal/mimicdb/03700181", "../multimodal/cinc2015/a103l"])
def test_real_wfdb_records_are_read_as_wfdb_reads_them(shared_data, record):
    """Every sample of the first signal, in the header's unit, at its own rate."""
    wfdb = pytest.importorskip("wfdb")
    path = shared_data / "ecg" / record
    expected = wfdb.rdrecord(str(path), smooth_frames=False).e_p_signal[0]
    streams, _ = read(f"{path}.hea", "ecg: 0")
    np.testing.assert_allclose(streams["ecg"].values[:, 0], 1000 * expected, atol=1e-6)


COLUMNS = (
    ("emg/biosppy/emg.txt", {}, {"emg": 1000}),
    ("eeg/biosppy/eeg_ec.txt", {}, {"eeg": 125}),
    (
        "multimodal/neurokit/bio_resting_5min_100hz.csv",
        {"sampling_frequency_hz": 100.0},
        {"ecg": 100, "ppg": 100, "respiration": 100},
    ),
    (
        "multimodal/physiokit/P11_baseline_1675943915_070305.csv",
        {"time_column": "arduino_ts", "time_unit": "ms"},
        {"eda": 275.16, "respiration": 275.16, "ppg": 275.16},
    ),
    (
        "eeg/muse/P300_subject1_session1_data_2017-02-04-15_45_13.csv",
        {"time_column": "timestamps", "streams": ("eeg: TP9, AF7, AF8, TP10 [uV]",)},
        {"eeg": 256.03},
    ),
)


@pytest.mark.parametrize(("form", "absent"), [("16", -32768), ("212", -2048), ("80", -128)])
def test_every_sample_of_a_wfdb_record_is_read_as_wfdb_reads_it(tmp_path, form, absent):
    """An odd number of them, one absent: as many, that one NaN; what a file has beyond its header's number is none."""
    wfdb = pytest.importorskip("wfdb")
    counts = np.arange(-50, 51)[:, None]
    counts[3] = absent
    more = {"fs": 250, "units": ["mV"], "sig_name": ["ECG"], "adc_gain": [200.0], "baseline": [0]}
    wfdb.wrsamp("r", d_signal=counts, fmt=[form], write_dir=str(tmp_path), **more)
    expected = wfdb.rdrecord(str(tmp_path / "r")).p_signal * 1000
    assert len(expected) == 101
    np.testing.assert_allclose(read(tmp_path / "r.hea")[0]["ecg"].values, expected, equal_nan=True)
    header = tmp_path / "r.hea"
    header.write_bytes(
        header.read_text().replace(" 101\n", " 90\n").encode() + "# von Mustermann, \u00e4lter\n".encode("cp1252")
    )
    np.testing.assert_allclose(read(header)[0]["ecg"].values, expected[:90], equal_nan=True)


LAYOUT = ("V", "II", "RESP", "PLETH")


def steps(streams, kind):
    """Times in quarters of a second from the file's date."""
    return ((streams[kind].times_ns - 1_714_979_289_000_000_000) / 250_000_000).tolist()


def test_the_segments_of_a_wfdb_record_are_where_they_belong(tmp_path):
    """Every segment has all signals, by number, each with a gain of its own; `~` is a gap of its length."""
    make.segment(tmp_path, "r_1", {"II": (10, "mV", [10, 20, 30]), "RESP": (1, "NU", [1, 2, 3])})
    make.segment(tmp_path, "r_2", {"II": (100, "mV", [-100, 500]), "RESP": (1, "NU", [4, 5])})
    (tmp_path / "r.hea").write_text("r/4 2 4 25 07:08:09 06/05/2024\nr_1 3\n~ 10\nr_2 2\n~ 10\n")
    streams, _ = read(tmp_path / "r.hea")
    assert steps(streams, "ecg") == steps(streams, "respiration") == [0, 1, 2, 13, 14]
    np.testing.assert_allclose(streams["ecg"].values[:, 0], [1000, 2000, 3000, -1000, 5000])
    assert streams["respiration"].values[:, 0].tolist() == [1, 2, 3, 4, 5]
    assert streams["ecg"].stream.sampling_frequency_hz == 4


def test_a_segment_of_a_variable_layout_has_a_few_of_its_signals(tmp_path):
    """By name, in any order; where it has none of a stream's channels that has no samples, a channel alone has NaN."""
    (tmp_path / "lay.hea").write_text("lay 4 4 0\n" + "".join(f"~ 0 10/mV 0 0 0 0 0 {name}\n" for name in LAYOUT))
    make.segment(tmp_path, "a", {"V": (10, "mV", [10, 20]), "II": (10, "mV", [30, 40])})
    make.segment(tmp_path, "b", {"RESP": (1, "mV", [7, 8, 9])})
    make.segment(tmp_path, "c", {"II": (20, "mV", [20, 20, 40])})
    (tmp_path / "r.hea").write_text("r/5 4 4 9 07:08:09 06/05/2024\nlay 0\na 2\nb 3\n~ 1\nc 3\n")
    streams, _ = read(tmp_path / "r.hea", "ecg: II, V", "respiration: RESP [a.u.]")
    assert steps(streams, "ecg") == [0, 1, 6, 7, 8]
    expected = [[3000, 1000], [4000, 2000], [1000, np.nan], [1000, np.nan], [2000, np.nan]]
    np.testing.assert_allclose(streams["ecg"].values, expected, equal_nan=True)
    assert (steps(streams, "respiration"), streams["respiration"].values[:, 0].tolist()) == ([2, 3, 4], [7, 8, 9])
    wfdb = pytest.importorskip("wfdb")
    theirs = wfdb.rdrecord(str(tmp_path / "r")).p_signal[:, [1, 0]] * 1000
    np.testing.assert_allclose(theirs[[0, 1, 6, 7, 8]], expected, equal_nan=True)
    assert np.isnan(theirs[2:6]).all()


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("r/2 1 4 5\nr_1 3\n", "2 segments are announced, 1 are there"),
        ("r/1 1 8 3\nr_1 3\n", "r_1.hea: must be a plain record of the rate of r.hea"),
        ("r/1 1 4 3\nr 3\n", "r.hea: must be a plain record of the rate of r.hea"),
        ("r/2 1 4 6\nr_1 3\nr_2 3\n", "II has another unit or rate in another segment"),
        ("r/1 1 4 3\n~ 3\n", "the record has no signals"),
        ("r/1 1 4 3\n../r_1 3\n", "names '../r_1.hea', which is not in its folder"),
    ],
)
def test_segments_that_make_no_record_are_told(tmp_path, header, said):
    """One sentence that names the file."""
    make.segment(tmp_path, "r_1", {"II": (10, "mV", [10, 20, 30])})
    make.segment(tmp_path, "r_2", {"II": (10, "uV", [10, 20, 30])})
    (tmp_path / "r.hea").write_text(header)
    with pytest.raises(ConfigError, match=re.escape(said)):
        read(tmp_path / "r.hea")


@pytest.mark.parametrize(("file", "more", "kinds"), COLUMNS, ids=[file.partition("/")[2] for file, _, _ in COLUMNS])
def test_real_columns_are_played_at_their_rate(shared_data, file, more, kinds):
    """What the file tells of its rate, or its own clock; two seconds of frames hold two seconds of samples."""
    config = FileConfig(sensor_id="file_1", file=str(shared_data / file), **more)
    recorded, _ = transport.read(config)
    rates = {each.sensor_type: each.stream.sampling_frequency_hz for each in recorded}
    assert rates == pytest.approx(kinds, abs=0.01)
    tape, counts = Tape(recorded, (), config), dict.fromkeys(kinds, 0)
    for item in (item for frame in range(20) for item in tape.items(frame, 0) if isinstance(item, Samples)):
        counts[item.sensor_type] += len(item.chunk.samples)
    assert counts == pytest.approx({kind: 2 * rate for kind, rate in kinds.items()}, abs=3)

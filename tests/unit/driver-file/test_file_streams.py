"""driver-file: which columns of a file become which stream, in which unit, and what is said of those that cannot."""

import re

import numpy as np
import pytest
import signal_file_makers as make
from driver_file import transport
from driver_file.config import FileConfig
from sense4hri.errors import ConfigError, DeviceLost
from sense4hri.signal_files.choice import Column, Wanted, parse

STEPS = np.arange(20)


def config(file, *streams, **more):
    return FileConfig(sensor_id="file_1", file=str(file), streams=streams, **more)


def read(file, *streams, **more):
    """Return the streams by sensor type."""
    recorded, _ = transport.read(config(file, *streams, **more))
    return {each.sensor_type: each for each in recorded}


def columns(folder, text):
    (folder / "a.csv").write_text(text)
    return folder / "a.csv"


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("ecg", Wanted("ecg")),
        ("ecg: MLII, V5", Wanted("ecg", (Column("MLII", ""), Column("V5", "")))),
        ("eda: 2 [uS] * 0.01", Wanted("eda", (Column("2", ""),), "uS", 0.01)),
        ("eeg: EEG *[mV]", Wanted("eeg", (Column("EEG *", ""),), "mV")),
        ("accelerometer: ACC X as x", Wanted("accelerometer", (Column("ACC X", "x"),))),
    ],
)
def test_an_entry_says_type_columns_names_unit_and_factor(entry, expected):
    """Everything but the type may be left out."""
    assert parse(entry) == expected


@pytest.mark.parametrize("entry", ["", "ECG: I", "ecg: I [uV", "ecg I", "eda: 1 * -", "a__b: 1"])
def test_what_is_no_entry_is_quoted(entry):
    """A mistyped entry ends the driver before a file is opened, and is shown as it was written."""
    with pytest.raises(ValueError, match="streams"):
        config("x", entry)


def test_a_type_twice_is_refused():
    """A sensor has one stream of a type."""
    with pytest.raises(ValueError, match="at most once"):
        config("x", "ecg: I", "ecg: II")


def test_units_become_canonical_once(tmp_path):
    """mV, g, degrees and a factor of the study's are scaled to uV, m/s^2 and rad/s; nothing is rounded."""
    file = columns(tmp_path, "I,X,Y,Z,T\n0.001,1,0,-1,180\n0.002,1,0,-1,90\n")
    streams = read(
        file, "ecg: I [mV]", "accelerometer: X, Y, Z [g]", "gyroscope: T as x [deg/s] * 2", sampling_frequency_hz=10
    )
    assert streams["ecg"].stream.unit == "uV"
    assert streams["ecg"].values[:, 0].tolist() == [1.0, 2.0]
    assert streams["accelerometer"].values[0].tolist() == [9.80665, 0, -9.80665]
    assert streams["accelerometer"].stream.channel_names == ("x", "y", "z")
    assert streams["gyroscope"].values[:, 0] == pytest.approx([2 * np.pi, np.pi])


@pytest.mark.parametrize(("values", "unit"), [("1\n2\n", "counts"), ("1.5\n2\n", "a.u.")])
def test_an_unknown_scale_is_told(tmp_path, values, unit):
    """Whole numbers of no unit are counts, fractions a.u.; nobody makes microvolts of them."""
    assert read(columns(tmp_path, values), "ecg: 0", sampling_frequency_hz=10)["ecg"].stream.unit == unit


def test_names_tell_the_streams(tmp_path):
    """ECG, PPG and RSP of a file that nobody described become these streams; channel names are the contract's."""
    streams = read(columns(tmp_path, "ECG,PPG,RSP,what\n1,2,3,4\n1,2,3,4\n"), sampling_frequency_hz=10)
    assert {kind: each.stream.channel_names for kind, each in streams.items()} == {
        "ecg": ("ECG",),
        "ppg": ("ppg_0",),
        "respiration": ("respiration",),
    }


def test_a_column_of_times_is_the_clock(tmp_path):
    """Its stamps are kept as they are, also across a gap; the rate is that of the other steps."""
    rows = "".join(f"{at},1\n" for at in [*range(0, 400, 4), *range(1000, 1400, 4)])
    stream = read(columns(tmp_path, f"t,ECG\n{rows}"), time_column="t", time_unit="ms")["ecg"]
    assert stream.stream.sampling_frequency_hz == pytest.approx(250)
    assert np.diff(stream.times_ns)[98:101].tolist() == [4_000_000, 604_000_000, 4_000_000]


def test_times_of_no_rate_are_irregular(tmp_path):
    """Steps that differ from each other make a stream of the rate 0."""
    rows = "".join(f"{at},1\n" for at in (0, 1, 5, 6, 20, 21, 60))
    assert read(columns(tmp_path, f"t,EDA\n{rows}"), time_column="t")["eda"].stream.sampling_frequency_hz == 0


def test_what_a_comment_says_is_heard(tmp_path):
    """The sampling rate and labels of a BioSPPy file."""
    file = columns(tmp_path, "# Simple Text Format\n# Sampling Rate (Hz):= 500.00\n# Labels:= EMG\n1\n2\n3\n")
    assert read(file)["emg"].stream.sampling_frequency_hz == 500


def test_a_last_row_that_was_cut_off_is_left_out(tmp_path):
    """The program that wrote it was ended; what is before is whole."""
    assert len(read(columns(tmp_path, "EDA,x\n1,1\n2,2\n3"), "eda: x", sampling_frequency_hz=4)["eda"].values) == 2


@pytest.mark.parametrize(
    ("text", "streams", "more", "said"),
    [
        ("x,ECG\n1,2\n", ("ecg: y",), {"sampling_frequency_hz": 10}, "no column 'y'; there are x, ECG"),
        ("x,ECG\n1,2\n1,oops\n1,2\n", (), {"sampling_frequency_hz": 10}, "line 3: column 'ECG' holds 'oops'"),
        ("x,ECG\n1,2\n1\n1,2\n", (), {"sampling_frequency_hz": 10}, "line 3: column 'ECG' is missing"),
        ("x,y\n1,2\n", (), {"sampling_frequency_hz": 10}, "does not tell what its columns are, say it: x, y"),
        ("x,ECG\n1,2\n", (), {}, "sampling_frequency_hz or time_column.*x, ECG"),
        ("x,ECG\n1,2\n", ("ecg: ECG [bar]",), {"sampling_frequency_hz": 10}, "unit 'bar' cannot become one of uV"),
        ("# nothing\n", (), {}, "no data"),
        ("x,ECG\n1,2\n", (), {"time_column": "t"}, "no column 't'; there are x, ECG"),
    ],
)
def test_what_cannot_be_is_one_sentence(tmp_path, text, streams, more, said):
    """A file that lacks what is asked for ends the driver with the file, the line and the column."""
    file = columns(tmp_path, text)
    with pytest.raises(ConfigError, match=said) as caught:
        read(file, *streams, **more)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_a_device_that_is_away(tmp_path):
    """It is waited for, as for a sensor that is switched off."""
    with pytest.raises(DeviceLost, match="is not there"):
        read(tmp_path / "later.edf")


@pytest.mark.parametrize("name", ["a.edf", "a.bdf", "a.hea", "a.what"])
def test_what_is_no_recording_is_told_with_its_name(tmp_path, name):
    """Bytes of something else end the driver, they do not crash it."""
    (tmp_path / name).write_bytes(bytes(range(256)) * 4)
    with pytest.raises(ConfigError, match=name):
        read(tmp_path / name)


def test_edf_channels_of_several_rates_and_annotations(tmp_path):
    """Each keeps its rate and unit, all begin at the file's own date; an annotation is an event at its time."""
    signals = {
        "ECG": (100, "uV", np.arange(200)),
        "EDA": (10, "uS", np.arange(20)),
        "Fp1": (100, "mV", -np.arange(200)),
    }
    file = make.edf(tmp_path / "a.edf", signals, [(0.5, "stimulus")])
    recorded, content = transport.read(config(file))
    streams = {each.sensor_type: each for each in recorded}
    assert {kind: each.stream.sampling_frequency_hz for kind, each in streams.items()} == {
        "ecg": 100,
        "eeg": 100,
        "eda": 10,
    }
    assert [each.times_ns[0] for each in recorded] == [make.START_NS] * 3
    np.testing.assert_allclose(streams["eeg"].values[:, 0], -1000.0 * np.arange(200))
    assert [(event.time_ns - make.START_NS, event.name) for event in content.events] == [(500_000_000, "stimulus")]


@pytest.mark.parametrize("streams", [(), ("eeg: *",)])
def test_an_edf_of_annotations_alone_is_told_so(tmp_path, streams):
    """A file of hypnogram stages has no signal that they could be played beside."""
    file = make.edf(tmp_path / "stages.edf", {}, [(0.0, "Sleep stage W"), (30.0, "Sleep stage 1")])
    with pytest.raises(ConfigError, match=r"file: .*stages.edf holds 2 markers and no signal: ") as caught:
        read(file, *streams)
    assert str(caught.value).endswith("give the file that was recorded beside it")


def test_an_edf_may_begin_within_a_second(tmp_path):
    """The fraction that an EDF+ tells in its first annotation is a fraction of a second, to 100 ns."""
    file = make.edf(tmp_path / "a.edf", {"ECG": (100, "uV", np.arange(100))})
    octets = file.read_bytes()
    assert octets.count(b"+0\x14\x14" + bytes(9)) == 1
    file.write_bytes(octets.replace(b"+0\x14\x14" + bytes(9), b"+0.2500001\x14\x14" + bytes(1)))
    assert read(file)["ecg"].times_ns[0] == make.START_NS + 250_000_100


@pytest.mark.parametrize("suffix", ["edf", "bdf"])
def test_a_hole_of_an_edf_d_is_a_hole(tmp_path, suffix):
    """Each data record is when its first annotation says, with nothing between them; events have their times too."""
    most = (1 << (15 if suffix == "edf" else 23)) - 1
    channels = {"ECG": ("mV", 1.0), "EDA": ("uS", 0.001)}
    records = [
        ("+0.25||~", [[0, -1, most, -most], [-7, 9]]),
        ("+1.25||~+1.5\x150.5|cue|and more|~", [[5, 6, 7, 8], [1, 2]]),
        ("+61.2500001||~-0.5|before|~", [[9, 10, 11, 12], [3, 4]]),
    ]
    recorded, content = transport.read(config(make.edf_d(tmp_path / f"a.{suffix}", channels, records)))
    ecg, eda = recorded
    assert [(each.stream.sampling_frequency_hz, each.stream.unit) for each in recorded] == [(4.0, "uV"), (2.0, "uS")]
    begun_ns = [250_000_000, 1_250_000_000, 61_250_000_100]
    step_ns = 250_000_000
    assert (ecg.times_ns - make.START_NS).tolist() == [at + step * step_ns for at in begun_ns for step in range(4)]
    assert (eda.times_ns - make.START_NS).tolist() == [at + step * 2 * step_ns for at in begun_ns for step in range(2)]
    np.testing.assert_allclose(ecg.values[:, 0] / 1000, [0, -1, most, -most, 5, 6, 7, 8, 9, 10, 11, 12], 1e-5, 1e-9)
    np.testing.assert_allclose(eda.values[:, 0], np.array([-7, 9, 1, 2, 3, 4]) / 1000, 1e-5)
    told = [(event.time_ns - make.START_NS, event.name) for event in content.events]
    assert told == [(1_500_000_000, "cue"), (1_500_000_000, "and more"), (-500_000_000, "before")]
    assert not content.notes


@pytest.mark.parametrize("suffix", ["edf", "bdf"])
def test_an_edf_d_without_a_hole_is_what_the_same_edf_c_is(tmp_path, suffix):
    """pyedflib reads the same streams and events in it once the header says that there is no gap."""
    counts = np.random.default_rng(1).integers(-30000, 30000, (6, 14)).tolist()
    told = [f"+{at}.25||~+{at}.5|cue {at}|~" for at in range(6)]
    records = [(text, [values[:10], values[10:]]) for text, values in zip(told, counts, strict=True)]
    file = make.edf_d(tmp_path / f"a.{suffix}", {"ECG": ("mV", 1.0), "EDA": ("uS", 0.001)}, records)
    ours, content = transport.read(config(file))
    file.write_bytes(file.read_bytes().replace(b"DF+D", b"DF+C", 1))
    theirs, same = transport.read(config(file))
    assert [each.stream for each in ours] == [each.stream for each in theirs]
    assert all(np.array_equal(one.times_ns, other.times_ns) for one, other in zip(ours, theirs, strict=True))
    assert all(np.allclose(one.values, other.values) for one, other in zip(ours, theirs, strict=True))
    assert sorted(content.events) == sorted(same.events)


@pytest.mark.parametrize("suffix", [".edf", ".bdf"])
@pytest.mark.parametrize("is_plus", [True, False])
@pytest.mark.parametrize("announced", [b"10      ", b"-1      "])
def test_an_edf_whose_recorder_was_killed_is_played_as_far_as_it_goes(tmp_path, suffix, is_plus, announced):
    """Cut off within its eighth record, its header with the count of records or still without: seven are played."""
    kinds = {(".edf", True): 1, (".edf", False): 0, (".bdf", True): 3, (".bdf", False): 2}
    signals = {"EEG Cz": (100, "uV", np.arange(1000) % 900), "ECG": (50, "mV", np.arange(500) % 900)}
    file = make.edf(tmp_path / f"a{suffix}", signals, [(1.5, "cue")] if is_plus else [], kinds[suffix, is_plus])
    whole, content = read(file), transport.read(config(file))[1]
    octets = file.read_bytes()
    head = 256 * (int(octets[252:256]) + 1)
    record = (len(octets) - head) // 10
    file.write_bytes(octets[:236] + announced + octets[244 : head + 7 * record + 11])
    recorded, cut = transport.read(config(file))
    for each in recorded:
        length = round(7 * each.stream.sampling_frequency_hz)
        expected = whole[each.sensor_type]
        assert (each.stream, each.times_ns.tolist()) == (expected.stream, expected.times_ns[:length].tolist())
        np.testing.assert_allclose(each.values, expected.values[:length], rtol=1e-9, atol=1e-9)
    assert [event.name for event in cut.events] == [event.name for event in content.events]
    assert cut.notes == (("it ends after 7 of its 10 data records",) if announced[:2] == b"10" else ())


def test_triggers_of_a_bdf_with_gaps_are_events(tmp_path):
    """Each new code when it began, across the gap too; in an EDF a channel of that name is none of a BioSemi's."""
    records = [("+0||~", [[0] * 4, [0, 7, 7, 0]]), ("+5||~", [[0] * 4, [7, 7, 9, 9]])]
    for suffix, expected in ((".bdf", [(250, "7"), (5000, "7"), (5500, "9")]), (".edf", [])):
        file = make.edf_d(tmp_path / f"a{suffix}", {"EEG Cz": ("uV", 1), "Status": ("", 1)}, records)
        events = transport.read(config(file))[1].events
        assert [((each.time_ns - make.START_NS) // 1_000_000, each.name) for each in events] == expected


def test_an_edf_d_that_is_cut_or_has_no_time_is_told(tmp_path):
    """What is whole is played, and a note says how much that is; a record that does not tell its time is none."""
    ecg = {"ECG": ("mV", 1.0)}
    file = make.edf_d(tmp_path / "a.edf", ecg, [("+0||~", [[1, 2]]), ("+9||~", [[3, 4]])])
    file.write_bytes(file.read_bytes()[:-1])
    recorded, content = transport.read(config(file))
    assert len(recorded[0].values) == 2
    assert content.notes == ("it ends after 1 of its 2 data records",)
    make.edf_d(file, ecg, [("+0||~", [[1, 2]]), ("+9|cue|~", [[3, 4]])])
    with pytest.raises(ConfigError, match=r"a.edf: data record 1 does not tell when it began"):
        read(file)


def test_a_wfdb_record_of_several_rates(tmp_path):
    """Signals of one rate are channels of one stream, and the unit is the header's."""
    file = make.wfdb(
        tmp_path / "r",
        {"I": (50, "mV", np.arange(100)), "II": (50, "mV", np.arange(100)), "RESP": (5, "NU", np.arange(10))},
    )
    streams = read(file)
    assert streams["ecg"].stream.channel_names == ("I", "II")
    np.testing.assert_allclose(streams["ecg"].values[:, 1], np.arange(100) * 1000.0)
    assert (streams["respiration"].stream.sampling_frequency_hz, streams["respiration"].stream.unit) == (5, "a.u.")


@pytest.mark.parametrize(
    ("form", "octets", "there"), [("16", 43, 10), ("16+3", 43, 10), ("16x2", 43, 5), ("80", 43, 21), ("212", 43, 14)]
)
def test_a_wfdb_record_shorter_than_its_header_says_is_told(tmp_path, form, octets, there):
    """What is there is played, and a note says how much that is; of a record that is whole there is none."""
    for frames in (25, there):
        (tmp_path / "r.hea").write_text(f"r 2 250 {frames}\n" + f"r.dat {form} 200/mV 12 0 0 0 0 ECG\n" * 2)
        (tmp_path / "r.dat").write_bytes(bytes(octets))
        recorded, content = transport.read(config(tmp_path / "r.hea"))
        assert len(recorded[0].values) == there * (2 if "x2" in form else 1)
        assert content.notes == ((f"it ends after {there} of its 25 frames",) if frames == 25 else ())


def test_two_signals_of_a_wfdb_record_that_are_described_alike_are_two(tmp_path):
    """As in PhysioNet's long-term AF database, whose leads are both `ECG`: each has its own samples."""
    counts = np.array([[1, 100], [2, 200], [3, 300]])
    (tmp_path / "r.dat").write_bytes(counts.astype("<i2").tobytes())
    (tmp_path / "r.hea").write_text("r 2 250 3\n" + "r.dat 16 200/mV 12 0 0 0 0 ECG\n" * 2)
    np.testing.assert_allclose(read(tmp_path / "r.hea")["ecg"].values, counts * 1000 / 200)


@pytest.mark.parametrize("first", ["0", ""])
def test_an_empty_first_cell_shifts_nothing(tmp_path, first):
    """Neither the empty name that a table's row numbers have, nor an absent row number: each column is its own."""
    file = columns(tmp_path, f"\tecg\teda\n{first}\t100.0\t1.5\n1\t101.0\t1.6\n")
    streams = read(file, sampling_frequency_hz=10)
    assert streams["ecg"].values[:, 0].tolist() == [100, 101]
    assert streams["eda"].values[:, 0].tolist() == [1.5, 1.6]


def test_a_separator_at_the_end_of_lines_is_no_column(tmp_path):
    """Of names, of rows, or of both."""
    for text in ("ecg\teda\t\n1\t2\t\n", "ecg\teda\n1\t2\t\n", "ecg\teda\t\n1\t2\n"):
        assert read(columns(tmp_path, text), sampling_frequency_hz=10)["eda"].values.tolist() == [[2.0]]


def test_names_that_are_not_one_for_each_column_are_refused(tmp_path):
    """Nobody knows which column the first name belongs to."""
    with pytest.raises(ConfigError, match=r"a\.csv: 2 names \(ecg, eda\) over a row of 3 cells"):
        read(columns(tmp_path, "ecg,eda\n0,100,1.5\n"), sampling_frequency_hz=10)


def test_each_channel_is_scaled_by_its_own_unit(tmp_path):
    """Of two leads, one in mV and one in uV, both become uV."""
    file = make.wfdb(tmp_path / "r", {"I": (50, "mV", np.full(100, 1)), "V1": (50, "uV", np.full(100, 1000))})
    ecg = read(file)["ecg"]
    assert (ecg.stream.unit, ecg.values[0].tolist()) == ("uV", [1000, 1000])


@pytest.mark.parametrize(
    ("streams", "text"), [((), "x,GSR (kOhm)\n1,100\n1,50\n1,0"), (["eda: 0 [ohm] * 100"], "a\n1e3\n500\n-1")]
)
def test_a_skins_resistance_is_played_as_conductance(tmp_path, streams, text):
    """uS by its column's name or the study's word, which may give a factor; what no resistance can be is NaN."""
    eda = read(columns(tmp_path, text + "\n"), *streams, sampling_frequency_hz=4)["eda"]
    assert eda.stream.unit == "uS"
    assert np.allclose(eda.values[:, 0], [10, 20, np.nan], equal_nan=True)


@pytest.mark.parametrize("unit", ["adu", "bar"])
def test_channels_that_do_not_become_one_unit_are_refused(tmp_path, unit):
    """One stream has one unit; the operator says which, or takes fewer columns."""
    file = make.wfdb(tmp_path / "r", {"I": (50, "mV", np.arange(100)), "V1": (50, unit, np.arange(100))})
    with pytest.raises(ConfigError, match=f"units that do not become one: mV, {unit}"):
        read(file)
    assert read(file, "ecg: I")["ecg"].stream.unit == "uV"


@pytest.mark.parametrize(
    ("names", "row", "expected"),
    [
        ("timestamp [ms];ecg [uV]", "0.0;-7", {"ecg": [-7]}),
        ("X [mg];Y [mg];Z [mg]", "1000;0;0", {"accelerometer": [9.80665, 0, 0]}),
        ("channel 0;channel 1;channel 2;ambient", "1;2;3;4", {"ppg": [1, 2, 3, 4]}),
        ("", "", {}),
        ("RR-interval [ms];HR [bpm]", "800;75", {}),
    ],
)
def test_polar_logger_files_are_what_their_units_and_channels_say(tmp_path, names, row, expected):
    """The phone's column of times is no channel, and only a PPG's own channels make a PPG."""
    head = f"Phone timestamp;sensor timestamp [ns];{names}\n"
    rows = "".join(f"2023-01-01T00:00:00.0;{at};{row}\n" for at in (10**17, 10**17 + 10**7, 10**17 + 2 * 10**7))
    file = columns(tmp_path, head + rows)
    if not expected:
        with pytest.raises(ConfigError, match=r"a\.csv"):
            read(file)
    else:
        assert {kind: each.values[0].tolist() for kind, each in read(file).items()} == expected


def test_a_polar_logger_file_may_be_cut_or_hold_odd_bytes(tmp_path):
    """Its last row is left out, and the phone's text is not read."""
    rows = "".join(f"2023\u20ac;{at};5\n" for at in (10**17, 10**17 + 10**7))
    text = f"Phone timestamp;sensor timestamp [ns];ecg [uV]\n{rows}2023-0"
    (tmp_path / "a.txt").write_bytes(text.encode("cp1252"))
    assert read(tmp_path / "a.txt")["ecg"].values.tolist() == [[5], [5]]


@pytest.mark.parametrize("head", ["", "time,ecg\n", "# sampling rate 100\ntime,ecg\n"])
def test_the_mark_before_excels_text_is_no_part_of_it(tmp_path, head):
    """A file of Excel's "CSV UTF-8": its first name is the first name, its first row is a sample."""
    file = tmp_path / "a.csv"
    file.write_text(head + "0,10\n0.01,11\n0.02,12\n", encoding="utf-8-sig")
    clock = "time" if head else "0"
    ecg = read(file, "ecg: 1", time_column=clock)["ecg"]
    np.testing.assert_array_equal(ecg.values[:, 0], [10, 11, 12])


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ('0.01,"1,000"', "line 3: column 'ecg' holds '1,000'"),
        ("0.01,1,000", "line 3: 3 numbers in 2 columns"),
        ("0,01,1,5", "line 3: 4 numbers in 2 columns"),
    ],
)
def test_a_comma_of_thousands_or_decimals_is_told(tmp_path, row, said):
    """A number is whole or refused, and no later column is shifted, whatever the first row looks like."""
    file = tmp_path / "a.csv"
    file.write_text(f"time,ecg\n0,999\n{row}\n0.02,998\n")
    with pytest.raises(ConfigError, match=re.escape(said)):
        read(file, time_column="time")


def test_quoted_cells_may_hold_the_separator(tmp_path):
    """Names and remarks in quotes are a cell each; the numbers behind them stay in their columns."""
    file = tmp_path / "a.csv"
    file.write_text('"time, s","remark","ECG, mV"\n0,"so, so",1\n0.01,"",2\n0.02,"well",3\n')
    ecg = read(file, "ecg: 2 [mV]", time_column="time, s")["ecg"]
    np.testing.assert_array_equal(ecg.values[:, 0], [1000, 2000, 3000])


def test_channels_of_one_name_are_all_played(tmp_path):
    """The second of two that the recorder called alike has its number in its name, as in driver-lsl."""
    names, values = ["EMG", "EMG"], np.arange(20).reshape(10, 2)
    emg = read(make.xdf(tmp_path / "a.xdf", 100, names, values, []), "emg: *")["emg"]
    assert emg.stream.channel_names == ("EMG", "EMG_1")
    np.testing.assert_array_equal(emg.values, values)
    file = columns(tmp_path, "t,ECG,ECG\n0,1,7\n1,2,8\n2,3,9\n")
    assert read(file, time_column="t")["ecg"].values.tolist() == [[1, 7], [2, 8], [3, 9]]
    assert read(file, "ecg: ECG_2", time_column="t")["ecg"].values.tolist() == [[7], [8], [9]]


@pytest.mark.parametrize(
    ("name", "unit", "value"),
    [
        ("ECG (mV)", "uV", 2000),
        ("ECG [uV]", "uV", 2),
        ("ECG [\u00b5V]", "uV", 2),
        ("ECG (lead II)", "counts", 2),
        ("ECG (1)", "counts", 2),
    ],
)
def test_a_column_may_be_named_with_its_unit(tmp_path, name, unit, value):
    """What stands in brackets at its end is the unit where it is one; the study's own word wins."""
    file = columns(tmp_path, "x,X (m/s^2)\n1,2\n1,2\n")
    assert read(file, "accelerometer: 1", sampling_frequency_hz=10)["accelerometer"].stream.unit == "m/s^2"
    file = columns(tmp_path, f"x,{name}\n1,2\n1,2\n")
    ecg = read(file, sampling_frequency_hz=10)["ecg"]
    assert (ecg.stream.unit, ecg.values[0, 0]) == (unit, value)
    assert read(file, "ecg: 1 [V]", sampling_frequency_hz=10)["ecg"].values[0, 0] == 2e6


def test_a_rate_with_a_comma_of_thousands_is_not_taken_for_one_hertz(tmp_path):
    """Nobody is told a rate of 1 Hz by `1,000 Hz`; a comma behind the rate is none of it."""
    with pytest.raises(ConfigError, match="does not tell its rate"):
        read(columns(tmp_path, "# Sampling rate: 1,000 Hz\nECG\n1\n2\n"))
    file = columns(tmp_path, '# {"sampling rate": 1000,"column": ["ECG"]}\n1\n2\n')
    assert read(file)["ecg"].stream.sampling_frequency_hz == 1000


def test_text_columns_may_be_called_dat(tmp_path):
    """Without a WFDB header beside it a `.dat` of text is columns; one of bytes waits for its header."""
    file = tmp_path / "a.dat"
    file.write_text("t ECG\n0 1\n1 2\n2 3\n")
    assert read(file, time_column="t")["ecg"].values.tolist() == [[1], [2], [3]]
    file.write_bytes(bytes(100))
    with pytest.raises(DeviceLost, match=r"a\.hea"):
        read(file)


@pytest.mark.parametrize("head", ["t;ECG\n", ""])
def test_decimals_behind_a_comma_between_semicolons(tmp_path, head):
    """As Excel writes them where the comma is the decimal mark: every row a sample, also without names."""
    rows = "".join(
        f"{at};{value}\r\n" for at, value in (("0,000", "-1,5"), ("0,010", ""), ("0,020", "2"), ("0,030", "3e-1"))
    )
    ecg = read(columns(tmp_path, head + rows), "ecg: 1", time_column="t" if head else "0")["ecg"]
    np.testing.assert_array_equal(ecg.values[:, 0], [-1.5, np.nan, 2, 0.3])
    assert ecg.times_ns.tolist() == [0, 10_000_000, 20_000_000, 30_000_000]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_a_unit_with_a_sign_of_windows_is_the_unit(tmp_path, encoding):
    """Excel writes the micro sign and the degree in either encoding: names, units and samples are the same."""
    text = "Zeit;W\u00e4rme (\u00b0C);EDA (\u00b5S)\r\n0;30,5;0,5\r\n1;31;1,5\r\n"
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    found = read(tmp_path / "a.csv", "eda: EDA (\u00b5S)", "temperature: W\u00e4rme (\u00b0C)", time_column="Zeit")
    assert {kind: each.stream.unit for kind, each in found.items()} == {"eda": "uS", "temperature": "degC"}
    assert [each.values.tolist() for each in found.values()] == [[[0.5], [1.5]], [[30.5], [31.0]]]


def test_commas_and_points_together_are_refused(tmp_path):
    """Of `0,5` and `1.000` nobody knows whether the second is one or a thousand."""
    with pytest.raises(ConfigError, match=r"line 3: numbers with commas and with points"):
        read(columns(tmp_path, "t;ECG\n0;0,5\n1;1.000\n2;1,5\n"), time_column="t")


def test_a_column_of_dates_is_the_clock(tmp_path):
    """As pandas and R write them: with a zone or in UTC, to the us; what is no date is told, but of a row cut off."""
    for zone, offset_s in (("", 0), ("Z", 0), ("+02:00", 7200)):
        rows = "".join(f"2024-05-06 07:08:{9 + i / 4:09.6f}{zone},{i}\n" for i in range(4))
        ecg = read(columns(tmp_path, f"t,ECG\n{rows}2024-05-0"), time_column="t")["ecg"]
        assert (ecg.times_ns - make.START_NS + offset_s * 10**9).tolist() == [0, 250 * 10**6, 500 * 10**6, 750 * 10**6]
        assert (ecg.stream.sampling_frequency_hz, len(ecg.values)) == (4, 4)
    with pytest.raises(ConfigError, match="line 3: column 't' holds 'noon', no date"):
        read(columns(tmp_path, "t,ECG\n2024-05-06T07:08:09,1\nnoon,2\n"), time_column="t")

"""driver-lsl: what an outlet's XML says becomes streams with canonical units, or a sentence."""

from pathlib import Path

import numpy as np
import pytest
from driver_lsl.config import LslConfig
from driver_lsl.protocol import left_out, parse, pick
from lsl_descriptions import xml
from sense4hri import lsl
from sense4hri.errors import ConfigError, DeviceLost
from sense4hri.signal_files.choice import parse_all
from sense4hri.signal_files.units import Scale


def picked(*descriptions, streams=()):
    """Return what is picked, by sensor type."""
    return {each.sensor_type: each for each in pick([parse(text) for text in descriptions], parse_all(streams))}


@pytest.mark.parametrize(
    ("predicate", "meant"),
    [
        ("type='EEG' or type='EKG'", f"(type='EEG' or type='EKG') and not(starts-with(source_id,'{lsl.OURS}'))"),
        (f"source_id='{lsl.OURS}p1-eeg-lsl_1-raw'", f"source_id='{lsl.OURS}p1-eeg-lsl_1-raw'"),
    ],
)
def test_our_own_echo_is_no_device(predicate, meant):
    """What bridge-lsl shows fits many a predicate; it is asked for only where the predicate names it."""
    assert lsl.meant(predicate) == meant


def test_eeg_has_its_labels_and_its_volts_become_microvolts():
    """Labels are channel names, the rate is the nominal one, and the factor is the unit's."""
    (stream,) = picked(xml("EEG", [("Fp1", "volts", "EEG"), ("Fp2", "volts", "EEG")])).values()
    assert stream.stream.channel_names == ("Fp1", "Fp2")
    assert (stream.stream.unit, stream.stream.sampling_frequency_hz) == ("uV", 250.0)
    assert stream.scales == (Scale(1e6), Scale(1e6))


def test_a_skins_resistance_becomes_a_conductance():
    """The interpreter would see responses upside down: 1000 over kOhm are uS."""
    found = picked(xml("EDA", [("GSR", "kOhm", "")]))["eda"]
    assert (found.stream.unit, found.scales) == ("uS", (Scale(1e3, over=True),))


@pytest.mark.parametrize(("unit", "expected"), [("", "counts"), ("raw", "counts"), ("µV", "uV")])
def test_where_no_scale_is_known_the_unit_is_counts(unit, expected):
    """An unknown unit is no reason to guess one."""
    assert picked(xml("ECG", [("I", unit, "")]))["ecg"].stream.unit == expected


def test_an_outlet_of_several_types_becomes_a_stream_of_each():
    """OpenSignals' single outlet: each channel's own type counts; the trigger is no EEG."""
    found = picked(xml("EEG", [("C3", "uV", "EEG"), ("EDA2", "uS", "EDA"), ("trg", "", "Trigger")]))
    assert {name: each.numbers for name, each in found.items()} == {"eeg": (0,), "eda": (1,), "markers": (2,)}


@pytest.mark.parametrize("sensor_type", ["respiration", "ppg", "eda", "accelerometer", "eye_tracking", "temperature"])
@pytest.mark.parametrize("unit", ["V", "millivolts", "µV"])
@pytest.mark.parametrize("own", [True, False])
def test_a_transducer_behind_an_amplifier_is_counts(sensor_type, unit, own):
    """Its type is said, by the channel or its stream; its volts have no scale that anybody knows."""
    kind = lsl.CONTENT_TYPES[sensor_type]
    found = picked(xml("EEG" if own else kind, [("Aux 1", unit, kind if own else "")]))
    assert {name: (each.stream.unit, each.scales) for name, each in found.items()} == {
        sensor_type: ("counts", (Scale(),))
    }


UNICORN = [
    ("EEG 1", "uV", "EEG"),
    ("EEG 2", "uV", "EEG"),
    ("Accelerometer X", "g", "EEG"),
    ("Gyroscope X", "deg/s", "EEG"),
]
UNICORN += [("Counter", "", "EEG"), ("Validation Indicator", "", "EEG"), ("Battery Level", "%", "EEG")]
EPOC = [("COUNTER", "", ""), ("INTERPOLATED", "", ""), ("AF3", "microvolts", ""), ("O1", "microvolts", "")]
EPOC += [("RAW_CQ", "", ""), ("MARKER_HARDWARE", "", "")]


@pytest.mark.parametrize(
    ("channels", "numbers", "without"),
    [
        (
            UNICORN,
            {"eeg": (0, 1), "accelerometer": (2,), "gyroscope": (3,)},
            "Counter, Validation Indicator, Battery Level",
        ),
        (EPOC, {"eeg": (2, 3), "markers": (5,)}, "COUNTER, INTERPOLATED, RAW_CQ"),
        ([("Fp1", "uV", ""), ("HEOG", "uV", ""), ("ECG", "mV", "EEG")], {"eeg": (0,), "eog": (1,), "ecg": (2,)}, ""),
        ([("Fp1", "uV", ""), ("x", "m/s^2", "")], {"eeg": (0,)}, "x"),
        ([("Fp1", "uV", ""), ("ACC_X", "uV", "")], {"eeg": (0,)}, "ACC_X"),
        ([("T7", "", ""), ("TP9", "raw", ""), ("A1", "", "")], {"eeg": (0, 1, 2)}, ""),
    ],
)
def test_only_electrodes_of_an_eeg_outlet_are_eeg(channels, numbers, without):
    """What else an amplifier sends beside them is a stream of its own, or is left out and named; EEG stays in uV."""
    outlet = parse(xml("EEG", channels, name="Amp"))
    found = pick([outlet], ())
    assert {each.sensor_type: each.numbers for each in found} == numbers
    assert [each.stream.unit for each in found if each.sensor_type == "eeg"] == [
        "uV" if channels[0][1] or channels is EPOC else "counts"
    ]
    said = left_out([outlet], found)
    names = without.split(", ") if without else []
    assert [name in said for name in names] == [True] * len(names)
    assert bool(said) == bool(names)


def test_a_gaze_stream_keeps_its_pupils_apart():
    """Gaze and pupil diameters are two sensor types, with confidence where it is asked for."""
    channels = [
        ("gaze_x", "pixels", ""),
        ("gaze_y", "pixels", ""),
        ("diameter_left", "mm", ""),
        ("diameter_right", "mm", ""),
    ]
    found = picked(xml("Gaze", channels, name="EyeLink"))
    assert found["eye_tracking"].stream.channel_names == ("gaze_x", "gaze_y")
    assert (found["pupillometry"].numbers, found["pupillometry"].stream.unit) == ((2, 3), "mm")


@pytest.mark.parametrize(
    ("kind", "labels", "names"),
    [
        ("ACC", ("ACC_Z", "ACC_Y", "ACC_X"), ("z", "y", "x")),
        ("ACC", ("Y", "X", "Z"), ("y", "x", "z")),
        ("ACC", ("az", "ay", "ax"), ("z", "y", "x")),
        ("ACC", ("accel Z (g)", "accel X (g)", "accel Y (g)"), ("z", "x", "y")),
        ("ACC", ("0", "1", "2"), ("x", "y", "z")),
        ("ACC", ("up", "body", "X"), ("y", "z", "x")),
        ("ACC", ("hand_x", "head_x", "head_y"), ("x", "y", "z")),
        ("Pupil", ("pupil_right", "pupil_left"), ("diameter_right", "diameter_left")),
        ("Pupil", ("RightPupilDiameter", "LeftPupilDiameter"), ("diameter_right", "diameter_left")),
        ("Pupil", ("PUPIL-R", "PUPIL-L"), ("diameter_right", "diameter_left")),
        ("Pupil", ("pupil", "confidence"), ("pupil", "confidence")),
        ("Gaze", ("Y", "X"), ("gaze_y", "gaze_x")),
        ("Gaze", ("confidence", "GazeX", "GazeY"), ("confidence", "gaze_x", "gaze_y")),
        ("Gaze", ("valid", "GazeY", "GazeX"), ("confidence", "gaze_y", "gaze_x")),
    ],
)
def test_channels_have_the_name_that_their_label_tells(kind, labels, names):
    """In whatever order they stand: only what no label tells is named as it stands."""
    (found,) = picked(xml(kind, [(label, "", "") for label in labels])).values()
    assert found.stream.channel_names == names


EYELINK = ("leftEyeX", "leftEyeY", "rightEyeX", "rightEyeY", "leftPupilArea", "rightPupilArea")
EYELINK += ("pixelsPerDegreeX", "pixelsPerDegreeY", "eyelink_timestamp", "LSL_timestamp")


def test_the_outlet_of_eyelinks_lsl_app_is_gaze_and_pupils_with_the_words_of_docs_devices():
    """App-EyeLink's ten channels without units: gaze of one eye in px, areas of both pupils in a.u."""
    words = (
        "eye_tracking: leftEyeX as gaze_x, leftEyeY as gaze_y [px]",
        "pupillometry: leftPupilArea as diameter_left, rightPupilArea as diameter_right [a.u.]",
    )
    page = (Path(__file__).parents[3] / "docs" / "devices.md").read_text()
    assert all(word in page for word in words)
    found = picked(xml("Gaze", [(label, "", "eyetracking") for label in EYELINK], 500, name="EyeLink"), streams=words)
    gaze, pupils = found["eye_tracking"], found["pupillometry"]
    assert (gaze.numbers, gaze.stream.unit, gaze.stream.channel_names) == ((0, 1), "px", ("gaze_x", "gaze_y"))
    assert (pupils.numbers, pupils.stream.unit) == ((4, 5), "a.u.")
    assert pupils.stream.channel_names == ("diameter_left", "diameter_right")


def test_the_study_may_say_what_the_outlet_does_not():
    """Channels by number, name or pattern, unit and factor: the words of driver-file."""
    (stream,) = picked(xml("Signal", [("a", "", ""), ("b", "", "")]), streams=("eda: 1 [uS] * 0.5",)).values()
    assert (stream.numbers, stream.scales, stream.stream.unit) == ((1,), (Scale(0.5),), "uS")


def test_channels_nobody_describes_are_numbered_and_labels_are_made_unique():
    """A description may be missing, or name two channels alike."""
    bare = "<channel_count>3</channel_count><channel_format>int16</channel_format><nominal_srate>100</nominal_srate>"
    bare = f"<info><name>n</name><type>EEG</type>{bare}</info>"
    assert parse(bare).channels == ("0", "1", "2")
    assert parse(bare).bits == 16
    assert parse(xml("EEG", [("C3", "", ""), ("C3", "", "")])).channels == ("C3", "C3_1")
    assert parse(xml("EEG", [(label, "", "") for label in ("C3", "C3_2", "C3")])).channels == ("C3", "C3_2", "C3_2_2")


@pytest.mark.parametrize(
    ("text", "events"),
    [
        (xml("Markers", [("m", "", "")], 0, "string"), True),
        (xml("Stim", [("m", "", "")], 0, "int32"), True),
        (xml("Markers", [("m", "", "")], 100, "int32"), False),
        (xml("Gaze", [("x", "px", "")], 0), False),
    ],
)
def test_texts_and_irregular_numbers_of_marker_types_are_events(text, events):
    """A trigger line that is sampled at a rate is a signal."""
    assert parse(text).events is events


def test_what_the_device_says_of_itself_is_passed_on():
    """Manufacturer and source_id become vendor and serial number."""
    identity = parse(xml("EEG", [("C3", "", "")], more="<manufacturer>Emotiv</manufacturer>")).identity
    assert (identity.vendor, identity.model, identity.serial_number) == ("Emotiv", "Amp", "sn-1")


@pytest.mark.parametrize("text", ["", "<info>", "<info><channel_count>x</channel_count></info>"])
def test_an_outlet_whose_description_cannot_be_read_is_looked_for_again(text):
    """XML comes from the network."""
    with pytest.raises(DeviceLost, match="description of the outlet cannot be read"):
        parse(text)


def test_a_description_of_what_cannot_be_is_told():
    """No channels: nothing that waiting would mend."""
    with pytest.raises(ConfigError, match="outlets"):
        parse(xml("EEG", [], 100))


def test_a_channel_that_is_missing_is_named_with_those_there_are():
    """The sentence helps to correct the study's file."""
    with pytest.raises(ConfigError, match=r"'Cz'; there are C3, C4"):
        picked(xml("EEG", [("C3", "", ""), ("C4", "", "")]), streams=("eeg: Cz",))


def test_a_heard_stream_is_shown_with_what_tells_it_from_others():
    """Name, type, channels, rate, source_id and host."""
    text = lsl.shown(xml("EEG", [("C3", "", "")]))
    assert text == "'Amp' (EEG, 1 channels, 250 Hz, source_id 'sn-1', on lab-2)"


@pytest.mark.parametrize("text", ["", xml("EEG", [], name="x\x01y"), xml("EEG", [], "fast")])
def test_a_strangers_stream_that_cannot_be_read_is_shown_as_that(text):
    """liblsl passes on any octets as a name; they must not end a driver that only lists what it heard."""
    assert lsl.shown(text) == "a stream whose description cannot be read"


@pytest.mark.parametrize(
    ("content_type", "expected"),
    [("EEG", "eeg"), ("ExG-EKG", "exg_ekg"), ("GSR", "eda"), ("Eye Tracking", "eye_tracking"),
     ("Pupil", "pupillometry"),     ("Markers", "markers"), ("MoCap", "mocap"), ("", ""), ("?", "")],
)  # fmt: skip
def test_content_types_become_sensor_types(content_type, expected):
    """Known words in any spelling; another word is a type of its own."""
    assert lsl.sensor_type(content_type) == expected


def test_every_sensor_type_goes_there_and_back():
    """What bridge-lsl writes is what driver-lsl reads."""
    assert all(lsl.sensor_type(name) == kind for kind, name in lsl.CONTENT_TYPES.items())


@pytest.mark.parametrize(
    ("values", "message"),
    [({"outlets": ()}, "outlets"), ({"outlets": (" ",)}, "outlets"), ({"known_peers": ("a b",)}, "known_peers"),
     ({"streams": ("eeg: *", "eeg: 1")}, "at most once"), ({"session": "a\nb"}, "session")],
)  # fmt: skip
def test_a_wrong_parameter_is_named(values, message):
    """What cannot be is told before the network is asked."""
    with pytest.raises(ValueError, match=message):
        LslConfig(**{"sensor_id": "x", "outlets": ("type='EEG'",)} | values)


def test_peers_and_session_are_written_as_liblsl_reads_them():
    """Nothing asked for leaves liblsl its own file."""
    assert lsl.settings((), "") == ""
    assert lsl.settings(("lab-1", "10.0.0.2"), "s1") == "[lab]\nKnownPeers = {lab-1, 10.0.0.2}\nSessionID = s1\n"


def test_the_two_clocks_are_read_together():
    """LSL's clock and the wall clock differ by what is measured, within the time that the reading took."""
    import time

    wall = lsl.wall(time.monotonic)
    assert wall.uncertainty_s < 0.01
    assert abs(time.monotonic_ns() + wall.offset_ns - time.time_ns()) < 5e6
    assert np.isfinite(wall.uncertainty_s)


@pytest.mark.parametrize(
    ("predicate", "said"),
    [
        ("type='EEG", "a quote is not closed"),
        ("starts-with(name,'EPOC'", "brackets do not match"),
        ("name]='x'", "brackets do not match"),
        ("EEG", "it compares nothing"),
    ],
)
def test_a_predicate_that_nothing_can_fit_is_refused(predicate, said):
    """Status 78 with the predicate in it, in place of looking for ever for what liblsl cannot read."""
    with pytest.raises(ValueError, match=said):
        LslConfig(sensor_id="eeg_1", outlets=(predicate,))


@pytest.mark.parametrize(
    "predicate", ["name='it\"s (one'", "contains(desc/manufacturer,'Bio') and type='EEG'", "count(desc) > 0"]
)
def test_a_predicate_may_hold_any_text_in_quotes(predicate):
    """Brackets and quotes of the other kind within a text are text."""
    assert LslConfig(sensor_id="eeg_1", outlets=(predicate,)).outlets == (predicate,)

"""BrainFlow's own tables of every board become streams with canonical units."""

import math

import pytest
from driver_brainflow.config import BrainflowConfig, sources_of, streams_of
from driver_brainflow.transport import PLAYBACK, STREAMING, boards
from sense4hri.device import check_stream
from sense4hri.errors import ConfigError
from sense4hri.names import SENSOR_TYPES

EACH = sorted(set(boards()) - {PLAYBACK, STREAMING})


def config(board: str, **given) -> BrainflowConfig:
    return BrainflowConfig(sensor_id="it_1", board=board, **given)


@pytest.mark.parametrize("board", EACH)
def test_every_board_has_streams(board):
    """Each board that BrainFlow knows samples something the contract names, in a unit it allows, each channel once."""
    streams = streams_of(config(board))
    assert streams
    for sensor_type, stream in streams.items():
        assert sensor_type in SENSOR_TYPES
        check_stream(sensor_type, stream, stream)
        assert stream.sampling_frequency_hz > 0
        assert len(set(stream.channel_names)) == len(stream.channel_names)


def test_every_row_of_a_board_is_in_one_stream_at_most():
    """An electrode that BrainFlow calls EEG, ECG, EMG and EOG alike is one channel of one stream."""
    rows = [row for source in sources_of(config("SYNTHETIC")).values() for row in source.rows]
    assert len(rows) == len(set(rows)) == 26  # 16 electrodes, 3 + 3 axes, EDA, 2 PPG, temperature


def test_a_cyton_by_hand():
    """A Cyton is eight electrodes at 250 Hz in uV, named as BrainFlow does, and an accelerometer in m/s^2."""
    sources = sources_of(config("CYTON"))
    assert list(sources) == ["eeg", "accelerometer"]
    eeg, accelerometer = sources["eeg"], sources["accelerometer"]
    assert eeg.stream.channel_names == ("Fp1", "Fp2", "C3", "C4", "P7", "P8", "O1", "O2")
    assert (eeg.rows, eeg.factor, eeg.stream.unit) == (tuple(range(1, 9)), 1.0, "uV")
    assert (accelerometer.factor, accelerometer.stream.unit) == (9.80665, "m/s^2")


def test_a_shimmer_by_hand():
    """BrainFlow hands out the counts of a Shimmer3's electrodes as they are, and converts its skin conductance."""
    streams = streams_of(config("SHIMMER3"))
    assert (streams["ecg"].unit, streams["eda"].unit) == ("counts", "uS")


def test_a_muse_has_three_rates_and_ppg_when_asked():
    """A Muse 2 samples EEG at 256 Hz, motion at 52; PPG at 64 only where the study wants it, by a command."""
    asked = config("MUSE_2", streams=("eeg", "gyroscope", "ppg"))
    rates_hz = {sensor_type: stream.sampling_frequency_hz for sensor_type, stream in streams_of(asked).items()}
    assert rates_hz == {"eeg": 256.0, "gyroscope": 52.0, "ppg": 64.0}
    assert asked.all_commands == ("p50",)
    assert "ppg" not in streams_of(config("MUSE_2"))
    assert config("MUSE_2").all_commands == ()
    assert math.isclose(sources_of(asked)["gyroscope"].factor, math.pi / 180)


def test_the_study_says_what_electrodes_measure():
    """One word makes all electrodes ECG; one each splits the board; `off` leaves one out."""
    assert streams_of(config("CYTON", exg=("ecg",)))["ecg"].channel_names == tuple(f"ecg_{n}" for n in range(8))
    mixed = streams_of(config("GANGLION_NATIVE", exg=("ecg", "emg", "emg", "off")))
    assert {name: stream.channel_names for name, stream in mixed.items() if name != "accelerometer"} == {
        "ecg": ("ecg",),
        "emg": ("emg_0", "emg_1"),
    }
    kept = streams_of(config("CYTON", exg=("off", "eeg", "eeg", *["ecg"] * 5)))
    assert kept["eeg"].channel_names == ("Fp2", "C3")


def test_other_rows_of_a_board_are_had_by_name():
    """What the contract has no type for is a stream of its own, in counts, where the study asks for it."""
    streams = streams_of(config("CYTON", streams=("eeg", "analog", "other")))
    assert streams["analog"].channel_names == ("analog_0", "analog_1", "analog_2")
    assert (streams["other"].unit, len(streams["other"].channel_names)) == ("counts", 7)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"board": "CYTN"}, "board 'CYTN'.*near it: CYTON"),
        ({"board": "muse_2_board"}, "near it: MUSE_2,"),
        ({"board": PLAYBACK}, "master_board"),
        ({"board": "CYTON", "master_board": "CYTON"}, "master_board"),
        ({"board": PLAYBACK, "master_board": "CYTON"}, "file: PLAYBACK_FILE plays one"),
        ({"board": PLAYBACK, "master_board": "STREAMING", "file": "a"}, "master_board 'STREAMING'"),
    ],
)
def test_a_board_that_cannot_be_is_refused_with_what_is_near(given, said):
    """The sentence names the parameter and, for a misspelt board, those it may have been."""
    with pytest.raises(ValueError, match=said):
        BrainflowConfig(sensor_id="it_1", **given)


@pytest.mark.parametrize(
    ("given", "said"), [({"streams": ("eda",)}, "has no eda; it has eeg"), ({"exg": ("ecg", "emg")}, "2 entries.*8")]
)
def test_what_a_board_does_not_have_is_refused(given, said):
    """A stream it lacks, or words for another number of electrodes, end the driver with the parameter's name."""
    with pytest.raises(ConfigError, match=said):
        streams_of(config("CYTON", **given))

"""The lane of a stream that is computed from another one and has no samples."""

import math

import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from web_gui.model import Study
from web_gui.problem_log import ProblemLog
from web_gui.snapshot import study_message
from web_gui.stream import Info

S = 1_000_000_000
NOW = 1_700_000_000 * S
BEHIND = 5000 * S  # of the device's clock
ECG, OF_HEART = StreamName("p1", "ecg", "h10_1"), StreamName("p1", "respiration", "h10_1_ecg")
COLUMN = S // 100


def tell(study, second, rate, reasons=(), quality=0.8, name=OF_HEART):
    """One features message, received a tenth of a second after its last sample."""
    at = NOW + second * S
    told = {"header": {"stamp": at + S // 10}, "device_timestamp": at - BEHIND, "breaths_per_min": rate}
    told |= {"breath_timestamps": [], "signal_quality": quality, "extra": [], "reasons": list(reasons)}
    stream = study.stream(name, at)
    stream.take_features(told, at + S // 5)
    return stream


def shown(study, now_ns=NOW):
    return study_message(study, ProblemLog(), now_ns)["streams"]


def test_a_stream_without_samples_has_a_lane_of_its_rate():
    """Each told value at its second, in breaths/min, with the quality of the newest message."""
    study = Study()
    for second in range(10):
        stream = tell(study, second, 12.0 + second)
    (told,) = shown(study, NOW + 10 * S)
    assert (told["lane"], told["raw"], told["channels"]) == (True, False, ["breathing rate"])
    assert (told["unit"], told["qualities"], told["why_none"]) == ("breaths/min", [0.8], "")
    line = stream.history.columns(NOW, NOW + 20 * S, COLUMN, [0])
    assert line.low[:, 0].tolist() == [12.0 + second for second in range(10)]
    assert ((line.times_ns - NOW) / S).tolist() == [second + 0.1 for second in range(10)]


def test_an_unknown_rate_is_a_hole_in_the_line_and_a_sentence():
    """NaN is drawn as nothing; the reason stands in words, for as long as it holds."""
    study = Study()
    tell(study, 0, 12.0)
    stream = tell(study, 1, math.nan, ["breathing rate: needs 20 s of beats"], quality=0.0)
    (told,) = shown(study, NOW + 2 * S)
    assert told["why_none"] == "breathing rate: needs 20 s of beats"
    assert np.isnan(stream.history.columns(NOW, NOW + 9 * S, COLUMN, [0]).low[-1, 0])
    tell(study, 2, 12.5)
    assert shown(study, NOW + 3 * S)[0]["why_none"] == ""


def test_a_silence_is_no_line():
    """Between two messages that are further apart than features are current lies a gap; a late one is none."""
    study = Study()
    for second in (0, 1, 4, 12):
        stream = tell(study, second, 12.0)
    gaps = stream.history.gaps(NOW, NOW + 20 * S)
    assert [(round((a - NOW) / S, 1), round((b - NOW) / S, 1)) for a, b in gaps] == [(4.1, 12.1)]


def test_what_is_derived_stands_below_the_signals():
    """Also below those whose type comes later in the order of the page."""
    study = Study()
    tell(study, 0, 12.0)
    for name in (ECG, ECG._replace(sensor_type="accelerometer")):
        study.stream(name, NOW).raw(Chunk(("x",), np.zeros((1, 1)), NOW, NOW), NOW)
    assert [one["type"] for one in shown(study)] == ["ecg", "accelerometer", "respiration"]


def test_samples_take_the_place_of_the_rate():
    """A belt whose features were heard before its samples is drawn by its samples, as soon as there is one."""
    study = Study()
    belt = StreamName("p1", "respiration", "belt_1")
    tell(study, 0, 12.0, name=belt)
    stream = study.stream(belt, NOW)
    stream.raw(Chunk(("respiration",), np.ones((5, 1)), NOW, NOW), NOW)
    assert (shown(study)[0]["channels"], shown(study)[0]["lane"]) == ([], True)
    stream.learn(Info(10.0, "a.u.", {}))
    tell(study, 1, 13.0, name=belt)
    told = shown(study)[0]
    assert (told["channels"], told["unit"], stream.derived) == (["respiration"], "a.u.", False)


def test_other_features_without_samples_have_no_lane():
    """Of a heart whose samples nobody sends the numbers are shown, and nothing is drawn."""
    study = Study()
    study.stream(ECG, NOW).take_features({"heart_rate_bpm": 60.0, "extra": [], "reasons": []}, NOW)
    assert shown(study)[0]["lane"] is False

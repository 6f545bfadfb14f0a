"""The state of the study, its sentences and its JSON."""

import json
import math

import numpy as np
import pytest
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from web_gui.axis import Axis
from web_gui.model import Study
from web_gui.problem_log import ProblemLog
from web_gui.problems import problems
from web_gui.readings import READINGS, further_reasons, reason, rows
from web_gui.snapshot import shown_channels, study_message, trend_message
from web_gui.steady import Steady
from web_gui.stream import Info

S = 1_000_000_000
NOW = 1_700_000_000 * S
NEVER_SET = Steady(lambda: NOW, lambda: NOW)
ECG = StreamName("p1", "ecg", "h10_1")
PPG = StreamName("p1", "ppg", "verity_1")
HEALTH = {"state": 2, "host": "lab", "lost_samples_total": 0, "reconnects_total": 2, "reasons": [], "contact": 1.0}
FEATURES = {
    "heart_rate_bpm": 72.0,
    "rr_interval_ms": 833.0,
    "hrv": {"window_s": 43.0, "rmssd_ms": 31.0, "sdnn_ms": math.nan, "pnn50_percent": 10.0, "lf_hf_ratio": math.nan},
    "peak_timestamps": [],
    "signal_quality": 0.91,
    "extra": [],
    "reasons": [],
}
CLOCK = {
    "device_reference": 0,
    "offset_ns": NOW,
    "skew_ppm": 18.0,
    "uncertainty_s": 0.0009,
    "latency_s": 0.031,
    "segment": 1,
    "state": 1,
}


def streaming(study, name=ECG, now_ns=NOW, seconds=20, health=HEALTH, features=FEATURES, clock=CLOCK):
    """Let a stream run for some seconds up to now_ns."""
    for k in range(seconds):
        at = now_ns - (seconds - 1 - k) * S
        stream = study.stream(name, at)
        stream.learn(Info(130.0, "uV", {}))
        device = at - NOW + 100 * S
        stream.raw(Chunk(("ecg",), np.zeros((130, 1)), device, at), at)
        if health is not None:
            stream.take_health(health, at)
        if features is not None:
            stream.take_features(features, at)
        if clock is not None:
            stream.take_clock({**clock, "offset_ns": NOW - 100 * S}, at)
    return stream


def sentences(study, now_ns=NOW):
    """What is wrong, as text."""
    return [problem.text for problem in problems(study, now_ns)]


def test_a_stream_in_order_gives_no_sentence():
    """Nothing is said while nothing is wrong."""
    study = Study()
    streaming(study)
    assert sentences(study) == []


def test_a_lost_sensor_is_one_sentence_with_what_is_done_about_it():
    """All streams of a lost sensor are one problem: since when, and that it is reconnecting."""
    study = Study()
    for name in (ECG, ECG._replace(sensor_type="accelerometer")):
        stream = streaming(study, name, NOW - 4 * S)
        stream.take_health({**HEALTH, "state": 3, "reasons": ["link timed out"]}, NOW)
    assert sentences(study) == ["p1 / h10_1: no data for 4 s, reconnecting, 2 reconnections so far (link timed out)"]


def test_a_device_that_only_reports_is_streaming_while_it_reports():
    """A strap without a raw stream is not missed for the samples it never sends; one that falls silent is."""
    study = Study()
    stream = study.stream(ECG, NOW - 60 * S)
    stream.take_health(HEALTH, NOW)
    stream.take_reported({"heart_rate": 62.0}, NOW - 2 * S)
    assert stream.status(NOW) == "streaming"
    assert sentences(study) == []
    assert stream.status(NOW + 3 * S) == "silent"


def test_health_older_than_three_seconds_means_lost():
    """A driver that says nothing is not streaming, whatever it said last."""
    study = Study()
    stream = streaming(study)
    assert stream.status(NOW + 2 * S) == "streaming"
    assert stream.status(NOW + 3 * S + 1) == "lost"


def test_samples_without_features_name_the_service_that_is_missing():
    """The operator reads what to start."""
    study = Study()
    streaming(study, features=None)
    assert sentences(study) == ["p1 / h10_1: ecg samples arrive, but no features; interpreter-ecg is not running"]
    study.services.nodes.add("interpreter_ecg")
    assert sentences(study) == ["p1 / h10_1: ecg samples arrive, but no features; interpreter-ecg runs but gives none"]


@pytest.mark.parametrize(
    ("health", "features", "clock", "said"),
    [
        ({**HEALTH, "battery_percent": 9.0}, FEATURES, CLOCK, "battery at 9 %"),
        ({**HEALTH, "contact": 0.0}, FEATURES, CLOCK, "no skin contact"),
        (HEALTH, {**FEATURES, "signal_quality": 0.2, "reasons": ["clipping"]}, CLOCK, "quality is 0.20 (clipping)"),
        (HEALTH, FEATURES, None, "no clock model"),
        (HEALTH, FEATURES, {**CLOCK, "state": 2}, "holdover"),
    ],
)
def test_each_condition_has_its_sentence(health, features, clock, said):
    """Battery, contact, quality and clock are told in words."""
    study = Study()
    streaming(study, health=health, features=features, clock=clock)
    assert any(said in text for text in sentences(study))


def test_a_clock_model_that_is_no_longer_told_is_none():
    """Who looks at a stream reads that clock-sync is gone, not that the clock is locked; samples keep their model."""
    study, later_ns = Study(), NOW + 20 * S
    streaming(study)
    assert study_message(study, ProblemLog(), NOW)["streams"][0]["clock"]["state"] == "LOCKED"
    streaming(study, now_ns=later_ns, clock=None)
    clock = study_message(study, ProblemLog(), later_ns)["streams"][0]["clock"]
    assert (clock["state"], clock["note"]) == ("NONE", "no news for 20 s")
    (text,) = sentences(study, later_ns)
    assert text == "p1 / h10_1: no clock model for ecg; placed by the last one. Is clock-sync running?"


def test_losses_are_told_while_they_happen():
    """Samples lost within the last minute are counted; older losses are history."""
    study = Study()
    stream = streaming(study)
    stream.take_health({**HEALTH, "lost_samples_total": 34}, NOW)
    assert any("lost 34 ecg samples" in text for text in sentences(study))
    for k in range(1, 62):
        stream.take_health({**HEALTH, "lost_samples_total": 34}, NOW + k * S)
    assert not any("lost 34" in text for text in sentences(study, NOW + 61 * S))


@pytest.mark.parametrize(
    ("step_s", "counted", "lost"), [(-6, 300, 0), (-5, 300, 300), (1, 800, 300), (6, 800, 300), (7, 800, 0)]
)
def test_where_a_replay_is_sought_to_nothing_is_lost(step_s, counted, lost):
    """What its counter shows at another place is no loss; within 5 s, and after a silence, it is one."""
    stream = Study().stream(ECG, NOW)
    stream.take_health({**HEALTH, "header": {"stamp": NOW - 100 * S}, "lost_samples_total": 500}, NOW)
    stamp = NOW - (100 - step_s) * S
    stream.take_health({**HEALTH, "header": {"stamp": stamp}, "lost_samples_total": counted}, NOW + S)
    assert stream.lost.lately(NOW + S) == lost


def test_one_sensor_under_two_people_is_an_error():
    """A sensor_id must be unique in a study."""
    study = Study()
    streaming(study)
    streaming(study, ECG._replace(human_id="p2"))
    assert any("under p1 and p2 at once" in text for text in sentences(study))


def test_a_sensor_on_its_way_to_another_person_is_no_error():
    """For a moment after a move the graph still shows the old topics."""
    study = Study()
    streaming(study)
    streaming(study, ECG._replace(human_id="p2"), seconds=2)
    assert not any("at once" in text for text in sentences(study))


def test_a_sensor_that_has_changed_hands_in_a_replay_is_neither_there_twice_nor_missed():
    """The topics of both stay on the graph from the first message to the last; what nobody sends is still missed."""
    study = Study()
    for human, ago_s in (("p1", 30), ("p2", 0)):
        streaming(study, ECG._replace(human_id=human), NOW - ago_s * S)
    assert sentences(study) == []
    later = NOW + 10 * S
    assert [text[:26] for text in sentences(study, later)] == [
        "p1 / h10_1: no data for 40",
        "p2 / h10_1: no data for 10",
    ]


def test_what_is_computed_of_a_sensor_moves_with_it():
    """Neither the old stream nor one late message of features is a second sensor; nothing stays with who wore it."""
    study = Study()
    breath = StreamName("p1", "respiration", "h10_1_ecg")
    study.stream(breath, NOW - 60 * S).take_features(FEATURES, NOW)
    study.stream(ECG, NOW - 60 * S).take_features(FEATURES, NOW)  # its samples come under p2 already
    later = NOW + 30 * S
    for name in (breath, ECG):
        streaming(study, name._replace(human_id="p2"), later, seconds=29)
    assert not any("at once" in text for text in sentences(study, later))
    study.features_gone(breath)
    assert breath not in study.streams
    study.features_gone(breath._replace(human_id="p2"))
    assert breath._replace(human_id="p2") in study.streams


@pytest.mark.parametrize("health", [HEALTH, None])
def test_a_slow_sensor_is_not_silent_between_its_samples(health):
    """Of one sample every 10 s none is missed for 10 s; after more than twice as long it is."""
    study = Study()
    stream = study.stream(StreamName("p1", "temperature", "t_1"), NOW)
    stream.learn(Info(0.1, "degC", {}))
    for second in range(101):
        at = NOW + second * S
        if health:
            stream.take_health(health, at)
        if second % 10 == 0:
            stream.raw(Chunk(("t",), np.zeros((1, 1)), None, at), at)
        if second > 20:
            assert stream.status(at) == "streaming"
    late = NOW + 125 * S
    if health:
        stream.take_health(health, late)
    assert stream.status(late) == ("silent" if health else "lost")


def test_what_the_registry_says_of_a_sensor_is_told_with_its_name():
    """On the page that sentence stands among those of all sensors."""
    study = Study()
    study.take_notes({"h10_1": ["human_id 'p2' was asked for, but its topics are under 'p1'"]})
    assert sentences(study) == ["h10_1: human_id 'p2' was asked for, but its topics are under 'p1'"]


def test_a_sensor_that_changes_hands_moves():
    """After human_id was set the stream is shown under its new owner alone."""
    study = Study()
    streaming(study)
    study.gone(ECG, NOW)
    study.found(ECG._replace(human_id="p2"), NOW)
    assert [name.human_id for name in study.streams] == ["p2"]


def test_a_problem_goes_away_by_itself_and_stays_in_the_log():
    """Since when, and for how long, can be read afterwards."""
    study, log = Study(), ProblemLog()
    streaming(study, features=None)
    log.update(problems(study, NOW), NOW)
    assert [entry.since_ns for entry in log.lasting()] == [NOW]
    log.update([], NOW + 5 * S)
    assert log.lasting() == []
    assert [(entry.since_ns, entry.ended_ns) for entry in log.ended()] == [(NOW, NOW + 5 * S)]


def test_heart_rate_is_absent_with_a_reason_rather_than_old():
    """The last value is never left standing."""
    study = Study()
    streaming(study)
    assert study.heart_rate("p1", NOW) == (72.0, "ecg h10_1")
    value, why = study.heart_rate("p1", NOW + 6 * S)
    assert value is None
    assert why == "no data from h10_1"
    assert study.heart_rate("p9", NOW) == (None, "no ECG or PPG sensor on this participant")


def test_the_fused_heart_rate_comes_first():
    """What fusion used is what the glance shows."""
    study = Study()
    streaming(study)
    study.take_state("p1", {"state": "calm_relaxed", "heart_rate_bpm": 70.0, "reasons": []}, NOW)
    assert study.heart_rate("p1", NOW) == (70.0, "fused state")


def test_a_missing_value_says_what_it_waits_for():
    """NaN becomes the message's own reason, or the length of signal the contract asks for."""
    sdnn = next(reading for reading in READINGS["ecg"] if reading.label == "SDNN")
    assert reason(sdnn, FEATURES) == "needs 120 s, has 43 s"
    long = {**FEATURES, "hrv": {**FEATURES["hrv"], "window_s": 200.0}}
    given = ["sdnn_ms: too many ectopic beats", "the mains hum is strong"]
    assert reason(sdnn, {**long, "reasons": given}) == given[0]
    assert further_reasons("ecg", {**long, "reasons": given}) == given[1:]
    row = next(row for row in rows("ecg", FEATURES, {}) if row["label"] == "SDNN")
    assert row["value"] is None


def test_the_device_stands_beside_what_is_computed():
    """Names of `device` messages meet their feature."""
    found = {row["label"]: row["device"] for row in rows("ecg", FEATURES, {"heart_rate": 72.0, "rr_interval": 830.0})}
    assert (found["heart rate"], found["RR interval"], found["RMSSD"]) == (72.0, 830.0, None)


def test_everything_the_page_gets_is_plain_json():
    """NaN and infinity never reach the page; any text passes as text."""
    study, log = Study(), ProblemLog()
    stream = streaming(study, clock={**CLOCK, "latency_s": math.nan, "skew_ppm": math.inf})
    stream.take_health({**HEALTH, "rssi_dbm": math.nan, "host": "<b>"}, NOW)
    study.take_state("p1", {"state": "<script>", "reasons": ['"><img>'], "heart_rate_bpm": math.nan}, NOW)
    study.take_marker({"stamp_ns": NOW, "name": "</script>", "value": "x", "human_id": ""}, NOW)
    study.tick(NOW)
    log.update(problems(study, NOW), NOW)
    for message in (study_message(study, log, NOW), trend_message(study)):
        json.dumps(message, allow_nan=False)


def test_a_marker_without_a_stamp_stands_where_it_was_heard():
    """As `ros2 topic pub` sends it; at 1970 nobody would see it."""
    study = Study(clock=NEVER_SET)
    for stamp_ns in (0, NOW - S):
        study.take_marker({"stamp_ns": stamp_ns, "name": "note", "value": "", "human_id": ""}, NOW)
    assert [marked.at_ns for marked in study.markers] == [NOW, NOW - S]


def test_a_marker_that_a_replay_says_again_is_one_marker():
    """Sought back, or in a loop, it says what it has said: the same event, not a second one."""
    study = Study()
    told = [
        {"stamp_ns": NOW - k * S, "name": "response", "value": value, "human_id": ""}
        for k, value in [(2, "a"), (1, "b")]
    ]
    for plain in [*told, *told, {**told[1], "human_id": "p1"}]:
        study.take_marker(plain, NOW)
    assert [(marked.value, marked.human_id) for marked in study.markers] == [("a", ""), ("b", ""), ("b", "p1")]


def test_the_strip_has_one_point_a_second_and_a_bounded_length():
    """Ten minutes are kept, no more; stretches of one state are one stretch."""
    study = Study(trend_s=60.0)
    streaming(study)
    for k in range(200):
        study.take_state("p1", {"state": "calm_relaxed", "heart_rate_bpm": 70.0, "reasons": []}, NOW + k * S)
        study.tick(NOW + k * S)
    trend = trend_message(study)["participants"][0]
    assert (len(trend["heart_rate"]), trend_message(study)["span_s"]) == (60, 60)
    assert [stretch[2] for stretch in trend["state"]] == ["calm_relaxed"]


def test_the_strip_tells_of_a_time_once_where_a_replay_is_sought_back():
    """What was played before stays before, and no stretch ends before it begins."""
    study = Study()
    streaming(study)
    for second, back_s in (*((k, 0) for k in range(60)), *((k, 20) for k in range(60, 70))):
        now_ns = NOW + second * S
        study.axis.saw(now_ns - (86_400 + back_s) * S, now_ns)
        study.take_state("p1", {"state": "calm_relaxed", "heart_rate_bpm": 70.0 + back_s, "reasons": []}, now_ns)
        study.tick(now_ns)
    (trend,) = trend_message(study)["participants"]
    at_s = [(at_ms - NOW / 1e6) / 1e3 + 86_400 for at_ms, _ in trend["heart_rate"]]
    assert at_s == [*range(70 - 20)]
    assert [rate for _, rate in trend["heart_rate"]] == 41 * [70.0] + 9 * [90.0]  # the edge follows within a second
    assert [(to_ms - from_ms) / 1e3 for from_ms, to_ms, _ in trend["state"]] == [49.0]


def test_the_strip_of_a_fast_replay_has_no_holes_between_its_points():
    """A state that is told all the time is one stretch at any speed, also when it is played slowly after that."""
    study = Study()
    streaming(study)
    played_ns = NOW - 86_400 * S
    for second in range(40):
        now_ns = NOW + second * S
        study.axis.saw(played_ns, now_ns)
        state = "stressed_anxious" if second == 10 else "calm_relaxed"
        study.take_state("p1", {"state": state, "heart_rate_bpm": 70.0, "reasons": []}, now_ns)
        study.tick(now_ns)
        played_ns += (20 if second < 20 else 1) * S
    (trend,) = trend_message(study)["participants"]
    (first_ms, until_ms, _), (stressed_ms, calm_ms, state), (again_ms, last_ms, _) = trend["state"][-3:]
    assert state == "stressed_anxious"
    assert (until_ms - first_ms) / 1e3 > 7 * 20  # the pace is known after the first points
    assert (stressed_ms - until_ms, again_ms - calm_ms) == (1000, 1000)  # a point lasts a second
    assert (last_ms - again_ms) / 1e3 == 9 * 20 + 19 + 19


def test_a_stream_without_raw_is_derived_until_it_falls_silent_and_is_forgotten():
    """Respiration from an ECG has features only; ten minutes after the last of them it is gone from the page."""
    study = Study()
    name = StreamName("p1", "respiration", "h10_1_ecg")
    stream = study.stream(name, NOW)
    assert stream.status(NOW) == "waiting"
    stream.take_features({"breath_timestamps": [], "reasons": [], "extra": []}, NOW)
    assert stream.status(NOW) == "derived"
    assert stream.status(NOW + 6 * S) == "silent"
    study.tick(NOW + 599 * S)
    assert name in study.streams
    study.tick(NOW + 601 * S)
    assert name not in study.streams


def test_the_session_is_told_in_words():
    """Phase, people and start of a session reach the header; a failed one is a sentence."""
    study = Study()
    study.session.take_state({"phase": 2, "session_id": "s1", "study": "demo", "human_ids": ["p1"], "start_at": NOW})
    told = study_message(study, ProblemLog(), NOW)["session"]
    assert (told["phase"], told["humans"], told["start_ms"]) == ("recording", ["p1"], NOW // 1_000_000)
    study.session.take_state({"phase": 4, "detail": "recorder did not answer"})
    assert sentences(study) == ["the session failed: recorder did not answer"]


def test_the_lane_of_ppg_shows_the_channel_in_use():
    """Four optical channels share one lane: the one the interpreter chose, else the first; never the ambient light."""
    study = Study()
    stream = study.stream(PPG, NOW)
    stream.learn(Info(55.0, "counts", {}))
    stream.raw(Chunk(("ambient", "ppg_0", "ppg_1"), np.zeros((55, 3)), S, NOW), NOW)
    assert shown_channels(stream) == [1]
    stream.take_features({**FEATURES, "channel_name": "ppg_1"}, NOW)
    assert shown_channels(stream) == [2]


def test_what_comes_before_the_metadata_is_kept_and_placed_when_they_come():
    """No sample is lost while a driver is asked for its parameters."""
    study = Study()
    stream = study.stream(ECG, NOW)
    for k in range(3):
        stream.raw(Chunk(("ecg",), np.zeros((130, 1)), (k + 1) * S, NOW + k * S), NOW + k * S)
    assert stream.history is None
    stream.learn(Info(130.0, "uV", {}))
    assert stream.history.samples_total == 390


def test_the_axis_follows_a_replay_and_returns_to_now():
    """When everything that arrives is from another time, the right edge goes there."""
    axis = Axis(NEVER_SET.wall_ns)
    assert axis.now_ns(NOW) == NOW
    for k in range(3):
        axis.saw(NOW - 86_400 * S + k * S, NOW + k * S)
    assert axis.replaying(NOW + 2 * S)
    assert axis.now_ns(NOW + 3 * S) == NOW - 86_400 * S + 3 * S
    axis.saw(NOW + 4 * S, NOW + 4 * S)
    for later_s in (4, 12):
        assert axis.now_ns(NOW + later_s * S) == NOW + later_s * S
    axis.saw(NOW + 12 * S, NOW + 12 * S)
    axis.saw(NOW - 86_400 * S, NOW + 13 * S)
    assert axis.now_ns(NOW + 13 * S) == NOW + 13 * S


@pytest.mark.parametrize("rate", [0.1, 0.5, 1.0, 5.0])
def test_the_edge_stays_with_what_is_played_at_any_speed(rate):
    """Also where it is sought back, or is paused for a moment: no lane leaves the window."""
    axis, played_ns = Axis(NEVER_SET.wall_ns), NOW - 86_400 * S
    for tenth in range(900):
        if 300 <= tenth < 340:
            continue
        played_ns += round(rate * S / 10) if tenth != 600 else -20 * S
        now_ns = NOW + tenth * S // 10
        axis.saw(played_ns, now_ns)
        axis.saw(played_ns - S // 2, now_ns)  # of a stream that comes late
        if not 600 <= tenth <= 610:
            assert 0 <= axis.now_ns(now_ns) - played_ns <= S
    assert axis.replaying(now_ns)


class Slow:
    """A person's ECG of a day ago, played at a rate: samples twice a second of it, everything else once."""

    def __init__(self, rate):
        self.study, self.rate = Study(clock=NEVER_SET), rate
        self.at_ns, self.played_ns = NOW, NOW - 86_400 * S

    def play(self, seconds, streams=(ECG,)):
        """Play so many s of it; yield what time it is, five times between two messages."""
        for half in range(2 * seconds):
            for name in streams:
                self.study.axis.saw(self.played_ns, self.at_ns)
                stream = self.study.stream(name, self.at_ns)
                stream.learn(Info(130.0, "uV", {}))
                stream.raw(
                    Chunk(("ecg",), np.zeros((65, 1)), self.played_ns - NOW + 90_000 * S, self.played_ns), self.at_ns
                )
                if half % 2 == 0:
                    stream.take_health({**HEALTH, "header": {"stamp": self.played_ns}}, self.at_ns)
                    stream.take_features(FEATURES, self.at_ns)
                    stream.take_clock({**CLOCK, "offset_ns": NOW - 90_000 * S}, self.at_ns)
                    self.study.take_state("p1", {"state": "calm_relaxed", "heart_rate_bpm": 72.0}, self.at_ns)
            yield from self.wait(0.5)

    def wait(self, seconds):
        """Let so many s of it pass without a message; yield what time it is."""
        for _ in range(5):
            self.at_ns += round(seconds * S / self.rate / 5)
            self.played_ns += round(seconds * S / 5)
            yield self.at_ns


@pytest.mark.parametrize("rate", [0.02, 0.1, 0.25, 1.0, 4.0])
def test_what_is_played_slowly_is_not_lost_between_two_messages(rate):
    """Half a second of the recording is half a second, however long it takes."""
    slow = Slow(rate)
    study = slow.study
    for now_ns in slow.play(20):
        assert study.streams[ECG].status(now_ns) == "streaming"
        assert study.state("p1", now_ns) is not None
        assert sentences(study, now_ns) == []
        assert abs(study.axis.now_ns(now_ns) - slow.played_ns) <= 0.5 * S
    assert study.streams[ECG].patience_s() == pytest.approx(max(1.0, 2 * 0.5 / max(1.0, rate) + 0.5))


def test_what_falls_silent_while_the_rest_is_played_slowly_is_lost():
    """After as much of the recording as it would have taken live."""
    slow = Slow(0.1)
    other = ECG._replace(sensor_id="h10_2")
    for _ in slow.play(10, (ECG, other)):
        pass
    told_ns = slow.played_ns - S  # of its health
    said = [(slow.study.streams[other].status(now_ns), slow.played_ns) for now_ns in slow.play(10)]
    lost_ns = next(at_ns for status, at_ns in said if status == "lost")
    assert (lost_ns - told_ns) / S == pytest.approx(3.1, abs=0.05)
    assert slow.study.streams[ECG].status(slow.at_ns) == "streaming"


def test_unassigned_sensors_come_last_and_people_in_their_order():
    """p2 stands before p10, and what nobody wears at the end."""
    study = Study()
    for human in ("unassigned", "p10", "p2"):
        study.stream(ECG._replace(human_id=human, sensor_id=f"s_{human}"), NOW)
    assert study.humans() == ["p2", "p10", "unassigned"]

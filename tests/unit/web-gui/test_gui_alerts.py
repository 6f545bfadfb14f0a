"""Alerts on the page: the bounds of Prometheus' rules, each raised and ended by what is heard on the graph."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from sense4hri.beats import AFRESH_S, Beat
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.recorder_status import RecorderStatus
from web_gui.lately import Increase
from web_gui.model import Study
from web_gui.problem_log import Problem, ProblemLog
from web_gui.problems import problems
from web_gui.rules import RULES, Rule
from web_gui.snapshot import study_message
from web_gui.steady import Steady
from web_gui.stream import Info

S = 1_000_000_000
NOW = 1_700_000_000 * S
NEVER_SET = Steady(lambda: NOW, lambda: NOW)
ECG = StreamName("p1", "ecg", "h10_1")
FOLDER = Path(__file__).resolve().parents[3] / "compose" / "prometheus"
GROUPS = yaml.safe_load((FOLDER / "rules.yml").read_text())["groups"]
ALERTS = {rule["alert"]: rule for group in GROUPS for rule in group["rules"] if "alert" in rule}
HEALTH = {"state": 2, "lost_samples_total": 0, "reconnects_total": 0, "battery_percent": 80.0, "contact": 1.0}
HEALTH |= {"nominal_rate_hz": 130.0, "measured_rate_hz": 129.0, "reasons": []}
CLOCK = {
    "device_reference": 0,
    "offset_ns": NOW - 100 * S,
    "skew_ppm": 18.0,
    "latency_s": 0.03,
    "segment": 1,
    "state": 1,
}
MEASURED = {"measured_at": SimpleNamespace(sec=NOW // S, nanosec=0), "skew_ppm": 0.0, "uncertainty_s": 1e-4}
HOST = {"host": "lab_b", "reference": "lab_a", "offset_ns": 400_000, "round_trip_s": 4e-4, "state": 1} | MEASURED
FEATURES = {"signal_quality": 0.9, "reasons": [], "peak_timestamps": []}


def read(rule):
    """A rule of rules.yml as the page's table has it."""
    compared = re.search(r"(<|>|==) ([\d.]+)", rule["expr"])
    sign, bound = compared.groups() if compared else ("", "0")
    counted = re.search(r"increase\(\w+\[1m\]\)", rule["expr"])
    severity = {"critical": "error", "warning": "warning"}[rule["labels"]["severity"]]
    for_s = {"1m": 60.0, "5s": 5.0, None: 0.0}[rule.get("for")]
    return Rule(rule["alert"], sign, float(bound), severity, for_s, 60.0 if counted else 0.0)


def test_the_page_and_prometheus_tell_the_same_from_the_same_bound_on():
    """No alert of one is unknown to the other, and none has another bound, wait, window or severity."""
    assert {name: read(rule) for name, rule in ALERTS.items()} == RULES


class Bench:
    """A study in which all is well, but for what a test changes."""

    def __init__(self):
        self.study, self.log, self.now_ns = Study(clock=NEVER_SET), ProblemLog(), NOW
        self.run(15)

    def run(self, seconds, health=(), clock=(), delay_s=0.0, beat=(), recorder=(), host=()):
        """Let so many seconds pass, with these values of each message."""
        for _ in range(seconds):
            self.now_ns += S
            stream = self.study.stream(ECG, self.now_ns)
            stream.learn(Info(130.0, "uV", {}))
            received_ns = self.now_ns - round(delay_s * S)
            if dict(health).get("state", 2) == 2:
                stream.raw(Chunk(("ecg",), np.zeros((13, 1)), self.now_ns - NOW + 100 * S, received_ns), self.now_ns)
            stream.take_health(HEALTH | dict(health), self.now_ns)
            stream.take_clock(CLOCK | dict(clock), self.now_ns)
            stream.take_features(FEATURES, self.now_ns)
            if beat is not None:
                self.study.services.take(Beat("fusion_affect", "1")._replace(**dict(beat)), self.now_ns)
            self.study.hosts.take(SimpleNamespace(clocks=[SimpleNamespace(**HOST | dict(host))]), self.now_ns)
            told = {"recording": True, "minutes_left": 90.0, "behind_s": 0.0} | dict(recorder)
            self.study.session.recorder.take(RecorderStatus("recorder", **told), self.now_ns)
            self.log.update(problems(self.study, self.now_ns), self.now_ns)

    def told(self):
        """Names of the rules that what is told now breaks."""
        return {entry.problem.alert for entry in self.log.lasting()}


CASES = {
    "StreamSilent": {"health": {"state": 3}},
    "SensorNotFound": {},  # of a sensor that never was there: below
    "RateLow": {"health": {"measured_rate_hz": 110.0}},
    "SamplesLost": {"health": {"lost_samples_total": 13}},
    "LatencyGrowing": {"delay_s": 0.4},
    "LinkBehind": {"clock": {"latency_s": 1.5}},
    "ClockUnlocked": {"clock": {"state": 2}},
    "ClockNotFound": {"clock": {"state": 0}},
    "HostClocksApart": {"host": {"offset_ns": -1_200_000}},
    "HostUnanswering": {"host": {"state": 2}},
    "NetworkSlow": {"host": {"round_trip_s": 0.2}},
    "BatteryLow": {"health": {"battery_percent": 19.0}},
    "ContactLost": {"health": {"contact": 0.4}},
    "RecorderCannotRecord": {"recorder": {"level": "error", "message": "NOT RECORDING: no space"}},
    "DiskFilling": {"recorder": {"minutes_left": 29.0}},
    "MessagesLost": {"recorder": {"lost": 2}},
    "RecorderBehind": {"recorder": {"behind_s": 4.0}},
    "MessagesDropped": {"beat": {"dropped": 5}},
    "ServiceNotReady": {"beat": {"missing": "the database is locked"}},
    "ServiceDown": {"beat": None},
    "ServiceUnanswering": {"beat": {"trouble": "no answer from the main thread"}},
    "ServiceRestarting": {"beat": {"run": "2"}},
}


def test_every_rule_has_its_case():
    """A rule that is added is tried."""
    assert CASES.keys() == RULES.keys()


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case])
def test_every_alert_is_raised_after_its_wait_not_before_and_ends(name):
    """By what is heard on the graph alone; nothing else is told, and how long it lasted stays in the log."""
    bench, rule = Bench(), RULES[name]
    assert bench.told() == set()
    bench.run(max(1, int(rule.for_s)), **CASES[name])
    early = bench.told()
    bench.run(5, **CASES[name])
    assert bench.told() == {name}
    assert not rule.for_s or early == set()
    severities = [entry.problem.severity for entry in bench.log.lasting()]
    assert severities == [rule.severity]
    kept = {key: value for key, value in CASES[name].items() if key in ("beat", "health")}
    lasting = {"SamplesLost": kept, "MessagesDropped": kept, "ServiceRestarting": kept}.get(name, {})
    lasting |= {"recorder": {"lost": 2}} if name == "MessagesLost" else {}
    bench.run(round(max(rule.window_s, AFRESH_S, 30)) + 1, **lasting)
    assert bench.told() == set()
    (over,) = [entry for entry in bench.log.ended() if entry.problem.alert == name]
    assert over.ended_ns is not None
    assert over.ended_ns - over.since_ns >= 2 * S


LOSS = {"level": "warning", "lost": 3, "message": "3 messages lost (2 of /a, 1 of /b)"}


def recorder_says(bench):
    """The sentences about the recorder that are told now, newest first."""
    return [entry.problem.text for entry in bench.log.lasting() if entry.problem.text.startswith("recorder: ")]


def test_what_the_recorder_loses_is_one_sentence_while_it_is_lost_and_a_number_afterwards():
    """It names the topics; a minute later only the total that the recorder tells is left, and what else it doubts."""
    bench = Bench()
    bench.run(1, recorder=LOSS)
    assert recorder_says(bench) == ["recorder: 3 messages lost within a minute; in all 2 of /a, 1 of /b"]
    bench.run(61, recorder=LOSS)
    assert recorder_says(bench) == []
    assert study_message(bench.study, bench.log, bench.now_ns)["recorder"]["lost"] == 3
    full = {"message": f"{LOSS['message']}; the disk lasts 12 more minutes", "minutes_left": 12.0}
    bench.run(1, recorder=LOSS | full)
    assert recorder_says(bench) == ["recorder: the disk lasts 12 more minutes"]
    assert bench.told() == {"DiskFilling"}


def test_a_disk_that_fills_is_told_also_where_the_recorder_speaks_of_losses_alone():
    """Its own bound of minutes may be another one."""
    bench = Bench()
    bench.run(62, recorder=LOSS | {"minutes_left": 29.0})
    assert recorder_says(bench) == ["recorder: the disk lasts 29 more minutes; make room, or stop before that"]


def test_a_sensor_that_has_not_been_found_is_told_after_a_minute():
    """Not while somebody may still be putting it on."""
    study, log = Study(), ProblemLog()
    for second in range(62):
        at = NOW + second * S
        study.stream(ECG, at).take_health(HEALTH | {"state": 1}, at)
        log.update(problems(study, at), at)
        assert {entry.problem.alert for entry in log.lasting()} == ({"SensorNotFound"} if second >= 60 else set())


def test_a_sensor_that_has_never_said_what_it_measures_is_told_with_its_driver_s_last_error():
    """Its driver has no stream to tell its health on; once it has one, that tells."""
    study, log = Study(), ProblemLog()
    for second in range(62):
        at = NOW + second * S
        study.services.take(Beat("driver_lsl_belt_1", "1", missing="the device is LOST: no outlet 'belt'"), at)
        log.update(problems(study, at), at)
        assert [entry.problem.alert for entry in log.lasting()] == (["SensorNotFound"] if second >= 60 else [])
        assert study_message(study, log, at)["unseen"] == [
            {"node": "driver_lsl_belt_1", "why": "the device is LOST: no outlet 'belt'"}
        ]
    (entry,) = log.lasting()
    told = "driver_lsl_belt_1 has found no sensor yet: the device is LOST: no outlet 'belt'; is it on, worn and near?"
    assert entry.problem.text == told
    study.stream(StreamName("p1", "respiration", "belt_1"), at)
    assert not any(problem.alert == "SensorNotFound" for problem in problems(study, at))
    assert study_message(study, log, at)["unseen"] == []


def test_a_slow_stream_of_a_sensor_that_is_back_is_no_error_while_it_starts():
    """Its driver says until when its rate allows that; what then is lost is told at once."""
    study = Study()
    stream = study.stream(ECG, NOW)
    stream.take_health(HEALTH | {"state": 0, "reconnects_total": 1}, NOW)
    assert {problem.alert for problem in problems(study, NOW)} <= {"SensorNotFound"}
    assert stream.status(NOW) == "starting"
    stream.take_health(HEALTH | {"state": 3, "reconnects_total": 1}, NOW)
    assert "StreamSilent" in {problem.alert for problem in problems(study, NOW)}


@pytest.mark.parametrize(("rate_hz", "told_s"), [(130.0, 7), (0.2, 19)])
def test_a_driver_that_says_starting_while_no_more_samples_come_is_told_at_once(rate_hz, told_s):
    """A third-party one, whose device has gone: not as late as one that never was, nor before a slow stream can."""
    study = Study()
    stream = study.stream(ECG, NOW)
    stream.raw(Chunk(("ecg",), np.zeros((13, 1)), None, NOW), NOW)
    for second in range(1, told_s + 1):
        at = NOW + second * S
        stream.take_health(HEALTH | {"state": 0, "nominal_rate_hz": rate_hz}, at)
        told = {problem.alert for problem in problems(study, at)}
        assert ("StreamSilent" in told) is (second == told_s), second
    stream.raw(Chunk(("ecg",), np.zeros((13, 1)), None, at), at)
    assert "StreamSilent" not in {problem.alert for problem in problems(study, at)}


def test_two_recorders_of_one_name_are_told_and_are_no_restart():
    """They beat in turn; one that is started afresh is still told as that."""
    study = Study()
    for half_s, run in enumerate("121212"):
        at = NOW + half_s * S // 2
        study.services.take(Beat("recorder", run), at)
    told = [problem.text for problem in problems(study, at) if "recorder" in problem.text]
    assert told == [
        "two nodes are called recorder, and nobody can tell them apart; end one, or have them in two ROS domains"
    ]


@pytest.mark.parametrize(
    ("count", "sentence"),
    [
        (1, "p0 / h10_1: ecg comes 0.2 s after its receipt: a"),
        (2, "p1 / h10_1: ecg comes 0.3 s after its receipt, and one more stream is late: a"),
        (8, "p7 / h10_1: ecg comes 0.9 s after its receipt, and 7 more streams are late: a"),
    ],
)
def test_a_machine_that_is_too_busy_is_one_sentence(count, sentence):
    """However many streams it delays; the latest of them is named."""
    study = Study(clock=NEVER_SET)
    for number in range(count):
        stream = study.stream(ECG._replace(human_id=f"p{number}"), NOW)
        stream.raw(Chunk(("ecg",), np.zeros((13, 1)), None, NOW - (number + 2) * S // 10), NOW)
    (text,) = [problem.text for problem in problems(study, NOW) if problem.alert == "LatencyGrowing"]
    assert text.startswith(sentence)


def test_a_trouble_that_passes_within_its_wait_is_never_told():
    """Neither while it lasts nor in the log."""
    log = ProblemLog()
    log.update([Problem.of("RateLow", "rate", "p1 / h10_1: ecg comes at 80 % of its rate")], NOW)
    log.update([], NOW + 4 * S)
    assert (log.lasting(), log.ended()) == ([], [])


def test_what_is_not_known_breaks_no_rule():
    """None and NaN are no values, so a device that tells no battery raises nothing."""
    assert not any(rule.broken(value) for rule in RULES.values() for value in (None, float("nan")))


def test_a_counter_that_begins_anew_has_grown_by_what_it_counts():
    """As Prometheus' increase() has it; a restart hides no loss and invents none."""
    counter = Increase(60.0)
    for second, value in enumerate((100, 105, 0, 2)):
        counter.take(value, NOW + second * S)
    assert counter.lately(NOW + 3 * S) == 7
    assert counter.lately(NOW + 70 * S) == 0


def test_a_problem_names_its_stream():
    """So that the page can lead to it."""
    bench = Bench()
    bench.run(1, health={"contact": 0.0})
    (told,) = study_message(bench.study, bench.log, bench.now_ns)["problems"]
    assert (told["alert"], told["stream"]) == ("ContactLost", "p1/ecg/h10_1")

"""The session, who it waits for, and the recorder's words, as the page shows them."""

import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.recorder_status import RecorderStatus
from web_gui.model import Study
from web_gui.problem_log import ProblemLog
from web_gui.problems import problems
from web_gui.session import Session
from web_gui.snapshot import study_message
from web_gui.steady import Steady

ECG, PPG = "/humans/physiological/p1/ecg/h10_1/raw", "/humans/physiological/p1/ppg/verity_1/raw"
PREPARING = {
    "phase": 1,
    "session_id": "s1",
    "expected_services": ["recorder", "clock_sync"],
    "required_streams": [ECG, "/humans/physiological/p1/ppg/**", "/tf", "/nothing/*"],
    "waiting_for": ["recorder: no answer yet", f"{PPG}: slow, 40.0 of 55 Hz", "/tf: absent", "/nothing/*: absent"],
}
NOW = 1_700_000_000_000_000_000


def told(session):
    return {check.name: (check.ok, check.why) for check in session.checks()}


def test_what_is_waited_for_is_red_and_the_rest_green():
    """Services and required streams each once; of a glob the topic that is wrong is named."""
    session = Session(Steady())
    session.take_state(PREPARING)
    assert told(session) == {
        "recorder": (False, "no answer yet"),
        "clock_sync": (True, ""),
        ECG: (True, ""),
        "/humans/physiological/p1/ppg/**": (False, f"{PPG}: slow, 40.0 of 55 Hz"),
        "/tf": (False, "absent"),
        "/nothing/*": (False, "absent"),
    }


def test_nobody_has_to_record_what_is_played_back():
    """A recorded session that a replay says is in no doubt; one that a coordinator says is, also beside a replay."""
    for nodes, doubted in (
        ({"replay"}, False),
        ({"session_coordinator"}, True),
        ({"session_coordinator", "replay"}, True),
    ):
        study = Study()
        study.session.take_state({"phase": 2, "session_id": "s1"})
        study.session.said_by(nodes)
        study.session.said_by(set())  # whoever said it has left
        for second in range(10):
            study.tick(NOW + second * 1_000_000_000)
        told = study_message(study, ProblemLog(), NOW)["session"]
        assert (told["replayed"], bool(told["doubt"])) == (not doubted, doubted), nodes


def test_nothing_is_green_before_it_was_looked_at():
    """While the coordinator has not looked at the streams none of them counts as there."""
    session = Session(Steady())
    session.take_state({**PREPARING, "waiting_for": ["required streams: being looked at"]})
    assert [check.ok for check in session.checks() if check.kind == "stream"] == [False] * 4
    assert [check.name for check in session.checks() if check.kind == "other"] == []


def test_a_failed_session_keeps_what_it_had_been_waiting_for():
    """FAILED empties waiting_for; who did not answer stays red."""
    session = Session(Steady())
    session.take_state(PREPARING)
    session.take_state({**PREPARING, "phase": 4, "waiting_for": [], "detail": "did not answer: recorder"})
    assert told(session)["recorder"] == (False, "no answer yet")
    assert session.phase == "failed"
    session.take_state({"phase": 1, "session_id": "s2", "expected_services": ["recorder"], "waiting_for": []})
    assert told(session) == {"recorder": (True, "")}


def test_a_service_says_in_its_own_words_and_only_about_this_phase():
    """The detail of an acknowledgement is shown; one of another phase or session is not."""
    session = Session(Steady())
    session.take_state(PREPARING)
    session.take_ack({"session_id": "s1", "phase": 1, "service": "clock_sync", "detail": "4 of 4 clocks locked"})
    session.take_ack({"session_id": "s0", "phase": 1, "service": "clock_sync", "detail": "of another session"})
    session.take_ack({"session_id": "s1", "phase": 3, "service": "clock_sync", "detail": "of another phase"})
    assert told(session)["clock_sync"] == (True, "4 of 4 clocks locked")
    session.take_state({**PREPARING, "phase": 2, "waiting_for": []})
    assert told(session)["clock_sync"] == (True, "")


def test_what_nobody_expected_is_shown_all_the_same():
    """An entry of waiting_for that is neither service nor stream is not swallowed."""
    session = Session(Steady())
    session.take_state({"phase": 1, "session_id": "s1", "waiting_for": ["the moon: not full"]})
    assert told(session) == {"the moon": (False, "not full")}


def test_a_recorder_in_trouble_is_a_sentence_and_an_old_word_is_none():
    """Its own message, with its severity; after 5 s without news nothing is told any more, nor guessed."""
    study = Study()
    study.session.recorder.take(
        RecorderStatus("recorder", "warning", "12 min of disk left", free_bytes=900, lost=3), NOW
    )
    assert [(p.text, p.severity) for p in problems(study, NOW)] == [("recorder: 12 min of disk left", "warning")]
    shown = study_message(study, ProblemLog(), NOW)["recorder"]
    assert (shown["free_bytes"], shown["lost"], shown["minutes_left"]) == (900, 3, None)
    later = NOW + 6_000_000_000
    assert list(problems(study, later)) == []
    assert study_message(study, ProblemLog(), later)["recorder"] is None
    study.services.nodes.add("recorder")
    assert study_message(study, ProblemLog(), later)["recorder"] == {"recording": None}


RUNS = {"phase": 2, "session_id": "s1", "start_at": NOW}


def after(seconds, *told, study=None, state=RUNS):
    """The sentences of a page on which a session has run for some seconds, once told (when, recording, messages)."""
    study = study or Study()
    stream = study.stream(StreamName("p1", "ecg", "h10_1"), NOW)
    for second in range(seconds + 1):
        at = NOW + second * 1_000_000_000
        stream.raw(Chunk(("ecg",), np.zeros((1, 1)), None, at), at)
        study.session.take_state(state)
        for when, recording, messages in told:
            if when == second:
                said = RecorderStatus("recorder", "ok", "waits for a session", recording, messages=messages)
                study.session.recorder.take(said, at)
        study.tick(at)
    return [p.text for p in problems(study, at) if p.key == "not recorded"]


def test_rec_is_what_the_recorder_says_itself():
    """Silent, absent, not recording, or counting nothing while signals arrive: one sentence each, within 5 s."""
    healthy = [(second, True, 100 * second) for second in range(20)]
    assert after(19, *healthy) == []
    assert after(4, healthy[0]) == ["the recorder has said nothing for 4 s: what happens now may not be recorded"]
    assert after(4) == ["no recorder is heard: nothing is recorded"]
    idle = [(second, False, 0) for second in range(5)]
    assert after(4, *idle) == ["the session runs, but the recorder does not record: waits for a session"]
    frozen = [(second, True, 7) for second in range(6)]
    assert after(5, *frozen) == ["the recorder has counted no message for 5 s although signals arrive"]
    assert after(5, *frozen, state={"phase": 0}) == []


def test_a_recorder_that_fell_silent_while_it_recorded_is_missed_without_a_session_too():
    """It may record at all times; one that only waited is not missed."""
    lost = "the recorder has said nothing for 9 s: what happens now may not be recorded"
    assert after(9, (0, True, 1), state={"phase": 0}) == [lost]
    assert after(9, (0, False, 1), state={"phase": 0}) == []


def test_what_a_session_went_through_without_its_recorder_is_told_when_it_is_over():
    """Seconds of silence are counted until the next session begins."""
    study = Study()
    assert after(10, (0, True, 0), (8, True, 800), (9, True, 900), (10, True, 1000), study=study) == []
    study.session.take_state({"phase": 0, "session_id": "s1", "detail": "complete"})
    told = study_message(study, ProblemLog(), NOW)["session"]
    assert (told["doubt"], told["unrecorded_s"]) == ("", 7)
    study.session.take_state({**RUNS, "session_id": "s2"})
    study.tick(NOW + 11_000_000_000)
    assert study_message(study, ProblemLog(), NOW)["session"]["unrecorded_s"] == 0


def test_the_report_is_looked_for_where_the_recorder_says_or_in_the_finished_folder():
    """Not while a session runs: its folder has none yet."""
    session = Session(Steady())
    session.take_state({"phase": 2, "session_id": "s1", "directory": "/data/s1"})
    assert session.report_path == ""
    session.take_state({"phase": 0, "session_id": "", "directory": "/data/s1"})
    assert session.report_path == "/data/s1/report.html"
    session.recorder.take(RecorderStatus(report="/data/other/report.html"), NOW)
    assert session.report_path == "/data/other/report.html"
    long = f"/data/{'-'.join(['participant_07'] * 13)}/{'s' * 63}_{'t' * 63}/report.html"  # the folder of many people
    session.recorder.take(RecorderStatus(report=long), NOW)
    assert session.report_path == long

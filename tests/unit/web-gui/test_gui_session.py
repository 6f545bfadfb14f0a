"""The session, who it waits for, and the recorder's words, as the page shows them."""

import pytest
from web_gui.model import Study
from web_gui.problems import ProblemLog, problems
from web_gui.session import Session, recorder_status
from web_gui.snapshot import study_message

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
    session = Session()
    session.take_state(PREPARING)
    assert told(session) == {
        "recorder": (False, "no answer yet"),
        "clock_sync": (True, ""),
        ECG: (True, ""),
        "/humans/physiological/p1/ppg/**": (False, f"{PPG}: slow, 40.0 of 55 Hz"),
        "/tf": (False, "absent"),
        "/nothing/*": (False, "absent"),
    }


def test_nothing_is_green_before_it_was_looked_at():
    """While the coordinator has not looked at the streams none of them counts as there."""
    session = Session()
    session.take_state({**PREPARING, "waiting_for": ["required streams: being looked at"]})
    assert [check.ok for check in session.checks() if check.kind == "stream"] == [False] * 4
    assert [check.name for check in session.checks() if check.kind == "other"] == []


def test_a_failed_session_keeps_what_it_had_been_waiting_for():
    """FAILED empties waiting_for; who did not answer stays red."""
    session = Session()
    session.take_state(PREPARING)
    session.take_state({**PREPARING, "phase": 4, "waiting_for": [], "detail": "did not answer: recorder"})
    assert told(session)["recorder"] == (False, "no answer yet")
    assert session.phase == "failed"
    session.take_state({"phase": 1, "session_id": "s2", "expected_services": ["recorder"], "waiting_for": []})
    assert told(session) == {"recorder": (True, "")}


def test_a_service_says_in_its_own_words_and_only_about_this_phase():
    """The detail of an acknowledgement is shown; one of another phase or session is not."""
    session = Session()
    session.take_state(PREPARING)
    session.take_ack({"session_id": "s1", "phase": 1, "service": "clock_sync", "detail": "4 of 4 clocks locked"})
    session.take_ack({"session_id": "s0", "phase": 1, "service": "clock_sync", "detail": "of another session"})
    session.take_ack({"session_id": "s1", "phase": 3, "service": "clock_sync", "detail": "of another phase"})
    assert told(session)["clock_sync"] == (True, "4 of 4 clocks locked")
    session.take_state({**PREPARING, "phase": 2, "waiting_for": []})
    assert told(session)["clock_sync"] == (True, "")


def test_what_nobody_expected_is_shown_all_the_same():
    """An entry of waiting_for that is neither service nor stream is not swallowed."""
    session = Session()
    session.take_state({"phase": 1, "session_id": "s1", "waiting_for": ["the moon: not full"]})
    assert told(session) == {"the moon": (False, "not full")}


@pytest.mark.parametrize("wrong", ["", "many", "-3", "nan", "²", "9" * 30])
def test_what_the_recorder_cannot_say_is_nothing(wrong):
    """An empty or senseless number is None, never 0."""
    status = recorder_status(0, "fine", dict.fromkeys(("messages", "lost", "free_bytes"), wrong))
    assert (status.messages, status.lost, status.free_bytes, status.minutes_left) == (None, None, None, None)
    for minutes in ("", "soon", "nan", "inf"):
        assert recorder_status(0, "fine", {"minutes_left": minutes}).minutes_left is None


def test_a_recorder_in_trouble_is_a_sentence_and_an_old_word_is_none():
    """Its own message, with its severity; after 5 s without news nothing is told any more, nor guessed."""
    study = Study()
    study.session.take_recorder(recorder_status(1, "12 min of disk left", {"free_bytes": "900", "lost": "3"}), NOW)
    assert [(p.text, p.severity) for p in problems(study, NOW)] == [("recorder: 12 min of disk left", "warning")]
    shown = study_message(study, ProblemLog(), NOW)["recorder"]
    assert (shown["free_bytes"], shown["lost"], shown["minutes_left"]) == (900, 3, None)
    later = NOW + 6_000_000_000
    assert list(problems(study, later)) == []
    assert study_message(study, ProblemLog(), later)["recorder"] is None
    study.nodes.add("recorder")
    assert study_message(study, ProblemLog(), later)["recorder"] == {"recording": None}


def test_the_report_is_looked_for_where_the_recorder_says_or_in_the_finished_folder():
    """Not while a session runs: its folder has none yet."""
    session = Session()
    session.take_state({"phase": 2, "session_id": "s1", "directory": "/data/s1"})
    assert session.report_path == ""
    session.take_state({"phase": 0, "session_id": "", "directory": "/data/s1"})
    assert session.report_path == "/data/s1/report.html"
    session.take_recorder(recorder_status(0, "", {"report": "/data/other/report.html"}), NOW)
    assert session.report_path == "/data/other/report.html"

"""Who records, in the handshake: a session is complete only where somebody wrote all of it."""

from dataclasses import replace

import pytest
from conducted_study import Study
from sense4hri.recorder_status import RecorderStatus
from session_coordinator.heartbeat import Heartbeats
from session_coordinator.session import Phase, Publish


def test_a_recorder_that_does_not_finish_is_named():
    """The last ones have flush_timeout_s of their own, then the session has FAILED."""
    study = Study("driver", "recorder").record()
    study.stop()
    study.pass_s(9)
    study.ack("driver")
    study.pass_s(9)
    assert study.session.phase is Phase.STOPPING
    study.pass_s(1.5)
    assert study.session.detail == "did not finish within 10 s: recorder"


def test_a_recording_without_its_recorder_is_not_complete():
    """Where the recorder died and never came back, that is waited for, told, and the session has FAILED in the end."""
    study = Study("driver", "recorder").record()
    del study.nodes["recorder"]
    study.look()
    study.pass_s(0.1)
    assert study.session.waiting_for == ("recorder: no answer yet",)
    study.stop()
    study.ack("driver")
    assert study.session.phase is Phase.STOPPING
    study.pass_s(10.5)
    assert (study.session.phase, study.session.detail) == (Phase.FAILED, "gone before the end: recorder")


def test_a_recorder_that_was_out_of_sight_and_wrote_everything_is_complete():
    """DDS forgot the stopped process; it comes back while all wait for it, the same one, and says it lacks nothing."""
    study = Study("driver", "recorder").record()
    recorder = study.nodes.pop("recorder")
    study.look()
    study.stop()
    study.ack("driver")
    study.pass_s(1.0)
    study.nodes["recorder"] = recorder
    study.look()
    study.ack("recorder", directory="/r/s1")
    assert study.notes() == ["service gone: recorder", "service is back: recorder"]
    assert (study.session.phase, study.session.detail) == (Phase.IDLE, "session 's1': complete")


@pytest.mark.parametrize("forgotten", [True, False])
@pytest.mark.parametrize("told", ["", "nobody recorded for 3.0 s"])
def test_a_recorder_started_afresh_leaves_a_gap(forgotten, told):
    """Another process of the name has not written all of it, whether DDS still shows the old one or not."""
    study = Study("driver", "recorder").record()
    study.look()
    old = study.nodes.pop("recorder")
    if forgotten:
        study.look()
    study.nodes["recorder"] = frozenset({b"new"}) if forgotten else old | {b"new"}
    study.look()
    study.ack("recorder")
    study.stop()
    study.ack("driver")
    study.ack("recorder", detail=told)
    said = told or "was started afresh in the middle"
    assert study.session.detail.startswith("session 's1': incomplete: recorder")
    assert said in study.session.detail


def test_what_the_recorder_lacks_is_said_at_the_end():
    """A detail of the recorder's last acknowledgement makes the session incomplete, and is its reason."""
    study = Study("recorder").record()
    study.stop()
    study.ack("recorder", detail="3 messages lost (3 at the disk)")
    assert study.session.detail == "session 's1': incomplete: recorder: 3 messages lost (3 at the disk)"


def test_a_session_that_nobody_records_is_not_called_complete():
    """Without a recorder the session runs, and its end says that it was not recorded."""
    study = Study("driver").record()
    study.stop()
    study.ack("driver")
    assert study.session.detail == "session 's1': not recorded: no recorder took part"


def test_only_who_records_says_where_a_recording_lies():
    """A stranger's directory is nobody's: it neither stands in the session nor turns `not recorded` into `complete`."""
    study = Study("driver").record()
    study.ack("stranger", directory="/evil/dir")
    study.stop()
    study.ack("driver", directory="/evil/dir")
    assert study.session.detail == "session 's1': not recorded: no recorder took part"
    assert {effect.session.directory for effect in study.said if isinstance(effect, Publish)} == {""}


BEAT = RecorderStatus("recorder", "ok", "records session s1", recording=True, session_id="s1")


@pytest.mark.parametrize(
    ("beat", "age_s", "since_s", "told"),
    [
        (BEAT, 3.4, 60.0, ""),
        (BEAT, 3.6, 60.0, "no heartbeat for more than 3.5 s"),
        (replace(BEAT, level="error", message="NOT RECORDING: full"), 0.1, 60.0, "NOT RECORDING: full"),
        (replace(BEAT, level="warning", message="3 messages lost"), 0.1, 60.0, ""),
        (replace(BEAT, session_id="s0"), 0.1, 2.0, ""),
        (replace(BEAT, session_id="s0"), 0.1, 4.0, "does not record this session"),
        (replace(BEAT, recording=False), 0.1, 4.0, "does not record this session"),
    ],
)
def test_the_heartbeat_of_who_records_is_judged(beat, age_s, since_s, told):
    """Missing, an error, or of another session: within 5 s that is a sentence; who never said a thing is not judged."""
    beats = Heartbeats()
    assert beats.troubles(["recorder"], "s1", 40.0, 100.0) == {}
    beats.take(beat, 100.0 - age_s)
    troubles = beats.troubles(["recorder"], "s1", 100.0 - since_s, 100.0)
    assert (list(troubles), told in troubles.get("recorder", "")) == (["recorder"] if told else [], True)


def test_a_recorder_in_trouble_is_told_while_recording_and_holds_up_a_start():
    """It stands in waiting_for with its sentence and is noted, once each time; so is its end."""
    study = Study("recorder")
    study.start()
    study.do(study.coordinator.troubles({"recorder": "no heartbeat"}, study.now()))
    study.ack("recorder")
    study.pass_s(0.1)
    assert (study.session.phase, study.session.waiting_for) == (Phase.PREPARING, ("recorder: no heartbeat",))
    study.do(study.coordinator.troubles({}, study.now()))
    study.ack("recorder")
    assert study.session.phase is Phase.RECORDING
    for _ in range(2):
        study.do(study.coordinator.troubles({"recorder": "no heartbeat"}, study.now()))
        study.pass_s(0.1)
    assert study.session.waiting_for == ("recorder: no heartbeat",)
    study.do(study.coordinator.troubles({}, study.now()))
    study.pass_s(0.1)
    assert study.session.waiting_for == ()
    assert study.notes() == ["recorder: no heartbeat", "recorder: records again"]


def test_a_recorder_that_dies_while_preparing_is_waited_for():
    """Nothing begins without who was to record when it was asked for, also once DDS shows it gone."""
    study = Study("driver", "recorder")
    study.start()
    study.ack("driver", "recorder", ok=False, detail="the clock is not locked")
    study.do(study.coordinator.troubles({"recorder": "no heartbeat"}, study.now()))
    del study.nodes["recorder"]
    study.look()
    study.ack("driver")
    study.pass_s(0.1)
    assert study.session.phase is Phase.PREPARING
    assert study.session.waiting_for == ("recorder: no answer yet",)
    study.nodes["recorder"] = frozenset({b"another process"})
    study.look()
    study.do(study.coordinator.troubles({}, study.now()))
    study.ack("recorder")
    assert study.session.phase is Phase.RECORDING


def test_the_recorder_of_a_session_is_known_as_long_as_it_runs():
    """Of those who take part, the ones that finish last."""
    study = Study("driver", "recorder")
    assert study.coordinator.recorded_by == ()
    assert study.record().coordinator.recorded_by == ("recorder",)

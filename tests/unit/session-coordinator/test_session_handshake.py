"""The handshake as a state machine: what is said, to whom, and when."""

import json
from dataclasses import replace

import pytest
from conducted_study import WISH, Study
from sense4hri.beats import TWINS
from sense4hri.intake import check
from session_coordinator.config import Config
from session_coordinator.session import Ack, Phase, Publish
from session_coordinator.store import Store
from session_coordinator.wire import state_message


def test_a_session_from_start_to_end():
    """All ready, one start announced ahead, all finished, the recorder last: the phases come in this order."""
    study = Study("driver", "recorder")
    assert study.start().success
    assert study.session.waiting_for == ("driver: no answer yet", "recorder: no answer yet")
    study.ack("driver")
    assert study.session.phase is Phase.PREPARING
    study.ack("recorder", directory="/r/1")
    assert study.session.phase is Phase.RECORDING
    assert study.session.start_ns == study.now().ros_ns + 10**9
    study.ack("driver", "recorder")
    assert study.session.waiting_for == ()
    study.pass_s(1.0)
    assert study.stop("s1").directory == "/r/1"
    assert study.session.stop_ns == study.now().ros_ns
    study.ack("driver")
    assert study.session.waiting_for == ("recorder: no answer yet",)
    study.ack("recorder", directory="/r/1")
    assert study.phases() == [Phase.IDLE, Phase.PREPARING, Phase.RECORDING, Phase.STOPPING, Phase.IDLE]
    assert study.session.directory == "/r/1"
    assert study.session.detail == "session 's1': complete"
    assert study.session.session_id == ""


@pytest.mark.parametrize(("after_s", "notes"), [(-0.2, []), (0.4, ["driver heard of the start 0.4 s after it"])])
def test_who_hears_late_of_the_start_is_told_once(after_s, notes):
    """Its first segment opens later than the others': an analyst must be able to read that in the session's notes."""
    study = Study("driver")
    study.start()
    study.ack("driver")
    said_ns = study.session.start_ns + round(after_s * 1e9)
    told = Ack("s1", "driver", Phase.RECORDING, True, said_ns=said_ns)
    for _ in range(2):
        study.do(study.coordinator.ack(told, study.now()))
    study.stop()
    study.do(study.coordinator.ack(told._replace(phase=Phase.STOPPING), study.now()))
    assert study.notes() == notes


def test_who_comes_after_the_start_is_not_called_late():
    """That it appeared or was started afresh has been said."""
    study = Study("driver").record()
    study.nodes = {"driver": frozenset({b"another process"}), "recorder": frozenset({b"new"})}
    study.pass_s(5.0)
    study.look()
    for name in study.nodes:
        told = Ack("s1", name, Phase.RECORDING, True, said_ns=study.now().ros_ns)
        study.do(study.coordinator.ack(told, study.now()))
    assert study.notes() == ["service appeared: recorder", "service started afresh: driver"]


def test_who_is_not_ready_is_named_and_waited_for():
    """A service that says no is named with its reason; when it says yes, the recording begins."""
    study = Study("driver")
    study.start()
    study.ack("driver", ok=False, detail="ecg at 98.0 of 130 Hz")
    study.pass_s(200)
    assert study.session.waiting_for == ("driver: ecg at 98.0 of 130 Hz",)
    study.ack("driver")
    assert study.session.phase is Phase.RECORDING


def test_ready_may_be_taken_back():
    """Who was ready and no longer is holds the start up again."""
    study = Study("driver", "clock_sync")
    study.start()
    study.ack("driver")
    study.ack("driver", ok=False, detail="ecg is LOST")
    study.ack("clock_sync")
    assert study.session.phase is Phase.PREPARING


def test_who_never_answers_fails_the_session_by_name():
    """After answer_timeout_s the session has FAILED and says who did not answer; the next one may start."""
    study = Study("driver", "dead")
    study.start()
    study.ack("driver", ok=False, detail="not worn")
    study.pass_s(31)
    assert study.session.phase is Phase.FAILED
    assert study.session.detail == "did not answer within 30 s: dead"
    assert study.start().success


def test_what_is_never_ready_fails_the_session_with_the_reason():
    """After prepare_timeout_s the session has FAILED and says what was missing."""
    study = Study("driver")
    study.start()
    study.ack("driver", ok=False, detail="not worn")
    study.pass_s(601)
    assert (study.session.phase, study.session.detail) == (
        Phase.FAILED,
        "not ready within 600 s: driver: not worn",
    )


def test_required_streams_hold_the_start_up():
    """A required stream that was not looked at yet, or is absent, is waited for by name."""
    study = Study("driver")
    study.start(WISH._replace(required_streams=("/camera",)))
    study.ack("driver")
    assert study.session.waiting_for == ("required streams: being looked at",)
    study.do(study.coordinator.streams({"/camera": "absent"}, study.now()))
    assert study.session.waiting_for == ("/camera: absent",)
    study.do(study.coordinator.streams({}, study.now()))
    assert study.session.phase is Phase.RECORDING


def test_a_required_stream_that_goes_stale_while_recording_is_an_event():
    """It is noted once when it goes and once when it is back, and the recording goes on."""
    study = Study("driver")
    study.start(WISH._replace(required_streams=("/camera",)))
    study.ack("driver")
    study.do(study.coordinator.streams({}, study.now()))
    for troubles in ({"/camera": "stale"}, {"/camera": "stale"}, {}):
        study.do(study.coordinator.streams(troubles, study.now()))
    assert study.notes() == ["required stream /camera: stale", "required stream /camera: back"]
    assert study.session.phase is Phase.RECORDING


def test_a_required_service_is_expected_though_it_is_absent():
    """required_services are waited for also where nobody has ever seen them."""
    study = Study("driver", config=Config(required_services=("recorder",)))
    study.start()
    study.ack("driver")
    study.look()
    assert study.session.waiting_for == ("recorder: no answer yet",)


def test_who_only_looks_on_is_not_expected():
    """Hidden nodes and tools that never acknowledge hold nobody up."""
    study = Study("_ros2cli_17", "rosbag2_recorder", "driver")
    study.start()
    assert study.session.expected == ("driver",)


def test_a_second_start_is_refused_and_changes_nothing():
    """Two sessions at once: the second is told which one runs; in every phase."""
    study = Study("driver")
    study.start()
    for _ in range(3):
        before = study.session
        outcome = study.start(WISH._replace(session_id="s2"))
        assert not outcome.success
        assert "'s1' is " in outcome.message
        assert study.session is before
        study.ack("driver") if study.session.phase is Phase.PREPARING else study.stop()


def test_a_stop_without_a_start_is_refused():
    """Nothing runs, so nothing stops; a wrong name is told apart."""
    study = Study("driver")
    assert study.stop().message == "no session is running"
    study.start()
    assert study.stop("other").message == "session 'other' is not running, 's1' is"


def test_a_second_stop_is_no_mistake():
    """Stopping twice is accepted and does not move the stop."""
    study = Study("driver").record()
    study.stop()
    stop_ns = study.session.stop_ns
    study.pass_s(1)
    assert study.stop().success
    assert study.session.stop_ns == stop_ns


def test_a_stop_while_preparing_ends_the_session_unrecorded():
    """Stopped before it had begun: everybody finishes, no start was set, and the id may be used again."""
    study = Study("driver")
    study.start()
    study.stop()
    assert study.session.start_ns == 0
    study.ack("driver")
    assert study.session.detail == "session 's1': stopped before it had begun"
    assert study.start().success


@pytest.mark.parametrize(("after_s", "told"), [(0.5, "stopped before it had begun"), (1.5, "complete")])
def test_a_stop_before_the_common_start_is_not_called_complete(after_s, told):
    """The start is announced ahead: nobody's first segment has opened then, and the stop's stamp is before it."""
    study = Study("recorder")
    study.start()
    study.ack("recorder")
    study.ack("recorder")
    study.pass_s(after_s)
    study.stop()
    assert (study.session.stop_ns < study.session.start_ns) == (told != "complete")
    study.ack("recorder")
    study.pass_s(0.5)
    study.ack("recorder")
    assert study.session.detail == f"session 's1': {told}"


def test_a_clock_set_back_while_recording_takes_no_session_for_one_that_never_began():
    """By its stamps the stop is before the start then, too."""
    study = Study("recorder").record()
    study.pass_s(600.0)
    outcome = study.coordinator.stop("", study.now()._replace(ros_ns=study.session.start_ns - 10**12))
    assert (outcome.success, study.session.detail) == (True, "")


def test_who_appears_late_in_the_stopping_is_not_called_one_that_did_not_finish():
    """It has had no time to; what it was before it came, nobody can say."""
    study = Study("driver", "recorder").record()
    study.stop()
    study.pass_s(9.0)
    study.ack("driver")
    study.pass_s(5.0)
    study.nodes = {**study.nodes, "passer_by": frozenset({b"new"})}
    study.look()
    study.pass_s(1.0)
    study.ack("passer_by", "recorder")
    assert study.session.detail == "session 's1': complete"


def test_a_name_is_used_once():
    """A session_id that was recorded is refused; generated ones differ within one second."""
    study = Study("driver").record()
    study.stop()
    study.ack("driver")
    assert "used before" in study.start().message
    names = []
    for _ in range(2):
        names.append(study.start(WISH._replace(session_id="")).session_id)
        study.ack("driver")
        study.stop()
        study.ack("driver")
    assert len(set(names)) == 2


def test_who_does_not_finish_is_left_behind_and_named():
    """After flush_timeout_s the recorder is no longer held up; the session then FAILED, by name, with its directory."""
    study = Study("stuck", "recorder").record()
    study.stop()
    study.ack("stuck", ok=False, detail="busy")
    study.ack("recorder", ok=False, detail="waits for the others", directory="/r")
    study.pass_s(10.5)
    assert study.session.waiting_for == ("recorder: waits for the others",)
    study.ack("recorder", directory="/r")
    assert study.session.phase is Phase.FAILED
    assert study.session.detail == "did not finish within 10 s: stuck"
    assert study.session.directory == "/r"


def test_a_service_that_dies_or_appears_is_a_recorded_event():
    """While recording, the one that has gone is no longer expected, the new one is; both are noted."""
    study = Study("driver", "recorder").record()
    del study.nodes["driver"]
    study.look()
    study.nodes["late"] = frozenset({b"late"})
    study.look()
    assert study.notes() == ["service gone: driver", "service appeared: late"]
    assert study.session.expected == ("late", "recorder")
    study.stop()
    study.ack("late", "recorder")
    assert study.session.detail == "session 's1': complete, but gone before the end: driver"


def test_a_service_started_afresh_is_an_event_although_its_name_never_left():
    """DDS shows a killed process for up to 20 s: a second process under the name is what tells."""
    study = Study("driver").record()
    study.nodes["driver"] |= {b"another"}
    study.look()
    study.nodes["driver"] = frozenset({b"another"})
    study.look()
    assert study.notes() == ["service started afresh: driver"]
    study.stop()
    study.ack("driver")
    assert study.session.phase is Phase.IDLE


def test_what_others_say_is_cut_so_that_everybody_can_read_the_session(tmp_path):
    """1500 nodes that talk without end: every state passes what members check, and is read again after a restart."""
    study = Study("recorder", *(f"n{k:0>250}" for k in range(1500)), config=Config(prepare_timeout_s=60.0))
    study.start(WISH._replace(metadata_json=json.dumps({"notes": "x" * 60_000})))
    study.ack("recorder", ok=False, detail="\U0001f9e0" * 65_536, directory="/" + "d" * 65_000)
    study.ack(*study.session.expected[:100], ok=False, detail="\U0001f9e0" * 65_536)
    study.do(study.coordinator.troubles(dict.fromkeys(study.session.expected, "t" * 65_536), study.now()))
    study.do(study.coordinator.streams({f"/topic_{k:0>200}": "stale" for k in range(2000)}, study.now()))
    study.pass_s(1)
    study.pass_s(60)
    assert study.phases()[-1] is Phase.FAILED
    assert "recorder" in study.session.expected
    store = Store(tmp_path / "session.json")
    for published in (effect.session for effect in study.said if isinstance(effect, Publish)):
        check(state_message(published, 1))
        store.save(published, study.coordinator.used)
        assert store.load().session == published


def test_a_service_that_hangs_is_told_while_recording_a_stranger_s_holds_up_no_start():
    """By name, in waiting_for and in a note, once; and that it lives again."""
    study = Study("recorder", "clock_sync")
    study.start()
    study.do(study.coordinator.troubles({"somebody": "no heartbeat"}, study.now()))
    study.ack("recorder")
    study.ack("clock_sync")
    study.pass_s(0.1)
    assert study.session.phase is Phase.RECORDING
    study.ack("recorder")
    study.ack("clock_sync")
    for _ in range(2):
        study.do(study.coordinator.troubles({"clock_sync": "no heartbeat"}, study.now()))
    assert study.session.waiting_for == ("clock_sync: no heartbeat",)
    study.do(study.coordinator.troubles({}, study.now()))
    assert study.session.waiting_for == ()
    assert study.notes() == ["clock_sync: no heartbeat", "clock_sync: lives again"]


def test_two_nodes_of_one_name_hold_a_start_up_and_are_noted():
    """One answers for both, and both publish as one; that one of them has left is no life that came back."""
    study, twins = Study("driver"), {"driver": TWINS}
    study.start()
    study.do(study.coordinator.troubles(twins, study.now()))
    study.ack("driver")
    assert (study.session.phase, study.session.waiting_for) == (Phase.PREPARING, (f"driver: {TWINS}",))
    study.do(study.coordinator.troubles({}, study.now()))
    assert study.session.phase is Phase.RECORDING
    for told in (twins, twins, {}):
        study.do(study.coordinator.troubles(told, study.now()))
    assert study.notes() == [f"driver: {TWINS}", "driver: is one node again"]


def test_who_was_dead_before_a_session_and_takes_no_part_is_none_of_its_troubles():
    """One that was killed for good a day ago is in no recording; once it has lived again its next death is."""
    study, dead = Study("driver"), {"killed": "no heartbeat"}
    study.do(study.coordinator.troubles(dead, study.now()))
    study.start()
    study.ack("driver")
    assert study.session.phase is Phase.RECORDING
    study.do(study.coordinator.troubles(dead, study.now()))
    assert (study.session.waiting_for, study.notes()) == (("driver: no answer yet",), [])
    study.do(study.coordinator.troubles({}, study.now()))
    study.do(study.coordinator.troubles(dead, study.now()))
    assert study.notes() == ["killed: no heartbeat"]


def test_who_dies_while_stopping_is_not_taken_for_finished():
    """It is noted once and, when the time is up, named as not finished."""
    study = Study("driver", "recorder").record()
    study.stop()
    del study.nodes["driver"]
    study.look()
    study.look()
    study.pass_s(10.5)
    study.ack("recorder")
    assert study.notes() == ["service gone: driver"]
    assert study.session.detail == "did not finish within 10 s: driver"


def test_who_leaves_while_preparing_holds_nobody_up():
    """A service that goes before the start is noted and no longer expected."""
    study = Study("driver", "gone")
    study.start()
    study.ack("driver")
    del study.nodes["gone"]
    study.look()
    assert study.session.phase is Phase.RECORDING
    assert study.notes() == ["service gone: gone"]


def test_what_is_said_of_another_session_or_phase_does_not_count():
    """Late acknowledgements of the phase before, or of another session, change nothing."""
    study = Study("driver")
    study.start()
    study.do(study.coordinator.ack(Ack("s0", "driver", Phase.PREPARING, True), study.now()))
    study.ack("driver", phase=Phase.RECORDING)
    assert study.session.phase is Phase.PREPARING


def test_changes_of_what_is_missing_are_published_with_the_next_tick():
    """Twenty answers at once are one message, not twenty."""
    study = Study(*(f"m{k}" for k in range(20)))
    study.start()
    study.said.clear()
    study.ack(*(f"m{k}" for k in range(19)))
    study.pass_s(0.1)
    published = [effect.session for effect in study.said if isinstance(effect, Publish)]
    assert [session.waiting_for for session in published] == [("m19: no answer yet",)]
    assert replace(published[0], waiting_for=()) == replace(study.session, waiting_for=())

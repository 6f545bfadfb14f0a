"""The handshake as a state machine: what is said, to whom, when, and that nothing hangs."""

import json
from dataclasses import replace

import pytest
from sense4hri.intake import check
from sense4hri.recorder_status import RecorderStatus
from session_coordinator.config import Config
from session_coordinator.coordinator import Coordinator
from session_coordinator.heartbeat import Heartbeats
from session_coordinator.request import Request
from session_coordinator.session import Ack, Note, Now, Phase, Publish
from session_coordinator.store import Store
from session_coordinator.wire import state_message

START_NS = 1_800_000_000 * 10**9
WISH = Request("study", session_id="s1", human_ids=("p1",))


class Study:
    """A coordinator, its time, and the services on the graph."""

    def __init__(self, *services: str, config: Config | None = None, **kept: object) -> None:
        self.seconds = 100.0
        self.coordinator = Coordinator(config or Config(), self.now(), **kept)
        self.said: list[object] = []
        self.nodes = {name: frozenset({name.encode()}) for name in services}
        self.look()
        self.pass_s(3.0)

    @property
    def session(self):
        return self.coordinator.session

    def now(self) -> Now:
        return Now(START_NS + round(self.seconds * 1e9), self.seconds)

    def do(self, effects):
        self.said += effects
        return effects

    def look(self):
        return self.do(self.coordinator.seen(self.nodes, self.now()))

    def pass_s(self, seconds: float):
        self.seconds += seconds
        return self.do(self.coordinator.tick(self.now()))

    def start(self, wish: Request = WISH):
        outcome = self.coordinator.start(wish, self.now())
        self.do(outcome.effects)
        return outcome

    def stop(self, session_id: str = ""):
        outcome = self.coordinator.stop(session_id, self.now())
        self.do(outcome.effects)
        return outcome

    def ack(self, *services: str, ok: bool = True, detail: str = "", directory: str = "", phase: Phase | None = None):
        for service in services:
            told = Ack(self.session.session_id, service, phase or self.session.phase, ok, directory, detail)
            self.do(self.coordinator.ack(told, self.now()))

    def record(self):
        self.start()
        self.ack(*self.session.expected)
        self.ack(*self.session.expected)
        assert self.session.phase is Phase.RECORDING
        self.pass_s(0.1)
        return self

    def notes(self) -> list[str]:
        return [effect.text for effect in self.said if isinstance(effect, Note)]

    def phases(self) -> list[Phase]:
        phases = [effect.session.phase for effect in self.said if isinstance(effect, Publish)]
        return [phase for k, phase in enumerate(phases) if k == 0 or phase is not phases[k - 1]]


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


def test_what_is_said_of_another_session_or_phase_does_not_count():
    """Late acknowledgements of the phase before, or of another session, change nothing."""
    study = Study("driver")
    study.start()
    study.do(study.coordinator.ack(Ack("s0", "driver", Phase.PREPARING, True), study.now()))
    study.ack("driver", phase=Phase.RECORDING)
    assert study.session.phase is Phase.PREPARING


def test_nothing_is_recorded_before_the_graph_is_known():
    """A fresh coordinator sees nobody at first; it does not take that for everybody being ready."""
    study = Study()
    fresh = Coordinator(Config(), study.now())
    fresh.start(WISH, study.now())
    fresh.tick(study.now())
    assert fresh.session.phase is Phase.PREPARING
    study.seconds += 2.1
    fresh.tick(study.now())
    assert fresh.session.phase is Phase.RECORDING


def test_a_coordinator_started_afresh_goes_on():
    """It says the same session again, asks everybody again, takes nobody for gone too early, and notes its absence."""
    before = Study("driver", "recorder").record()
    after = Study(session=before.session, used=before.coordinator.used, gone_for_s=4.0)
    assert after.notes() == ["session_coordinator was away for 4.0 s"]
    assert after.session.phase is Phase.RECORDING
    assert after.session.start_ns == before.session.start_ns
    assert after.session.expected == ("driver", "recorder")
    assert len(after.session.waiting_for) == 2
    after.nodes = dict(before.nodes)
    after.look()
    after.ack("driver", "recorder")
    after.pass_s(0.1)
    assert after.session.waiting_for == ()
    after.stop()
    after.ack("driver", "recorder")
    assert after.session.detail == "session 's1': complete"
    assert "used before" in after.start().message


def test_a_coordinator_started_afresh_misses_no_stream_before_it_can_know_it():
    """Its graph is empty at first; what is still missing once it is settled is told."""
    before = Study("driver").record()
    after = Study(session=before.session, gone_for_s=4.0)
    after.do(after.coordinator.streams({"/a": "absent", "/b": "absent"}, after.now()))
    after.do(after.coordinator.streams({"/b": "absent"}, after.now()))
    after.pass_s(21.0)
    after.do(after.coordinator.streams({"/b": "absent"}, after.now()))
    assert [note for note in after.notes() if "stream" in note] == ["required stream /b: absent"]


def test_the_recorder_of_a_session_is_known_as_long_as_it_runs():
    """Of those who take part, the ones that finish last."""
    study = Study("driver", "recorder")
    assert study.coordinator.recorded_by == ()
    assert study.record().coordinator.recorded_by == ("recorder",)


def test_a_session_left_alone_for_long_is_interrupted():
    """A coordinator that was away for longer than resume_within_s does not pretend that the session went on."""
    before = Study("driver").record()
    after = Study("driver", session=before.session, gone_for_s=5000.0)
    assert after.session.phase is Phase.FAILED
    assert after.session.detail == ("interrupted: session_coordinator was away for 5000 s while it was RECORDING")


@pytest.mark.parametrize("phase", [Phase.PREPARING, Phase.RECORDING, Phase.STOPPING])
def test_nothing_hangs_when_everybody_is_dead(phase):
    """Whatever the phase in which everybody falls silent: after a stop the session ends within its deadlines."""
    study = Study("driver", "recorder")
    study.start()
    if phase is not Phase.PREPARING:
        study.ack("driver", "recorder")
    study.stop()
    for _ in range(30):
        study.pass_s(1)
    assert study.session.phase is Phase.FAILED
    assert study.session.detail == "did not finish within 10 s: driver, recorder"


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

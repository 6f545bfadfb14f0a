"""A coordinator that begins in the middle, or is left alone: it goes on, and nothing hangs."""

import math

import pytest
from conducted_study import WISH, Study
from session_coordinator.config import Config
from session_coordinator.coordinator import Coordinator
from session_coordinator.session import Phase


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


def test_an_absence_of_unknown_length_is_told_as_such():
    """The host's clock was set back meanwhile; the session goes on."""
    before = Study("driver", "recorder").record()
    after = Study(session=before.session, gone_for_s=math.nan)
    assert after.session.phase is Phase.RECORDING
    assert after.notes() == ["session_coordinator was away for a time that is not known: the clock was set back"]


def test_a_coordinator_started_afresh_misses_no_stream_before_it_can_know_it():
    """Its graph is empty at first; what is still missing once it is settled is told."""
    before = Study("driver").record()
    after = Study(session=before.session, gone_for_s=4.0)
    after.do(after.coordinator.streams({"/a": "absent", "/b": "absent"}, after.now()))
    after.do(after.coordinator.streams({"/b": "absent"}, after.now()))
    after.pass_s(21.0)
    after.do(after.coordinator.streams({"/b": "absent"}, after.now()))
    assert [note for note in after.notes() if "stream" in note] == ["required stream /b: absent"]


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

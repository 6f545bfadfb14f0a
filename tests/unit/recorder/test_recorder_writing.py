"""Which recording every message goes to: sessions, and what lies between them."""

import threading
import time

import pytest
from mcap.reader import make_reader
from numbered_writing import BETWEEN, NOTHING, ONE, OTHER, Study, session, sidecar, texts
from processes import poll
from recorder import writing as writing_module
from recorder.plan import IDLE, PREPARING, RECORDING, STOPPING, Plan, Session
from rosbags.highlevel import AnyReader
from string_messages import START_NS, cdr_string, string_channel


@pytest.mark.parametrize("always", [True, False])
def test_the_plan_follows_the_session(always):
    """A session is written from PREPARING until it is finished; a session first heard while it runs is a part of it."""
    plan = Plan(always)
    rest = BETWEEN if always else NOTHING
    assert plan.target == rest
    assert plan.hear(PREPARING, ONE) == session(ONE)
    assert plan.hear(RECORDING, ONE) == plan.hear(STOPPING, ONE) == session(ONE)
    assert plan.finish("s1") == rest
    assert plan.hear(STOPPING, ONE) == rest
    assert plan.hear(IDLE, Session("")) == rest
    assert plan.hear(RECORDING, OTHER) == session(OTHER, continued=True)
    assert plan.hear(PREPARING, ONE) == session(ONE)


def test_every_message_is_in_exactly_one_recording(study, tmp_path):
    """While another thread writes without pause the recording changes 20 times: none is lost, none is there twice."""
    stop = threading.Event()

    def publish() -> None:
        while not stop.is_set():
            study.put(20)
            time.sleep(0.001)

    study.turn(BETWEEN)
    study.reached(BETWEEN)
    thread = threading.Thread(target=publish)
    thread.start()
    for i in range(20):
        target = session(Session(f"s{i}")) if i % 2 else BETWEEN
        study.turn(target)
        study.reached(target)
        time.sleep(0.02)
    stop.set()
    thread.join()
    study.writing.close()
    parts = [texts(path.parent) for path in sorted(tmp_path.rglob("metadata.yaml"))]
    assert all(part == list(range(part[0], part[-1] + 1)) for part in parts if part)
    assert sorted(number for part in parts for number in part) == list(range(study.written))
    assert len(parts) == 20


def test_between_sessions_nothing_is_written_where_only_sessions_are(study, tmp_path):
    """Before and after the session nothing is kept; within it everything is, under names that are safe as paths."""
    study.put(3)
    study.turn(session(ONE))
    bag = study.reached(session(ONE))
    study.put(4)
    study.turn(NOTHING)
    study.put(5)
    poll(lambda: study.closed, "closed")
    assert texts(bag.directory) == [3, 4, 5, 6]
    parent, name = bag.directory.parent, bag.directory.name
    assert parent == tmp_path / "Prufung_1_b" / "p1-p2"
    assert name.startswith("s1_n-back_20")
    assert sidecar(bag.directory)["state"] == "complete"
    assert [path.parent for path in tmp_path.rglob("metadata.yaml")] == [bag.directory]


def test_a_recording_does_not_begin_with_what_nobody_publishes_any_more(study):
    """The next session's first file says what still holds, and nothing of a topic whose publishers have left."""
    study.turn(session(ONE))
    study.reached(session(ONE))
    clocks = [string_channel(f"/humans/physiological/{human}/ecg/h10_1/clock") for human in ("p1", "p2")]
    for channel in clocks:
        channel.state, channel.publishers = True, 1
        study.writing.queue.put(channel, cdr_string("0"), START_NS, START_NS, 1)
    clocks[0].publishers, clocks[0].gone = 0, True
    study.turn(session(OTHER))
    bag = study.reached(session(OTHER))
    study.writing.close()
    with AnyReader([bag.directory]) as reader:
        assert [connection.topic for connection in reader.connections] == [clocks[1].topic]


def test_a_session_gone_on_with_lies_beside_its_first_part(study):
    """A recorder that comes while the session runs names its folder after the earlier part, with _1 and so on."""
    names = []
    for target in (session(ONE), session(ONE, True), session(ONE, True)):
        study.turn(NOTHING)
        study.turn(target)
        names.append(study.reached(target).directory.name)
        study.turn(NOTHING)
        poll(lambda: study.writing.at.bag is None, "closed")
    assert names[1:] == [f"{names[0]}_1", f"{names[0]}_2"]


def test_a_session_that_cannot_be_opened_leaves_the_other_recording_running(study, monkeypatch):
    """The reason is told, what comes stays in the running recording, and the session is opened once it can be."""
    monkeypatch.setattr(writing_module, "RETRY_S", 0.05)
    study.turn(BETWEEN)
    between = study.reached(BETWEEN)
    blocked = study.root / "Prufung_1_b"
    blocked.write_text("a file where the folder should be")
    study.turn(session(ONE))
    poll(lambda: study.writing.at.problem, "the trouble is told")
    assert str(blocked) in study.writing.at.problem
    assert study.writing.at.bag is between
    study.put(3)
    poll(lambda: between.accounts.messages == 3, "still recorded")
    blocked.unlink()
    study.reached(session(ONE))
    study.put(2)
    study.writing.close()
    assert [texts(bag.directory) for bag in study.opened] == [[0, 1, 2], [3, 4]]


def test_a_session_that_is_given_up_leaves_no_trouble_behind(study):
    """Once nobody wishes for what could not be opened, the recording that went on is not called in trouble any more."""
    study.turn(BETWEEN)
    between = study.reached(BETWEEN)
    (study.root / "Prufung_1_b").write_text("a file where the folder should be")
    study.turn(session(ONE))
    poll(lambda: study.writing.at.problem, "the trouble is told")
    study.turn(BETWEEN)
    assert study.reached(BETWEEN) is between


@pytest.mark.parametrize("told_ns", [-1, -(2**63), 2**64, 0])
def test_a_stamp_no_file_can_say_is_left_out(study, told_ns):
    """A publisher's time beyond what the file can hold costs nothing: the receipt stands for it."""
    study.turn(BETWEEN)
    bag = study.reached(BETWEEN)
    study.writing.queue.put(study.channel, cdr_string("0"), START_NS, told_ns, 1)
    study.writing.close()
    with next(bag.directory.glob("*.mcap")).open("rb") as file:
        (message,) = (message for _, _, message in make_reader(file).iter_messages())
    assert (message.log_time, message.publish_time) == (START_NS, START_NS)


def test_two_recorders_in_one_directory_have_folders_of_their_own(tmp_path):
    """Each writes what it received, whole, though both began in the same second."""
    studies = [Study(tmp_path), Study(tmp_path)]
    for study in studies:
        study.turn(BETWEEN)
    bags = [study.reached(BETWEEN) for study in studies]
    for study in studies:
        study.put(10)
        study.writing.close()
    assert bags[0].directory != bags[1].directory
    assert [texts(bag.directory) for bag in bags] == [[*range(10)]] * 2


def test_a_clock_set_back_an_hour_loses_nothing(study, monkeypatch):
    """The step is an event of the recording; receipt times go back as they did, every message is there."""
    study.turn(BETWEEN)
    bag = study.reached(BETWEEN)
    study.put(50)
    poll(lambda: bag.accounts.messages == 50, "recorded")
    real = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: real() - 3600 * 10**9)
    for i in range(50):
        stamp = START_NS - 3600 * 10**9 + i
        study.writing.queue.put(study.channel, cdr_string(str(50 + i)), stamp, stamp, 51 + i)
    poll(lambda: bag.about.events, "the step is noted")
    study.turn(session(ONE))
    study.reached(session(ONE))
    monkeypatch.undo()
    study.writing.close()
    assert "host clock stepped by -3600." in bag.about.events[0]["what"]
    assert sorted(texts(bag.directory)) == list(range(100))

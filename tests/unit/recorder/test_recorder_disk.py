"""What a disk may do to the recorder: be full, slow, read-only, lose a folder, refuse; nothing is lost in silence."""

import errno
import os
import re
import shutil
import subprocess
import threading

import pytest
from numbered_writing import BETWEEN, NOTHING, ONE, OTHER, Study, session, sidecar, texts
from processes import DEADLINE_S, poll
from recorder import queued
from recorder import writing as writing_module
from recorder.space import RESERVE_BYTES, Space
from recorder.split import Entry
from sense4hri_recording import lock as lock_module
from string_messages import START_NS, cdr_string


def test_below_the_floor_nothing_begins_and_it_begins_when_there_is_room(tmp_path, monkeypatch):
    """The refusal names the parameter; what came meanwhile is counted in the recording that then begins."""
    monkeypatch.setattr(writing_module, "RETRY_S", 0.02)
    free = [10_000_000]
    monkeypatch.setattr(writing_module, "free_bytes", lambda path: free[0])
    study = Study(tmp_path, floor_bytes=500_000_000)
    study.turn(BETWEEN)
    poll(lambda: "10 MB free, free_floor_mb is 500" in study.writing.at.problem, "the refusal")
    assert list(tmp_path.iterdir()) == []
    study.put(7)
    poll(lambda: not study.writing.queue, "taken from the queue")
    free[0] = 1_000_000_000
    bag = study.reached(BETWEEN)
    study.put(1)
    study.writing.close()
    assert (bag.accounts.messages, bag.accounts.lost) == (1, 7)
    assert sidecar(bag.directory)["topics"][0]["losses"][0]["cause"] == "disk"


def test_a_session_is_not_charged_with_what_another_one_lost(tmp_path, monkeypatch):
    """What found no file while a session could not begin is forgotten with it; the next one lacks nothing."""
    free = [10_000_000]
    monkeypatch.setattr(writing_module, "free_bytes", lambda path: free[0])
    study = Study(tmp_path, floor_bytes=500_000_000)
    study.turn(session(ONE))
    poll(lambda: "10 MB free" in study.writing.at.problem, "the refusal")
    study.put(500)
    poll(lambda: not study.writing.queue, "taken from the queue")
    study.turn(NOTHING)
    poll(lambda: not study.writing.at.problem, "given up")
    free[0] = 1_000_000_000
    study.turn(session(OTHER))
    bag = study.reached(session(OTHER))
    study.put(10)
    study.writing.close()
    assert (bag.accounts.messages, bag.accounts.lost) == (10, 0)


def test_it_stops_before_the_disk_is_full_and_goes_on(tmp_path, monkeypatch):
    """At a tenth of the floor the file is ended with its index; at a fifth a further file is begun."""
    monkeypatch.setattr(writing_module, "SPACE_INTERVAL_S", 0.02)
    free = [600_000_000]
    monkeypatch.setattr(writing_module, "free_bytes", lambda path: free[0])
    study = Study(tmp_path, floor_bytes=500_000_000)
    study.turn(BETWEEN)
    bag = study.reached(BETWEEN)
    study.put(2)
    poll(lambda: bag.accounts.messages == 2, "recorded")
    free[0] = 100_000_000
    study.put(1)
    poll(lambda: bag.accounts.messages == 3, "below the floor, and still recorded")
    free[0] = 49_000_000
    poll(lambda: bag.paused, "stopped")
    assert "49 MB left" in bag.refused
    study.put(5)
    poll(lambda: bag.accounts.lost == 5, "counted")
    free[0] = 104_000_000
    poll(lambda: study.writing.space.free_bytes == free[0], "seen")
    study.put(1)
    poll(lambda: bag.accounts.lost == 6, "not yet gone on")
    free[0] = 105_000_000
    poll(lambda: not bag.paused, "goes on")
    study.put(1)
    study.writing.close()
    assert texts(bag.directory) == [0, 1, 2, 9]
    assert len(list(bag.directory.glob("*.mcap"))) == 2


def test_a_session_ends_cleanly_while_the_disk_is_full(tmp_path, monkeypatch):
    """Closed while it may not write, a recording is whole and lacks nothing but what it says, with its cause."""
    monkeypatch.setattr(writing_module, "SPACE_INTERVAL_S", 0.02)
    free = [600_000_000]
    monkeypatch.setattr(writing_module, "free_bytes", lambda path: free[0])
    study = Study(tmp_path, floor_bytes=500_000_000)
    study.turn(session(ONE))
    bag = study.reached(session(ONE))
    study.put(2)
    poll(lambda: bag.accounts.messages == 2, "recorded")
    free[0] = 1_000_000
    poll(lambda: bag.paused, "stopped")
    assert re.search(
        r"since \d\d:\d\d:\d\d UTC 1 MB left.*104 MB are free; what was written before is safe", bag.trouble
    )
    study.put(3)
    study.writing.close()
    about = sidecar(bag.directory)
    assert (bag.closed, bag.failure, bag.missing) == (True, "", "3 messages lost (3 at the disk)")
    assert (about["state"], texts(bag.directory)) == ("complete", [0, 1])
    assert "stopped writing: 1 MB left" in about["events"][0]["what"]


def test_what_nobody_foresaw_costs_what_was_in_hand(study, monkeypatch):
    """The writing thread fails: what it had written and what waits is in a file with an index; the service is told.

    Lost is the chunk in progress, which may hold half a message; it is counted.
    """
    failures: list[BaseException] = []

    def fails_where_told(entry):
        if entry.data == cdr_string("7"):
            raise LookupError("a fault nobody foresaw")
        real(entry)

    monkeypatch.setattr(threading, "excepthook", lambda hook: failures.append(hook.exc_value))
    study.turn(session(ONE))
    bag = study.reached(session(ONE))
    study.put(5)
    poll(lambda: bag.accounts.messages == 5 and bag.last_written_ns, "recorded")
    poll(lambda: not bag._split.unflushed, "and flushed")
    real = study.writing._heads.keep
    monkeypatch.setattr(study.writing._heads, "keep", fails_where_told)
    with study.writing.queue._lock:  # all in one drain
        stamps = range(START_NS + 5, START_NS + 12)
        study.writing.queue._items.extend(
            Entry(study.channel, cdr_string(str(number)), stamp, stamp, number + 1)
            for number, stamp in enumerate(stamps, start=5)
        )
    poll(lambda: failures, "the thread has ended")
    study.writing.close()
    about = sidecar(bag.directory)
    assert texts(bag.directory) == [0, 1, 2, 3, 4, 8, 9, 10, 11]
    assert (about["state"], about["topics"][0]["lost"]) == ("interrupted", 3)
    assert "a fault nobody foresaw" in about["why"]
    assert study.writing.at.bag is None


def test_what_the_thread_of_the_disk_left_is_done_by_the_one_that_closes(study, monkeypatch):
    """A job fails in a way nobody foresaw: the recording is closed all the same, with what is told of it."""
    monkeypatch.setattr(threading, "excepthook", lambda hook: None)
    study.turn(session(ONE))
    bag = study.reached(session(ONE))
    study.writing._disk.do(lambda: [][0])
    poll(lambda: not study.writing._disk._thread.is_alive(), "the thread has ended")
    study.put(2)
    study.writing.close()
    assert (bag.closed, study.closed, texts(bag.directory)) == (True, [bag], [0, 1])


def test_a_folder_deleted_under_the_recorder_is_replaced(study, monkeypatch):
    """The loss is said, and what comes afterwards is recorded in a new folder."""
    study.turn(BETWEEN)
    first = study.reached(BETWEEN)
    study.put(2)
    poll(lambda: first.last_written_ns, "on disk")
    shutil.rmtree(first.directory.rename(first.directory.with_name("deleted")))  # at once: its name may be taken again
    poll(lambda: len(study.opened) == 2, "a new folder")
    study.put(3)
    study.writing.close()
    assert texts(study.opened[1].directory) == [2, 3, 4]
    assert first.accounts.lost == 2
    assert any(
        "was deleted under the recorder" in event["what"] for event in sidecar(study.opened[1].directory)["events"]
    )


@pytest.mark.parametrize("call", ["fsync", "pwrite"])
def test_a_slow_disk_never_keeps_a_publisher_waiting(study, monkeypatch, call):
    """While a call to the disk has not come back messages are taken in, and none is lost."""
    real = getattr(os, call)
    called, let_go = threading.Event(), threading.Event()

    def slow(*arguments):
        called.set()
        assert let_go.wait(DEADLINE_S)
        return real(*arguments)

    study.turn(BETWEEN)
    bag = study.reached(BETWEEN)
    monkeypatch.setattr(os, call, slow)
    study.put()
    assert called.wait(DEADLINE_S)
    study.put(100)
    let_go.set()
    monkeypatch.undo()
    study.writing.close()
    assert texts(bag.directory) == list(range(101))


@pytest.mark.parametrize("ended", [False, True])
def test_what_finds_the_queue_full_is_counted_where_it_was(study, monkeypatch, ended):
    """With a disk that hangs the queue fills up; the hole lies between the messages around it, with its cause.

    What the middleware had lost before a message that finds no room is in it; at its end the recording has it too.
    """
    study.turn(BETWEEN)
    bag = study.reached(BETWEEN)
    study.put(1)
    poll(lambda: bag.accounts.messages == 1, "recorded")
    released, real = threading.Event(), os.pwrite

    def hanging(*arguments):
        released.wait(10)
        return real(*arguments)

    monkeypatch.setattr(os, "pwrite", hanging)
    study.put(1)
    poll(lambda: bag.accounts.messages == 2, "the disk hangs")
    monkeypatch.setattr(queued, "QUEUE_BYTES", 10 * len(cdr_string("10")))
    study.put(15)
    study.writing.queue.put(study.channel, cdr_string("none"), START_NS + 16, START_NS, 20, lost=2)
    if ended:
        study.turn(NOTHING)
    released.set()
    poll(lambda: bag.accounts.messages == 12, "the queue is empty again")
    study.put(1)
    study.writing.close()
    (topic,) = sidecar(bag.directory)["topics"]
    (hole,) = topic["losses"]
    assert (topic["messages"], topic["lost"]) == (12 if ended else 13, 8)
    assert (hole["after_ns"], hole["count"], hole["cause"]) == (START_NS + 11, 8, "queue")
    assert ended or hole["before_ns"] == START_NS + 17


def test_what_was_left_at_the_stop_is_lost_after_the_last_message(study):
    """It is counted in the recording that ends, as waiting in the recorder, from the last message to the end."""
    study.turn(BETWEEN)
    study.put(3)
    study.writing.queue.leave(study.channel, 7)
    study.writing.close()
    (bag,) = study.closed
    (hole,) = sidecar(bag.directory)["topics"][0]["losses"]
    assert (hole["after_ns"], hole["count"], hole["cause"]) == (START_NS + 2, 7, "queue")
    assert bag.accounts.lost == 7
    assert bag.missing == "7 messages lost (7 waiting in the recorder)"


def test_a_disk_without_locks_is_named_and_no_folder_is_left(tmp_path, monkeypatch):
    """Where no recording can be locked none is begun, again and again, and nothing of the tries stays."""
    monkeypatch.setattr(writing_module, "RETRY_S", 0.02)
    tries = []

    def refuse(fd):
        tries.append(fd)
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(lock_module, "_lock", refuse)
    study = Study(tmp_path)
    study.turn(BETWEEN)
    poll(lambda: len(tries) > 3, "some tries")
    assert "No locks available" in study.writing.at.problem
    study.writing.close()
    assert list(tmp_path.iterdir()) == []


def test_a_read_only_disk_is_named_and_used_once_it_can_be(tmp_path, monkeypatch):
    """Mounted read-only, nothing is begun and the reason is told; mounted again for writing, the recording begins."""
    monkeypatch.setattr(writing_module, "RETRY_S", 0.05)
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "none", str(disk)], capture_output=True).returncode != 0:
        pytest.skip("no right to mount a file system")
    study = Study(disk)
    try:
        study.turn(BETWEEN)
        poll(lambda: "Read-only file system" in study.writing.at.problem, "the refusal")
        subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
        bag = study.reached(BETWEEN)
        study.put(3)
        study.writing.close()
        assert texts(bag.directory) == [0, 1, 2]
    finally:
        study.writing.close()
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.parametrize("others_per_s", [0, 50_000_000, -50_000_000])
def test_how_long_the_disk_lasts_is_told_also_where_others_fill_it(others_per_s):
    """At the rate of the last minute: the recording's, or of all that fills it; what others free is no promise."""
    space, own_per_s = Space(500_000_000), 100_000
    for second in range(61):
        free = 10_000_000_000 - (own_per_s + others_per_s) * second
        space.look(second, own_per_s * second, free)
    per_s = own_per_s + max(0, others_per_s)
    assert space.minutes_left == pytest.approx((free - 50_000_000) / per_s / 60)


def test_what_a_recording_keeps_aside_does_not_count_as_a_disk_that_fills():
    """It is taken at once at its beginning, and would make minutes of hours."""
    space = Space(500_000_000)
    space.look(0, 0, 2_000_000_000)
    space.look(1, 10_000, 2_000_000_000 - RESERVE_BYTES - 10_000)
    assert space.minutes_left is not None
    assert space.minutes_left > 3000

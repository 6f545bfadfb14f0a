"""What had been sent when the recorder stops: taken in, or counted, or said to be more than can be counted."""

import threading
from contextlib import AbstractContextManager, nullcontext
from types import SimpleNamespace

import pytest
from recorder import hearing as hearing_module
from recorder.hearing import LONGEST_S, Hearing
from recorder.taken import Taken
from recorder.topics import OTHERS_DEPTH
from sense4hri import pace as pace_module


class Sent(AbstractContextManager):
    """Stands in for a subscription with so many messages waiting; taking one lets time pass."""

    def __init__(self, name, count, clock):
        self.topic_name, self.handle, self._left, self._clock = name, self, count, clock

    def __exit__(self, *_):
        return None

    pointer = property(lambda self: self)

    def next(self):
        if not self._left:
            return None
        self._left -= 1
        self._clock.now_s += 1 / 64
        return Taken(b"", 1, 1, 1, b"")


@pytest.fixture(autouse=True)
def sent_are_taken(monkeypatch):
    """What `Sent` gives is taken as rcl's messages are, and nobody has to be woken for it."""
    monkeypatch.setattr(hearing_module, "taker", lambda: nullcontext(lambda sent: sent.next()))
    guard = SimpleNamespace(handle=None, trigger=lambda: None, destroy=lambda: None)
    monkeypatch.setattr(hearing_module, "GuardCondition", lambda *_, **__: guard)


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now_s=0.0)
    monkeypatch.setattr(hearing_module.time, "monotonic", lambda: clock.now_s)
    return clock


@pytest.mark.parametrize(
    ("own", "other", "taken", "counted", "uncounted"),
    [
        (30, 20, 50, 0, []),
        (60, 50, 65, 45, []),
        (150, 100, 65, 129, ["/other"]),
        (5, 5000, 65, 129, ["/other"]),
    ],
)
def test_what_is_too_much_at_the_stop_is_counted(clock, own, other, taken, counted, uncounted):
    """Messages are taken in for 1 s, the study's own first, counted for 2 s more, and then their topic is named."""
    found, late = [], []

    def made(kind, name, take, profile, **_):
        return Sent(name, own if name == "/own" else other, clock)

    service = SimpleNamespace(
        node=SimpleNamespace(create_subscription=made, context=None),
        thread=lambda name, work, pulse: SimpleNamespace(join=lambda: None),
    )
    hearing = Hearing(service)
    for name in ("/other", "/own"):
        hearing.subscribe(bytes, name, lambda *_, name=name: found.append((name, bool(late))), None, name == "/own")
    assert hearing.close(lambda: late.append(True)) == uncounted
    assert [x[1] for x in found].count(False) == taken
    assert [x[1] for x in found].count(True) == counted
    assert found[0][0] == "/own"
    assert taken == 65 or [name for name, _ in found] == ["/own"] * own + ["/other"] * other


class Ready:
    """Stands in for rcl's wait set: what stands in `handles` has messages."""

    def __init__(self, *_):
        self._handles = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def clear_entities(self):
        pass

    def add_subscription(self, handle):
        self._handles.append(handle)

    def add_guard_condition(self, handle):
        pass

    def wait(self, nanoseconds):
        pass

    def get_ready_entities(self, kind):
        return [handle.pointer for handle in self._handles]


class Waiting(Sent):
    """One message that takes long to be handed over, though it costs no processor: the machine is busy with others."""

    def next(self):
        threading.Event().wait(0.2)
        return super().next()


def test_a_round_that_was_kept_waiting_is_rested_for_by_what_it_used_and_answers_meanwhile(monkeypatch):
    """A busy machine's rounds take long: the thread says in the middle of one that it turns, and rests no longer."""
    rests, answered, pulses, work = [], [], [], []
    monkeypatch.setattr(hearing_module.rcl, "WaitSet", Ready)
    clock = SimpleNamespace(now_s=0.0)

    def thread(name, function, pulse):
        work.append(function)
        pulses.append(pulse)
        return SimpleNamespace(join=lambda: None)

    node = SimpleNamespace(
        create_subscription=lambda kind, name, take, profile, **_: Waiting(name, 1, clock),
        context=SimpleNamespace(handle=None),
    )
    hearing = Hearing(SimpleNamespace(node=node, thread=thread))

    def rest(seconds):
        rests.append(seconds)
        hearing.close(lambda: None)

    monkeypatch.setattr(hearing_module.time, "sleep", rest)
    hearing.subscribe(bytes, "/a", lambda *_: pulses[0].ask(lambda: answered.append("/a")), None, True)
    hearing.subscribe(bytes, "/b", lambda *_: answered.append("taken: /b"), None, True)
    work[0]()
    assert answered[:2] == ["/a", "taken: /b"]
    assert len(rests) == 1
    assert rests[0] < 0.4  # twice the 0.4 s that were waited would be 0.8


@pytest.fixture
def rounds(monkeypatch, clock):
    """Two rounds of a hearing, to be made by `.work[0]()`; what it said of itself at their ends; no time passes."""
    monkeypatch.setattr(hearing_module.rcl, "WaitSet", Ready)
    work, ends, no_clock = [], [], SimpleNamespace(now_s=0.0)
    node = SimpleNamespace(
        create_subscription=lambda kind, name, take, profile, **_: Sent(name, 1, no_clock),
        context=SimpleNamespace(handle=None),
    )

    def thread(name, function, pulse):
        work.append(function)
        return SimpleNamespace(join=lambda: None)

    def rest(seconds):
        ends.append(hearing.behind_s)
        if len(ends) == 2:
            hearing.close(lambda: None)

    hearing = Hearing(SimpleNamespace(node=node, thread=thread))
    monkeypatch.setattr(hearing_module.time, "sleep", rest)
    return SimpleNamespace(hearing=hearing, work=work, ends=ends)


def test_how_far_behind_it_is_is_told_in_the_middle_of_a_round(monkeypatch, rounds):
    """Where more comes than is taken in a round lasts for seconds, and what the one before has found is long past."""
    hearing, told = rounds.hearing, []
    monkeypatch.setattr(hearing_module.time, "time_ns", lambda: 5_000_000_001)  # 5 s after what `Sent` gives
    for name in ("/a", "/b"):
        hearing.subscribe(bytes, name, lambda _: told.append(hearing.behind_s), None, True)
    rounds.work[0]()
    assert told == [0.0, 5.0]
    assert rounds.ends == [5.0, 0.0]


def test_what_comes_while_a_round_hardly_goes_on_waits_for_it(monkeypatch, clock, rounds):
    """A thread that hardly gets a core takes one topic for a minute: nothing of it was late, all that follows is."""
    hearing, told = rounds.hearing, []
    monkeypatch.setattr(hearing_module.time, "time_ns", lambda: 1)  # when `Sent` was received

    def take(_):
        clock.now_s += 60.0
        told.append(hearing.behind_s)

    hearing.subscribe(bytes, "/a", take, None, True)
    rounds.work[0]()
    assert told == [60.0]
    assert rounds.ends == [0.0, 0.0]


def test_after_a_round_that_used_much_it_rests_no_longer_than_a_stop_can_wait(monkeypatch):
    """A flood that takes a minute of CPU is no reason to hear nothing for two: queues fill, and a stop waits."""
    rests, work = [], []
    monkeypatch.setattr(hearing_module.rcl, "WaitSet", Ready)
    used_s = iter([0.0, 60.0])
    monkeypatch.setattr(pace_module.time, "thread_time", lambda: next(used_s))

    def thread(name, function, pulse):
        work.append(function)
        return SimpleNamespace(join=lambda: None)

    def rest(seconds):
        rests.append(seconds)
        hearing.close(lambda: None)

    hearing = Hearing(SimpleNamespace(node=SimpleNamespace(context=SimpleNamespace(handle=None)), thread=thread))
    monkeypatch.setattr(hearing_module.time, "sleep", rest)
    work[0]()
    assert rests == [LONGEST_S]


def test_a_round_empties_the_queue_of_a_topic_that_others_publish(monkeypatch):
    """The next one begins 0.05 s later or more: what is left of a robot's /tf would find the queue full."""
    monkeypatch.setattr(hearing_module.rcl, "WaitSet", Ready)
    clock, work, taken = SimpleNamespace(now_s=0.0), [], []
    node = SimpleNamespace(
        create_subscription=lambda kind, name, take, profile, **_: Sent(name, OTHERS_DEPTH, clock),
        context=SimpleNamespace(handle=None),
    )

    def thread(name, function, pulse):
        work.append(function)
        return SimpleNamespace(join=lambda: None)

    hearing = Hearing(SimpleNamespace(node=node, thread=thread))
    hearing.subscribe(bytes, "/tf", taken.append, None, False)
    in_a_round = []

    def rest(seconds):
        in_a_round.append(len(taken))
        hearing.close(lambda: None)

    monkeypatch.setattr(hearing_module.time, "sleep", rest)
    work[0]()
    assert in_a_round == [OTHERS_DEPTH]

"""Whether a service is said to be alive, and when its process ends."""

import threading

import pytest
from processes import poll
from sense4hri import liveness as module
from sense4hri.liveness import HUNG_S, SILENT_S, TICK_S, Liveness, Pulse

NAMES = ("the main thread", "the ROS thread")


class Threads:
    """Threads that answer at once, but for those that hang."""

    def __init__(self) -> None:
        self.hanging: set[str] = set()
        self.waiting: list[object] = []
        self.hung: list[list[str]] = []
        self.liveness = Liveness({name: self._ask(name) for name in NAMES}, lambda names: self.hung.append(list(names)))

    def _ask(self, name):
        def ask(answer):
            if name in self.hanging:
                self.waiting.append(answer)
            else:
                answer()

        return ask

    def pass_by(self, seconds, own=1.0):
        for _ in range(round(seconds / TICK_S)):
            self.liveness.tick(TICK_S, {threading.get_native_id(): own})


@pytest.fixture
def threads():
    return Threads()


def test_nobody_is_alive_before_he_has_answered(threads):
    """A service of which nothing is known yet is not alive; one answer of each is enough."""
    assert threads.liveness.silent() == list(NAMES)
    threads.liveness.tick(0.0)
    assert threads.liveness.silent() == []


@pytest.mark.parametrize("name", NAMES)
def test_who_falls_silent_is_named_and_then_ends_the_process(threads, name):
    """Either thread alone is enough: first the service is not alive, later its process is told to end, once."""
    threads.pass_by(60.0)
    threads.hanging.add(name)
    threads.pass_by(SILENT_S + TICK_S)
    assert (threads.liveness.silent(), threads.hung) == ([name], [])
    threads.pass_by(2 * HUNG_S)
    assert threads.hung == [[name]]


def test_who_answers_late_is_alive_again(threads):
    """A thread that was busy for long and goes on is alive, and was never told to end."""
    threads.hanging.add("the main thread")
    threads.pass_by(HUNG_S - SILENT_S - TICK_S)
    threads.hanging.clear()
    for answer in threads.waiting:
        answer()
    threads.pass_by(HUNG_S)
    assert (threads.liveness.silent(), threads.hung) == ([], [])


def test_silences_are_not_added_up(threads):
    """A thread that is busy for long again and again, and answers each time, never hangs."""
    for _ in range(3):
        threads.hanging.add("the main thread")
        threads.pass_by(HUNG_S * 0.7)
        threads.hanging.clear()
        for answer in threads.waiting:
            answer()
        threads.waiting.clear()
        threads.pass_by(2 * TICK_S)
    assert (threads.liveness.silent(), threads.hung) == ([], [])


def test_the_time_in_which_the_process_was_stopped_counts_for_nobody(threads):
    """After SIGSTOP or a suspended machine the first look finds an hour gone: nobody is silent, nothing ends."""
    threads.pass_by(5.0)
    threads.hanging.add("the ROS thread")
    threads.pass_by(2 * TICK_S)
    threads.liveness.tick(3600.0)
    assert (threads.liveness.silent(), threads.hung) == ([], [])


def test_a_machine_that_is_too_busy_ends_nothing_but_a_hang(threads):
    """A thread that waits for a processor nine seconds of ten is told silent after a minute, and no more; where it
    is silent for long enough beyond that, its process ends."""
    threads.pass_by(5.0)
    threads.hanging.add("the main thread")
    threads.pass_by(2 * HUNG_S, own=0.1)
    assert (threads.liveness.silent(), threads.hung) == (["the main thread"], [])
    threads.pass_by(9 * HUNG_S, own=0.1)
    assert threads.hung == [["the main thread"]]


def test_a_thread_that_hangs_is_not_excused_by_others_that_wait(threads):
    """Only its own waiting counts: one that sleeps for ever on a machine that is too busy ends its process in time."""
    threads.pass_by(5.0)
    threads.hanging.add("the ROS thread")
    for _ in range(round((HUNG_S + TICK_S) / TICK_S)):
        threads.liveness.tick(TICK_S, {threading.get_native_id(): 1.0, -1: 0.0})
    assert threads.hung == [["the ROS thread"]]


def test_before_its_first_answer_a_thread_is_given_the_time_of_the_one_that_waited_longest(threads):
    """Where a service starts on a machine that is too busy, nobody knows yet which thread is which."""
    threads.hanging.add("the main thread")
    threads.pass_by(2 * HUNG_S, own=0.1)
    assert threads.hung == []


def test_a_thread_that_begins_later_is_alive_until_it_does_not_answer_and_forgotten_when_it_ends(threads):
    """It is asked like the others: silent after so long, answered by its own beat."""
    pulse = Pulse()
    threads.pass_by(TICK_S)
    threads.liveness.watch("the disk thread", pulse.ask)
    assert threads.liveness.silent() == []
    threads.pass_by(SILENT_S + 2 * TICK_S)
    assert threads.liveness.silent() == ["the disk thread"]
    pulse.beat()
    assert threads.liveness.silent() == []
    threads.liveness.forget("the disk thread")
    threads.pass_by(HUNG_S + 2 * TICK_S)
    assert (threads.liveness.silent(), threads.hung) == ([], [])


@pytest.mark.parametrize(("own", "ends"), [(0.0, False), (1.0, True)])
def test_the_running_watch_asks_how_long_each_waited_for_a_processor(monkeypatch, own, ends):
    """A thread that is silent because it never had a processor ends nothing, one that had one does."""
    told = []

    class Processor:
        def own(self, elapsed_s):
            return {1: own}

    monkeypatch.setattr(module, "Processor", Processor)
    monkeypatch.setattr(module, "TICK_S", 0.002)
    monkeypatch.setattr(module, "HUNG_S", 0.02)
    watched = Liveness({}, told.append)
    watched.watch("the disk thread", lambda answer: None)
    threading.Thread(target=watched.keep_asking, daemon=True).start()
    try:
        poll(lambda: watched.silent(0.2), "a long silence", 30, 0.01)
    finally:
        watched.close()
    assert bool(told) == ends


def test_the_processor_is_asked_only_for_who_is_late(monkeypatch):
    """Linux's account of every thread costs more than all else here: it is read while somebody has not answered."""
    asked, hanging, kept = [], threading.Event(), []

    class Account:
        def own(self, elapsed_s):
            asked.append(elapsed_s)
            return {}

    def ask(answer):
        kept.append(answer) if hanging.is_set() else answer()

    monkeypatch.setattr(module, "TICK_S", 0.01)
    monkeypatch.setattr(module, "Processor", Account)
    ticks, liveness = [], Liveness({"one": ask}, lambda names: None)
    tick = liveness.tick
    liveness.tick = lambda *how: ticks.append(how) or tick(*how)
    threading.Thread(target=liveness.keep_asking, daemon=True).start()
    poll(lambda: len(ticks) > 20, "it has been asked often")
    assert asked == []
    hanging.set()
    poll(lambda: asked, "its processor is looked at")
    hanging.clear()
    kept[-1]()
    poll(lambda: ticks[-1][1] is None, "and no more")
    liveness.close()

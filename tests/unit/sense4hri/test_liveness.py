"""Whether a service is said to be alive, and when its process ends."""

import pytest
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

    def pass_by(self, seconds):
        for _ in range(round(seconds / TICK_S)):
            self.liveness.tick(TICK_S)


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


def test_the_time_in_which_the_process_was_stopped_counts_for_nobody(threads):
    """After SIGSTOP or a suspended machine the first look finds an hour gone: nobody is silent, nothing ends."""
    threads.pass_by(5.0)
    threads.hanging.add("the ROS thread")
    threads.pass_by(2 * TICK_S)
    threads.liveness.tick(3600.0)
    assert (threads.liveness.silent(), threads.hung) == ([], [])


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

"""Whether a service is said to be alive."""

import threading

from sense4hri.liveness import Liveness


def test_a_service_is_alive_where_every_thread_answers():
    """An answer from another thread, a moment later, is an answer."""
    asks = {"one": lambda answer: answer(), "two": lambda answer: threading.Timer(0.01, answer).start()}
    assert Liveness(asks, answer_s=60.0).silent() == []


def test_a_thread_that_does_not_answer_is_named():
    """One thread that hangs is enough, and only that one is named."""
    asks = {"the main thread": lambda answer: answer(), "the ROS thread": lambda answer: None}
    assert Liveness(asks, answer_s=0.05).silent() == ["the ROS thread"]


def test_each_time_is_asked_anew():
    """A thread that has answered once and hangs now is not alive."""
    answers = [lambda answer: answer(), lambda answer: None]
    liveness = Liveness({"main": lambda answer: answers.pop(0)(answer)}, answer_s=0.05)
    assert [liveness.silent(), liveness.silent()] == [[], ["main"]]

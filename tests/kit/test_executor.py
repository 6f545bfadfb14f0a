"""What turns a service's node: everything that comes is handed over, whatever comes and goes beside it."""

import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future

import pytest
from builtin_interfaces.msg import Time
from ears import Ears
from processes import DEADLINE_S, poll
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sense4hri.executor import MOST_AT_ONCE, TURN_S
from sense4hri.ros_thread import RosThread
from std_msgs.msg import String
from std_srvs.srv import Trigger

CYCLES = 60


class Spun(Ears):
    """A node whose executor is the kit's, on a thread of its own."""

    def __init__(self) -> None:
        super().__init__("spun")
        self.failures: list[BaseException] = []
        self.changes = 0
        self.thread = RosThread(self.node, self.failures.append, lambda place, why: None, self.changed)

    def changed(self) -> None:
        self.changes += 1

    def close(self) -> None:
        self.thread.close()
        super().close()


@pytest.fixture
def spun(opened) -> Iterator[Spun]:
    return opened(Spun())


def test_nothing_is_missed_while_subscriptions_come_and_go(spun, opened):
    """Another thread makes and ends subscriptions all the time; of a topic beside them every message is heard."""
    heard, speaker = [], opened(Ears("speaker"))
    spun.thread.start()
    spun.node.create_subscription(String, "/steady", lambda message, info: heard.append(message.data), 1000)
    publisher = speaker.node.create_publisher(String, "/steady", 1000)
    poll(lambda: publisher.get_subscription_count() == 1, "the two know each other")
    for number in range(CYCLES):
        other = spun.node.create_subscription(String, f"/other_{number}", lambda message, info: None, 1)
        publisher.publish(String(data=str(number)))
        spun.node.destroy_subscription(other)
    poll(lambda: len(heard) == CYCLES, lambda: f"all are heard: {heard}, {spun.failures}")
    assert heard == [str(number) for number in range(CYCLES)]


def test_of_what_has_come_and_gone_nothing_is_kept(spun):
    """Not the weak references either that rclpy leaves in the node's callback group, some for each subscription."""
    spun.thread.start()
    kept = spun.node.default_callback_group.entities
    for number in range(CYCLES):
        other = spun.node.create_subscription(String, f"/other_{number}", lambda message, info: None, 1)
        spun.node.destroy_subscription(other)
    del other
    spun.thread.do(spun.node.executor.wake)  # what it waited for until now is free in the next look
    poll(lambda: all(one() is not None for one in list(kept)), lambda: f"{len(kept)} are kept, {spun.failures}", 10)
    assert spun.failures == []


def test_who_is_answered_later_keeps_nobody_waiting(spun, opened):
    """A service answers with what a Future will hold; meanwhile another one, and tasks, get their turn."""
    later, turned = Future(), threading.Event()
    spun.node.create_service(Trigger, "/slow", lambda request, response: later)
    spun.node.create_service(Trigger, "/fast", lambda request, response: Trigger.Response(message="at once"))
    spun.thread.start()
    asker = opened(Ears("asker"))
    client = asker.node.create_client(Trigger, "/slow")
    asker.until(client.service_is_ready, "the slow one is served")
    slow = client.call_async(Trigger.Request())
    assert asker.ask(Trigger, "/fast", Trigger.Request()).message == "at once"
    spun.thread.do(turned.set)
    assert turned.wait(30)
    assert not slow.done()
    later.set_result(Trigger.Response(message="at last"))
    asker.until(slow.done, "the slow one answers")
    assert slow.result().message == "at last"


def test_a_quality_of_service_that_does_not_fit_is_told(spun, opened):
    """A subscription that wants what a publisher does not offer hears nothing, and rclpy's warning of it comes."""
    told = []
    events = SubscriptionEventCallbacks(incompatible_qos=told.append)
    reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    spun.node.create_subscription(String, "/misfit", lambda message, info: None, reliable, event_callbacks=events)
    spun.thread.start()
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    opened(Ears("speaker")).node.create_publisher(String, "/misfit", best_effort)
    poll(lambda: told, "the misfit is told")


@pytest.mark.parametrize("step", ["get_num_entities", "is_ready", "take_data"])
def test_a_subscription_may_be_destroyed_while_its_events_are_looked_at(spun, step, monkeypatch):
    """Another thread may end one at any moment: between any two steps of the look nothing falls over."""
    leaving = spun.node.create_subscription(String, "/leaving", lambda message, info: None, 1)
    event = leaving.event_handlers[0]
    asked, looked = getattr(event, step), threading.Event()
    monkeypatch.setattr(event, "is_ready", lambda wait_set: True)
    event._ready_to_take_data = True  # as rclpy leaves it where there is something

    def leave(*args: object) -> object:
        spun.node.destroy_subscription(leaving)
        return step == "is_ready" or asked(*args)

    monkeypatch.setattr(event, step, leave)
    spun.thread.start()
    poll(lambda: spun.failures or leaving not in spun.node.subscriptions, "it is gone")
    spun.thread.do(looked.set)
    poll(lambda: spun.failures or looked.is_set(), "the next turn comes")
    assert spun.failures == []


def test_the_node_takes_the_time_of_a_replay(spun, opened):
    """With use_sim_time, which anybody may set, rclpy's own subscription of /clock gets the message alone."""
    spun.thread.start()
    spun.node.set_parameters([Parameter("use_sim_time", value=True)])
    clock = opened(Ears("speaker")).node.create_publisher(Clock, "/clock", 10)

    def is_seven() -> bool:
        clock.publish(Clock(clock=Time(sec=7)))  # as a replay does: nobody tells when best effort is heard
        return spun.node.get_clock().now().nanoseconds == 7 * 10**9

    poll(lambda: spun.failures or is_seven(), "it is seven")
    assert spun.failures == []


def test_what_a_callback_raises_ends_the_thread_and_is_told(spun, opened):
    """A service that went on without its callbacks would look alive."""
    spun.thread.start()

    def fail(message: String) -> None:
        raise KeyError(message.data)

    spun.node.create_subscription(String, "/bad", fail, 10)
    speaker = opened(Ears("speaker")).node.create_publisher(String, "/bad", 10)
    poll(speaker.get_subscription_count, "the two know each other")
    speaker.publish(String(data="this"))
    poll(lambda: spun.failures, "the thread ends")
    assert isinstance(spun.failures[0], KeyError)


def test_a_topic_with_more_than_a_turn_takes_is_heard_whole(spun, opened):
    """What is left goes on in the next turn, and another topic gets its turn between."""
    many, other = [], []
    gate = threading.Event()
    spun.thread.start()
    spun.node.create_subscription(String, "/gate", lambda message, info: gate.wait(30), 1)
    spun.node.create_subscription(String, "/many", lambda message, info: many.append(message.data), 500)
    spun.node.create_subscription(String, "/other", lambda message, info: other.append(len(many)), 1)
    node = opened(Ears("speaker")).node
    publishers = {name: node.create_publisher(String, f"/{name}", 500) for name in ("gate", "many", "other")}
    poll(lambda: all(one.get_subscription_count() for one in publishers.values()), "they know each other")
    publishers["gate"].publish(String())
    for number in range(4 * MOST_AT_ONCE):
        publishers["many"].publish(String(data=str(number)))
    publishers["other"].publish(String())
    gate.set()
    poll(lambda: len(many) == 4 * MOST_AT_ONCE and other, lambda: f"all are heard: {len(many)}, {spun.failures}")
    assert many == [str(number) for number in range(4 * MOST_AT_ONCE)]


def test_who_asks_is_answered_however_slow_the_messages_are(spun, opened):
    """Where a topic has much work waiting, as on a machine that is too busy, a task gets its turn before it ends."""
    many, taken_before = [], []

    def slow(message: String, info: object) -> None:
        if not many:
            spun.thread.do(lambda: taken_before.append(len(many)))
        many.append(message.data)
        time.sleep(TURN_S / 2)

    spun.node.create_subscription(String, "/slow", slow, 500)
    speaker = opened(Ears("speaker")).node.create_publisher(String, "/slow", 500)
    poll(speaker.get_subscription_count, "the two know each other")
    for number in range(MOST_AT_ONCE):
        speaker.publish(String(data=str(number)))
    spun.thread.start()
    poll(lambda: taken_before, lambda: f"the task has its turn: {spun.failures}")
    assert taken_before[0] < MOST_AT_ONCE / 2


def test_samples_do_not_overtake_an_announcement(spun, opened):
    """What comes during a turn full of samples is taken within 50 ms of them: 1 s of a session replayed at 20x."""
    taken, announced = [], []
    speaker = opened(Ears("speaker")).node
    samples, news = (speaker.create_publisher(String, f"/{name}", 500) for name in ("samples", "news"))

    def sample(message: String, info: object) -> None:
        if not taken:
            news.publish(String())
            poll(lambda: news.wait_for_all_acked(Duration(seconds=0)), "it has come")
        taken.append(message.data)
        time.sleep(0.002)

    spun.node.create_subscription(String, "/samples", sample, 500)
    spun.node.create_subscription(String, "/news", lambda message, info: announced.append(len(taken)), 1)
    poll(lambda: samples.get_subscription_count() and news.get_subscription_count(), "they know each other")
    for number in range(MOST_AT_ONCE):
        samples.publish(String(data=str(number)))
    spun.thread.start()
    poll(lambda: announced, lambda: f"it is taken: {spun.failures}")
    assert announced[0] * 0.002 < 0.05


def test_a_timer_is_no_silent_trap(spun):
    """A timer of rclpy's, which would never fire here, ends the thread with a sentence."""
    spun.node.create_timer(0.1, lambda: None)
    spun.thread.start()
    poll(lambda: spun.failures, "the thread ends")
    assert "spun has a timer" in str(spun.failures[0])


def test_a_change_of_the_graph_is_told_and_nothing_else_is(spun, opened):
    """Somebody begins to publish, to subscribe, ends: told each time, and what is said on a topic is none of it."""
    speaker, heard = opened(Ears("speaker")), []
    spun.thread.start()
    spun.node.create_subscription(String, "/said", lambda message, info: heard.append(message.data), 1000)
    publisher = speaker.node.create_publisher(String, "/said", 1000)
    poll(lambda: publisher.get_subscription_count() == 1, "the two know each other")
    publisher.publish(String())
    poll(lambda: heard, "the first is heard")
    until_quiet(spun)
    before = spun.changes
    for _ in range(20):
        publisher.publish(String())
    poll(lambda: len(heard) == 21, "all are heard")
    assert spun.changes == before
    for change in (
        lambda: speaker.node.create_publisher(String, "/new", 1),
        lambda: speaker.node.create_subscription(String, "/new", lambda message: None, 1),
        lambda: speaker.node.destroy_publisher(publisher),
    ):
        before = spun.changes
        change()
        poll(lambda before=before: spun.changes > before, "it is told")
    assert spun.failures == []


def until_quiet(spun: Spun) -> None:
    """Wait until the graph has not changed for a while: what DDS has to say of two nodes comes bit by bit."""
    seen = [spun.changes, time.monotonic()]

    def quiet() -> bool:
        if spun.changes != seen[0]:
            seen[:] = spun.changes, time.monotonic()
        return time.monotonic() - seen[1] > 1.0

    poll(quiet, "the graph is quiet")


def test_what_may_wait_is_taken_together(spun, opened):
    """Of a topic that may wait 0.5 s what comes meanwhile is handed over in one turn, and others wait for nothing."""
    speaker, patient, prompt, within_s = opened(Ears("speaker")), [], [], 0.5
    waits = spun.node.create_subscription(String, "/waits", lambda message, info: patient.append(message.data), 100)
    spun.node.create_subscription(String, "/prompt", lambda message, info: prompt.append(time.monotonic()), 100)
    spun.thread.delay(waits, within_s)
    spun.thread.start()
    publishers = [speaker.node.create_publisher(String, name, 100) for name in ("/waits", "/prompt")]
    poll(lambda: all(one.get_subscription_count() == 1 for one in publishers), "they know each other")
    publishers[0].publish(String(data="first"))
    poll(lambda: patient, "the first is heard")
    waited, begun_s = 0, time.monotonic()
    for number in range(10):
        publishers[0].publish(String(data=str(number)))
        publishers[1].publish(String())
        poll(lambda number=number: len(prompt) == number + 1, "what may not wait is heard")
        waited += len(patient) < number + 2
    assert waited >= 5 or time.monotonic() - begun_s > within_s
    poll(lambda: len(patient) == 11, "all are heard")
    assert patient == ["first", *map(str, range(10))]
    assert spun.failures == []


def test_what_may_wait_does_not_wait_again_while_there_is_more_of_it(spun, opened):
    """What has come is handed over, also where it is more than a turn takes: it would else grow without bound."""
    speaker, heard = opened(Ears("speaker")), []
    many = spun.node.create_subscription(String, "/many", lambda message, info: heard.append(message.data), 500)
    spun.thread.delay(many, 1000.0)
    publisher = speaker.node.create_publisher(String, "/many", 500)
    poll(publisher.get_subscription_count, "the two know each other")
    for number in range(4 * MOST_AT_ONCE):
        publisher.publish(String(data=str(number)))
    assert publisher.wait_for_all_acked(Duration(seconds=DEADLINE_S))  # what comes later may wait
    spun.thread.start()
    poll(lambda: len(heard) == 4 * MOST_AT_ONCE, lambda: f"all are heard: {len(heard)}, {spun.failures}", 30)
    assert heard == [str(number) for number in range(4 * MOST_AT_ONCE)]


def test_what_may_wait_may_be_destroyed_on_another_thread_while_it_is_taken_note_of(spun):
    """As clock-sync ends what it hears: between two steps of the thread's look at its node nothing falls over."""
    leaving = spun.node.create_subscription(String, "/leaving", lambda message, info: None, 1)
    spun.thread.delay(leaving, 0.1)
    leaving.handle.destroy_when_not_in_use()  # the node has still got it
    spun.thread.start()
    turned = threading.Event()
    spun.thread.do(turned.set)
    poll(lambda: spun.failures or turned.is_set(), "the next turn comes")
    assert spun.failures == []

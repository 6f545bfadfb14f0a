"""How drivers and interpreters take part in a session, with toys as real processes and the test as coordinator."""

import asyncio
import time
from array import array
from types import SimpleNamespace

from sense4hri import qos
from sense4hri.names import StreamName, folder_name
from sense4hri.session import REPEAT_S, SessionMember, concerns, required, waits_for, warmup_allowed
from sense4hri.stamps import set_time, to_ns
from sense4hri_msgs.msg import ECG, PhysioRaw, PhysioRawChannel, SensorInfo, SensorInfoArray, SessionAck, SessionState

P1 = StreamName("p1", "ecg", "toy_1")
START_NS = 10**15
RECEIVED_NS = 10**18


class Sessions:
    """The test's own coordinator: publishes states, hears acknowledgements."""

    def __init__(self, ears) -> None:
        self._ears = ears
        self._publisher = ears.node.create_publisher(SessionState, "/study/session", qos.SESSION)
        self.acks = ears.hear(SessionAck, "/study/ack", qos.ACK)

    def say(self, phase: int, start_ns: int = 0, **fields: object) -> None:
        state = SessionState(session_id="s1", phase=phase, **fields)
        set_time(state.start_at, start_ns)
        self._publisher.publish(state)

    def ack(self, service: str, phase: int, ok: bool = True) -> SessionAck:
        def found():
            return [a for a in self.acks if (a.service, a.phase, a.ok) == (service, phase, ok)]

        return self._ears.until(found, lambda: f"{service} acknowledges {phase}: {self.acks}")[-1]

    def until_quiet(self) -> None:
        """Wait until nobody has repeated anything for twice the time between repeats."""
        heard = [(len(self.acks), time.monotonic())]

        def quiet() -> bool:
            if len(self.acks) != heard[-1][0]:
                heard.append((len(self.acks), time.monotonic()))
            return time.monotonic() - heard[-1][1] > 2 * REPEAT_S

        self._ears.until(quiet, "silence")


def test_a_driver_is_ready_when_it_streams_at_its_rate(start, ears):
    """Declared at 100 Hz and streaming so: ready. Declared at 110 Hz: not ready, with stream and rate named."""
    sessions = Sessions(ears)
    start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    start("toy_driver.py", human_id="p1", sensor_id="slow_1", ecg__sampling_frequency_hz=125.0)
    start("toy_driver.py", human_id="p2", sensor_id="other_1", ecg__sampling_frequency_hz=125.0)
    everyone = ["driver_toy_toy_1", "driver_toy_slow_1", "driver_toy_other_1"]
    sessions.say(SessionState.PREPARING, human_ids=["p1"], waiting_for=everyone)
    sessions.ack("driver_toy_toy_1", SessionState.PREPARING)
    sessions.ack("driver_toy_other_1", SessionState.PREPARING)
    ears.until(
        lambda: any(a.service == "driver_toy_slow_1" and "of 125 Hz" in a.detail and not a.ok for a in sessions.acks),
        "the slow one names stream and rate",
    )
    assert not any(a.ok for a in sessions.acks if a.service == "driver_toy_slow_1")


def test_a_lost_sensor_says_so(start, ears, tmp_path):
    """A driver whose device does not stream is not ready, and says in which state it is, until it streams."""
    sessions = Sessions(ears)
    away = tmp_path / "away"
    away.touch()
    start("toy_driver.py", human_id="p1", sensor_id="toy_1", env={"TOY_AWAY": str(away)})
    sessions.say(SessionState.PREPARING, waiting_for=["driver_toy_toy_1"])
    ears.until(lambda: any("ecg is " in ack.detail for ack in sessions.acks), "the driver says in which state it is")
    assert not any(ack.ok for ack in sessions.acks)
    away.unlink()
    sessions.ack("driver_toy_toy_1", SessionState.PREPARING, ok=True)


def test_who_comes_late_acknowledges_too(start, ears):
    """A service started while the session records hears of it and acknowledges, as the state is transient local."""
    sessions = Sessions(ears)
    sessions.say(SessionState.RECORDING, start_ns=time.time_ns(), waiting_for=["toy_interpreter"])
    start("toy_interpreter.py")
    sessions.ack("toy_interpreter", SessionState.RECORDING)
    sessions.say(SessionState.STOPPING)
    sessions.ack("toy_interpreter", SessionState.STOPPING)


def test_who_is_waited_for_says_it_again(start, ears):
    """A coordinator that was started afresh, and knows of no answer, gets one without any change of phase."""
    sessions = Sessions(ears)
    start("toy_interpreter.py")
    sessions.say(SessionState.PREPARING, waiting_for=["toy_interpreter"])  # heard only once it has found this node
    sessions.ack("toy_interpreter", SessionState.PREPARING)
    sessions.say(SessionState.PREPARING)
    sessions.until_quiet()
    sessions.acks.clear()
    sessions.say(SessionState.PREPARING, waiting_for=["toy_interpreter: no answer yet"])
    sessions.ack("toy_interpreter", SessionState.PREPARING)


def tell_of_toy_1(ears) -> None:
    """Say on `/study/sensors` what the stream P1 is like."""
    sensors = ears.node.create_publisher(SensorInfoArray, "/study/sensors", qos.SENSORS)
    info = SensorInfo(
        sensor_id="toy_1", sensor_type="ecg", sampling_frequency_hz=100.0, unit="uV", channel_names=["ecg"]
    )
    sensors.publish(SensorInfoArray(sensors=[info]))


def publish_frames(publisher, first: int, last: int) -> None:
    """Frames of 0.5 s each, number k ending k half seconds after START_NS."""
    for k in range(first, last + 1):
        message = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=array("d", [0.0] * 50))])
        set_time(message.device_timestamp, START_NS + k * 500_000_000)
        set_time(message.header.stamp, START_NS + RECEIVED_NS + k * 500_000_000)
        publisher.publish(message)


def test_interpreters_cut_at_the_first_message_of_the_session(start, ears):
    """The message stamped start_at or later begins a new segment and its grid; everything before is the old one."""
    sessions = Sessions(ears)
    tell_of_toy_1(ears)
    process = start("toy_interpreter.py")
    got = ears.hear(ECG, P1.topic("features"), qos.deep(qos.FEATURES))
    raw = ears.node.create_publisher(PhysioRaw, P1.topic("raw"), qos.RAW)
    sessions.say(SessionState.PREPARING, human_ids=["p1"], waiting_for=["toy_interpreter"])
    sessions.ack("toy_interpreter", SessionState.PREPARING)
    ears.until(lambda: raw.get_subscription_count() > 0, "the interpreter subscribes")
    publish_frames(raw, 1, 7)
    ears.until(lambda: len(got) == 3, "three updates of the old segment")
    start_ns = START_NS + RECEIVED_NS + 10 * 500_000_000 - 1
    sessions.say(SessionState.RECORDING, start_ns=start_ns, human_ids=["p1"])
    sessions.ack("toy_interpreter", SessionState.RECORDING)
    publish_frames(raw, 8, 16)
    ears.until(lambda: len(got) >= 7, "updates of the new segment")
    ends = [(to_ns(message.device_timestamp) - START_NS) / 1e9 for message in got]
    # a segment whose first sample is at 0.01 s updates at 1.01, 2.01, ..; the new one has its first sample at 4.51 s
    assert ends == [1.01, 2.01, 3.01, 4.01, 5.51, 6.51, 7.51]
    assert [message.peak_count for message in got] == [101, 100, 100, 100, 101, 100, 100]
    assert "Traceback" not in process.log()


def test_an_interpreter_is_ready_once_it_hears_what_is_required(start, ears):
    """A required stream of its types that it has not found, or has not heard, holds a session up; no other one does."""
    sessions = Sessions(ears)
    start("toy_interpreter.py")
    required_streams = [P1.topic("raw"), P1._replace(sensor_type="eda").topic("raw"), "/odom", "/humans/**/raw"]
    waiting_for = ["toy_interpreter"]
    sessions.say(SessionState.PREPARING, required_streams=required_streams, waiting_for=waiting_for)
    said = sessions.ack("toy_interpreter", SessionState.PREPARING, ok=False).detail
    assert said == f"{P1.topic('raw')} is not seen yet"
    tell_of_toy_1(ears)
    raw = ears.node.create_publisher(PhysioRaw, P1.topic("raw"), qos.RAW)
    silent = f"{P1.topic('raw')} is not heard yet"
    ears.until(lambda: any(ack.detail == silent for ack in sessions.acks), "the interpreter has heard nothing")
    assert not any(ack.ok for ack in sessions.acks)
    publish_frames(raw, 1, 1)
    sessions.ack("toy_interpreter", SessionState.PREPARING)


def test_what_cannot_be_interpreted_holds_no_session_up(start, ears):
    """A required stream whose features would have too long a name: it is recorded, and the interpreter is ready."""
    sessions = Sessions(ears)
    process = start("toy_derived.py")
    long = P1._replace(sensor_id="s" * 63)
    ears.node.create_publisher(PhysioRaw, long.topic("raw"), qos.RAW)
    sessions.say(SessionState.PREPARING, required_streams=[long.topic("raw")], waiting_for=["toy_derived"])
    sessions.ack("toy_derived", SessionState.PREPARING)
    assert "its features have no name" in process.log()


def test_nothing_wakes_a_service_of_which_no_session_asks_anything(monkeypatch):
    """It sets no timer without a session and while one records; while one prepares it is asked again and again.

    A bare wake of a process ten times a second costs 0.15 % of a core, in every service.
    """

    async def timers_set() -> int:
        loop, at_s, handlers, thrice = asyncio.get_running_loop(), [], [], asyncio.Event()
        call_at = loop.call_at
        monkeypatch.setattr(loop, "call_at", lambda *args, **more: at_s.append(args[0]) or call_at(*args, **more))

        def ready(state: SessionState) -> tuple[bool, str]:
            if len(at_s) == 3:
                thrice.set()
            return False, "not yet"

        service = SimpleNamespace(
            stopped=asyncio.Event(),
            node=SimpleNamespace(get_name=lambda: "me"),
            publisher=lambda *_: SimpleNamespace(publish=lambda ack: None),
            subscribe=lambda kind, topic, handler, profile: handlers.append(handler),
            every=lambda seconds, function: at_s.append(seconds),
            start=lambda work: working.append(asyncio.ensure_future(work)),
        )
        working: list[asyncio.Future[None]] = []
        SessionMember(service, ready)
        (hear,) = handlers
        hear(SessionState())
        await turns()
        assert not at_s
        hear(SessionState(session_id="s1", phase=SessionState.PREPARING))
        await thrice.wait()
        hear(SessionState(session_id="s1", phase=SessionState.RECORDING))
        await turns()
        before, last = len(at_s), asyncio.Event()
        call_at(at_s[-1] + 0.01, last.set)
        await last.wait()
        await turns()
        working[0].cancel()
        return len(at_s) - before

    async def turns() -> None:
        for _ in range(20):
            await asyncio.sleep(0)

    assert asyncio.run(timers_set()) == 0


def test_only_raw_streams_by_their_names_are_required_ones():
    """A glob names no stream, and neither does a topic of the robot or another field of a stream."""
    state = SessionState(required_streams=[P1.topic("raw"), P1.topic("health"), "/humans/*/*/*/*/raw", "/odom"])
    assert required(state) == {P1}


def test_which_streams_concern_a_session():
    """Those of its participants and the required ones; where nobody is named, everything that somebody wears."""
    named = SessionState(human_ids=["p1"], required_streams=["/humans/physiological/*/eda/**"])
    room = StreamName("unassigned", "eda", "room")
    assert [concerns(named, name) for name in (P1, P1._replace(human_id="p2"), room)] == [True, False, True]
    nobody = SessionState()
    assert [concerns(nobody, name) for name in (P1, room)] == [True, False]


def test_what_a_state_says_of_a_service():
    """An entry of waiting_for names the node up to the colon; the warm-up is accepted only by a plain true."""
    assert waits_for(["recorder: writing"], "recorder")
    assert not waits_for(["recorder_2", "recorder2: x"], "recorder")
    texts = ['{"allow_warmup": true}', '{"allow_warmup": "yes"}', "", "[true]", "{"]
    assert [warmup_allowed(SessionState(metadata_json=text)) for text in texts] == [True, False, False, False, False]


def test_free_text_becomes_a_folder_name():
    """Nothing in a study's name can leave the folder or be unreadable in a shell."""
    assert folder_name("Prüfung 1/b") == "Prufung_1_b"
    assert [folder_name(text) for text in ("../..", "リーチ", "", "a" * 80)] == ["unnamed"] * 3 + ["a" * 60]

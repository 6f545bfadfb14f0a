"""A service that cannot work any more says so or ends: a toy service as a real process."""

import asyncio
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from processes import poll
from rclpy.node import NodeNameNonExistentError
from sense4hri import diagnostics, qos
from sense4hri.beats import Beat
from sense4hri.liveness import HUNG_S
from sense4hri.service import Service
from sense4hri.topics import UNKNOWN_NODE
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel

SIX = {f"{one}_parameters" for one in ("describe", "get", "list", "set")} | {
    "get_parameter_types",
    "set_parameters_atomically",
}


def test_what_is_missing_is_said(start):
    """/healthz answers ok while both threads turn; /readyz says in its body what is missing."""
    toy = start("toy_service.py")
    poll(lambda: toy.get("/healthz") == (200, "ok\n"), "alive")
    poll(lambda: toy.get("/readyz") == (503, "not ready: the toy is not wound up\n"), "what is missing")
    assert toy.stop_within() == 0


def test_a_main_thread_that_hangs_is_not_alive(start):
    """While the main thread does not answer, /healthz is 503 and names it; the port itself still answers."""
    toy = start("toy_service.py")
    poll(
        lambda: toy.get("/readyz")[1] == "not ready: the toy is not wound up\n" and toy.get("/healthz")[0] == 200,
        "alive",
    )
    toy.send(signal.SIGUSR1)
    poll(lambda: toy.get("/healthz") == (503, "no answer from: the main thread\n"), "not alive")
    assert toy.get("/readyz")[1].startswith("not ready: no answer from: the main thread; ")
    assert toy.get("/metrics")[0] == 200
    toy.kill()


def test_a_thread_that_fails_fails_its_service(start):
    """An exception on a thread ends the process with a traceback and a status that has it restarted."""
    toy = start("toy_service.py", fault="thread")
    assert toy.wait() == 1
    assert "the toy's disk is broken" in toy.log()


def test_a_ros_thread_that_ends_ends_the_service(start):
    """An exception on the ROS thread ends the process: the service does not live on deaf."""
    toy = start("toy_service.py", fault="ros")
    assert toy.wait() == 1
    assert "The ROS thread has ended" in toy.log()


@pytest.mark.parametrize("name", ["http", "liveness"])
def test_no_thread_of_the_kit_ends_in_silence(start, name):
    """A service does not live on without its port, or with a /healthz that nobody keeps true."""
    toy = start("toy_service.py", fault=name)
    assert toy.wait() == 1
    assert "the toy's disk is broken" in toy.log()


def test_nobody_waits_for_a_name_that_is_still_looked_up(start):
    """A name server that does not answer keeps a service that is told to stop no longer than Docker waits."""
    toy = start("toy_service.py", fault="name")
    poll(lambda: toy.get("/healthz") == (200, "ok\n"), "alive")
    assert toy.stop_within() == 0


def test_raw_bytes_that_a_handler_cannot_decode_are_refused(start, ears):
    """The service lives, counts them and names topic and reason; the next good message is heard."""
    toy = start("toy_service.py", raw="/toy/raw")
    publisher = ears.node.create_publisher(PhysioRaw, "/toy/raw", qos.RAW)
    good = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=[1.0])])

    said = "/toy/raw: refused from /ears: a raw message with channels of [] samples", "decoded ('ecg',)"

    def heard() -> bool:
        for message in (PhysioRaw(), good):
            publisher.publish(message)
        return all(sentence in toy.log() for sentence in said)

    ears.until(heard, toy.log)
    assert UNKNOWN_NODE not in toy.log()  # nobody is told by a name that is none
    assert 'sense4hri_refused_messages_total{field="PhysioRaw",service="toy_service"}' in toy.get("/metrics")[1]
    assert toy.stop_within() == 0


def test_a_service_says_that_it_lives_which_thread_hangs_and_that_it_ends(start, ears):
    """Once a second on /diagnostics; a run after a SIGKILL is another one, a stop in order says that it ends."""
    told = ears.hear(DiagnosticArray, diagnostics.TOPIC, qos.HEALTH)

    def newest() -> Beat | None:
        ears.spin(0.05)
        return diagnostics.beats(told[-1])[0] if told else None

    toy = start("toy_service.py")
    first = poll(newest, "the first beat")
    assert (first.service, first.trouble, first.ended) == ("toy_service", "", False)
    toy.send(signal.SIGUSR2)
    poll(lambda: newest().trouble == "no answer from the round thread", "the hung thread is named")
    assert toy.get("/healthz")[0] == 503 or poll(lambda: toy.get("/healthz")[0] == 503, "not alive")
    toy.kill()
    toy = start("toy_service.py")
    second = poll(lambda: (beat := newest()) and beat.run != first.run and beat, "a beat of the second run")
    assert (second.trouble, second.ended) == ("", False)
    assert toy.stop() == 0
    assert poll(lambda: newest().ended, "that it ends")


def test_the_operating_system_knows_each_thread_by_its_name(start):
    """So `top -H` tells which of them is busy."""
    toy = start("toy_service.py")

    def names() -> set[str]:
        return {file.read_text().strip() for file in Path(f"/proc/{toy.child.pid}/task").glob("*/comm")}

    poll(lambda: {"round", "http", "liveness"} <= names(), "threads with their names")


def test_two_of_one_name_both_say_so_in_their_log(start):
    """Nobody can tell them apart: two recorders, say. One alone says nothing."""
    first, second = start("toy_service.py"), start("toy_service.py")
    for toy in (first, second):
        toy.until("another node is called /toy_service too")
    assert first.log().count("another node is called") == 1


def test_a_service_that_ends_by_itself_says_so(start, ears):
    """As a replay does at the end of its recording: who heard it is not to think that it hangs or was killed."""
    told = ears.hear(DiagnosticArray, diagnostics.TOPIC, qos.deep(qos.HEALTH))
    toy = start("toy_service.py", ends=True)
    ears.until(lambda: told, "the first beat")
    toy.send(signal.SIGHUP)
    ears.until(lambda: diagnostics.beats(told[-1])[0].ended, "that it ends", 20)
    assert toy.wait() == 0


def test_a_process_that_hangs_ends_and_one_that_was_stopped_goes_on(start):
    """A hung thread ends its process with a traceback; SIGSTOP for as long, then SIGCONT, changes nothing."""
    hung, stuck, stopped = (start("toy_service.py") for _ in range(3))
    for toy in (hung, stuck, stopped):
        poll(lambda toy=toy: toy.get("/healthz")[0] == 200, "alive")
    stopped.send(signal.SIGSTOP)
    hung.send(signal.SIGUSR1)
    stuck.send(signal.SIGUSR2)
    assert hung.wait(3 * HUNG_S) == 1
    assert stuck.wait(3 * HUNG_S) == 1
    assert "no answer from the round thread for" in stuck.log()
    assert "no answer from the main thread for" in hung.log()
    assert "toy_service.py" in hung.log().partition("this process ends")[2]
    stopped.send(signal.SIGCONT)
    poll(lambda: stopped.get("/healthz") == (200, "ok\n"), "alive again")
    assert stopped.stop_within() == 0


@pytest.mark.parametrize(
    ("parameters", "more"), [({}, set()), ({"start_type_description_service": True}, {"get_type_description"})]
)
def test_a_node_serves_its_parameters_and_no_more_unless_it_is_told_to(start, ears, parameters, more):
    """A service is two endpoints that every process of a study learns of; a node has the six that ROS users expect."""

    def served() -> set[str]:
        ears.spin(0.05)
        with suppress(NodeNameNonExistentError):
            found = ears.node.get_service_names_and_types_by_node("toy_service", "/")
            return {name.removeprefix("/toy_service/") for name, _ in found}
        return set()

    toy = start("toy_service.py", **parameters)
    poll(lambda: toy.get("/healthz")[0] == 200, "alive")
    poll(lambda: served() >= SIX | more, "the services of its parameters, and what it was told to serve")
    assert served() == SIX | more


def test_no_service_carries_a_code_generator(ros_domain):
    """A process with a node of the kit's has loaded neither rosidl's generator nor its parsers, 15 MB of memory."""
    node = "import sys, sense4hri.service, rclpy; rclpy.init(); rclpy.create_node('plain').destroy_node(); "
    told = subprocess.check_output([sys.executable, "-c", node + "print({'lark', 'em'} & set(sys.modules))"], text=True)
    assert told == "set()\n"


def test_what_has_the_same_rhythm_has_the_same_beat():
    """Begun at any two moments it is done at once and then in the same turns, so the process wakes up once for both."""
    done = []

    async def two_rhythms() -> None:
        loop = asyncio.get_running_loop()
        toy = SimpleNamespace(_loop=loop, _begun_s=loop.time(), stopped=asyncio.Event(), start=loop.create_task)
        Service.every(toy, 0.2, lambda: done.append(("first", loop.time())))
        await asyncio.sleep(0.07)
        Service.every(toy, 0.2, lambda: done.append(("second", loop.time())))
        async with asyncio.timeout(30):
            while len(done) < 8:
                await asyncio.sleep(0.01)
        toy.stopped.set()

    asyncio.run(two_rhythms())
    turns = [dict(done[turn : turn + 2]) for turn in (2, 4, 6)]
    assert [sorted(turn) for turn in turns] == [["first", "second"]] * 3
    assert min(abs(turn["first"] - turn["second"]) for turn in turns) < 0.03

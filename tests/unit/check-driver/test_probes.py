"""check-driver leaves a sensor on whom it found it on, whatever happens while it tries."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import MethodType, SimpleNamespace

import pytest
from check_driver import probes
from check_driver.findings import Findings
from check_driver.heard import Heard
from check_driver.parameters import ask
from check_driver.probes import Probes
from rcl_interfaces.srv import GetParameters
from sense4hri.line import Line
from sense4hri.names import StreamName
from sense4hri_msgs.msg import StreamHealth


class Driver:
    """A node that keeps the human_id it is given. fault: what the waiting for its topics ends with."""

    def __init__(self, fault: type[BaseException] | None) -> None:
        self.human_id, self.worn, self.fault = "p1", list[str](), fault

    def answer(self, _line, kind, _node, _service, request):
        if kind is GetParameters:
            return SimpleNamespace(values=[SimpleNamespace(string_value=self.human_id)])
        self.human_id = request.parameters[0].value.string_value
        self.worn.append(self.human_id)
        return SimpleNamespace(results=[SimpleNamespace(successful=True, reason="")])

    def until(self, done, _timeout_s):
        if self.fault and self.human_id == "p9":
            raise self.fault
        return done()


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("fault", [None, KeyboardInterrupt])
def test_a_sensor_is_left_on_its_wearer(monkeypatch, raw, fault):
    """One that only reports, one whose samples do not come in time, and one whose check is interrupted."""
    driver, name, findings = Driver(fault), StreamName("p1", "eda", "box_1"), Findings()
    heard = Heard(name, findings, ("eda",), 0.1, 2.0, [SimpleNamespace(heard_s=0.0, device_ns=0)] if raw else [])
    topics = SimpleNamespace(streams={name: heard}, look=lambda: True, published=dict)
    monkeypatch.setattr(probes, "ask", driver.answer)
    with suppress(KeyboardInterrupt):
        Probes(driver, topics, "/driver_box_box_1", findings).wearer("p9")
    assert ("p9" in driver.worn, driver.human_id) == (True, "p1")


def test_a_device_that_only_reports_is_missed_under_its_new_wearer(monkeypatch):
    """It samples nothing; what it has reported again and again must come under the new name, too."""
    driver, name, findings = Driver(None), StreamName("p1", "ecg", "strap_1"), Findings()
    heard = Heard(name, findings, reported_s=[0.0, 1.0, 2.0])
    monkeypatch.setattr(probes, "ask", driver.answer)
    topics = SimpleNamespace(streams={name: heard}, look=lambda: True, published=dict)
    Probes(driver, topics, "/driver_strap_strap_1", findings).wearer("p9")
    assert any("no report came under it" in each.what for each in findings.departures())


@pytest.fixture
def process():
    """One that may be stopped."""
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as child:
        yield child
        child.kill()


def kill(pid, number):
    """Send the signal, and wait until the process has heard it."""
    os.kill(pid, number)
    os.waitid(os.P_PID, pid, os.WSTOPPED if number == signal.SIGSTOP else os.WCONTINUED)


class Plug:
    """A line to a driver whose device is one process: samples come while that runs, health all the time."""

    def __init__(self, pid: int, streams: dict[StreamName, Heard], told: int, again: bool, samples: bool) -> None:
        self._stat, self._streams, self._told, self._again = Path(f"/proc/{pid}/stat"), streams, told, again
        self._samples = samples
        self.stopped, self.now_s = False, 100.0

    def monotonic(self):
        return self.now_s

    def until(self, done, timeout_s):
        """Let the time pass at once, with a message of each kind every quarter of a second."""
        stopped = self._stat.read_text().rpartition(") ")[2][0] == "T"
        self.stopped |= stopped
        heard = self._streams[StreamName("p1", "eda", "box_1")]
        for _ in range(round(timeout_s * 4)):
            self.now_s += 0.25
            state = self._told if stopped else StreamHealth.STREAMING
            heard.health.append(SimpleNamespace(heard_s=self.now_s, message=SimpleNamespace(state=state)))
            if stopped or (self.stopped and not self._again):
                continue
            heard.reported_s.append(self.now_s)
            if self._samples:
                heard.frames.append(SimpleNamespace(heard_s=self.now_s, device_ns=0))
        return done()


@pytest.mark.parametrize(
    ("told", "again", "samples", "departures"),
    [
        (StreamHealth.LOST, True, True, []),
        (StreamHealth.STREAMING, True, True, [(4, "STREAMING while its device is stopped")]),
        (StreamHealth.LOST, False, True, [(6, "does not stream again")]),
        (StreamHealth.STREAMING, True, False, []),
        (StreamHealth.STREAMING, False, False, [(6, "does not stream again")]),
    ],
)
def test_a_stopped_process_is_told_and_streams_again(monkeypatch, process, told, again, samples, departures):
    """It is stopped and goes on; health of what is sampled must say so meanwhile; topics it has left say nothing."""
    findings = Findings()
    frames = [SimpleNamespace(heard_s=0.0, device_ns=0)] if samples else []
    streams = {
        name: Heard(name, findings, ("eda",), 0.1, 2.0, [*frames], reported_s=[-2.0, -1.0, 0.0])
        for name in (StreamName("p1", "eda", "box_1"), StreamName("p9", "eda", "box_1"))
    }
    published = {f"/humans/physiological/p1/eda/box_1/{'raw' if samples else 'device'}": ["/driver_box_box_1"]}
    topics = SimpleNamespace(streams=streams, look=lambda: True, published=lambda: published)
    plug = Plug(process.pid, streams, told, again, samples)
    monkeypatch.setattr(probes, "time", plug)
    monkeypatch.setattr(probes, "os", SimpleNamespace(kill=kill))
    Probes(plug, topics, "/driver_box_box_1", findings).unplugged(process.pid)
    assert (plug.stopped, process.poll()) == (True, None)
    found = [(each.section, each.what) for each in findings.departures()]
    assert len(found) == len(departures)
    assert all(a == b and sentence in what for (a, what), (b, sentence) in zip(found, departures, strict=True)), found


@pytest.mark.parametrize("ended_at", [signal.SIGSTOP, signal.SIGCONT])
def test_a_process_that_has_ended_meanwhile_is_told(monkeypatch, ended_at):
    """Whether before it is stopped or while it is: what was found until then is not lost."""
    findings, line = Findings(), SimpleNamespace(until=lambda done, timeout_s: None)

    def gone(_pid, number):
        if number == ended_at:
            raise ProcessLookupError

    monkeypatch.setattr(probes, "os", SimpleNamespace(kill=gone))
    topics = SimpleNamespace(streams={}, look=lambda: True, published=dict)
    Probes(line, topics, "/driver_box_box_1", findings).unplugged(4711)
    assert [each.what for each in findings.departures() if "process 4711" in each.what]


@pytest.mark.parametrize(("nodes", "departures"), [(["metadata_registry"], 0), (["driver_box_box_1"], 1)])
def test_a_wearer_whom_a_registry_gives_back_says_nothing_of_the_driver(monkeypatch, nodes, departures):
    """It does so where an operator's order stands; where there is none the driver itself has not kept the new one."""
    driver, name, findings = Driver(None), StreamName("p1", "eda", "box_1"), Findings()
    heard = Heard(name, findings, ("eda",), 0.1, 2.0, [SimpleNamespace(heard_s=0.0, device_ns=0)])

    def until(done, _timeout_s):
        driver.human_id = "p1"
        return done()

    monkeypatch.setattr(probes, "ask", driver.answer)
    topics = SimpleNamespace(streams={name: heard}, look=lambda: True, published=dict)
    line = SimpleNamespace(until=until, node=SimpleNamespace(get_node_names=lambda: nodes))
    Probes(line, topics, "/driver_box_box_1", findings).wearer("p9")
    found = findings.departures() if departures else findings.remarks()
    assert any("has taken human_id p9, and says that it is p1" in each.what for each in found)
    assert len([each for each in findings.departures() if "no pseudonym" not in each.what]) == departures


def test_who_wears_it_already_is_no_change_of_wearer(monkeypatch):
    """That its topics would move is not found out by it, and that is said."""
    driver, findings = Driver(None), Findings()
    monkeypatch.setattr(probes, "ask", driver.answer)
    Probes(driver, SimpleNamespace(streams={}), "/driver_box_box_1", findings).wearer("p1")
    assert driver.worn == []
    assert ["p1 wears it already" in each.what for each in findings.remarks()] == [True]


def test_a_sensor_whose_wearer_is_not_told_is_not_moved(monkeypatch):
    """Nobody could put it back."""
    findings = Findings()
    monkeypatch.setattr(probes, "ask", lambda *_: None)
    Probes(None, SimpleNamespace(streams={}), "/driver_box_box_1", findings).wearer("p9")
    assert ["human_id" in each.what for each in findings.departures()] == [True]


@pytest.mark.parametrize(("lost", "told"), [(0, "answer"), (1, "answer"), (9, None)])
def test_an_answer_that_is_lost_is_asked_for_once_more(lost, told):
    """On a busy machine the answer to a client that has just come is lost now and then; who is mute stays so."""
    futures = iter(
        [SimpleNamespace(done=lambda each=each: each >= lost, result=lambda: "answer") for each in range(10)]
    )
    client = SimpleNamespace(service_is_ready=lambda: True, call_async=lambda _request: next(futures))
    gone = []
    node = SimpleNamespace(create_client=lambda _kind, _name: client, destroy_client=gone.append)
    line = SimpleNamespace(node=node, until=lambda condition, _seconds: condition(), _to="driver")
    line.answer = MethodType(Line.answer, line)
    assert ask(line, GetParameters, "/driver_belt", "get_parameters", GetParameters.Request()) == told
    assert gone == [client]

"""check-driver leaves a sensor on whom it found it on, whatever happens while it tries."""

from contextlib import suppress
from types import SimpleNamespace

import pytest
from check_driver import probes
from check_driver.findings import Findings
from check_driver.heard import Heard
from check_driver.probes import Probes
from rcl_interfaces.srv import GetParameters
from sense4hri.names import StreamName


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


def test_a_sensor_whose_wearer_is_not_told_is_not_moved(monkeypatch):
    """Nobody could put it back."""
    findings = Findings()
    monkeypatch.setattr(probes, "ask", lambda *_: None)
    Probes(None, SimpleNamespace(streams={}), "/driver_box_box_1", findings).wearer("p9")
    assert ["human_id" in each.what for each in findings.departures()] == [True]

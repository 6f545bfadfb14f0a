"""What a driver does when something is done to it: a change of wearer, a forbidden one, a pulled plug."""

import os
import signal
import time
from contextlib import suppress
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from sense4hri.line import Line
from sense4hri_msgs.msg import StreamHealth

from check_driver.findings import Findings
from check_driver.heard import Heard
from check_driver.parameters import ask
from check_driver.topics import Topics

MOVED_S, STOPPED_S, BACK_S = 10.0, 8.0, 30.0
REGISTRY = "metadata_registry"
NOTICED_S = 5.0
"""Until health says that no samples come."""


class Probes:
    """Of one driver's node."""

    def __init__(self, line: Line, topics: Topics, node: str, findings: Findings) -> None:
        self._line, self._topics, self._node, self._findings = line, topics, node, findings

    def fixed(self, sensor_id: str) -> None:
        """Set what nobody may set at run time: it must be refused, with a reason, and stay as it is."""
        result = self._set("sensor_id", f"{sensor_id}_2"[:63])
        if result is None:
            self._findings.wrong(6, self._node, "does not answer set_parameters")
        elif result.successful:
            self._set("sensor_id", sensor_id)
            self._findings.wrong(6, self._node, "parameter sensor_id can be set at run time, only human_id may be")
        elif not result.reason:
            self._findings.remark(self._node, "refuses to change sensor_id without a reason")
        if self._text("sensor_id") not in ("", sensor_id):
            self._findings.wrong(6, self._node, "parameter sensor_id is changed though the change was refused")

    def wearer(self, human_id: str) -> None:
        """Put the sensor on somebody else, and back: topics must move, counts and device time go on.

        Whatever happens meanwhile, Ctrl-C too, it is left on whom it was on; where that is not told it is not moved.
        """
        back = self._text("human_id")
        if not back:
            self._findings.wrong(6, self._node, "does not say its human_id: its wearer is left as it is")
            return
        if back == human_id:
            self._findings.remark(self._node, f"{human_id} wears it already: name somebody else to see its topics move")
            return
        before = {heard.name.sensor_type: heard for heard in self._topics.streams.values() if heard.steady}
        try:
            if self._worn(human_id, before):
                self._moved(back, before)
        finally:
            if self._text("human_id") != back:
                self._set("human_id", back)

    def _worn(self, human_id: str, before: dict[str, Heard]) -> bool:
        """Try what is no pseudonym, then human_id; return whether the sensor moved to that."""
        bad = self._set("human_id", "no pseudonym!")
        if bad is not None and bad.successful:
            self._findings.wrong(6, self._node, "parameter human_id takes what is no human_id: 'no pseudonym!'")
        return self._moved(human_id, before)

    def _moved(self, human_id: str, before: dict[str, Heard]) -> bool:
        result = self._set("human_id", human_id)
        if result is None or not result.successful:
            why = result.reason if result else "no answer"
            self._findings.wrong(6, self._node, f"parameter human_id cannot be set to {human_id}: {why}")
            return False
        since_s = time.monotonic()
        wanted = {heard.name._replace(human_id=human_id) for heard in before.values()}

        def there() -> bool:
            self._topics.look()
            heard = [self._topics.streams.get(name) for name in wanted]
            return all(each and each.newest_s > since_s for each in heard)

        came = self._line.until(there, MOVED_S)
        if not came and (now := self._text("human_id")) not in ("", human_id):
            self._given_back(human_id, now)
            return False
        if not came:
            what = "raw" if any(heard.frames for heard in before.values()) else "report"
            self._findings.wrong(
                6, self._node, f"human_id is {human_id} and no {what} came under it within {MOVED_S:g} s"
            )
        left = [topic for topic in self._topics.published() if topic.split("/")[3] != human_id]
        if came and left and not self._line.until(lambda: not self._left(human_id), 2.0):
            self._findings.wrong(6, self._node, f"human_id is {human_id} and it still publishes {left[0]}")
        self._goes_on(before, wanted)
        return bool(came)

    def _given_back(self, human_id: str, now: str) -> None:
        told = f"has taken human_id {human_id}, and says that it is {now}"
        if REGISTRY in self._line.node.get_node_names():
            self._findings.remark(self._node, f"{told}: an order in the {REGISTRY} stands? Assign it there")
        else:
            self._findings.wrong(6, self._node, told)

    def _left(self, human_id: str) -> list[str]:
        return [topic for topic in self._topics.published() if topic.split("/")[3] != human_id]

    def _goes_on(self, before: dict[str, Heard], wanted: set[Any]) -> None:
        """The device has not been restarted by it: its clock and the driver's counts go on."""
        for name in wanted:
            now, then = self._topics.streams.get(name), before[name.sensor_type]
            if now is None or now is then or not (now.frames and then.frames):
                continue
            if 0 < now.frames[-1].device_ns < then.frames[0].device_ns:
                self._findings.wrong(6, name.topic("raw"), "device_timestamp begins anew with the change of wearer")
            if not self._line.until(lambda now=now: now.health, 3.0):  # type: ignore[misc]
                continue
            if then.health and now.health[-1].message.samples_total < then.health[-1].message.samples_total:
                self._findings.wrong(6, name.topic("health"), "samples_total begins anew with the change of wearer")

    def unplugged(self, pid: int) -> None:
        """Stop a process (the driver, or what plays its device) for a while: it must be told, and end by itself."""
        published = self._topics.published()  # of whom it was on before, nothing comes any more
        streams = [
            each
            for each in self._topics.streams.values()
            if each.steady and each.name.topic("raw" if each.frames else "device") in published
        ]
        try:
            os.kill(pid, signal.SIGSTOP)
        except ProcessLookupError:
            self._findings.wrong(6, self._node, f"process {pid} has ended before it was to be stopped")
            return
        stopped_s = time.monotonic()
        try:
            self._line.until(lambda: None, STOPPED_S)
        finally:
            with suppress(ProcessLookupError):  # then nothing streams again, which is told
                os.kill(pid, signal.SIGCONT)
        going_s = time.monotonic()
        for heard in (each for each in streams if each.frames):  # how long reports may be away nobody declares
            self._told(heard, stopped_s, going_s)

        def back() -> bool:
            self._topics.look()
            return all(heard.newest_s > going_s + 1.0 for heard in streams)

        if not self._line.until(back, BACK_S):
            self._findings.wrong(6, self._node, f"does not stream again within {BACK_S:g} s of process {pid} going on")

    def _told(self, heard: Heard, stopped_s: float, going_s: float) -> None:
        """While no samples came, health went on and did not say STREAMING; a stopped driver says nothing at all."""
        late = [each.message for each in heard.health if stopped_s + NOTICED_S < each.heard_s < going_s]
        silent = not any(stopped_s + 1.0 < frame.heard_s < going_s for frame in heard.frames)
        if silent and any(message.state == StreamHealth.STREAMING for message in late):
            self._findings.wrong(4, heard.name.topic("health"), "STREAMING while its device is stopped")

    def _text(self, name: str) -> str:
        """Return the parameter's text; empty where the node does not answer."""
        answer = ask(self._line, GetParameters, self._node, "get_parameters", GetParameters.Request(names=[name]))
        return str(answer.values[0].string_value) if answer and answer.values else ""

    def _set(self, name: str, value: str) -> Any:
        given = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=given)])
        answer = ask(self._line, SetParameters, self._node, "set_parameters", request)
        return answer.results[0] if answer and answer.results else None

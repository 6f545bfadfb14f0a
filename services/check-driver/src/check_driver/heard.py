"""What came on the topics of one stream, and what is wrong with single messages of it."""

import math
import time
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sense4hri.names import StreamName
from sense4hri.stamps import SECOND_NS, to_ns

from check_driver.findings import Findings

FAR_S = 5.0
"""From the host's clock: more than any queue holds a message back."""
UNITS = {
    "heart_rate": "1/min",
    "rr_interval": "ms",
    "pp_interval": "ms",
    "pp_error": "ms",
    "spo2": "%",
    "respiration_rate": "1/min",
}
NEVER_ZERO = ("heart_rate", "rr_interval", "pp_interval", "spo2", "respiration_rate")


class Frame(NamedTuple):
    """One raw message. heard_ns, heard_s: wall and monotonic clock here; device_ns: 0 where it has none."""

    heard_ns: int
    heard_s: float
    stamp_ns: int
    device_ns: int
    n: int


class Health(NamedTuple):
    """One health message, when it was heard."""

    heard_s: float
    message: Any


@dataclass
class Heard:
    """One stream of the sensor under one wearer."""

    name: StreamName
    findings: Findings
    channels: tuple[str, ...] = ()
    lowest: float = math.inf
    highest: float = -math.inf
    frames: list[Frame] = field(default_factory=list)
    health: list[Health] = field(default_factory=list)

    def raw(self, message: Any) -> None:
        """Take a `PhysioRaw`."""
        topic = self.name.topic("raw")
        now_ns = self._header(topic, message)
        sizes = {len(channel.samples) for channel in message.channels}
        if len(sizes) != 1 or 0 in sizes:
            self.findings.wrong(4, topic, "channels are absent, empty or of unequal length")
            return
        names = tuple(channel.channel_name for channel in message.channels)
        if len(set(names)) < len(names) or not all(names):
            self.findings.wrong(4, topic, f"channel names {list(names)}: each must be there, and once")
        if self.channels not in ((), names):
            self.findings.wrong(2, topic, f"channels change from {list(self.channels)} to {list(names)}")
        self.channels = names
        self._values(message)
        stamp_ns, device_ns = to_ns(message.header.stamp), to_ns(message.device_timestamp)
        self.frames.append(Frame(now_ns, time.monotonic(), stamp_ns, device_ns, sizes.pop()))

    def take_health(self, message: Any) -> None:
        """Take a `StreamHealth`."""
        self._header(self.name.topic("health"), message)
        self.health.append(Health(time.monotonic(), message))

    def device(self, message: Any) -> None:
        """Take a `PhysioDeviceFeature`."""
        topic = self.name.topic("device")
        self._header(topic, message)
        if not message.features:
            self.findings.wrong(4, topic, "a message without features")
        for each in message.features:
            if not each.name or not each.values:
                self.findings.wrong(4, topic, f"feature {each.name!r} has no name or no value")
            if each.unit != UNITS.get(each.name, each.unit):
                self.findings.wrong(5, topic, f"{each.name} is in {each.unit!r}, must be {UNITS[each.name]}")
            if each.name in NEVER_ZERO and 0.0 in each.values:
                self.findings.wrong(4, topic, f"{each.name} is 0: what cannot be computed is left out, or NaN")

    def clock_measurement(self, message: Any) -> None:
        """Take a `ClockMeasurement`."""
        topic = self.name.topic("clock_measurement")
        self._header(topic, message)
        if not to_ns(message.device_timestamp):
            self.findings.wrong(4, topic, "device_timestamp is zero: nothing was measured")
        if message.uncertainty_s < 0 or not message.method:
            self.findings.wrong(4, topic, "uncertainty_s is below 0, or method is empty")

    def _header(self, topic: str, message: Any) -> int:
        """Check what every message has; return the wall clock."""
        now_ns, stamp_ns = time.time_ns(), to_ns(message.header.stamp)
        if message.header.frame_id != self.name.sensor_id:
            self.findings.wrong(3, topic, f"header.frame_id is {message.header.frame_id[:80]!r}, must be the sensor_id")
        if not stamp_ns:
            self.findings.wrong(3, topic, "header.stamp is zero, must be the host's clock at receipt")
        elif abs(now_ns - stamp_ns) > FAR_S * SECOND_NS:
            self.findings.wrong(3, topic, f"header.stamp is more than {FAR_S:g} s from this host's clock")
        return now_ns

    def _values(self, message: Any) -> None:
        for channel in message.channels:
            finite = [value for value in channel.samples if math.isfinite(value)]
            if any(math.isinf(value) for value in channel.samples):
                self.findings.wrong(4, self.name.topic("raw"), f"{channel.channel_name}: a sample is infinite")
            if finite and channel.channel_name != "confidence":
                self.lowest, self.highest = min(self.lowest, min(finite)), max(self.highest, max(finite))

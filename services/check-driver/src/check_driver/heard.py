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
FLAGS = ("blocked", "contact")
SAME_NS = 1000
"""Nearer to each other no two clocks are all the time."""
COPIED = "device_timestamp is header.stamp: where the device gives no time it must be zero"
WENT_BACK = "device_timestamp goes back: was the device restarted, or did its counter wrap?"
LASTING_S = 10.0
"""For so long may last what is reported, a fixation or a breath: told at its end, by the time of its beginning."""
STEADY = 3
"""Reports, in the time that it is listened to, of what is expected to report again."""
NEVER_ZERO = ("heart_rate", "rr_interval", "pp_interval", "spo2", "respiration_rate")


class Frame(NamedTuple):
    """One raw message. heard_s: when it came, on the monotonic clock; device_ns: 0 where it has none."""

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
    """One stream of the sensor under one wearer.

    Messages are taken with heard_ns, when each reached this computer by its wall clock: they may have waited here.
    """

    name: StreamName
    findings: Findings
    channels: tuple[str, ...] = ()
    lowest: float = math.inf
    highest: float = -math.inf
    frames: list[Frame] = field(default_factory=list)
    reported_s: list[float] = field(default_factory=list)
    """When each `PhysioDeviceFeature` came, on the monotonic clock."""
    health: list[Health] = field(default_factory=list)
    since_s: float = -math.inf
    """From when it is listened to, on the monotonic clock: a stream may be there later than others."""
    copies: int = 0
    """Reports in a row whose device time is their receipt."""
    reported_ns: int = 0
    """Device time of the last report that has one; 0: none has."""

    @property
    def steady(self) -> bool:
        """True where more is to be expected: it samples, or reports again and again."""
        return bool(self.frames) or len(self.reported_s) >= STEADY

    @property
    def newest_s(self) -> float:
        """When the newest of what it says steadily was heard, on the monotonic clock; -inf: not yet."""
        times_s = [frame.heard_s for frame in self.frames[-1:]] or self.reported_s[-1:]
        return times_s[0] if times_s else -math.inf

    def raw(self, message: Any, heard_ns: int) -> None:
        """Take a `PhysioRaw`."""
        topic = self.name.topic("raw")
        heard_s = self._header(topic, message, heard_ns)
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
        self.frames.append(Frame(heard_s, stamp_ns, device_ns, sizes.pop()))

    def take_health(self, message: Any, heard_ns: int) -> None:
        """Take a `StreamHealth`."""
        self.health.append(Health(self._header(self.name.topic("health"), message, heard_ns), message))

    def device(self, message: Any, heard_ns: int) -> None:
        """Take a `PhysioDeviceFeature`."""
        topic = self.name.topic("device")
        self.reported_s.append(self._header(topic, message, heard_ns))
        device_ns = to_ns(message.device_timestamp)
        self.copies = self.copies + 1 if abs(device_ns - to_ns(message.header.stamp)) < SAME_NS else 0
        if self.copies >= STEADY:
            self.findings.wrong(3, topic, COPIED)
        if device_ns and self.reported_ns - device_ns > LASTING_S * SECOND_NS:
            self.findings.wrong(3, topic, WENT_BACK)
        self.reported_ns = device_ns or self.reported_ns
        if not message.features:
            self.findings.wrong(4, topic, "a message without features")
        for each in message.features:
            if not each.name or not each.values:
                self.findings.wrong(4, topic, f"feature {each.name!r} has no name or no value")
            if each.unit != UNITS.get(each.name, each.unit):
                self.findings.wrong(5, topic, f"{each.name} is in {each.unit!r}, must be {UNITS[each.name]}")
            if each.name in FLAGS and any(not (math.isnan(value) or value in (0.0, 1.0)) for value in each.values):
                self.findings.wrong(5, topic, f"{each.name} is {list(each.values)}, must be 0 or 1")
            if any(map(math.isinf, each.values)):
                self.findings.wrong(4, topic, f"{each.name} is infinite: what cannot be computed is left out, or NaN")
            if each.name in NEVER_ZERO and 0.0 in each.values:
                self.findings.wrong(4, topic, f"{each.name} is 0: what cannot be computed is left out, or NaN")

    def clock_measurement(self, message: Any, heard_ns: int) -> None:
        """Take a `ClockMeasurement`."""
        topic = self.name.topic("clock_measurement")
        self._header(topic, message, heard_ns)
        if not to_ns(message.device_timestamp):
            self.findings.wrong(4, topic, "device_timestamp is zero: nothing was measured")
        if not 0 <= message.uncertainty_s < math.inf or not message.method:
            self.findings.wrong(4, topic, "uncertainty_s is not 0 or above, or method is empty")

    def _header(self, topic: str, message: Any, heard_ns: int) -> float:
        """Check what every message has; return when it was heard, on the monotonic clock."""
        stamp_ns = to_ns(message.header.stamp)
        if message.header.frame_id != self.name.sensor_id:
            self.findings.wrong(3, topic, f"header.frame_id is {message.header.frame_id[:80]!r}, must be the sensor_id")
        if not stamp_ns:
            self.findings.wrong(3, topic, "header.stamp is zero, must be the host's clock at receipt")
        elif abs(heard_ns - stamp_ns) > FAR_S * SECOND_NS:
            self.findings.wrong(3, topic, f"header.stamp is more than {FAR_S:g} s from this host's clock")
        return time.monotonic() - (time.time_ns() - heard_ns) / SECOND_NS

    def _values(self, message: Any) -> None:
        for channel in message.channels:
            finite = [value for value in channel.samples if math.isfinite(value)]
            if any(math.isinf(value) for value in channel.samples):
                self.findings.wrong(4, self.name.topic("raw"), f"{channel.channel_name}: a sample is infinite")
            if channel.channel_name == "confidence":
                if finite and not 0 <= min(finite) <= max(finite) <= 1:
                    self.findings.wrong(2, self.name.topic("raw"), "confidence is not within 0 to 1")
            elif finite:
                self.lowest, self.highest = min(self.lowest, min(finite)), max(self.highest, max(finite))

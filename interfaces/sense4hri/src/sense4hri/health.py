"""Health of a stream: state, and what is known of its link."""

import math
import time
from collections import deque
from dataclasses import dataclass, field
from enum import IntEnum

from sense4hri_msgs.msg import StreamHealth

from sense4hri import stamps, wire
from sense4hri.host_clocks import this_host
from sense4hri.running_rate import RATE_TRUST
from sense4hri.stream_info import long_s

RATE_WINDOW_S, SILENCE_S = 10.0, 3.0
SETTLE_S = 30.0  # that a device streams before it is said to send too many samples: what waited comes at once at first
CLOCK_READINGS = 5


class State(IntEnum):
    """State of a stream, as in the StreamHealth message."""

    STARTING = StreamHealth.STARTING
    CONNECTING = StreamHealth.CONNECTING
    STREAMING = StreamHealth.STREAMING
    LOST = StreamHealth.LOST
    STOPPING = StreamHealth.STOPPING


NOT_STREAMING = {
    State.STARTING: "no sample has come yet",
    State.CONNECTING: "looking for the device",
    State.LOST: "connected, but no samples come",
    State.STOPPING: "the driver is stopping",
}
"""The reason where the device has given none."""


@dataclass
class Link:
    """What is known of a device's link; NaN = not known."""

    battery_percent: float = math.nan
    rssi_dbm: float = math.nan
    contact: float = math.nan
    reconnects_total: int = 0
    undecodable_frames_total: int = 0
    reason: str = ""


@dataclass
class StreamCounts:
    """What came on one stream.

    nominal_hz: the declared rate, 0 where there is none. loss_known: whether the newest samples tell what is missing;
    False until some have come. time_doubt: why the newest frame has no device time though its device sent one;
    value_doubt: why it has NaN where its device sent a number. begun_monotonic_s: since when its device streams;
    begun_total: samples that had come until then. device_time: whether the device stamps its newest samples.
    """

    nominal_hz: float = 0.0
    samples_total: int = 0
    lost_samples_total: int = 0
    loss_known: bool = False
    device_time: bool = False
    gaps_total: int = 0
    duplicates_total: int = 0
    impossible_times_total: int = 0
    impossible_values_total: int = 0
    time_doubt: str = ""
    value_doubt: str = ""
    latency_s: float = math.nan
    begun_monotonic_s: float = -math.inf
    begun_total: int = 0
    last_monotonic_s: float = -math.inf
    arrivals: deque[tuple[float, int]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self.begin()

    def arrived(self, n: int) -> None:
        """Count n samples that came now."""
        now = time.monotonic()
        self.samples_total += n
        self.last_monotonic_s = now
        self.arrivals.append((now, n))
        self._forget(now)

    def begin(self) -> None:
        """The device streams from now on; this stream of it may be slow."""
        self.begun_monotonic_s, self.begun_total = time.monotonic(), self.samples_total

    def state(self) -> State:
        """Return the state of a stream whose device streams: lost where it is silent for longer than its rate allows.

        Until then one that has sent nothing since the device began is starting. What has no rate always streams.
        """
        if self.nominal_hz <= 0:
            return State.STREAMING
        silent_s = time.monotonic() - max(self.begun_monotonic_s, self.last_monotonic_s)
        if silent_s > long_s(SILENCE_S, self.nominal_hz):
            return State.LOST
        return State.STREAMING if self.last_monotonic_s >= self.begun_monotonic_s else State.STARTING

    def measured_rate_hz(self) -> float:
        """Return samples per second of host time over the last seconds; NaN where fewer than two frames came."""
        self._forget(time.monotonic())
        if len(self.arrivals) < 2:
            return math.nan
        span = self.arrivals[-1][0] - self.arrivals[0][0]
        return (sum(n for _, n in self.arrivals) - self.arrivals[0][1]) / span if span > 0 else math.nan

    def rate_doubt(self) -> str:
        """Return what is wrong where more samples without device time come than are declared; empty where nothing is.

        Fewer show as a low rate; nothing else shows more. Over all the time that the device has been streaming, so that
        no burst is taken for it.
        """
        passed_s = time.monotonic() - self.begun_monotonic_s
        if self.device_time or self.nominal_hz <= 0 or passed_s < long_s(SETTLE_S, self.nominal_hz):
            return ""
        rate_hz = (self.samples_total - self.begun_total) / passed_s
        if rate_hz <= self.nominal_hz * (1 + RATE_TRUST):
            return ""
        return f"{rate_hz:.4g} samples per s come, declared are {self.nominal_hz:g}: their times are wrong"

    def _forget(self, now_s: float) -> None:
        """Leave out frames that came before the window of the rate."""
        begin_s = now_s - long_s(RATE_WINDOW_S, self.nominal_hz)
        while self.arrivals and self.arrivals[0][0] < begin_s:
            self.arrivals.popleft()


def realtime_minus_monotonic_ns() -> int:
    """Return the wall clock less the clock that nobody sets; of several readings the one that took least time.

    A process that is kept waiting between the two would otherwise tell of a step of the wall clock that never was.
    """
    readings = []
    for _ in range(CLOCK_READINGS):
        before_ns, wall_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        readings.append((after_ns - before_ns, wall_ns - (before_ns + after_ns) // 2))
    return min(readings)[1]


def health_message(
    sensor_id: str, state: State, nominal_rate_hz: float, link: Link, counts: StreamCounts
) -> StreamHealth:
    """Return the health of one stream as it is now."""
    now_ns = time.time_ns()
    why = [counts.rate_doubt()] if state is State.STREAMING else [link.reason or NOT_STREAMING[state]]
    message = StreamHealth(
        state=int(state),
        host=this_host(),
        realtime_minus_monotonic_ns=realtime_minus_monotonic_ns(),
        nominal_rate_hz=nominal_rate_hz,
        measured_rate_hz=counts.measured_rate_hz(),
        samples_total=counts.samples_total,
        lost_samples_total=counts.lost_samples_total if counts.loss_known else -1,
        gaps_total=counts.gaps_total,
        duplicates_total=counts.duplicates_total,
        reconnects_total=link.reconnects_total,
        latency_s=counts.latency_s,
        battery_percent=link.battery_percent,
        rssi_dbm=link.rssi_dbm,
        contact=link.contact,
        extra=[
            wire.feature("undecodable_frames_total", "1", link.undecodable_frames_total),
            wire.feature("impossible_device_times_total", "1", counts.impossible_times_total),
            wire.feature("impossible_values_total", "1", counts.impossible_values_total),
        ],
        reasons=[*filter(None, (*why, counts.time_doubt, counts.value_doubt))],
    )
    message.header.frame_id = sensor_id
    stamps.set_time(message.header.stamp, now_ns)
    return message

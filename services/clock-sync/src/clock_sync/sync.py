"""The graph side: which streams feed which estimator, and when a model is published."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from sense4hri import qos, stamps
from sense4hri.cdr import stamps_ns
from sense4hri.discovery import RawStreams
from sense4hri.host_account import HostAccount
from sense4hri.names import StreamName
from sense4hri.service import Service
from sense4hri.session import SessionMember, concerns, required, warmup_allowed
from sense4hri.stream_info import StreamInfo
from sense4hri_msgs.msg import ClockMeasurement, ClockModel, PhysioRaw, SessionState, StreamHealth

from clock_sync.config import Config
from clock_sync.estimator import ClockEstimator
from clock_sync.hosts import Reference
from clock_sync.merge import Merge
from clock_sync.model import Model, State

RAW_QUEUE = 5000
WITHIN_S = 0.1
"""What streams say is heard so much later: what is taken of a message is in it, and nobody waits for a model."""
SEGMENT_EVERY_S = 10.0  # a line of a device whose clock begins anew
MOST_GONE = 1000  # devices that are remembered when they have gone, the newest
OTHER_NS = stamps.SECOND_NS  # so far one stream of a device may come behind another

SHOWN: tuple[tuple[str, str, Callable[[Model], float]], ...] = (
    ("clock_offset_seconds", "ROS time minus device time at the newest sample.", lambda model: model.offset_ns * 1e-9),
    ("clock_skew_ratio", "Rate of ROS time over the device's, minus 1.", lambda model: model.skew_ppm * 1e-6),
    ("clock_uncertainty_seconds", "95 % half width of the offset.", lambda model: model.uncertainty_s),
    ("clock_latency_seconds", "Mean delay of the newest packets.", lambda model: model.latency_s),
    ("clock_state", "0 warm-up, 1 locked, 2 hold-over.", lambda model: float(model.state)),
    ("clock_segment", "Number of the clock's epoch.", lambda model: model.segment),
)
"""Of each device: name of the metric, text, value."""


def _started_anew(before: HostAccount | None, account: HostAccount) -> bool:
    """True where both are stamped and the host was started in between."""
    return before is not None and bool(before.stamp_ns and account.stamp_ns) and account.is_of_a_new_start(before)


@dataclass
class Device:
    """One sensor_id: one clock, however many streams."""

    sensor_id: str
    estimator: ClockEstimator = field(default_factory=ClockEstimator)
    publishers: dict[StreamName, Publisher] = field(default_factory=dict)
    merge: Merge = field(default_factory=Merge)
    timeless: set[StreamName] = field(default_factory=set)  # streams whose messages carry no device time
    host: str = ""
    account: HostAccount | None = None
    published_ns: int | None = None
    state: State | None = None
    """Of the model published last; None before there is one, as with a device that gives no time."""
    late: bool = False


class ClockSync:
    """Keeps a model for every device on the graph; one that comes back goes on with its clock, if it left lately."""

    def __init__(self, service: Service[Config], hosts: Reference) -> None:
        self._service, self._config, self._hosts = service, service.config, hosts
        self._interval_ns = round(service.config.publish_interval_s * stamps.SECOND_NS)
        self._devices: dict[str, Device] = {}
        self._subscriptions: dict[StreamName, list[Subscription]] = {}
        self._waiting: list[StreamName] = []
        RawStreams(service, None, self._learn, self._remove, self._find)
        SessionMember(service, self._ready)

    def _ready(self, session: SessionState) -> tuple[bool, str]:
        """Say whether a session may begin: what it requires is heard, and its clocks are locked or may warm up."""
        needed = [
            device for device in self._devices.values() if any(concerns(session, name) for name in device.publishers)
        ]
        hosts = {device.host for device in needed if device.host}
        warming = [f"clock of {device.sensor_id}" for device in needed if device.state is State.WARMUP]
        warming += [f"clock of host {host}" for host in hosts if self._hosts.state(host) is State.WARMUP]
        unheard = sorted(name.topic("raw") for name in required(session) if not self._heard(name))
        told = [f"{', '.join(unheard)} not heard yet"] if unheard else []
        told += [f"{', '.join(sorted(warming))} not locked yet"] if warming else []
        told += [doubt for host in sorted(hosts) if (doubt := self._hosts.doubt(host))]
        return not unheard and (not warming or warmup_allowed(session)), "; ".join(told)

    def _heard(self, name: StreamName) -> bool:
        """Whether it is known if a stream gives device time; one that waits for its twin to go is not asked."""
        device = self._devices.get(name.sensor_id)
        if device is None or name in self._waiting:
            return device is not None
        return name in device.publishers and (device.state is not None or name in device.timeless)

    def _find(self, name: StreamName) -> None:
        twin = next((other for other in self._subscriptions if other[1:] == name[1:]), None)
        if twin is not None:
            self._service.log.warning(
                f"sensor_id {name.sensor_id!r} is on {twin.topic('raw')} and on {name.topic('raw')}: "
                "the second waits until the first has gone"
            )
            self._waiting.append(name)
            return
        device = self._devices.setdefault(name.sensor_id, Device(name.sensor_id))
        device.publishers[name] = self._service.publisher(ClockModel, name.topic("clock"), qos.CLOCK)
        subscribe = partial(self._service.subscribe, fit=True, within_s=WITHIN_S)
        self._subscriptions[name] = [
            subscribe(
                PhysioRaw,
                name.topic("raw"),
                lambda cdr: self._packet(device, name, cdr),
                qos.deep(qos.RAW, RAW_QUEUE),
                raw=True,
            ),
            subscribe(
                StreamHealth,
                name.topic("health"),
                lambda message: self._health(device, message),
                qos.deep(qos.HEALTH, 10),
            ),
            subscribe(
                ClockMeasurement,
                name.topic("clock_measurement"),
                lambda message: self._measurement(device, message),
                qos.CLOCK_MEASUREMENT,
            ),
        ]
        if device.estimator.known:
            self._publish(device)

    def _learn(self, info: StreamInfo) -> None:
        device = self._devices.get(info.name.sensor_id)
        if device is None or not math.isfinite(info.transport_delay_s):
            return
        if info.transport_delay_s != device.estimator.transport_delay_s:
            device.estimator.transport_delay_s = info.transport_delay_s
            if device.estimator.known:
                self._publish(device)

    def _remove(self, name: StreamName) -> None:
        if name in self._waiting:
            self._waiting.remove(name)
            return
        for subscription in self._subscriptions.pop(name, ()):
            self._service.unsubscribe(subscription)
        device = self._devices[name.sensor_id]
        publisher = device.publishers.pop(name, None)
        if publisher is not None:
            self._service.node.destroy_publisher(publisher)
        heir = next((other for other in self._waiting if other[1:] == name[1:]), None)
        if heir is not None:
            self._waiting.remove(heir)
            self._find(heir)
        if not device.publishers:
            self._show_nothing(device)
            self._forget_all_but_newest(device)

    def _forget_all_but_newest(self, gone: Device) -> None:
        """Remember a device that has gone, and so many that have gone before it: strangers come and go for ever."""
        self._devices[gone.sensor_id] = self._devices.pop(gone.sensor_id)
        left = [device.sensor_id for device in self._devices.values() if not device.publishers]
        for sensor_id in left[:-MOST_GONE]:
            del self._devices[sensor_id]

    def _packet(self, device: Device, name: StreamName, cdr: bytes) -> None:
        received_ns, device_ns = stamps_ns(cdr)
        if device_ns == 0:
            device.timeless.add(name)
            return
        device.timeless.discard(name)
        streams = {other.sensor_type for other in device.publishers if other not in device.timeless}
        for packet in device.merge.push(name.sensor_type, device_ns, received_ns, streams):
            self._take(device, packet.stream, packet.device_ns, packet.received_ns)

    def _take(self, device: Device, stream: str, device_ns: int, received_ns: int) -> None:
        if device.estimator.packet(stream, device_ns, received_ns):
            self._publish_segment(device, "its clock began a new epoch")
        elif device.published_ns is None or not -OTHER_NS < received_ns - device.published_ns < self._interval_ns:
            self._publish(device)

    def _health(self, device: Device, message: StreamHealth) -> None:
        account = HostAccount(stamps.to_ns(message.header.stamp), message.realtime_minus_monotonic_ns)
        begun = device.host not in ("", message.host) or _started_anew(device.account, account)
        device.host, device.account = message.host, account
        if begun:
            device.estimator.host_started(message.realtime_minus_monotonic_ns)
        if not device.estimator.host_clock(message.realtime_minus_monotonic_ns):
            return
        for other in self._devices.values():
            if other.host == device.host and other.estimator.host_step(message.realtime_minus_monotonic_ns):
                self._publish_segment(other, f"the clock of host {device.host!r} was stepped")

    def _measurement(self, device: Device, message: ClockMeasurement) -> None:
        if device.estimator.measurement(
            stamps.to_ns(message.header.stamp),
            stamps.to_ns(message.device_timestamp),
            message.offset_ns,
            message.uncertainty_s,
        ):
            self._publish_segment(device, "two measurements of its link disagree with those before")

    def _publish_segment(self, device: Device, why: str) -> None:
        model = self._publish(device)
        if model.segment > 1:
            told = f"{device.sensor_id}: {why}; segment {model.segment}"
            self._service.log.warning_at_times(told, SEGMENT_EVERY_S, about=device.sensor_id)

    def _publish(self, device: Device) -> Model:
        model = device.estimator.model()
        device.published_ns, device.state = model.stamp_ns, model.state
        message = ClockModel()
        message.header.frame_id = device.sensor_id
        stamps.set_time(message.header.stamp, model.stamp_ns)
        stamps.set_time(message.device_reference, model.device_reference_ns)
        message.offset_ns, message.skew_ppm = model.offset_ns, model.skew_ppm
        message.uncertainty_s, message.latency_s = model.uncertainty_s, model.latency_s
        message.segment, message.state = model.segment, int(model.state)
        for publisher in device.publishers.values():
            publisher.publish(message)
        self._show(device, model)
        return model

    def _show_nothing(self, device: Device) -> None:
        """No alert judges the clock of a device that has gone."""
        for name, text, _ in SHOWN if device.state is not None else ():
            self._service.metrics.gauge(name, text, sensor_id=device.sensor_id).set(math.nan)
        self._service.metrics.gone(sensor_id=device.sensor_id)

    def _show(self, device: Device, model: Model) -> None:
        for name, text, of in SHOWN:
            self._service.metrics.gauge(name, text, sensor_id=device.sensor_id).set(of(model))
        late = model.latency_s > self._config.latency_alarm_s
        if late and not device.late:
            self._service.log.warning(f"{device.sensor_id}: its data are {model.latency_s:.1f} s late")
        if device.late and model.latency_s < self._config.latency_alarm_s / 2:
            self._service.log.info(f"{device.sensor_id}: its data are in time again")
            late = False
        device.late = late or (device.late and model.latency_s >= self._config.latency_alarm_s / 2)

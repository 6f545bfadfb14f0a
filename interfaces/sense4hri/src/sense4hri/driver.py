"""Shell of every driver: keeps a device streaming, stamps, publishes and counts what it yields."""

import asyncio
import contextlib
import dataclasses
import math
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioRaw, SessionState, StreamHealth

from sense4hri import parameters, qos, stamps, wire
from sense4hri.chunk import Break, Chunk
from sense4hri.device import Device, DriverConfig, Feature, Identity, Item, Reported, Samples, Status, Stream
from sense4hri.errors import ConfigError, DeviceLost, FrameError
from sense4hri.health import Link, State, StreamCounts, health_message
from sense4hri.names import StreamName, is_human_id
from sense4hri.sample_clock import SampleClock
from sense4hri.service import Service, run
from sense4hri.session import SessionMember, concerns

BACKOFF_S = (0.5, 1.0, 2.0, 5.0, 10.0)
STOP_TIMEOUT_S = 8.0  # a radio must be released
HEALTH_INTERVAL_S = 1.0
SILENCE_S = 3.0
READY_RATE = 0.95  # share of the nominal rate at which a session may begin

__all__ = [
    "Device",
    "DriverConfig",
    "Feature",
    "Identity",
    "Item",
    "Reported",
    "Samples",
    "Status",
    "Stream",
    "run_driver",
]
Config = TypeVar("Config", bound=DriverConfig)


def run_driver(
    kind: str,
    schema: type[Config],
    streams_of: Callable[[Config], Mapping[str, Stream]],
    make_device: Callable[[Config, Mapping[str, Stream]], Device],
) -> int:
    """Keep one device streaming until stopped; return the exit status.

    streams_of(config) gives the defaults of each stream by sensor type; parameters `<sensor_type>.<field>` override
    them, and make_device gets the result.
    """

    async def main(service: Service[Config]) -> None:
        streams = {
            sensor_type: _declared(service, sensor_type, stream)
            for sensor_type, stream in streams_of(service.config).items()
        }
        driver = _Driver(service, streams)
        SessionMember(service, driver.ready)
        device = make_device(service.config, streams)
        service.every(HEALTH_INTERVAL_S, driver.publish_health)
        work = asyncio.ensure_future(driver.keep_streaming(device))
        stop = asyncio.ensure_future(service.stopped.wait())
        await asyncio.wait({work, stop}, return_when=asyncio.FIRST_COMPLETED)
        stop.cancel()
        if not work.done():
            driver.stopping()
            work.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await work

    return run(
        f"driver_{kind}",
        schema,
        main,
        node_name=lambda config: f"driver_{kind}_{config.sensor_id}",
        stop_timeout_s=STOP_TIMEOUT_S,
    )


def _declared(service: Service[Any], sensor_type: str, stream: Stream) -> Stream:
    kinds = {
        "sampling_frequency_hz": float,
        "unit": str,
        "range_min": float,
        "range_max": float,
        "resolution_bits": int,
        "channel_names": tuple[str, ...],
    }
    defaults = dataclasses.asdict(stream)
    values = {
        name: parameters.declare(service.node, f"{sensor_type}.{name}", kind, defaults[name])
        for name, kind in kinds.items()
    }
    if not values["sampling_frequency_hz"] >= 0:
        raise ConfigError(f"parameter '{sensor_type}.sampling_frequency_hz' is negative; 0 means irregular")
    return Stream(**values)


class _Outlet:
    """Publishers and counts of one stream; the publishers move with human_id, the counts stay."""

    def __init__(self, service: Service[Any], sensor_type: str, sensor_id: str, stream: Stream) -> None:
        self.stream = stream
        self.clock = SampleClock(stream.sampling_frequency_hz)
        self.counts = StreamCounts()
        self.raw: Publisher
        self.device: Publisher
        self.health: Publisher
        self._service, self._sensor_type, self._sensor_id = service, sensor_type, sensor_id
        self._floor_s = math.inf
        self._floor_at_s = 0.0
        labels = {"sensor_type": sensor_type, "sensor_id": sensor_id}
        self.samples_metric = service.metrics.counter("samples", "Samples published.", **labels)
        self.lost_metric = service.metrics.counter("lost_samples", "Samples missing by device time.", **labels)
        self.gaps_metric = service.metrics.counter("gaps", "Holes in the signal by device time.", **labels)

    def open(self, human_id: str) -> None:
        """Publish under human_id from now on."""
        name = StreamName(human_id, self._sensor_type, self._sensor_id)
        self.raw = self._service.publisher(PhysioRaw, name.topic("raw"), qos.RAW)
        self.device = self._service.publisher(PhysioDeviceFeature, name.topic("device"), qos.DEVICE)
        self.health = self._service.publisher(StreamHealth, name.topic("health"), qos.HEALTH)

    def close(self) -> None:
        """Leave the present topics."""
        for publisher in (self.raw, self.device, self.health):
            self._service.node.destroy_publisher(publisher)

    def count(self, chunk: Chunk) -> None:
        """Bring the counts up to date with samples that just came."""
        timed = self.clock.place(chunk)
        self.counts.arrived(len(chunk.samples))
        self.samples_metric.inc(len(chunk.samples))
        if timed.break_ is Break.DUPLICATE:
            self.counts.duplicates_total += 1
        if timed.break_ is Break.GAP:
            self.counts.gaps_total += 1
            self.counts.lost_samples_total += timed.lost
            self.gaps_metric.inc()
            self.lost_metric.inc(timed.lost)
        if timed.break_ is Break.RESET:
            self._floor_s = math.inf
        if chunk.device_ns is not None:
            self.counts.latency_s = self._delay_s(
                chunk.received_ns * 1e-9, (chunk.received_ns - chunk.device_ns) * 1e-9
            )

    def _delay_s(self, now_s: float, difference_s: float) -> float:
        """Return the delay beyond the smallest one seen; that one is forgotten at 300 ppm, more than clocks drift."""
        self._floor_s = min(difference_s, self._floor_s + 3e-4 * max(0.0, now_s - self._floor_at_s))
        self._floor_at_s = now_s
        return difference_s - self._floor_s


class _Driver:
    """The one device of this process on the graph."""

    def __init__(self, service: Service[Any], streams: Mapping[str, Stream]) -> None:
        self._service, self._config = service, service.config
        self._state, self._link = State.STARTING, Link()
        self._outlets = {
            sensor_type: _Outlet(service, sensor_type, service.config.sensor_id, stream)
            for sensor_type, stream in streams.items()
        }
        self._own_change = False
        self._state_metric = service.metrics.gauge(
            "state", "0 starting, 1 connecting, 2 streaming, 3 lost, 4 stopping.", sensor_id=service.config.sensor_id
        )
        self._reconnects = service.metrics.counter(
            "reconnects", "Times the link was lost.", sensor_id=service.config.sensor_id
        )
        self._bad = service.metrics.counter(
            "undecodable_frames", "Frames that could not be decoded.", sensor_id=service.config.sensor_id
        )
        self._battery = service.metrics.gauge(
            "battery_ratio", "Charge of the battery, 0 to 1.", sensor_id=service.config.sensor_id
        )
        for outlet in self._outlets.values():
            outlet.open(service.config.human_id)
        service.node.add_on_set_parameters_callback(self._on_set)

    async def keep_streaming(self, device: Device) -> None:
        """Stream, and stream again after every loss, for ever."""
        attempt = 0
        while True:
            self._enter(State.CONNECTING)
            received_before = self._received()
            try:
                async with contextlib.aclosing(device.stream()) as items:
                    async for item in items:
                        self._take(item)
                raise DeviceLost("the device ended its stream")
            except DeviceLost as err:
                if self._received() > received_before:
                    attempt = 0
                self._lost(str(err), quiet=attempt > 0)
            await asyncio.sleep(BACKOFF_S[min(attempt, len(BACKOFF_S) - 1)])
            attempt += 1

    def ready(self, session: SessionState) -> tuple[bool, str]:
        """Say whether a session may begin: every stream of it streams at its rate; else which does not."""
        human_id, sensor_id = self._config.human_id, self._config.sensor_id
        behind = [
            f"{sensor_type} {why}"
            for sensor_type, outlet in self._outlets.items()
            if concerns(session, StreamName(human_id, sensor_type, sensor_id)) and (why := self._behind(outlet))
        ]
        return not behind, "; ".join(behind)

    def _behind(self, outlet: _Outlet) -> str:
        """Return what keeps a stream from being recorded, empty where nothing does."""
        state, nominal_hz = self._stream_state(outlet), outlet.stream.sampling_frequency_hz
        if state is not State.STREAMING:
            return f"is {state.name}" + (f": {self._link.reason}" if self._link.reason else "")
        rate_hz = outlet.counts.measured_rate_hz()
        if nominal_hz > 0 and not rate_hz >= READY_RATE * nominal_hz:
            return "has only begun" if math.isnan(rate_hz) else f"at {rate_hz:.1f} of {nominal_hz:g} Hz"
        return ""

    def stopping(self) -> None:
        """Say that the driver is about to leave."""
        self._enter(State.STOPPING)
        self.publish_health()

    def publish_health(self) -> None:
        """Publish the health of every stream as it is now."""
        for outlet in self._outlets.values():
            message = health_message(
                self._config.sensor_id,
                self._stream_state(outlet),
                outlet.stream.sampling_frequency_hz,
                self._link,
                outlet.counts,
            )
            outlet.health.publish(message)

    def _stream_state(self, outlet: _Outlet) -> State:
        """Return the device's state, unless this stream alone is silent."""
        silent_s = time.monotonic() - outlet.counts.last_monotonic_s
        if self._state is State.STREAMING and outlet.stream.sampling_frequency_hz > 0 and silent_s > SILENCE_S:
            return State.LOST
        return self._state

    def _received(self) -> int:
        return sum(outlet.counts.samples_total for outlet in self._outlets.values())

    def _enter(self, state: State) -> None:
        self._state = state
        self._state_metric.set(int(state))
        self._service.ready(state is State.STREAMING)

    def _lost(self, reason: str, quiet: bool) -> None:
        if self._state is State.STREAMING:
            self._link.reconnects_total += 1
            self._reconnects.inc()
        if not quiet:
            self._service.log.warning(f"{self._config.sensor_id}: {reason}; trying again")
        self._link.reason = reason
        self._link.rssi_dbm = math.nan
        self._enter(State.LOST)

    def _take(self, item: Item) -> None:
        match item:
            case Samples(sensor_type, chunk):
                self._samples(self._outlets[sensor_type], chunk)
            case Reported():
                self._report(item)
            case FrameError():
                self._link.undecodable_frames_total += 1
                self._bad.inc()
                self._service.log.warning(
                    f"{self._config.sensor_id}: undecodable frame: {item}", throttle_duration_sec=10.0
                )
            case Status(battery_percent, rssi_dbm, contact):
                self._status(battery_percent, rssi_dbm, contact)
            case Identity():
                self._identify(item)

    def _samples(self, outlet: _Outlet, chunk: Chunk) -> None:
        outlet.raw.publish(wire.raw_message(chunk, self._config.sensor_id))
        outlet.count(chunk)
        if self._state is not State.STREAMING:
            self._service.log.info(f"{self._config.sensor_id}: streaming")
            self._link.reason = ""
            self._enter(State.STREAMING)

    def _report(self, report: Reported) -> None:
        message = PhysioDeviceFeature(features=[wire.feature(*feature) for feature in report.features])
        message.header.frame_id = self._config.sensor_id
        stamps.set_time(message.header.stamp, report.received_ns)
        stamps.set_time(message.device_timestamp, report.device_ns)
        self._outlets[report.sensor_type].device.publish(message)

    def _status(self, battery_percent: float | None, rssi_dbm: float | None, contact: float | None) -> None:
        if battery_percent is not None:
            self._link.battery_percent = float(battery_percent)
            self._battery.set(battery_percent / 100)
        if rssi_dbm is not None:
            self._link.rssi_dbm = float(rssi_dbm)
        if contact is not None:
            self._link.contact = float(contact)

    def _identify(self, identity: Identity) -> None:
        known = {name: value for name, value in identity._asdict().items() if value is not None}
        self._own_change = True
        self._service.node.set_parameters(parameters.as_parameters(known))
        self._own_change = False

    def _on_set(self, changes: list[Parameter]) -> SetParametersResult:
        """Let anyone set human_id, and nobody but the driver anything else. Runs on the ROS thread or our own."""
        for change in changes:
            if change.name != "human_id" and not self._own_change:
                return SetParametersResult(successful=False, reason=f"{change.name} cannot be set at run time")
            if change.name == "human_id" and not (isinstance(change.value, str) and is_human_id(change.value)):
                return SetParametersResult(
                    successful=False,
                    reason=f"human_id {change.value!r}: letters, digits and single '_', a letter first, at most 63",
                )
            if change.name == "human_id":
                self._service.post(self._move, change.value)
        return SetParametersResult(successful=True)

    def _move(self, human_id: str) -> None:
        if human_id == self._config.human_id:
            return
        self._service.log.info(f"{self._config.sensor_id}: {self._config.human_id} -> {human_id}")
        self._config = dataclasses.replace(self._config, human_id=human_id)
        for outlet in self._outlets.values():
            outlet.close()
            outlet.open(human_id)
        self.publish_health()

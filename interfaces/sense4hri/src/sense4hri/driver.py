"""Shell of every driver: keeps a device streaming, stamps, publishes and counts what it yields."""

import asyncio
import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from rclpy.publisher import Publisher
from sense4hri_msgs.msg import Marker, SessionState

from sense4hri import qos, stamps
from sense4hri.device import (
    ClockMeasurement,
    Declared,
    Device,
    DriverConfig,
    Hears,
    Identity,
    Item,
    Marked,
    Noted,
    Reported,
    Samples,
    Status,
    Stream,
)
from sense4hri.driver_parameters import OwnParameters
from sense4hri.errors import DeviceLost, FrameError
from sense4hri.health import Link, State
from sense4hri.names import SENSOR_TYPES, StreamName
from sense4hri.outlet import Outlet, Outlets
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri.session import SessionMember, concerns

BACKOFF_S = (0.5, 1.0, 2.0, 3.0)  # a device that is back streams again within 5 s
STOP_TIMEOUT_S = 8.0  # a radio must be released
HEALTH_INTERVAL_S = 1.0
BAD_EVERY_S = 10.0  # a line of frames that cannot be read
MARKERS = "/study/markers"
READY_RATE = 0.95  # share of the nominal rate at which a session may begin

Config = TypeVar("Config", bound=DriverConfig)


def run_driver(
    kind: str,
    schema: type[Config],
    streams_of: Callable[[Config], Mapping[str, Stream]],
    make_device: Callable[[Config, Mapping[str, Stream]], Device],
) -> int:
    """Keep one device streaming until stopped; return the exit status.

    streams_of(config) gives each raw stream by sensor type as the driver knows it; parameters `<sensor_type>.<field>`
    of the study override it, and make_device gets the result. What a device only reports under is known from its
    configuration (`reported_types`). Nothing is known of one that says only once connected what it measures: it yields
    `Declared`.
    """

    async def main(service: Service[Config]) -> None:
        driver = _Driver(service, streams_of(service.config))
        SessionMember(service, driver.ready)
        device = make_device(service.config, driver.streams)
        if isinstance(device, Hears):
            service.subscribe(Marker, MARKERS, functools.partial(driver.pass_on, device), qos.MARKERS, keep=True)
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


class _Driver:
    """The one device of this process on the graph."""

    def __init__(self, service: Service[Any], streams: Mapping[str, Stream]) -> None:
        self._service, self._config = service, service.config
        self._state, self._link = State.STARTING, Link()
        self._outlets = Outlets(service, service.config.sensor_id, service.config.human_id)
        self.streams = self._outlets.declare(streams)
        """As the study's parameters have them."""
        for sensor_type in service.config.reported_types:
            self._outlets.of(sensor_type)
        self._markers: Publisher | None = None
        self._state_metric = service.metrics.gauge(
            "state", "0 starting, 1 connecting, 2 streaming, 3 lost, 4 stopping.", sensor_id=service.config.sensor_id
        )
        self._reconnects = service.metrics.counter(
            "reconnects", "Times the link was lost.", sensor_id=service.config.sensor_id
        )
        self._bad = service.metrics.counter(
            "undecodable_frames", "Frames that could not be decoded.", sensor_id=service.config.sensor_id
        )
        self._show_link()
        self._parameters = OwnParameters(service, self._move)

    async def keep_streaming(self, device: Device) -> None:
        """Stream, and stream again after every loss, until stopping: a device may be lost while it is released."""
        attempt = 0
        while True:
            self._enter(State.CONNECTING)
            try:
                async with contextlib.aclosing(device.stream()) as items:
                    async for item in items:
                        self._take(item)
                raise DeviceLost("the device ended its stream")
            except DeviceLost as err:
                if self._state is State.STOPPING:
                    return
                if self._state is State.STREAMING:
                    attempt = 0
                self._lost(str(err), quiet=attempt > 0)
            await asyncio.sleep(BACKOFF_S[min(attempt, len(BACKOFF_S) - 1)])
            attempt += 1

    def ready(self, session: SessionState) -> tuple[bool, str]:
        """Say whether a session may begin: every stream of it streams at its rate; else which does not."""
        if not self._outlets.by_type:  # which streams there are is known once the device is connected
            wanted = any(self._concerned(session, sensor_type) for sensor_type in SENSOR_TYPES)
            return not wanted, self._not_streaming(self._state) if wanted else ""
        behind = [
            f"{sensor_type} {why}"
            for sensor_type, outlet in self._outlets.by_type.items()
            if self._concerned(session, sensor_type) and (why := self._behind(outlet))
        ]
        return not behind, "; ".join(behind)

    def _concerned(self, session: SessionState, sensor_type: str) -> bool:
        return concerns(session, StreamName(self._config.human_id, sensor_type, self._config.sensor_id))

    def _not_streaming(self, state: State) -> str:
        return f"is {state.name}" + (f": {self._link.reason}" if self._link.reason else "")

    def _behind(self, outlet: Outlet) -> str:
        """Return what keeps a stream from being recorded, empty where nothing does."""
        state, nominal_hz = self._stream_state(outlet), outlet.nominal_hz
        if state is not State.STREAMING:
            return self._not_streaming(state)
        rate_hz = outlet.counts.measured_rate_hz()
        if nominal_hz > 0 and not rate_hz >= READY_RATE * nominal_hz:
            return "has only begun" if math.isnan(rate_hz) else f"at {rate_hz:.1f} of {nominal_hz:g} Hz"
        return ""

    def stopping(self) -> None:
        """Say that the driver is about to leave."""
        self._enter(State.STOPPING)
        self.publish_health()

    def pass_on(self, device: Hears, marker: Marker) -> None:
        """Hand a marker to the device, unless it is its own or somebody else's."""
        if marker.source == self._config.sensor_id or marker.human_id not in ("", self._config.human_id):
            return
        device.hear(Marked(stamps.event_ns(marker), None, marker.name, marker.value))

    def publish_health(self) -> None:
        """Publish the health of every stream as it is now."""
        for outlet in self._outlets.by_type.values():
            outlet.publish_health(self._stream_state(outlet), self._link)

    def _stream_state(self, outlet: Outlet) -> State:
        """Return the device's state; while it streams, that of this stream alone."""
        return outlet.counts.state() if self._state is State.STREAMING else self._state

    def _enter(self, state: State) -> None:
        self._state = state
        self._state_metric.set(int(state))
        self._service.ready(state is State.STREAMING, f"the device is {state.name}", self._link.reason)

    def _lost(self, reason: str, quiet: bool) -> None:
        if self._state is State.STREAMING:
            self._link.reconnects_total += 1
            self._reconnects.inc()
        if not quiet:
            self._service.log.warning(f"{self._config.sensor_id}: {reason}; trying again")
        self._link.reason = reason
        self._link.rssi_dbm = self._link.contact = math.nan
        self._show_link()
        self._enter(State.LOST)

    def _take(self, item: Item) -> None:
        match item:
            case Samples():
                self._streaming()
                self._outlets.of(item.sensor_type).publish(item)
            case Reported():
                self._report(item)
            case Marked():
                self._mark(item)
            case ClockMeasurement():
                for outlet in self._outlets.by_type.values():
                    outlet.measure(item)
            case Declared(streams):
                with self._parameters.changing():
                    self._outlets.declare_again(streams)
                self._streaming_if_irregular()
            case FrameError():
                self._link.undecodable_frames_total += 1
                self._bad.inc()
                self._service.log.warning_at_times(f"{self._config.sensor_id}: undecodable frame: {item}", BAD_EVERY_S)
            case Noted(text):
                self._service.log.warning(f"{self._config.sensor_id}: {text}")
            case Status(battery_percent, rssi_dbm, contact):
                self._status(battery_percent, rssi_dbm, contact)
            case Identity():
                self._parameters.identify(item, self._config)

    def _streaming(self) -> None:
        if self._state is not State.STREAMING:
            self._service.log.info(f"{self._config.sensor_id}: streaming")
            self._link.reason = ""
            for outlet in self._outlets.by_type.values():
                outlet.counts.begin()
            self._enter(State.STREAMING)

    def _report(self, report: Reported) -> None:
        """Publish a report; of a device that samples nothing it is all there is to stream."""
        self._outlets.of(report.sensor_type).report(report)
        self._streaming_if_irregular()

    def _streaming_if_irregular(self) -> None:
        """A device that is connected streams where nothing of it comes at a rate: it may be silent for long."""
        if not any(outlet.nominal_hz > 0 for outlet in self._outlets.by_type.values()):
            self._streaming()

    def _mark(self, marked: Marked) -> None:
        """Publish what the device says happened; the topic is there from the first time on."""
        if self._markers is None:
            self._markers = self._service.publisher(Marker, MARKERS, qos.MARKERS)
        marker = Marker(name=marked.name, value=marked.value, human_id=self._config.human_id)
        marker.source, marker.uncertainty_s = self._config.sensor_id, math.nan
        stamps.set_time(marker.header.stamp, marked.event_ns)
        stamps.set_time(marker.device_timestamp, marked.device_ns if stamps.can_be(marked.device_ns) else None)
        self._markers.publish(marker)

    def _status(self, battery_percent: float | None, rssi_dbm: float | None, contact: float | None) -> None:
        if battery_percent is not None:
            self._link.battery_percent = float(battery_percent)
        if rssi_dbm is not None:
            self._link.rssi_dbm = float(rssi_dbm)
        if contact is not None:
            self._link.contact = float(contact)
        self._show_link()

    def _show_link(self) -> None:
        """Show what is known of the device's link; NaN what is not."""
        for name, text, value in (
            ("battery_ratio", "Charge of the battery, 0 to 1.", self._link.battery_percent / 100),
            ("rssi_dbm", "Strength of the radio signal received.", self._link.rssi_dbm),
            ("contact_ratio", "Contact of the electrodes or the skin, 0 to 1.", self._link.contact),
        ):
            self._service.metrics.gauge(name, text, sensor_id=self._config.sensor_id).set(value)

    def _move(self, human_id: str) -> None:
        if human_id == self._config.human_id:
            return
        self._service.log.info(f"{self._config.sensor_id}: {self._config.human_id} -> {human_id}")
        self._config = dataclasses.replace(self._config, human_id=human_id)
        self._outlets.move(human_id)
        self.publish_health()

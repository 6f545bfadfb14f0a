"""The streams of a driver on the graph: their parameters, their publishers, and what came on them."""

import dataclasses
import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from sense4hri_msgs.msg import ClockMeasurement as ClockMeasurementMessage
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioRaw, StreamHealth

from sense4hri import parameters, qos, stamps, wire
from sense4hri.chunk import Break, Chunk
from sense4hri.device import ClockMeasurement, Reported, Samples, Stream, check_rate, check_stream
from sense4hri.health import Link, State, StreamCounts, health_message, realtime_minus_monotonic_ns
from sense4hri.holes import Holes, one_by_one
from sense4hri.intake import LARGEST
from sense4hri.modalities import modality
from sense4hri.names import StreamName
from sense4hri.running_rate import MEMORY_S
from sense4hri.sample_clock import SampleClock
from sense4hri.schema import Rule, parameters_of
from sense4hri.service import Service
from sense4hri.stamps import SECOND_NS
from sense4hri.stream_metrics import StreamMetrics

HOST_STEP_NS = 2_000_000  # by which the host's clock must move to have been set
FEW = 32  # numbers, of which Python knows several times sooner than numpy that none is too large
STAMPED_S = 1.0  # for which frames are published that were stamped before the step


class Outlet:
    """Publishers and counts of one stream; the publishers move with human_id, the counts stay.

    stream: None where the device only reports values of this sensor type and samples nothing; then there is no `raw`.
    """

    def __init__(self, service: Service[Any], sensor_type: str, sensor_id: str, stream: Stream | None) -> None:
        self.counts = StreamCounts()
        self._service, self._sensor_type, self._sensor_id = service, sensor_type, sensor_id
        self._publishers: dict[str, Publisher] = {}
        self._name: StreamName
        self._floor_s = math.inf
        self._floor_at_s = 0.0
        self._host_ns, self._stepped_s = realtime_minus_monotonic_ns(), -math.inf
        self._metrics = StreamMetrics(service.metrics, sensor_type, sensor_id)
        self.become(stream)

    def become(self, stream: Stream | None) -> None:
        """Be of another rate, unit or set of channels from now on; to be called while closed."""
        self.stream = stream
        self.counts.nominal_hz = self.nominal_hz
        self._clock = SampleClock(self.nominal_hz)
        self._counted_only = self._counted_ns = 0  # samples missing by the device's count, not yet by its clock; when
        self._holes = Holes(self.nominal_hz) if self.nominal_hz > 0 else None

    @property
    def nominal_hz(self) -> float:
        """The declared rate; 0 where samples come irregularly or not at all."""
        return self.stream.sampling_frequency_hz if self.stream else 0.0

    def open(self, human_id: str) -> None:
        """Publish under human_id from now on."""
        self._name = StreamName(human_id, self._sensor_type, self._sensor_id)
        if self.stream is not None:
            self._publisher("raw", PhysioRaw)
        self._publisher("device", PhysioDeviceFeature)
        self._publisher("health", StreamHealth)

    def close(self) -> None:
        """Leave the present topics."""
        for publisher in self._publishers.values():
            self._service.node.destroy_publisher(publisher)
        self._publishers.clear()

    def publish(self, item: Samples) -> None:
        """Publish samples under the declared names of the channels, a frame with holes in parts, and count them.

        Raises ValueError where the driver sends other channels than it has declared, or irregular samples together
        without the time of each.
        """
        shape = item.chunk.samples.shape
        if self.stream is None or len(shape) != 2 or shape[1] != len(self.stream.channel_names):
            declared = self.stream.channel_names if self.stream else "no raw stream"
            came = f"{self._sensor_type} samples of shape {shape}, channels {item.chunk.channels}"
            raise ValueError(f"{came}; declared: {declared}")
        self.counts.time_doubt = self.counts.value_doubt = ""
        gaps: list[int] = []
        if parts := self._parts(item):
            for chunk in parts:
                device_ns, samples = self._possible(chunk.device_ns), self._bearable(chunk.samples)
                named = Chunk(self.stream.channel_names, samples, device_ns, chunk.received_ns)
                self._publisher("raw", PhysioRaw).publish(wire.octets_of(named, self._sensor_id))
                gaps += self._count(named, item.lost)
            self._came(len(item.chunk.samples), named)
        self._count_missing(gaps, item.lost or 0, item.chunk.received_ns)

    def _parts(self, item: Samples) -> list[Chunk]:
        """Return what is to be published: nothing of a read that brought no sample; irregular ones one by one."""
        if not item.chunk.samples.size:
            return []
        if item.times_ns is not None:
            cut = self._holes.cut if self._holes else one_by_one
            return cut(item.chunk, item.times_ns)
        if self._holes is None and len(item.chunk.samples) > 1:
            came = f"{len(item.chunk.samples)} irregular samples of {self._sensor_type} came together"
            raise ValueError(f"{came}: `times_ns` must tell when each was, or each comes alone")
        return [item.chunk]

    def report(self, report: Reported) -> None:
        """Publish what the device computed itself."""
        message = PhysioDeviceFeature(features=[wire.feature(*feature) for feature in report.features])
        message.header.frame_id = self._sensor_id
        stamps.set_time(message.header.stamp, report.received_ns)
        stamps.set_time(message.device_timestamp, self._possible(report.device_ns))
        self._publisher("device", PhysioDeviceFeature).publish(message)

    def _possible(self, device_ns: int | None) -> int | None:
        """Return a device time as a message can carry it; an impossible one is none, is counted and told of."""
        if not (fits := stamps.can_be(device_ns)):
            self.counts.impossible_times_total += 1
            self.counts.time_doubt = f"the device time {device_ns} ns cannot be: it is given as unknown"
        return device_ns if fits else None

    def _bearable(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return samples as everybody takes them; a number that is too large is NaN, is counted and told of."""
        if 0 < samples.size <= FEW and max(map(abs, samples.ravel().tolist())) <= LARGEST:
            return samples
        beyond = np.abs(samples) > LARGEST
        if not beyond.any():
            return samples
        self.counts.impossible_values_total += int(beyond.sum())
        self.counts.value_doubt = f"a value beyond {LARGEST:g} is given as NaN"
        return np.where(beyond, np.nan, samples)

    def measure(self, measured: ClockMeasurement) -> None:
        """Publish a measurement of the clock, unless its time cannot be; the topic is there from the first one on."""
        if self._possible(measured.device_ns) is None:
            return
        message = ClockMeasurementMessage(
            offset_ns=measured.offset_ns, uncertainty_s=measured.uncertainty_s, method=measured.method
        )
        message.header.frame_id = self._sensor_id
        stamps.set_time(message.header.stamp, measured.received_ns)
        stamps.set_time(message.device_timestamp, measured.device_ns)
        self._publisher("clock_measurement", ClockMeasurementMessage).publish(message)

    def publish_health(self, state: State, link: Link) -> None:
        """Publish the health of the stream as it is now."""
        message = health_message(self._sensor_id, state, self.nominal_hz, link, self.counts)
        self._publisher("health", StreamHealth).publish(message)
        self._metrics.show(message)

    def _publisher(self, field: str, message: type) -> Publisher:
        if field not in self._publishers:
            profile = getattr(qos, field.upper())
            self._publishers[field] = self._service.publisher(message, self._name.topic(field), profile)
        return self._publishers[field]

    def _count(self, chunk: Chunk, lost: int | None) -> list[int]:
        """Count a frame; return how many samples are missing before it by the clock, none where it continues.

        lost: by the device's own count, None where it has none.
        """
        timed = self._clock.place(chunk)
        self.counts.device_time = chunk.device_ns is not None
        self.counts.loss_known = lost is not None or (self.counts.device_time and self.nominal_hz > 0)
        if timed.break_ is Break.DUPLICATE:
            self.counts.duplicates_total += 1
            self._metrics.duplicates.inc()
        if timed.break_ is Break.RESET:
            self._floor_s, self._counted_only = math.inf, 0
        return [timed.lost] if timed.break_ is Break.GAP else []

    def _came(self, n: int, newest: Chunk) -> None:
        """Count what came together, n samples: once for all messages of it, each of which this would cost as much."""
        self.counts.arrived(n)
        self._metrics.published(n, newest.received_ns)
        if newest.device_ns is not None:
            self.counts.latency_s = self._delay_s(
                newest.received_ns * 1e-9, (newest.received_ns - newest.device_ns) * 1e-9
            )

    def _count_missing(self, gaps: list[int], by_count: int, received_ns: int) -> None:
        """Count what is missing by the clock or by the device's count: the larger, and once.

        Where stamps jitter the clock tells some frames later what the count has told at once.
        """
        if received_ns - self._counted_ns > MEMORY_S * SECOND_NS:
            self._counted_only = 0
        if not gaps and not by_count:
            return
        if by_count:
            self._counted_ns = received_ns
        by_clock = sum(gaps)
        missing = max(by_clock - self._counted_only, by_count)
        self._counted_only = max(0, self._counted_only + by_count - by_clock)
        if by_clock and missing <= 0:
            return
        number = len(gaps) or bool(by_count)
        self.counts.gaps_total += number
        self.counts.lost_samples_total += missing
        self._metrics.gaps.inc(number)
        self._metrics.lost.inc(missing)

    def _delay_s(self, now_s: float, difference_s: float) -> float:
        """Return the delay beyond the smallest one seen; that one is forgotten at 300 ppm, more than clocks drift.

        Where the host's clock was set it is forgotten at once: it was measured on the clock as it was.
        """
        before_ns, self._host_ns = self._host_ns, time.time_ns() - time.monotonic_ns()
        if abs(self._host_ns - before_ns) > HOST_STEP_NS:  # or this process was kept waiting between the two
            self._host_ns = realtime_minus_monotonic_ns()
            if abs(self._host_ns - before_ns) > HOST_STEP_NS:
                self._stepped_s = time.monotonic()
        if time.monotonic() - self._stepped_s < STAMPED_S:
            self._floor_s = math.inf
        self._floor_s = min(difference_s, self._floor_s + 3e-4 * max(0.0, now_s - self._floor_at_s))
        self._floor_at_s = now_s
        return difference_s - self._floor_s


class Outlets:
    """All streams of the one device of a driver, by sensor type."""

    def __init__(self, service: Service[Any], sensor_id: str, human_id: str) -> None:
        self._service, self._sensor_id, self._human_id = service, sensor_id, human_id
        self.by_type: dict[str, Outlet] = {}

    def declare(self, streams: Mapping[str, Stream], connected: bool = False) -> dict[str, Stream]:
        """Offer what the driver knows of its streams; return them with the study's parameters in place of its own.

        connected: the device itself says so, also of rates that it is asked for. Raises ConfigError that names the
        parameter which cannot be.
        """
        rates_known = connected or not self._service.config.asks_rates
        declared = {
            sensor_type: self._parameters(sensor_type, own, rates_known) for sensor_type, own in streams.items()
        }
        for sensor_type, stream in declared.items():
            self._offer(sensor_type, stream)
        return declared

    def declare_again(self, streams: Mapping[str, Stream]) -> None:
        """Offer what the device says of its streams; those it no longer has are withdrawn. Raises ConfigError."""
        for sensor_type in [one for one, outlet in self.by_type.items() if outlet.stream and one not in streams]:
            self.by_type.pop(sensor_type).close()
            self._withdraw(sensor_type)
        self.declare(streams, connected=True)

    def of(self, sensor_type: str) -> Outlet:
        """Return the outlet of a sensor type; of one nobody declared it carries reports and health, no samples."""
        if sensor_type not in self.by_type:
            self._offer(sensor_type, None)
        return self.by_type[sensor_type]

    def move(self, human_id: str) -> None:
        """Publish everything under human_id from now on."""
        self._human_id = human_id
        for outlet in self.by_type.values():
            outlet.close()
            outlet.open(human_id)

    def _offer(self, sensor_type: str, stream: Stream | None) -> None:
        """Open an outlet; one that is as it was before stays untouched, so that nobody has to find it again."""
        outlet = self.by_type.get(sensor_type)
        if outlet is None:
            outlet = self.by_type[sensor_type] = Outlet(self._service, sensor_type, self._sensor_id, stream)
        elif outlet.stream == stream:
            return
        outlet.close()
        outlet.become(stream)
        outlet.open(self._human_id)

    def _parameters(self, sensor_type: str, own: Stream, rate_known: bool) -> Stream:
        """Declare the parameters of a stream, afresh where there are some; only the driver itself sets them."""
        self._withdraw(sensor_type)
        node = self._service.node
        values = {
            each.name: parameters.declare(
                node, f"{sensor_type}.{each.name}", each.kind, getattr(own, each.name), each.rule
            )
            for each in parameters_of(Stream)
        }
        for name, help_ in modality(sensor_type).parameters.items():
            parameters.declare(node, f"{sensor_type}.{name}", float, math.nan, Rule(help_, settable=True, nan=True))
        stream = Stream(**values)
        check_stream(sensor_type, own, stream)
        if rate_known:
            check_rate(sensor_type, own, stream)
        return stream

    def _withdraw(self, sensor_type: str) -> None:
        for name in (*(field.name for field in dataclasses.fields(Stream)), *modality(sensor_type).parameters):
            if self._service.node.has_parameter(f"{sensor_type}.{name}"):
                self._service.node.undeclare_parameter(f"{sensor_type}.{name}")

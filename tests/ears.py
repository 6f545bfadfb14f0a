"""Nodes of a test's own: one that listens, and one that plays a driver nobody here has written."""

import os
import time
from array import array
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
import rclpy
from numpy.typing import NDArray
from processes import DEADLINE_S
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import set_time
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioFeature, PhysioRaw, PhysioRawChannel

Wave = Callable[[NDArray[np.float64]], Mapping[str, NDArray[np.float64]]]
EPOCH_NS = 599_616_000_000_000_000
RECEIVED_NS = 1_700_000_000_000_000_000


class Ears:
    """A node, spun while it waits.

    beside: one that was there before; both are spun while either waits, so each answers who asks for its parameters.
    """

    def __init__(
        self, name: str = "ears", parameters: Mapping[str, Any] | None = None, beside: "Ears | None" = None
    ) -> None:
        self._own_context = beside is None
        if beside is None:
            self.context = rclpy.Context()
            rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
            self._executor = SingleThreadedExecutor(context=self.context)
        else:
            self.context, self._executor = beside.context, beside._executor
        self.node = rclpy.create_node(name, context=self.context)
        for key, value in (parameters or {}).items():
            self.node.declare_parameter(key, value)
        self._executor.add_node(self.node)

    def hear(self, kind: type, topic: str, profile: QoSProfile | int) -> list[Any]:
        """Subscribe; return the list that the messages go to."""
        got: list[Any] = []
        self.node.create_subscription(kind, topic, got.append, profile)
        return got

    def spin(self, seconds: float = 0.05) -> None:
        """Let one callback run, or that much time pass."""
        self._executor.spin_once(timeout_sec=seconds)

    def until(self, condition: Callable[[], Any], what: str | Callable[[], str], seconds: float = DEADLINE_S) -> Any:
        """Spin until condition() is true and return it; fail with `what` after so many seconds."""
        deadline = time.monotonic() + seconds
        while not (result := condition()):
            if time.monotonic() > deadline:
                pytest.fail(f"not within {seconds:g} s: {what if isinstance(what, str) else what()}")
            self.spin()
        return result

    def ask(self, kind: type, name: str, request: Any) -> Any:
        """Return a service's response."""
        client = self.node.create_client(kind, name)
        try:
            self.until(client.service_is_ready, f"{name} is served")
            answer = client.call_async(request)
            self.until(answer.done, f"{name} answers")
            return answer.result()
        finally:
            self.node.destroy_client(client)

    def close(self) -> None:
        self._executor.remove_node(self.node)
        self.node.destroy_node()
        if self._own_context:
            self._executor.shutdown()
            rclpy.shutdown(context=self.context)


class ThirdPartyDriver(Ears):
    """A driver of one stream, as sections 2 to 6 of the contract describe it; it hears the features made of it.

    wave: times in s after the first sample, shape (n,), -> the samples of every channel by its name. Device time begins
    at EPOCH_NS; everything is received RECEIVED_NS - EPOCH_NS later. also: a second stream of the device, at the same
    rate: its sensor type, unit and wave. publishes: sensor type of the features where that is not the stream's.
    """

    def __init__(
        self,
        stream: StreamName,
        features: type,
        wave: Wave,
        fs_hz: float,
        frame: int,
        unit: str,
        beside: Ears | None = None,
        also: tuple[str, str, Wave] | None = None,
        publishes: str = "",
    ) -> None:
        identity = ("vendor", "model", "serial_number", "firmware_version", "body_location")
        parameters = {"human_id": stream.human_id, "sensor_id": stream.sensor_id, "transport_delay_s": 0.0}
        parameters |= dict.fromkeys(identity, "other")
        for sensor_type, its_unit, its_wave in ((stream.sensor_type, unit, wave), *([also] if also else [])):
            own = {
                "sampling_frequency_hz": fs_hz,
                "unit": its_unit,
                "range_min": -8388608.0,
                "range_max": 8388607.0,
                "resolution_bits": 22,
                "channel_names": list(its_wave(np.zeros(1))),
            }
            parameters |= {f"{sensor_type}.{key}": value for key, value in own.items()}
        super().__init__(f"driver_other_{stream.sensor_id}", parameters, beside)
        self.stream, self.sent, self._publishes = stream, 0, publishes or stream.sensor_type
        self._kind, self._wave, self._fs_hz, self._frame, self._also = features, wave, fs_hz, frame, also
        self._open()

    def _open(self) -> None:
        self.features: list[Any] = []
        self._raw = self.node.create_publisher(PhysioRaw, self.stream.topic("raw"), qos.RAW)
        self._device = self.node.create_publisher(PhysioDeviceFeature, self.stream.topic("device"), qos.DEVICE)
        if self._also:
            topic = self.stream._replace(sensor_type=self._also[0]).topic("raw")
            self._also_raw = self.node.create_publisher(PhysioRaw, topic, qos.RAW)
        self._heard = self.node.create_subscription(
            self._kind, self._features_topic, self.features.append, qos.FEATURES
        )

    def wear(self, human_id: str) -> None:
        """Publish under this name from now on, as a driver does when its human_id is set."""
        self.node.destroy_publisher(self._raw)
        self.node.destroy_publisher(self._device)
        if self._also:
            self.node.destroy_publisher(self._also_raw)
        self.node.destroy_subscription(self._heard)
        self.stream = self.stream._replace(human_id=human_id)
        self._open()

    def until_heard(self, device: bool = True, by: Sequence[str] = ()) -> None:
        """Wait until a service takes in what is published, and can be heard itself.

        device: also what a device says. by: nodes that take in the raw samples, all of them, whatever others do.
        """
        topic = self._raw.topic_name
        ends = (self._raw, *([self._device] if device else []), *([self._also_raw] if self._also else []))
        self.until(lambda: all(end.get_subscription_count() > 0 for end in ends), "the service subscribes")
        self.until(lambda: self._heard.get_publisher_count() > 0, "the service publishes features")
        listening = lambda: {one.node_name for one in self.node.get_subscriptions_info_by_topic(topic)}  # noqa: E731
        self.until(lambda: set(by) <= listening(), lambda: f"{listening()} take in {topic}, not all of {by}")
        self.until(
            lambda: self._raw.get_subscription_count() >= self.node.count_subscribers(topic),
            "all of them are connected",
        )

    @property
    def _features_topic(self) -> str:
        return self.stream.derived(self._publishes).topic("features")

    def play(self, seconds: float, heart_rate: float | None = None, held_s: float = 0.0) -> None:
        """Publish that many seconds of signal, each frame once the features of those before have come.

        heart_rate: in 1/min, reported beside every frame as the device's own. held_s: of signal that the service holds
        back, one second or a frame where it takes markers.
        """
        before, first = len(self.features), self.sent
        while self.sent < first + seconds * self._fs_hz:
            self._send()
            if heart_rate is not None:
                self.report(heart_rate)
            due = int((self.sent - first - 2) / self._fs_hz - held_s)
            self.until(lambda due=due: len(self.features) - before >= due, f"update {due} of {self.stream.sensor_id}")

    def _send(self) -> None:
        times_s = (self.sent + np.arange(self._frame)) / self._fs_hz
        self.sent += self._frame
        if self._also:
            self._also_raw.publish(self._frame_of(self._also[2](times_s)))
        self._raw.publish(self._frame_of(self._wave(times_s)))

    def _frame_of(self, samples: Mapping[str, NDArray[np.float64]]) -> PhysioRaw:
        message = PhysioRaw(
            channels=[
                PhysioRawChannel(channel_name=name, samples=array("d", values.tobytes()))
                for name, values in samples.items()
            ]
        )
        message.header.frame_id = self.stream.sensor_id
        set_time(message.header.stamp, RECEIVED_NS + self._newest_ns())
        set_time(message.device_timestamp, EPOCH_NS + self._newest_ns())
        return message

    def report(self, heart_rate: float) -> None:
        """Publish a heart rate in 1/min of the device's own, received with the newest frame."""
        message = PhysioDeviceFeature(features=[PhysioFeature(name="heart_rate", unit="1/min", values=[heart_rate])])
        message.header.frame_id = self.stream.sensor_id
        set_time(message.header.stamp, RECEIVED_NS + self._newest_ns())
        self._device.publish(message)

    def _newest_ns(self) -> int:
        return round((self.sent - 1) / self._fs_hz * 1e9)

"""What comes from ROS into the study: subscriptions that follow the graph."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import sense4hri_msgs.msg as contract
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sense4hri import qos
from sense4hri.discovery import RawStreams
from sense4hri.errors import FrameError
from sense4hri.modalities import MODALITIES
from sense4hri.names import ROOT, StreamName, is_human_id
from sense4hri.service import Service
from sense4hri.session import SessionMember
from sense4hri.stamps import to_ns
from sense4hri.stream_info import StreamInfo
from sense4hri.wire import chunk_of

from web_gui.config import Config
from web_gui.model import Study
from web_gui.session import recorder_status
from web_gui.stream import Info

LOOK_EVERY_S = 1.0
FACES = "/humans/faces/"
RECORDER = "recorder: recording"  # name of the status on /diagnostics
PACKAGE = "sense4hri_msgs/msg/"
QUEUES = {
    "raw": qos.deep(qos.RAW),
    "device": qos.deep(qos.DEVICE, 200),
    "features": qos.deep(qos.FEATURES, 200),
    "clock": qos.CLOCK,
    "health": qos.deep(qos.HEALTH, 10),
}
# the type each field must have; a topic of the right name and another type is not ours
TYPES: dict[str, tuple[type, ...]] = {
    "raw": (contract.PhysioRaw,),
    "device": (contract.PhysioDeviceFeature,),
    "features": tuple(getattr(contract, entry.message) for entry in MODALITIES.values() if entry.message),
    "clock": (contract.ClockModel,),
    "health": (contract.StreamHealth,),
}


class Graph:
    """Subscribes to everything the page shows as it appears, and lets go of what has gone."""

    def __init__(self, service: Service[Config], study: Study) -> None:
        self._service, self._study = service, study
        self._node = service.node
        self._subscriptions: dict[str, Subscription] = {}
        self._undecodable = service.metrics.counter("undecodable_messages", "Raw messages with unequal or no channels.")
        RawStreams(service, None, self._learn, self._gone, self._found)
        self._subscribe(contract.SessionState, "/study/session", self._session, qos.SESSION)
        self._subscribe(contract.SessionAck, "/study/ack", self._ack, qos.deep(qos.ACK))
        self._subscribe(DiagnosticArray, "/diagnostics", self._recording, qos.deep(qos.HEALTH, 100))
        SessionMember(service)
        self._subscribe(contract.Marker, "/study/markers", self._marker, qos.MARKERS)
        service.every(LOOK_EVERY_S, self._look)

    def _look(self) -> None:
        """Compare the graph with what is subscribed."""
        self._study.nodes = set(self._node.get_node_names())
        present = {topic: types for topic, types in self._node.get_topic_names_and_types() if self._follows(topic)}
        published = {topic for topic in present if self._node.count_publishers(topic)}
        for topic in [topic for topic in self._subscriptions if self._follows(topic) and topic not in published]:
            self._service.unsubscribe(self._subscriptions.pop(topic))
        for topic in published - self._subscriptions.keys():
            self._open(topic, present[topic])

    @staticmethod
    def _follows(topic: str) -> bool:
        return topic.startswith(ROOT + "/") or (topic.startswith(FACES) and topic.endswith("/expression"))

    def _open(self, topic: str, types: list[str]) -> None:
        if topic.startswith(FACES):
            if "hri_msgs/msg/Expression" in types:
                self._open_expression(topic)
            return
        parsed = StreamName.parse(topic)
        kind = _contract_type(types)
        if parsed is not None and kind is not None and kind in TYPES.get(parsed[1], ()):
            name, field = parsed
            handlers: dict[str, Callable[[StreamName, Any], None]] = {
                "raw": self._raw,
                "device": self._device,
                "features": self._features,
                "clock": self._clock,
                "health": self._health,
            }
            self._subscribe(kind, topic, partial(handlers[field], name), QUEUES[field])
            return
        parts = topic.removeprefix(ROOT + "/").split("/")
        if len(parts) == 2 and parts[1] == "state" and is_human_id(parts[0]) and kind is contract.UserState:
            self._subscribe(kind, topic, partial(self._state, parts[0]), qos.STATE)

    def _open_expression(self, topic: str) -> None:
        from hri_msgs.msg import Expression  # only where a robot publishes faces is its package needed

        face_id = topic.removeprefix(FACES).split("/")[0]
        self._subscribe(Expression, topic, partial(self._expression, face_id), qos.adapt(self._node, topic))

    def _subscribe(self, kind: type, topic: str, handler: Callable[[Any], None], profile: QoSProfile) -> None:
        self._subscriptions[topic] = self._service.subscribe(kind, topic, handler, profile)

    def _found(self, name: StreamName) -> None:
        self._study.found(name, time.time_ns())

    def _gone(self, name: StreamName) -> None:
        self._study.gone(name, time.time_ns())

    def _learn(self, info: StreamInfo) -> None:
        stream = self._study.stream(info.name, time.time_ns())
        stream.learn(Info(info.sampling_frequency_hz, info.unit, info.parameters))

    def _raw(self, name: StreamName, message: Any) -> None:
        try:
            chunk = chunk_of(message)
        except FrameError:
            self._undecodable.inc()
            return
        now_ns = time.time_ns()
        self._study.axis.saw(chunk.received_ns, now_ns)
        self._study.stream(name, now_ns).raw(chunk, now_ns)

    def _device(self, name: StreamName, message: Any) -> None:
        newest = {feature.name: float(feature.values[-1]) for feature in message.features if len(feature.values)}
        now_ns = time.time_ns()
        self._study.stream(name, now_ns).take_reported(newest, now_ns)

    def _features(self, name: StreamName, message: Any) -> None:
        now_ns = time.time_ns()
        self._study.stream(name, now_ns).take_features(plain(message), now_ns)

    def _clock(self, name: StreamName, message: Any) -> None:
        now_ns = time.time_ns()
        self._study.stream(name, now_ns).take_clock(plain(message), now_ns)

    def _health(self, name: StreamName, message: Any) -> None:
        now_ns = time.time_ns()
        self._study.stream(name, now_ns).take_health(plain(message), now_ns)

    def _state(self, human_id: str, message: Any) -> None:
        self._study.take_state(human_id, plain(message), time.time_ns())

    def _expression(self, face_id: str, message: Any) -> None:
        self._study.take_expression(face_id, plain(message), time.time_ns())

    def _session(self, message: Any) -> None:
        self._study.session.take_state(plain(message))

    def _ack(self, message: Any) -> None:
        self._study.session.take_ack(plain(message))

    def _recording(self, message: Any) -> None:
        for status in message.status:
            if status.name == RECORDER:
                values = {entry.key: entry.value for entry in status.values}
                told = recorder_status(status.level[0], status.message, values)
                self._study.session.take_recorder(told, time.time_ns())

    def _marker(self, message: Any) -> None:
        self._study.take_marker({**plain(message), "stamp_ns": to_ns(message.header.stamp)})


def plain(message: Any) -> dict[str, Any]:
    """Return a message as plain values: times in ns, nested messages as dicts, arrays as lists."""
    return {name: _value(getattr(message, name)) for name in message.get_fields_and_field_types()}


def _value(value: Any) -> Any:
    if isinstance(value, str | bool | int | float):
        return value
    if hasattr(value, "nanosec"):
        return to_ns(value)
    if hasattr(value, "get_fields_and_field_types"):
        return plain(value)
    return [_value(entry) for entry in value.tolist()] if hasattr(value, "tolist") else [_value(v) for v in value]


def _contract_type(types: list[str]) -> type | None:
    names = [name.removeprefix(PACKAGE) for name in types if name.startswith(PACKAGE)]
    return getattr(contract, names[0], None) if len(names) == 1 else None

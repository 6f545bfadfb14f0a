"""fusion-affect: wires the graph to the fusion, and its states to the graph."""

import re
import sys
from collections.abc import Callable
from typing import Any

from hri_msgs.msg import Expression as ExpressionMessage
from hri_msgs.msg import IdsList
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sense4hri import qos
from sense4hri.names import UNASSIGNED, StreamName, state_topic
from sense4hri.service import Service, run
from sense4hri.session import SessionMember
from sense4hri.stamps import from_ns, to_ns
from sense4hri.wire import feature
from sense4hri_msgs.msg import (
    ECG,
    PPG,
    ClockModel,
    Indicator,
    Marker,
    PhysioDeviceFeature,
    SensorAssignmentArray,
    StreamHealth,
    UserState,
)
from std_msgs.msg import String

from fusion_affect.align import ClockModel as Model
from fusion_affect.config import Config
from fusion_affect.fusion import Fusion, Rate
from fusion_affect.state import Expression, State
from fusion_affect.tree import load

LOOK_INTERVAL_S = 0.5
TELL_INTERVAL_S = 0.05  # what came in the meantime, on whichever topic, is all known before a state is computed
HEART_RATE_TYPES = {"ecg": ECG, "ppg": PPG}
_PERSON = re.compile(r"/humans/persons/([A-Za-z_][A-Za-z0-9_]*)/(face_id|alias)")
_FACE = re.compile(r"/humans/faces/([A-Za-z_][A-Za-z0-9_]*)/expression")


class Source:
    """A topic that may come and go: how it is heard, and what is to be done when it has vanished."""

    def __init__(
        self, message: type, handler: Callable[[Any], None], own_qos: QoSProfile | None, gone: Callable[[], None]
    ) -> None:
        self.message, self.handler, self.gone = message, handler, gone
        self.own_qos = own_qos
        """None for a topic that is not ours: it is heard as it is offered."""


class Shell:
    """Follows the graph, hands every message to the fusion, publishes what is due."""

    def __init__(self, service: Service[Config], fusion: Fusion) -> None:
        self._service, self._fusion = service, fusion
        self._heard: dict[str, tuple[Source, Subscription, QoSProfile]] = {}
        self._publishers: dict[str, Publisher] = {}
        self._unstamped = service.metrics.counter("unstamped_expressions", "Expressions without a stamp.")
        self._published = service.metrics.counter("states", "States published.")
        self._unknown = service.metrics.counter("unknown_states", "States published that are unknown.")
        service.subscribe(SensorAssignmentArray, "/study/assignments", self._on_assignments, qos.ASSIGNMENTS)
        service.subscribe(Marker, "/study/markers", self._on_marker, qos.MARKERS)

    def look(self) -> None:
        """Begin to hear what has appeared on the graph, stop hearing what has vanished."""
        node = self._service.node
        present = {}
        for topic, types in node.get_topic_names_and_types():
            source = self._heard[topic][0] if topic in self._heard else self._source(topic)
            if source and _type_name(source.message) in types and node.count_publishers(topic):
                present[topic] = source
        for topic in self._heard.keys() - present.keys():
            source, subscription, _ = self._heard.pop(topic)
            self._service.unsubscribe(subscription)
            source.gone()
        for topic, source in present.items():
            offered = source.own_qos or qos.adapt(node, topic)
            if topic in self._heard and self._heard[topic][2] != offered:
                self._service.unsubscribe(self._heard.pop(topic)[1])
            if topic not in self._heard:
                self._heard[topic] = source, self._subscribe(topic, source, offered), offered
        self._offer({parsed[0].human_id for topic in self._heard if (parsed := StreamName.parse(topic))})

    def _offer(self, human_ids: set[str]) -> None:
        """Have a topic for everybody with a stream before there is a state: the first one is to be heard too."""
        wanted = human_ids - {UNASSIGNED}
        for human_id in wanted - self._publishers.keys():
            self._publishers[human_id] = self._service.publisher(UserState, state_topic(human_id), qos.STATE)
        for human_id in self._publishers.keys() - wanted:
            self._service.node.destroy_publisher(self._publishers.pop(human_id))

    def _subscribe(self, topic: str, source: Source, offered: QoSProfile) -> Subscription:
        handler = self._while_heard(topic, source.handler)
        if source.message is not ExpressionMessage:
            return self._service.subscribe(source.message, topic, handler, offered)
        # recognisers send it without a stamp: the middleware knows when it came

        def hear(message: ExpressionMessage, info: dict[str, Any]) -> None:
            self._service.post(handler, (message, info["received_timestamp"]))

        return self._service.node.create_subscription(source.message, topic, hear, offered)  # type: ignore[arg-type]

    def _while_heard(self, topic: str, handler: Callable[[Any], None]) -> Callable[[Any], None]:
        """Leave out what was still in the queue when its topic vanished."""

        def handle(message: Any) -> None:
            if topic in self._heard:
                handler(message)

        return handle

    def tell(self) -> None:
        """Publish the states that have become due."""
        for state in self._fusion.due():
            self._publish(state)

    def _source(self, topic: str) -> Source | None:
        """What is to be heard on a topic; None for most topics."""
        fusion = self._fusion
        if parsed := StreamName.parse(topic):
            return self._stream_source(*parsed)
        if topic == "/humans/faces/tracked":
            return Source(IdsList, lambda m: fusion.faces(m.ids, to_ns(m.header.stamp)), None, lambda: None)
        if topic in ("/humans/persons/tracked", "/humans/persons/known"):
            return Source(IdsList, lambda m: fusion.persons(topic, m.ids), None, lambda: fusion.persons(topic, ()))
        if found := _PERSON.fullmatch(topic):
            person_id, tell = found[1], fusion.person_face if found[2] == "face_id" else fusion.alias
            return Source(String, lambda m: tell(person_id, m.data), None, lambda: tell(person_id, None))
        if found := _FACE.fullmatch(topic):
            face_id = found[1]
            return Source(
                ExpressionMessage,
                lambda m: self._on_expression(face_id, m),
                None,
                lambda: fusion.face_vanished(face_id),
            )
        return None

    def _stream_source(self, name: StreamName, field: str) -> Source | None:
        def gone() -> None:
            self._fusion.vanished(name, field)

        if field == "health":
            return Source(StreamHealth, lambda m: self._on_health(name, m), qos.HEALTH, gone)
        if name.sensor_type not in HEART_RATE_TYPES:
            return None
        if field == "features":
            message = HEART_RATE_TYPES[name.sensor_type]
            return Source(message, lambda m: self._on_features(name, m), qos.deep(qos.FEATURES), gone)
        if field == "device":
            return Source(PhysioDeviceFeature, lambda m: self._on_device(name, m), qos.deep(qos.DEVICE), gone)
        if field == "clock":
            return Source(ClockModel, lambda m: self._on_clock(name, m), qos.CLOCK, lambda: None)
        return None

    def _on_features(self, name: StreamName, message: Any) -> None:
        rate = Rate(message.heart_rate_bpm, message.signal_quality, tuple(message.reasons))
        self._fusion.rate(name, "features", rate, to_ns(message.header.stamp), to_ns(message.device_timestamp))

    def _on_device(self, name: StreamName, message: PhysioDeviceFeature) -> None:
        for told in message.features:
            if told.name == "heart_rate" and len(told.values):
                times_ns = to_ns(message.header.stamp), to_ns(message.device_timestamp)
                self._fusion.rate(name, "device", Rate(told.values[-1]), *times_ns)

    def _on_clock(self, name: StreamName, message: ClockModel) -> None:
        self._fusion.clock(name, Model(to_ns(message.device_reference), message.offset_ns, message.skew_ppm))

    def _on_health(self, name: StreamName, message: StreamHealth) -> None:
        self._fusion.health(name, to_ns(message.header.stamp), message.state == StreamHealth.STREAMING)

    def _on_expression(self, face_id: str, heard: tuple[ExpressionMessage, int]) -> None:
        message, receipt_ns = heard
        stamp_ns = to_ns(message.header.stamp)
        if not stamp_ns:
            if not self._fusion.unstamped_expressions:
                self._service.log.warning(f"expressions of face {face_id} bear no stamp: their receipt counts")
            self._unstamped.inc()
        seen = Expression(message.expression, message.confidence, message.valence, message.arousal)
        self._fusion.expression(face_id, seen, stamp_ns, receipt_ns)

    def _on_assignments(self, message: SensorAssignmentArray) -> None:
        self._fusion.assignments([(a.human_id, a.person_id, to_ns(a.since)) for a in message.assignments])

    def _on_marker(self, message: Marker) -> None:
        self._fusion.marker(message.name, message.human_id, to_ns(message.header.stamp))

    def _publish(self, state: State) -> None:
        self._published.inc()
        self._unknown.inc(state.state == "unknown")
        if publisher := self._publishers.get(state.human_id):  # None where the last stream has just vanished
            publisher.publish(_message(state))


def _message(state: State) -> UserState:
    message = UserState(
        human_id=state.human_id,
        state=state.state,
        confidence=state.confidence,
        person_id=state.person_id,
        face_id=state.face_id,
        expression=state.expression,
        heart_rate_bpm=state.heart_rate_bpm,
        indicators=[
            Indicator(name=i.name, value=i.value, confidence=i.confidence, sources=list(i.sources))
            for i in state.indicators
        ],
        extra=[feature(name, unit, value) for name, unit, value in state.extra],
        reasons=list(state.reasons),
    )
    message.header.stamp = from_ns(state.time_ns)
    message.header.frame_id = state.human_id
    return message


def _type_name(message: type) -> str:
    package, _, _ = message.__module__.partition(".")
    return f"{package}/msg/{message.__name__}"


async def fuse(service: Service[Config]) -> None:
    """Publish states until told to stop."""
    config = service.config
    tree = load(config.tree_file)
    service.log.info(f"decides by the tree '{tree.name}' ({config.tree_file or 'the one shipped'})")
    fusion = Fusion(tree, config.heart_rate_source, config.baseline_s)
    shell = Shell(service, fusion)
    SessionMember(service, begin=fusion.cut_at)
    service.every(LOOK_INTERVAL_S, shell.look)
    service.every(TELL_INTERVAL_S, shell.tell)
    service.ready()
    await service.stopped.wait()


def main() -> int:
    """Run the fusion; return the exit status."""
    return run("fusion_affect", Config, fuse)


if __name__ == "__main__":
    sys.exit(main())

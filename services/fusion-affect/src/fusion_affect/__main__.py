"""fusion-affect: wires the graph to the fusion, and its states to the graph."""

import asyncio
import sys
import time
from collections.abc import Callable
from typing import Any

from hri_msgs.msg import Expression as ExpressionMessage
from hri_msgs.msg import IdsList
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sense4hri import host_clocks, qos
from sense4hri.graph import Follower, follow
from sense4hri.host_clocks import HostClocks, SensorHosts
from sense4hri.names import ROOT, UNASSIGNED, StreamName, state_topic
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri.session import SessionMember
from sense4hri.stamps import from_ns, to_ns
from sense4hri.topics import Topic
from sense4hri.wire import feature
from sense4hri_msgs.msg import (
    ECG,
    PPG,
    ClockModel,
    HostClockArray,
    Indicator,
    Marker,
    PhysioDeviceFeature,
    SensorAssignmentArray,
    StreamHealth,
    UserState,
)
from std_msgs.msg import String

from fusion_affect.align import AWAITED_LOOKS
from fusion_affect.align import ClockModel as Model
from fusion_affect.config import Config
from fusion_affect.fusion import Fusion
from fusion_affect.state import Expression, State
from fusion_affect.streams import Rate, reported
from fusion_affect.tree import Tree, load

LOOK_INTERVAL_S = 0.5
DOUBT_EVERY_S = 600.0  # a line of a host whose times cannot be corrected
TELL_INTERVAL_S = 0.05  # what came in the meantime, on whichever topic, is all known before a state is computed
HEART_RATE_TYPES = {"ecg": ECG, "ppg": PPG}
PERSONS, FACES = "/humans/persons", "/humans/faces"


class Shell:
    """Follows the graph, hands every message to the fusion, publishes what is due."""

    def __init__(self, service: Service[Config], tree: Tree) -> None:
        config = service.config
        self._service = service
        self._fusion = Fusion(tree, config.heart_rate_source, config.baseline_s, self._tell_soon)
        self._looks_left, self._telling = 0, False
        self._streams: list[Follower] = []
        self._publishers: dict[str, Publisher] = {}
        self._unstamped = service.metrics.counter("unstamped_expressions", "Expressions without a stamp.")
        self._published = service.metrics.counter("states", "States published.")
        self._unknown = service.metrics.counter("unknown_states", "States published that are unknown.")
        self._hosts = SensorHosts(HostClocks())
        service.subscribe(HostClockArray, host_clocks.TOPIC, self._on_host_clocks, qos.HOST_CLOCKS)
        service.subscribe(SensorAssignmentArray, "/study/assignments", self._on_assignments, qos.ASSIGNMENTS)
        service.subscribe(Marker, "/study/markers", self._on_marker, qos.MARKERS, keep=True)

        SessionMember(service, begin=self._fusion.cut_at)
        self._follow_streams()
        self._follow_persons()
        service.every(LOOK_INTERVAL_S, self._look)

    def _follow_streams(self) -> None:
        for sensor_type, message in HEART_RATE_TYPES.items():
            self._follow_field(sensor_type, "features", message, self._on_features, qos.deep(qos.FEATURES))
            self._follow_field(sensor_type, "device", PhysioDeviceFeature, self._on_device, qos.deep(qos.DEVICE))
            self._follow_field(sensor_type, "clock", ClockModel, self._on_clock, qos.CLOCK)
        self._follow_field("*", "health", StreamHealth, self._on_health, qos.HEALTH)

    def _follow_field(
        self, sensor_type: str, field: str, message: type, handler: Callable[[StreamName, Any], None], own: QoSProfile
    ) -> None:
        def heard(topic: Topic, message: Any) -> None:
            if parsed := StreamName.parse(topic.name):
                handler(parsed[0], message)

        def gone(topic: Topic) -> None:
            if parsed := StreamName.parse(topic.name):
                self._fusion.vanished(*parsed)

        def offered(topic: Topic, profile: QoSProfile) -> None:
            if field == "features" and (parsed := StreamName.parse(topic.name)):
                self._fusion.features_offered(parsed[0])

        globs = [f"{ROOT}/*/{sensor_type}/*/{field}"]
        self._streams.append(
            follow(self._service, globs, heard, gone, on_publishers=offered, types=[message], profile=own)
        )

    def _follow_persons(self) -> None:
        """Hear who ROS4HRI tracks; these topics are not ours."""
        fusion = self._fusion
        self._follow_foreign(
            [f"{FACES}/tracked"],
            IdsList,
            lambda topic, m: fusion.faces(m.ids, to_ns(m.header.stamp)),
            lambda topic: fusion.faces_vanished(),
        )
        self._follow_foreign(
            [f"{PERSONS}/tracked", f"{PERSONS}/known"],
            IdsList,
            lambda topic, m: fusion.persons(topic.name, m.ids),
            lambda topic: fusion.persons(topic.name, ()),
        )
        self._follow_link("face_id", fusion.person_face)
        self._follow_link("alias", fusion.alias)
        follow(
            self._service,
            [f"{FACES}/*/expression"],
            self._on_expression,
            lambda topic: fusion.face_vanished(_id(topic)),
            types=[ExpressionMessage],
            with_info=True,  # recognisers send it without a stamp: the middleware knows when it came
        )

    def _follow_link(self, field: str, tell: Callable[[str, str | None], None]) -> None:
        """Hear what a person's topic names; None is told when it has vanished."""
        self._follow_foreign(
            [f"{PERSONS}/*/{field}"],
            String,
            lambda topic, message: tell(_id(topic), message.data),
            lambda topic: tell(_id(topic), None),
        )

    def _follow_foreign(
        self, globs: list[str], message: type, heard: Callable[[Topic, Any], None], gone: Callable[[Topic], None]
    ) -> None:
        follow(self._service, globs, heard, gone, types=[message])

    def _look(self) -> None:
        """Offer a state to everybody with a stream."""
        topics = [topic.name for follower in self._streams for topic in follower.topics]
        self._offer({parsed[0].human_id for name in topics if (parsed := StreamName.parse(name))})

    def _offer(self, human_ids: set[str]) -> None:
        """Have a topic for everybody with a stream before there is a state: the first one is to be heard too."""
        wanted = human_ids - {UNASSIGNED}
        for human_id in wanted - self._publishers.keys():
            self._publishers[human_id] = self._service.publisher(UserState, state_topic(human_id), qos.STATE)
        for human_id in self._publishers.keys() - wanted:
            self._service.node.destroy_publisher(self._publishers.pop(human_id))

    def _tell_soon(self) -> None:
        """Look for what is due until a further look, without news, would find nothing more (`align.Grid`)."""
        self._looks_left = AWAITED_LOOKS + 1
        if not self._telling:
            self._telling = True
            self._service.start(self._tell())

    async def _tell(self) -> None:
        """Publish the states that become due."""
        while self._looks_left:
            self._looks_left -= 1
            await asyncio.sleep(TELL_INTERVAL_S)
            for state in self._fusion.due():
                self._publish(state)
        self._telling = False

    def _on_features(self, name: StreamName, message: Any) -> None:
        rate = Rate(message.heart_rate_bpm, message.signal_quality, tuple(message.reasons))
        self._fusion.rate(name, "features", rate, self._received_ns(name, message), to_ns(message.device_timestamp))

    def _on_device(self, name: StreamName, message: PhysioDeviceFeature) -> None:
        told = {each.name: each.values[-1] for each in message.features if len(each.values)}
        if "heart_rate" not in told:
            return
        times_ns = self._received_ns(name, message), to_ns(message.device_timestamp)
        self._fusion.rate(name, "device", reported(told), *times_ns)

    def _on_clock(self, name: StreamName, message: ClockModel) -> None:
        behind_ns = self._received_ns(name, message) - to_ns(message.header.stamp)
        offset_ns = message.offset_ns + behind_ns
        self._fusion.clock(name, Model(to_ns(message.device_reference), offset_ns, message.skew_ppm))

    def _on_health(self, name: StreamName, message: StreamHealth) -> None:
        self._hosts.told(name.sensor_id, message.host)
        streaming, ends = message.state == StreamHealth.STREAMING, message.state == StreamHealth.STOPPING
        self._fusion.health(name, self._received_ns(name, message), streaming, ends)

    def _on_host_clocks(self, message: HostClockArray) -> None:
        self._hosts.clocks.take(message, time.monotonic())

    def _received_ns(self, name: StreamName, message: Any) -> int:
        """Return a message's receipt stamp on the reference host's clock; 0 = it bears none."""
        stamp_ns = to_ns(message.header.stamp)
        if not stamp_ns:
            return 0
        if doubt := self._hosts.doubt(name.sensor_id, [stamp_ns]):
            self._service.log.warning_at_times(doubt, DOUBT_EVERY_S, about=doubt)
        return self._hosts.reference_ns(name.sensor_id, stamp_ns)

    def _on_expression(self, topic: Topic, message: ExpressionMessage, info: dict[str, Any]) -> None:
        face_id, receipt_ns = _id(topic), info["received_timestamp"]
        stamp_ns = to_ns(message.header.stamp)
        if not stamp_ns:
            if not self._fusion.unstamped_expressions:
                self._service.log.warning(f"expressions of face {face_id} bear no stamp: their receipt counts")
            self._unstamped.inc()
        seen = Expression(message.expression, message.confidence, message.valence, message.arousal)
        self._fusion.expression(face_id, seen, stamp_ns, receipt_ns)

    def _on_assignments(self, message: SensorAssignmentArray) -> None:
        entries = [(a.human_id, a.person_id, to_ns(a.since)) for a in message.assignments]
        self._fusion.assignments(entries, to_ns(message.header.stamp))

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


def _id(topic: Topic) -> str:
    """The person or face that a topic of ROS4HRI is about: `/humans/faces/<id>/expression`."""
    return topic.name.split("/")[3]


async def fuse(service: Service[Config]) -> None:
    """Publish states until told to stop."""
    config = service.config
    tree = load(config.tree_file)
    service.log.info(f"decides by the tree '{tree.name}' ({config.tree_file or 'the one shipped'})")
    Shell(service, tree)
    service.ready()
    await service.stopped.wait()


def main() -> int:
    """Run until stopped; return the exit status."""
    return run("fusion_affect", Config, fuse)


if __name__ == "__main__":
    sys.exit(main())

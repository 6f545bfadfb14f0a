"""What comes from ROS into the study: subscriptions that follow the graph."""

from collections.abc import Callable
from functools import partial
from typing import Any

import sense4hri_msgs.msg as contract
from sense4hri import diagnostics, host_clocks, qos
from sense4hri.discovery import RawStreams
from sense4hri.graph import follow
from sense4hri.message_types import message_class, type_name
from sense4hri.modalities import MODALITIES
from sense4hri.names import ROOT, StreamName, is_human_id
from sense4hri.recorder_status import RecorderStatus
from sense4hri.service import Service
from sense4hri.session import SessionMember
from sense4hri.stamps import SECOND_NS, to_ns
from sense4hri.stream_info import StreamInfo
from sense4hri.topics import UNKNOWN_NODE, Topic

from web_gui.conduct import LATCHED, fault, left_out, notes
from web_gui.config import Config
from web_gui.intake import MOST_ITEMS, chunk_of, plain, shown
from web_gui.model import Study
from web_gui.stream import MOST_REPORTED, Info

LOOK_EVERY_S = 1.0
REFUSED_NS = 10 * SECOND_NS  # for so long what is refused now and then is one problem
FACES = "/humans/faces/"
EXPRESSION = "hri_msgs/msg/Expression"
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
TYPE_NAMES = {field: {type_name(kind) for kind in kinds} for field, kinds in TYPES.items()}


class Graph:
    """Subscribes to everything the page shows as it appears, and lets go of what has gone."""

    def __init__(self, service: Service[Config], study: Study) -> None:
        self._service, self._study = service, study
        self._node, self._now_ns = service.node, study.clock.now_ns
        self._refused: dict[str, tuple[int, int]] = {}  # of each topic: how many, and when the newest came
        self._at_fault: set[str] = set()  # topics, with their types, whose publishers do something wrong
        self._undecodable = service.metrics.counter("undecodable_messages", "Raw messages with unequal or no channels.")
        RawStreams(service, None, self._learn, lambda name: None)
        service.watch([f"{ROOT}/*/*/*/raw"], self._published, TYPE_NAMES["raw"])
        service.subscribe(contract.SessionState, "/study/session", self._session, qos.SESSION)
        service.subscribe(contract.SessionAck, "/study/ack", self._ack, qos.deep(qos.ACK), keep=True)
        service.hear_diagnostics(self._diagnostics)
        SessionMember(service)
        service.subscribe(contract.HostClockArray, host_clocks.TOPIC, self._host_clocks, qos.HOST_CLOCKS)
        service.subscribe(contract.Marker, "/study/markers", self._marker, qos.MARKERS, keep=True)
        service.subscribe(contract.SensorInfoArray, "/study/sensors", self._sensors, qos.SENSORS)
        self._judged = service.watch([f"{ROOT}/**", *LATCHED], lambda topic: None)
        self._follow_streams()
        self._follow_people()
        service.every(LOOK_EVERY_S, self._look)

    def _look(self) -> None:
        """Take note of who is there."""
        services = self._study.services
        services.nodes = set(self._node.get_node_names())
        listeners = self._node.get_subscriptions_info_by_topic("/study/session")
        services.expected = {shown(one.node_name) for one in listeners[:MOST_ITEMS] if one.node_name != UNKNOWN_NODE}
        publishers = self._node.get_publishers_info_by_topic("/study/session")
        self._study.session.said_by({one.node_name for one in publishers if one.node_name != UNKNOWN_NODE})
        for place, what in list(self._service.refusals.named.items()):
            if what.count != self._refused.get(place, (0, 0))[0]:
                self._refused[place] = what.count, self._now_ns()
            lately = self._now_ns() - self._refused[place][1] < REFUSED_NS
            self._study.judge(f"refused {place}", left_out(place, what) if lately else "")
        self._judge()

    def _follow_streams(self) -> None:
        handlers: dict[str, Callable[[StreamName, Any], None]] = {
            "raw": self._raw,
            "device": self._device,
            "features": self._features,
            "clock": self._clock,
            "health": self._health,
        }
        gone = {"features": self._features_gone}
        for field, handler in handlers.items():
            follow(
                self._service,
                [f"{ROOT}/*/*/*/{field}"],
                partial(_of_stream, handler),
                gone.get(field, lambda topic: None),
                types=TYPES[field],
                profile=None if field == "raw" else QUEUES[field],
                depth=QUEUES[field].depth,
                raw=field == "raw",
            )

    def _features_gone(self, topic: Topic) -> None:
        if (parsed := StreamName.parse(topic.name)) is not None:
            self._study.features_gone(parsed[0])

    def _follow_people(self) -> None:
        """Hear everybody's state and, where the robot's messages are installed, the expressions of faces."""
        follow(
            self._service,
            [f"{ROOT}/*/state"],
            self._state,
            lambda topic: self._study.state_gone(_human_of(topic)),
            types=[contract.UserState],
            profile=qos.STATE,
        )
        expression = message_class(EXPRESSION)
        if expression is not None:
            follow(
                self._service,
                [f"{FACES}*/expression"],
                self._expression,
                lambda topic: self._study.face_gone(_face_of(topic)),
                types=[expression],
            )

    def _judge(self) -> None:
        """Take note of what publishers do wrong, for as long as they do, by the names they have said by now."""
        faults = {
            why if topic.excess else f"{topic.name} {topic.type_name}": why
            for topic in self._judged.topics.values()
            if (why := fault(topic, TYPE_NAMES))
        }
        for place in self._at_fault - faults.keys():
            self._study.judge(place, "")
        for place, why in faults.items():
            self._study.judge(place, why)
        self._at_fault = set(faults)

    def _sensors(self, message: Any) -> None:
        """Take the registry's own sentences about a sensor: what was asked and has not happened."""
        told = {sensor.sensor_id: notes(sensor.parameters_json) for sensor in message.sensors}
        self._study.take_notes({sensor_id: texts for sensor_id, texts in told.items() if texts})

    def _published(self, topic: Topic) -> None:
        """Show a stream as soon as it is on the graph, also one that says nothing."""
        if topic.excess or (parsed := StreamName.parse(topic.name)) is None:
            return
        told = self._study.found if topic.publishers else self._study.gone
        told(parsed[0], self._now_ns())

    def _learn(self, info: StreamInfo) -> None:
        self._study.stream(info.name, self._now_ns()).learn(Info.of(info))

    def _raw(self, name: StreamName, cdr: bytes) -> None:
        now_ns = self._now_ns()
        try:
            chunk = chunk_of(cdr)
        except ValueError as err:
            self._undecodable.inc()
            self._service.refuse(name.topic("raw"), contract.PhysioRaw.__name__, str(err))
            return
        self._study.take_raw(name, chunk, now_ns)

    def _device(self, name: StreamName, message: Any) -> None:
        told = [feature for feature in message.features[:MOST_REPORTED] if len(feature.values)]
        newest = {shown(feature.name): float(feature.values[-1]) for feature in told}
        now_ns = self._now_ns()
        self._study.stream(name, now_ns).take_reported(newest, now_ns)

    def _features(self, name: StreamName, message: Any) -> None:
        now_ns = self._now_ns()
        self._study.stream(name, now_ns).take_features(plain(message), now_ns)

    def _clock(self, name: StreamName, message: Any) -> None:
        now_ns = self._now_ns()
        self._study.stream(name, now_ns).take_clock(plain(message), now_ns)

    def _health(self, name: StreamName, message: Any) -> None:
        now_ns = self._now_ns()
        self._study.stream(name, now_ns).take_health(plain(message), now_ns)

    def _state(self, topic: Topic, message: Any) -> None:
        human_id = _human_of(topic)
        if is_human_id(human_id):
            self._study.take_state(human_id, plain(message), self._now_ns())

    def _expression(self, topic: Topic, message: Any) -> None:
        self._study.take_expression(_face_of(topic), plain(message), self._now_ns())

    def _session(self, message: Any) -> None:
        self._study.session.take_state(plain(message))

    def _ack(self, message: Any) -> None:
        self._study.session.take_ack(plain(message))

    def _diagnostics(self, message: Any) -> None:
        for beat in diagnostics.beats(message):
            service, trouble, missing = map(shown, (beat.service, beat.trouble, beat.missing))
            short = beat._replace(service=service, trouble=trouble, missing=missing)
            self._study.services.take(short, self._now_ns())
        for status in message.status:
            if told := RecorderStatus.parse(status):
                self._study.session.recorder.take(told, self._now_ns())

    def _host_clocks(self, message: Any) -> None:
        self._study.hosts.take(message, self._now_ns())

    def _marker(self, message: Any) -> None:
        self._study.take_marker({**plain(message), "stamp_ns": to_ns(message.header.stamp)}, self._now_ns())


def _of_stream(handler: Callable[[StreamName, Any], None], topic: Topic, message: Any) -> None:
    """Hand on what came on a topic that follows the contract; another one of the same shape is not ours."""
    if parsed := StreamName.parse(topic.name):
        handler(parsed[0], message)


def _human_of(topic: Topic) -> str:
    """Return whose state a topic tells."""
    return topic.name.split("/")[-2]


def _face_of(topic: Topic) -> str:
    """Return whose expression a topic tells."""
    return topic.name.removeprefix(FACES).split("/")[0]

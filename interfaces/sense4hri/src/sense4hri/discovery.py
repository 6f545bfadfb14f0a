"""Raw streams on the graph, and what is known of each (contract, section 6).

Metadata comes (1) from the node that publishes `raw`; (2) else from `/study/sensors`, as in a replay; (3) else, after
5 s, from the data: rate from the stamps, unit unknown. A node that says that it knows nothing ends step 1 at once. One
that is silent, as on a busy machine, has NODE_ALONE_S before the registry is believed in its place, and its data are
looked at from LOOK_S on; it goes on being asked until something is known.
"""

import asyncio
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any
from weakref import WeakValueDictionary

from rclpy.subscription import Subscription
from sense4hri_msgs.msg import PhysioRaw, SensorInfo, SensorInfoArray

from sense4hri import qos, strict_json
from sense4hri.errors import Refusal
from sense4hri.graph import ask_parameters
from sense4hri.modalities import modality
from sense4hri.names import ROOT, StreamName
from sense4hri.service import Service
from sense4hri.stamps import SECOND_NS, to_ns
from sense4hri.stream_info import SENSOR_PARAMETERS, STREAM_PARAMETERS, StreamInfo, info_of, rate_of
from sense4hri.topics import UNKNOWN_NODE, Topic

POLL_S = 0.2
LOOK_S = 1.0
NODE_ALONE_S = 4.0
ASK_TIMEOUT_S = 5.0
ASK_AGAIN_S = 1.0
MOST_ASKED = 4  # questions to one node at a time: each costs two topics, and one that is mute is asked for ever
DATA_S = 5.0
RAW_TYPE = "sense4hri_msgs/msg/PhysioRaw"


@dataclass
class _Known:
    """publisher: the one followed. before: others that were there when it was found."""

    publisher: bytes
    instances: frozenset[bytes]
    before: frozenset[bytes]
    learning: "asyncio.Task[None]"


class RawStreams:
    """Follows the graph; calls back on the main thread.

    Of a process with more streams than a device has (`crowd`), each is found when its first message comes.

    sensor_types: those to follow, None = all of them.
    on_found(name): a stream is there, nothing is known of it yet. on_added(info): now it is. on_removed(name): its
    publisher is gone (also before a restarted driver's stream is found again).
    """

    def __init__(
        self,
        service: Service[Any],
        sensor_types: Collection[str] | None,
        on_added: Callable[[StreamInfo], None],
        on_removed: Callable[[StreamName], None],
        on_found: Callable[[StreamName], None] = lambda name: None,
    ) -> None:
        self._service = service
        self._on_added, self._on_removed, self._on_found = on_added, on_removed, on_found
        self._known: dict[StreamName, _Known] = {}
        self._silent: dict[StreamName, Subscription] = {}  # streams of a process with many, until their first message
        self._registered: dict[tuple[str, str], SensorInfo] = {}
        self._asking: WeakValueDictionary[str, asyncio.Semaphore] = WeakValueDictionary()
        service.subscribe(SensorInfoArray, "/study/sensors", self._remember, qos.SENSORS)
        globs = [f"{ROOT}/*/{sensor_type}/*/raw" for sensor_type in sensor_types or ("*",)]
        service.watch(globs, self._changed, [RAW_TYPE])

    def _remember(self, message: SensorInfoArray) -> None:
        self._registered = {(sensor.sensor_type, sensor.sensor_id): sensor for sensor in message.sensors}

    def _changed(self, topic: Topic) -> None:
        parsed = StreamName.parse(topic.name)
        if parsed is None:
            return
        name, known = parsed[0], self._known.get(parsed[0])
        if known is None and topic.excess:
            return
        if known is not None and known.publisher in topic.instances:
            known.instances = topic.instances
            if topic.instances - {known.publisher}:
                self._service.start(self._compare(name, known))
            return
        self._end_silence(name)
        if known is None and topic.instances and topic.one_of_many:
            self._await_message(name, topic.instances)
        else:
            self._begin(name, topic.instances)

    def _await_message(self, name: StreamName, instances: frozenset[bytes]) -> None:
        """Follow a stream once it says something: what is made of a silent one costs every service memory."""

        def begin(cdr: bytes) -> None:
            self._end_silence(name)
            self._begin(name, instances)

        topic = name.topic("raw")
        self._silent[name] = self._service.subscribe(PhysioRaw, topic, begin, qos.RAW, raw=True, fit=True)

    def _end_silence(self, name: StreamName) -> None:
        if name in self._silent:
            self._service.unsubscribe(self._silent.pop(name))

    async def _compare(self, name: StreamName, known: _Known) -> None:
        """Another publisher is there beside the known one: the same node, started afresh, takes its place.

        DDS keeps one that was killed for a while. Any other node is a stranger on this topic: the stream goes on.
        """
        while self._known.get(name) is known and known.publisher in known.instances:
            nodes = self._publishers_of(name)
            others = set(nodes) - {known.publisher}
            if known.publisher not in nodes or not others:
                return
            if UNKNOWN_NODE not in "".join(nodes.values()):
                again = {publisher for publisher in others - known.before if nodes[publisher] == nodes[known.publisher]}
                if again:
                    self._begin(name, frozenset(nodes), min(again))
                return
            await asyncio.sleep(POLL_S)

    def _begin(self, name: StreamName, instances: frozenset[bytes], publisher: bytes | None = None) -> None:
        """Follow a publisher of the stream, the others that are there now having been there before it."""
        known = self._known.pop(name, None)
        if known is not None:
            known.learning.cancel()
            self._on_removed(name)
        if instances:
            publisher = publisher or min(instances)
            self._on_found(name)
            learning = self._service.start(self._learn(name))
            self._known[name] = _Known(publisher, instances, instances - {publisher}, learning)

    def _publishers_of(self, name: StreamName) -> dict[bytes, str]:
        """Return the full names of the nodes that publish `raw`, by their ids."""
        found = self._service.node.get_publishers_info_by_topic(name.topic("raw"))
        return {bytes(each.endpoint_gid): f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in found}

    async def _learn(self, name: StreamName) -> None:
        loop = asyncio.get_running_loop()
        begun_s, knows_nothing = loop.time(), asyncio.Event()
        node = asyncio.ensure_future(self._from_node(name, knows_nothing))
        data: asyncio.Future[StreamInfo] | None = None
        info = None
        try:
            while info is None:
                await asyncio.wait({node}, timeout=POLL_S)
                waited_s = loop.time() - begun_s
                if node.done():
                    info = node.result()
                elif knows_nothing.is_set() or waited_s > NODE_ALONE_S:
                    info = self._from_registry(name)
                if data is None and (knows_nothing.is_set() or waited_s > LOOK_S):
                    data = asyncio.ensure_future(self._from_data(name))
                if info is None and data is not None and data.done() and waited_s > DATA_S:
                    info = data.result()
        finally:
            node.cancel()
            if data is not None:
                data.cancel()
        if info.problem:
            self._service.refuse(name.topic("raw"), "parameters", info.problem)
        self._on_added(info)

    async def _from_node(self, name: StreamName, knows_nothing: asyncio.Event) -> StreamInfo:
        """Ask the node that publishes until it says the rate; set knows_nothing where it answers without."""
        while True:
            node = self._publisher_of(name)
            if node is not None:
                try:
                    values = await self._parameters(node, name)
                except TimeoutError:  # at once, where a node's name is none
                    await asyncio.sleep(POLL_S)
                    continue
                info = info_of(name, "node", node, values)
                if info is not None:
                    return info
                knows_nothing.set()
            await asyncio.sleep(POLL_S if node is None else ASK_AGAIN_S)

    def _publisher_of(self, name: StreamName) -> str | None:
        """Full name of the node that publishes `raw`; None while nobody knows it."""
        nodes = self._publishers_of(name)
        node = nodes.get(self._known[name].publisher) if name in self._known else None
        return None if node is None or UNKNOWN_NODE in node else node

    async def _parameters(self, node: str, name: StreamName) -> dict[str, Any]:
        """Return the parameters of the contract that the node has. Raises TimeoutError."""
        turn = self._asking.setdefault(node, asyncio.Semaphore(MOST_ASKED))
        async with turn:
            return await self._asked(node, name)

    async def _asked(self, node: str, name: StreamName) -> dict[str, Any]:
        asked = [*SENSOR_PARAMETERS, *(f"{name.sensor_type}.{parameter}" for parameter in STREAM_PARAMETERS)]
        values = await ask_parameters(self._service, node, asked, ASK_TIMEOUT_S)
        optional = [f"{name.sensor_type}.{parameter}" for parameter in modality(name.sensor_type).parameters]
        return values | (await ask_parameters(self._service, node, optional, ASK_TIMEOUT_S) if optional else {})

    def _from_registry(self, name: StreamName) -> StreamInfo | None:
        sensor = self._registered.get((name.sensor_type, name.sensor_id))
        if sensor is None:
            return None
        values = {parameter: getattr(sensor, parameter) for parameter in SENSOR_PARAMETERS}
        values |= {f"{name.sensor_type}.{parameter}": getattr(sensor, parameter) for parameter in STREAM_PARAMETERS}
        return info_of(name, "registry", sensor.node, {**self._optional(sensor), **values})

    def _optional(self, sensor: SensorInfo) -> dict[str, Any]:
        """Return what the registry knows beyond its own fields; nothing where it is not what it should be."""
        try:
            told = strict_json.parse(sensor.parameters_json, "parameters_json")
            if isinstance(told, dict):
                return told
            raise Refusal("parameters_json is no JSON object")
        except Refusal as err:
            self._service.refuse("/study/sensors", "SensorInfoArray", f"sensor {sensor.sensor_id!r}: {err}")
            return {}

    async def _from_data(self, name: StreamName) -> StreamInfo:
        """What the stamps of DATA_S of messages say, or of what comes within that time of the first one."""
        stamps: list[tuple[int, int]] = []
        channels: list[str] = []
        enough = asyncio.Event()

        def take(message: PhysioRaw) -> None:
            stamp_ns = to_ns(message.device_timestamp) or to_ns(message.header.stamp)
            stamps.append((stamp_ns, len(message.channels[0].samples) if message.channels else 0))
            channels[:] = [channel.channel_name for channel in message.channels]
            if stamps[-1][0] - stamps[0][0] >= DATA_S * SECOND_NS:
                enough.set()

        subscription = self._service.subscribe(PhysioRaw, name.topic("raw"), take, qos.deep(qos.RAW), fit=True)
        try:
            while not stamps:
                await asyncio.sleep(POLL_S)
            try:
                async with asyncio.timeout(DATA_S):
                    await enough.wait()
            except TimeoutError:
                self._service.log.info(f"{name.topic('raw')}: little data in {DATA_S:.0f} s to learn a rate from")
        finally:
            self._service.unsubscribe(subscription)
        values = {
            f"{name.sensor_type}.sampling_frequency_hz": rate_of(stamps),
            f"{name.sensor_type}.channel_names": channels,
        }
        return info_of(name, "data", "", values) or StreamInfo(name, 0.0)

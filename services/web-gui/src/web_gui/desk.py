"""What readers ask for, passed on to the graph: sessions started and stopped, sensors assigned, markers."""

from dataclasses import dataclass
from typing import Any

from rclpy.client import Client
from sense4hri import qos
from sense4hri.service import Service
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import Marker
from sense4hri_msgs.srv import AssignSensor, StartSession, StopSession

from web_gui.config import Config
from web_gui.hosts import PAGE
from web_gui.messages import Assign, Press, Start, Stop
from web_gui.model import Study

ANSWER_S = 5.0
MOVED_S = 7.0  # the registry watches the topics for 4 s before it answers
LOOK_EVERY_S = 0.5
COORDINATOR, REGISTRY = "session-coordinator", "metadata-registry"


@dataclass(frozen=True)
class Answer:
    """What became of an order, in words."""

    ok: bool
    text: str


class Desk:
    """Hands orders to the session-coordinator and the metadata-registry, markers to `/study/markers`."""

    def __init__(self, service: Service[Config], study: Study) -> None:
        self._service, self._study = service, study
        self._starts = service.node.create_client(StartSession, "/study/start_session")
        self._stops = service.node.create_client(StopSession, "/study/stop_session")
        self._assigns = service.node.create_client(AssignSensor, "/study/assign_sensor")
        self._markers = service.publisher(Marker, "/study/markers", qos.MARKERS)
        self._marked = service.metrics.counter("markers", "Markers set on the page.")
        service.every(LOOK_EVERY_S, self._look)

    async def start(self, wish: Start) -> Answer:
        """Ask for a session."""
        fields = {key: value for key, value in wish._asdict().items() if key != "number"}
        lists = {key: list(fields[key]) for key in ("human_ids", "required_streams")}
        return await self._ask(COORDINATOR, self._starts, StartSession.Request(**(fields | lists)))

    async def stop(self, wish: Stop) -> Answer:
        """Ask for the end of the session."""
        return await self._ask(COORDINATOR, self._stops, StopSession.Request(session_id=wish.session_id))

    async def assign(self, wish: Assign) -> Answer:
        """Ask for a sensor to be somebody's; done once its topics bear the name."""
        request = AssignSensor.Request(sensor_id=wish.sensor_id, human_id=wish.human_id)
        return await self._ask(REGISTRY, self._assigns, request, MOVED_S)

    def mark(self, press: Press) -> None:
        """Publish a marker at the time it was pressed."""
        session = self._study.session
        running = session.phase in ("preparing", "recording", "stopping")
        marker = Marker(
            uncertainty_s=press.uncertainty_s,
            session_id=str(session.state.get("session_id", "")) if running else "",
            human_id=press.human_id,
            name=press.name,
            value=press.value,
            source=PAGE,
        )
        marker.header.stamp = from_ns(press.at_ns)
        self._markers.publish(marker)
        self._marked.inc()

    def _look(self) -> None:
        self._study.session.coordinator = self._starts.service_is_ready()

    async def _ask(self, whom: str, client: Client, request: Any, within_s: float = ANSWER_S) -> Answer:
        if not client.service_is_ready():
            module = whom.replace("-", "_")
            return Answer(False, f"no {whom} is on the graph: start it with `python -m {module}`")
        try:
            answer = await self._service.call(client, request, within_s)
        except TimeoutError as err:
            return Answer(False, f"the {whom} gave no answer, what was asked may still happen: {err}")
        return Answer(answer.success, answer.message)

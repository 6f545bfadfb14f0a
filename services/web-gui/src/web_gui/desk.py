"""What readers ask for, passed on to the graph: sessions started and stopped, markers."""

from dataclasses import dataclass
from typing import Any

from rclpy.client import Client
from sense4hri import qos
from sense4hri.service import Service
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import Marker
from sense4hri_msgs.srv import StartSession, StopSession

from web_gui.config import Config
from web_gui.messages import Press, Start, Stop
from web_gui.model import Study

ANSWER_S = 5.0
LOOK_EVERY_S = 0.5
SOURCE = "web-gui"
NOBODY = "no session-coordinator is on the graph: start it with `python -m session_coordinator`"


@dataclass(frozen=True)
class Answer:
    """What became of an order, in words."""

    ok: bool
    text: str


class Desk:
    """Hands orders to the session-coordinator and markers to `/study/markers`."""

    def __init__(self, service: Service[Config], study: Study) -> None:
        self._service, self._study = service, study
        self._starts = service.node.create_client(StartSession, "/study/start_session")
        self._stops = service.node.create_client(StopSession, "/study/stop_session")
        self._markers = service.publisher(Marker, "/study/markers", qos.MARKERS)
        self._marked = service.metrics.counter("markers", "Markers set on the page.")
        service.every(LOOK_EVERY_S, self._look)

    async def start(self, wish: Start) -> Answer:
        """Ask for a session."""
        fields = {key: value for key, value in wish._asdict().items() if key != "number"}
        lists = {key: list(fields[key]) for key in ("human_ids", "required_streams")}
        return await self._ask(self._starts, StartSession.Request(**(fields | lists)))

    async def stop(self, wish: Stop) -> Answer:
        """Ask for the end of the session."""
        return await self._ask(self._stops, StopSession.Request(session_id=wish.session_id))

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
            source=SOURCE,
        )
        marker.header.stamp = from_ns(press.at_ns)
        self._markers.publish(marker)
        self._marked.inc()

    def _look(self) -> None:
        self._study.session.coordinator = self._starts.service_is_ready()

    async def _ask(self, client: Client, request: Any) -> Answer:
        if not client.service_is_ready():
            return Answer(False, NOBODY)
        try:
            answer = await self._service.call(client, request, ANSWER_S)
        except TimeoutError as err:
            return Answer(False, f"the session-coordinator gave no answer: {err}")
        return Answer(answer.success, answer.message)

"""session-coordinator: wires the state machine to the graph, the ROS services, HTTP and the state file."""

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import serialize_message
from sense4hri import diagnostics, qos
from sense4hri.beats import SILENT_S, TWINS, Beats
from sense4hri.errors import ConfigError, Refusal
from sense4hri.names import ROOT, StreamName
from sense4hri.recorder_status import RecorderStatus
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri.stamps import SECOND_NS, to_ns
from sense4hri_msgs.msg import Marker, SessionAck, SessionState
from sense4hri_msgs.srv import StartSession, StopSession

from session_coordinator.awake import AwakeClock
from session_coordinator.config import Config
from session_coordinator.coordinator import DISCOVERY_S, Coordinator
from session_coordinator.heartbeat import Heartbeats
from session_coordinator.markers import Markers
from session_coordinator.request import MarkerWish, Request, StartWish, StopWish, ended, press, request
from session_coordinator.session import ACTIVE, Ack, Effect, Note, Now, Outcome, Publish
from session_coordinator.store import Store
from session_coordinator.streams import StreamWatch
from session_coordinator.wire import Told, marker_message, state_message, told

TICK_S, LOOK_S, BEAT_S = 0.1, 0.25, 1.0
PROCESS_BYTES = 12  # of an endpoint's id are the same for one process
SESSION_TOPIC = "/study/session"
RIVAL_S = 25.0  # DDS shows a killed coordinator for up to 20 s


class Shell:
    """The session as seen from outside: topics, services, HTTP, file."""

    def __init__(self, service: Service[Config], store: Store, coordinator: Coordinator, awake: AwakeClock) -> None:
        self._service, self._store, self._coordinator, self._awake = service, store, coordinator, awake
        self._trouble = ""
        self._latest, self._is_mute = coordinator.session, True
        self._ticked_s, self._unheard_at_s, self._alone_at_s = time.monotonic(), awake.now_s(), awake.now_s()
        self._watch, self._recorders, self._services = StreamWatch(service, awake.now_s), Heartbeats(), Beats()
        self._people = service.watch([f"{ROOT}/*/*/*/*"], lambda topic: None)
        self._sessions = service.publisher(SessionState, SESSION_TOPIC, qos.SESSION)
        self._markers = Markers(service, lambda: self._coordinator.recorded_by)
        self._phase = service.metrics.gauge("session_phase", "0 idle, 1 preparing, 2 recording, 3 stopping, 4 failed.")
        self._waiting = service.metrics.gauge("session_waiting", "Services and streams the session waits for.")
        self._marked = service.metrics.counter("markers", "Markers set over HTTP or by session-coordinator itself.")
        service.subscribe(SessionAck, "/study/ack", self._on_ack, qos.deep(qos.ACK), keep=True)
        service.hear_diagnostics(self._on_diagnostics)
        service.serve(StartSession, "/study/start_session", self._start)
        service.serve(StopSession, "/study/stop_session", self._stop)
        service.http.get("/session", self._told, Told)
        service.http.post("/start", self._post_start, StartWish, Done)
        service.http.post("/stop", self._post_stop, StopWish, Done)
        service.http.post("/markers", self._post_marker, MarkerWish, Marked)
        self._follow_streams()

    def tick(self) -> None:
        """Let time pass; that it passed without this process is noted."""
        stood_s, self._ticked_s = time.monotonic() - self._ticked_s, time.monotonic()
        if stood_s > SILENT_S and self._coordinator.session.phase in ACTIVE:
            self._coordinator.woke(self._now())
            self._do([Note(f"{self._service.node.get_name()}: stood still for {stood_s:.0f} s")])
        self._do(self._coordinator.tick(self._now()))
        if self._is_mute:
            self._say()
        self._markers.send()

    def close(self) -> None:
        """Keep no marker back."""
        self._markers.close()

    def look(self) -> None:
        """Look at the graph: who hears the session, and how the required streams are."""
        self.tick()  # first: it takes note of a standstill
        present: dict[str, frozenset[bytes]] = {}
        for info in self._service.node.get_subscriptions_info_by_topic(SESSION_TOPIC):
            process = bytes(info.endpoint_gid)[:PROCESS_BYTES]
            present[info.node_name] = present.get(info.node_name, frozenset()) | {process}
        if not self._has_rival():
            self._alone_at_s = self._awake.now_s()
        self._do(self._coordinator.seen(present, self._now()))
        if self._coordinator.session.phase in ACTIVE:
            self._do(self._coordinator.streams(self._watch.look(), self._now()))
            self._do(self._coordinator.troubles(self._troubles(), self._now()))

    def beat(self) -> None:
        """Keep the time until which the session was looked after; what could not be kept is tried again."""
        if self._trouble:
            self._keep(self._save)
        elif self._coordinator.session.phase in ACTIVE:
            self._keep(self._store.beat)

    def _told(self) -> Told:
        """The session, and who would take part in one that started now."""
        return told(self._coordinator.session, self._coordinator.present)

    def _now(self) -> Now:
        return Now(int(self._service.node.get_clock().now().nanoseconds), self._awake.now_s())

    def _do(self, effects: list[Effect]) -> None:
        for effect in effects:
            match effect:
                case Publish(session):
                    # what cannot be said is not kept either: it would end the next run too
                    serialize_message(state_message(session, self._now().ros_ns))
                    self._latest = session
                    self._keep(self._save)
                    self._say()
                    self._phase.set(int(session.phase))
                    self._waiting.set(len(session.waiting_for))
                case Note(text):
                    self._service.log.warning(text)
                    self._mark(self._now().ros_ns, "note", text)

    def _say(self) -> None:
        """Publish the latest state; of one who has just begun and conducts nothing, once no other one is there.

        Services would take that for the end of the other one's session. Who hears it is found as slowly as that one.
        """
        if not self._sessions.get_subscription_count():
            self._unheard_at_s = self._awake.now_s()
        knows_graph = self._awake.now_s() - self._unheard_at_s > DISCOVERY_S
        if self._latest.phase in ACTIVE or (knows_graph and not self._has_rival()):
            self._is_mute = False
        if not self._is_mute:
            self._sessions.publish(state_message(self._latest, self._now().ros_ns))

    def _has_rival(self) -> bool:
        """True where another coordinator is on the graph; DDS shows a killed one for a while."""
        return int(self._service.node.count_publishers(SESSION_TOPIC)) > 1

    def _save(self) -> None:
        self._store.save(self._latest, self._coordinator.used)

    def _mark(
        self,
        stamp_ns: int,
        name: str,
        value: str,
        human_id: str = "",
        source: str = "session-coordinator",
        uncertainty_s: float = float("nan"),
    ) -> Marker:
        session_id = self._coordinator.session.session_id
        marker = marker_message(stamp_ns, session_id, name, value, human_id, source, uncertainty_s)
        self._markers.put(marker)
        self._marked.inc()
        return marker

    def _keep(self, write: Any) -> None:
        trouble = ""
        try:
            write()
        except OSError as err:
            trouble = f"{self._service.config.state_file}: {err.strerror}"
        if trouble and trouble != self._trouble:
            self._service.log.error(f"the session cannot be kept, a restart would end it: {trouble}")
        self._trouble = trouble

    def _follow_streams(self) -> None:
        session = self._coordinator.session
        self._watch.follow(session.required_streams if session.phase in ACTIVE else ())

    def _on_ack(self, ack: SessionAck) -> None:
        said_ns = to_ns(ack.header.stamp)
        told = Ack(ack.session_id, ack.service, ack.phase, ack.ok, ack.directory, ack.detail, said_ns)
        self._do(self._coordinator.ack(told, self._now()))

    def _on_diagnostics(self, told: DiagnosticArray) -> None:
        for service in diagnostics.beats(told):
            self._services.take(service, self._awake.now_s())
        for status in told.status:
            beat = RecorderStatus.parse(status)
            if beat is not None and beat.node in self._service.config.last_services:
                self._recorders.take(beat, self._awake.now_s())

    def _troubles(self) -> Mapping[str, str]:
        """What is wrong with the other services; of those who record, what they say of the recording first.

        Of two coordinators each has a rule of its own: `_has_rival`.
        """
        session, now_s = self._coordinator.session, self._awake.now_s()
        recording = [name for name in self._service.config.last_services if name in session.expected]
        recorders = self._recorders.troubles(recording, session.session_id, self._coordinator.entered_s, now_s)
        services = {**dict.fromkeys(self._services.twins(now_s), TWINS), **self._services.troubles(now_s)}
        services.pop(self._service.node.get_name(), None)
        return {**services, **recorders}

    def _begin(self, wish: Request) -> Outcome:
        if self._awake.now_s() - self._alone_at_s > RIVAL_S:
            outcome = Outcome(False, "", "", "two session-coordinators are on this ROS domain; end one of them", [])
        else:
            outcome = self._coordinator.start(wish, self._now())
        if outcome.success and (strangers := [h for h in wish.human_ids if not self._is_known(h)]):
            message = f"{outcome.message}; no sensor has been seen of {', '.join(strangers)}"
            outcome = outcome._replace(message=message)
        self._settle(outcome)
        if outcome.success:
            self._follow_streams()
            self.look()
        return outcome

    def _is_known(self, human_id: str) -> bool:
        """True where a stream is published under this name."""
        parsed = [StreamName.parse(topic) for topic, _ in self._people.topics]
        return any(stream[0].human_id == human_id for stream in parsed if stream)

    def _end(self, wish: StopWish) -> Outcome:
        outcome = self._coordinator.stop(ended(wish), self._now())
        if not outcome.success and self._has_rival():
            outcome = outcome._replace(message=f"{outcome.message}; another session-coordinator is on this ROS domain")
        self._settle(outcome)
        return outcome

    def _settle(self, outcome: Outcome) -> None:
        log = self._service.log
        log.info(outcome.message) if outcome.success else log.warning(f"refused: {outcome.message}")
        self._do(outcome.effects)

    def _start(self, wish: Any, response: Any) -> Any:
        fields = {name: getattr(wish, name) for name in wish.get_fields_and_field_types()}
        lists = {name: tuple(fields[name]) for name in ("human_ids", "required_streams")}
        try:
            outcome = self._begin(request(StartWish(**(fields | lists))))
        except ValueError as err:
            response.success, response.message = False, str(err)
            return response
        response.success, response.session_id, response.message = outcome.success, outcome.session_id, outcome.message
        return response

    def _stop(self, wish: Any, response: Any) -> Any:
        try:
            outcome = self._end(StopWish(wish.session_id))
        except ValueError as err:
            response.success, response.message = False, str(err)
            return response
        response.success, response.directory, response.message = outcome.success, outcome.directory, outcome.message
        return response

    def _post_start(self, wish: StartWish) -> "Done":
        """Start a session; answered once it is accepted."""
        return _done(self._begin(request(wish)))

    def _post_stop(self, wish: StopWish) -> "Done":
        """Stop the session; answered once it is accepted."""
        return _done(self._end(wish))

    def _post_marker(self, wish: MarkerWish) -> "Marked":
        """Set a marker."""
        now_ns = self._now().ros_ns
        asked = press(wish)
        stamp_ns = now_ns - round(asked.age_s * SECOND_NS)
        source = asked.source or "http"
        marker = self._mark(stamp_ns, asked.name, asked.value, asked.human_id, source, asked.uncertainty_s)
        return Marked(stamp_ns, marker.session_id)


@dataclass(frozen=True)
class Done:
    """An order that is carried out; directory: where the recording lies, once it is known."""

    success: bool
    session_id: str
    message: str
    directory: str


@dataclass(frozen=True)
class Marked:
    """A marker that is set: its stamp in ns of ROS time, and the session it belongs to, or empty."""

    stamp_ns: int
    session_id: str


def _done(outcome: Outcome) -> Done:
    if not outcome.success:
        raise Refusal(outcome.message, status=409)
    return Done(True, outcome.session_id, outcome.message, outcome.directory)


def _restored(service: Service[Config], store: Store, awake: AwakeClock) -> Coordinator:
    now, kept = Now(time.time_ns(), awake.now_s()), None
    try:
        kept = store.load()
    except (ValueError, OSError) as err:
        service.log.error(f"{err}; set aside as {_set_aside(store)}: a session that ran is not gone on with")
    if kept is None:
        return Coordinator(service.config, now)
    return Coordinator(service.config, now, kept.session, kept.used, kept.gone_for_s)


def _set_aside(store: Store) -> Path:
    try:
        return store.set_aside()
    except OSError as err:
        raise ConfigError(f"parameter 'state_file': {err}") from err


async def serve(service: Service[Config]) -> None:
    """Coordinate until told to stop; a running session goes on, and is taken up again by the next run."""
    store, awake = Store(Path(service.config.state_file)), AwakeClock()
    shell = Shell(service, store, _restored(service, store, awake), awake)
    service.every(TICK_S, shell.tick)
    service.every(LOOK_S, shell.look)
    service.every(BEAT_S, shell.beat)
    service.ready()
    await service.stopped.wait()
    shell.close()


def main() -> int:
    """Run until stopped; return the exit status."""
    return run("session_coordinator", Config, serve)


if __name__ == "__main__":
    sys.exit(main())

"""The study's session and its recorder, as the page shows them. Pure."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from sense4hri.patterns import Patterns
from sense4hri.waiting import STREAMS_NOT_LOOKED_AT, Waited

from web_gui import reports
from web_gui.readings import Plain
from web_gui.recorder import Recorder
from web_gui.steady import Steady

PHASES = ("idle", "preparing", "recording", "stopping", "failed")
MOST_SERVICES = 500
REPLAY = "replay"  # its node


class Check(NamedTuple):
    """Something that a session needs. kind: `service`, `stream` or `other`; why: of a service, what it says."""

    kind: str
    name: str
    ok: bool
    why: str


class Session:
    """The session as last heard on `/study/session`, who answered on `/study/ack`, and what the recorder says."""

    def __init__(self, clock: Steady) -> None:
        self.state: Plain = {}
        self.coordinator = False
        """Whether a session can be started: somebody serves `/study/start_session`."""
        self.replayed = False
        """Whether the session is one of a recording that is played: nobody has to record it."""
        self.report = ""
        """Address on this server of the newest report, "" where there is none to be served."""
        self.recorder = Recorder()
        self._clock, self._start_ns = clock, 0
        self._acks: dict[str, Plain] = {}
        self._waited: tuple[str, ...] = ()

    @property
    def phase(self) -> str:
        """The phase in one word."""
        phase = int(self.state.get("phase", 0))
        return PHASES[phase] if phase < len(PHASES) else "failed"

    @property
    def human_ids(self) -> tuple[str, ...]:
        """Who takes part."""
        return tuple(self.state.get("human_ids", ()))

    @property
    def start_ns(self) -> int:
        """When it begins or began, by the time of day as it is set now; 0 where that is not known."""
        return self._clock.wall_ns(self._start_ns) if self.state.get("start_at") else 0

    def said_by(self, nodes: set[str]) -> None:
        """Take the names of the nodes that say what the session does; of who has left nothing is known anew."""
        if nodes:
            self.replayed = nodes == {REPLAY}

    def take_state(self, plain: Plain) -> None:
        """Take a SessionState."""
        if _about(plain) != _about(self.state):
            self._acks = {}
        if plain.get("start_at") != self.state.get("start_at"):
            self._start_ns = plain.get("start_at", 0) - self._clock.wall_ns(0)
        self.state = plain
        if self.phase != "failed":  # which says no more what it had been waiting for
            self._waited = tuple(plain.get("waiting_for", ()))

    def take_ack(self, plain: Plain) -> None:
        """Take a SessionAck; one of another phase is too late to be shown."""
        known = plain["service"] in self._acks or len(self._acks) < MOST_SERVICES
        if _about(plain) == _about(self.state) and known:
            self._acks[str(plain["service"])] = plain

    @property
    def report_path(self) -> str:
        """Where the newest report lies as the recorder sees it, "" where none is known."""
        told = self.recorder.report
        directory = str(self.state.get("directory", ""))
        return told or (f"{directory}/{reports.NAME}" if directory and self.phase in ("idle", "failed") else "")

    def checks(self) -> list[Check]:
        """Return every expected service and required stream; of a failed session as it was when it failed."""
        waits = dict(Waited.parse(text) for text in self._waited)
        looking = waits.pop(STREAMS_NOT_LOOKED_AT, None)
        services = [self._service(name, waits) for name in self.state.get("expected_services", ())]
        streams = [_stream(glob, waits, looking) for glob in self.state.get("required_streams", ())]
        known = {check.name for check in services}
        globs = Patterns(self.state.get("required_streams", ()))
        others = [n for n in waits if n not in known and not globs.match(n) and n not in {s.name for s in streams}]
        return [*services, *streams, *(Check("other", name, False, waits[name]) for name in others)]

    def _service(self, name: str, waits: Mapping[str, str]) -> Check:
        said = str(self._acks.get(name, {}).get("detail", ""))
        if name in waits:
            return Check("service", name, False, waits[name] or said or "not ready")
        return Check("service", name, True, said)


def _stream(glob: str, waits: Mapping[str, str], looking: str | None) -> Check:
    """Return a required stream, or all that match a required glob."""
    if looking is not None:
        return Check("stream", glob, False, looking)
    meant = Patterns((glob,))
    wrong = [why if topic == glob else f"{topic}: {why}" for topic, why in _topics(waits) if meant.match(topic)]
    wrong += [waits[glob]] if glob in waits and not meant.match(glob) else []
    return Check("stream", glob, not wrong, "; ".join(wrong))


def _topics(waits: Mapping[str, str]) -> Iterable[tuple[str, str]]:
    return ((name, why) for name, why in waits.items() if name.startswith("/"))


def _about(plain: Plain) -> tuple[Any, Any]:
    return plain.get("session_id", ""), plain.get("phase", 0)

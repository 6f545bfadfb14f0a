"""A session-coordinator, its time and the services on its graph, without ROS: what test_session_*.py conducts."""

from session_coordinator.config import Config
from session_coordinator.coordinator import Coordinator
from session_coordinator.request import Request
from session_coordinator.session import Ack, Note, Now, Phase, Publish

START_NS = 1_800_000_000 * 10**9
WISH = Request("study", session_id="s1", human_ids=("p1",))


class Study:
    """A coordinator, its time, and the services on the graph."""

    def __init__(self, *services: str, config: Config | None = None, **kept: object) -> None:
        self.seconds = 100.0
        self.coordinator = Coordinator(config or Config(), self.now(), **kept)
        self.said: list[object] = []
        self.nodes = {name: frozenset({name.encode()}) for name in services}
        self.look()
        self.pass_s(3.0)

    @property
    def session(self):
        return self.coordinator.session

    def now(self) -> Now:
        return Now(START_NS + round(self.seconds * 1e9), self.seconds)

    def do(self, effects):
        self.said += effects
        return effects

    def look(self):
        return self.do(self.coordinator.seen(self.nodes, self.now()))

    def pass_s(self, seconds: float):
        self.seconds += seconds
        return self.do(self.coordinator.tick(self.now()))

    def start(self, wish: Request = WISH):
        outcome = self.coordinator.start(wish, self.now())
        self.do(outcome.effects)
        return outcome

    def stop(self, session_id: str = ""):
        outcome = self.coordinator.stop(session_id, self.now())
        self.do(outcome.effects)
        return outcome

    def ack(self, *services: str, ok: bool = True, detail: str = "", directory: str = "", phase: Phase | None = None):
        for service in services:
            told = Ack(self.session.session_id, service, phase or self.session.phase, ok, directory, detail)
            self.do(self.coordinator.ack(told, self.now()))

    def record(self):
        self.start()
        self.ack(*self.session.expected)
        self.ack(*self.session.expected)
        assert self.session.phase is Phase.RECORDING
        self.pass_s(1.1)  # the common start has come
        return self

    def notes(self) -> list[str]:
        return [effect.text for effect in self.said if isinstance(effect, Note)]

    def phases(self) -> list[Phase]:
        phases = [effect.session.phase for effect in self.said if isinstance(effect, Publish)]
        return [phase for k, phase in enumerate(phases) if k == 0 or phase is not phases[k - 1]]

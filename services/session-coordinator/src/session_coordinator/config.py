"""Parameters of session-coordinator; every one has a default."""

from dataclasses import dataclass, field

IGNORED = ("_*", "rosbag2_*", "rqt_*", "foxglove_bridge", "rosbridge_websocket", "ros2_*")


@dataclass(frozen=True)
class Config:
    """Who must answer, and how long everybody is waited for."""

    required_services: tuple[str, ...] = field(
        default=(), metadata={"help": "nodes that must take part, also where they are not on the graph"}
    )
    ignored_services: tuple[str, ...] = field(
        default=IGNORED, metadata={"help": "globs of nodes that only look on and never acknowledge"}
    )
    last_services: tuple[str, ...] = field(
        default=("recorder",), metadata={"help": "nodes that finish after all others have"}
    )
    lead_s: float = field(default=1.0, metadata={"help": "how long ahead the common start is announced, s"})
    answer_timeout_s: float = field(
        default=30.0, metadata={"help": "who says nothing for so long while preparing fails the session, s"}
    )
    prepare_timeout_s: float = field(
        default=600.0, metadata={"help": "what is not ready after so long fails the session, s"}
    )
    flush_timeout_s: float = field(
        default=10.0, metadata={"help": "how long services may take to finish, and once more the last ones, s"}
    )
    stale_s: float = field(default=3.0, metadata={"help": "a required stream silent for so long is stale, s"})
    state_file: str = field(
        default="session.json", metadata={"help": "where the running session is kept, to outlive a restart"}
    )
    resume_within_s: float = field(
        default=120.0, metadata={"help": "a session is gone on with after an absence of at most so long, s"}
    )

    def __post_init__(self) -> None:
        for name in ("answer_timeout_s", "prepare_timeout_s", "flush_timeout_s", "stale_s", "resume_within_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"parameter '{name}' must be above 0, is {getattr(self, name)}")
        if not 0.1 <= self.lead_s <= 60:
            raise ValueError(f"parameter 'lead_s' must be 0.1 to 60, is {self.lead_s}")
        if not self.state_file:
            raise ValueError("parameter 'state_file' must name a file")

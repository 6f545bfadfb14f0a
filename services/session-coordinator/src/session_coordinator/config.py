"""Parameters of session-coordinator; every one has a default."""

from dataclasses import dataclass

from sense4hri.patterns import checked
from sense4hri.schema import Schema, parameter

IGNORED = ("_*", "rosbag2_*", "rqt_*", "foxglove_bridge", "rosbridge_websocket", "ros2_*")


@dataclass(frozen=True)
class Config(Schema):
    """Who must answer, and how long everybody is waited for."""

    required_services: tuple[str, ...] = parameter(
        (), help="nodes that must take part, also where they are not on the graph"
    )
    ignored_services: tuple[str, ...] = parameter(
        IGNORED, help="globs of nodes that only look on and never acknowledge"
    )
    last_services: tuple[str, ...] = parameter(("recorder",), help="nodes that finish after all others have")
    lead_s: float = parameter(1.0, help="how long ahead the common start is announced", unit="s", low=0.1, high=60)
    answer_timeout_s: float = parameter(
        30.0,
        help="who says nothing for so long while preparing fails the session; DDS shows a killed process up to 20 s",
        unit="s",
        low=0.01,
    )
    prepare_timeout_s: float = parameter(
        600.0, help="what is not ready after so long fails the session", unit="s", low=0.01
    )
    flush_timeout_s: float = parameter(
        10.0, help="how long services may take to finish, and once more the last ones", unit="s", low=0.01
    )
    stale_s: float = parameter(3.0, help="a required stream silent for so long is stale", unit="s", low=0.01)
    state_file: str = parameter(
        "session.json",
        help="where the running session is kept, to outlive a restart",
        matches=".+",
        form="the name of a file",
    )
    resume_within_s: float = parameter(
        120.0, help="a session is gone on with after an absence of at most so long", unit="s", low=0.01
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        checked(self.ignored_services, "parameter 'ignored_services'")

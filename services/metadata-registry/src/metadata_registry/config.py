"""Parameters of metadata-registry; every one has a default."""

from dataclasses import dataclass

from sense4hri.schema import Schema, parameter


@dataclass(frozen=True)
class Config(Schema):
    """Where the registry keeps what it knows, and how it looks at the graph."""

    database: str = parameter(
        "registry.sqlite", help="SQLite file, made where it does not exist", matches=".+", form="the name of a file"
    )
    scan_interval_s: float = parameter(0.5, help="how often the graph is looked at for drivers", unit="s", low=0.01)
    refresh_interval_s: float = parameter(
        30.0,
        help="how often one known driver's parameters are read again, each in its turn; a change is heard at once on"
        " /parameter_events",
        unit="s",
        low=0.01,
    )
    session_over_after_s: float = parameter(
        120.0,
        help="a session that nobody records is over once no session-coordinator has been there for so long; at least"
        " that one's resume_within_s",
        unit="s",
        low=1.0,
    )
    answer_timeout_s: float = parameter(2.0, help="how long a driver may take to answer", unit="s", low=0.01)

"""Parameters of metadata-registry; every one has a default."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Config:
    """Where the registry keeps what it knows, and how it looks at the graph."""

    database: str = field(default="registry.sqlite", metadata={"help": "SQLite file; made where it does not exist"})
    scan_interval_s: float = field(default=0.5, metadata={"help": "how often the graph is looked at for drivers, s"})
    refresh_interval_s: float = field(
        default=30.0, metadata={"help": "how often a known driver's parameters are read again, s"}
    )
    answer_timeout_s: float = field(default=2.0, metadata={"help": "how long a driver may take to answer, s"})

    def __post_init__(self) -> None:
        if not self.database:
            raise ValueError("parameter 'database' must name a file")
        for name in ("scan_interval_s", "refresh_interval_s", "answer_timeout_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"parameter '{name}' must be above 0, is {getattr(self, name)}")

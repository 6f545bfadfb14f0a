"""Parameters of web-gui."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Config:
    """Where the page is served and how much it remembers."""

    host: str = field(default="127.0.0.1", metadata={"help": "address to listen on; 0.0.0.0 only behind a firewall"})
    port: int = field(default=8080, metadata={"help": "port of the page"})
    allowed_hosts: tuple[str, ...] = field(
        default=("127.0.0.1", "localhost", "::1"),
        metadata={"help": "names under which browsers may open the page; any other Host or Origin is refused"},
    )
    history_s: float = field(default=180.0, metadata={"help": "raw signal kept for scrolling back, in s"})
    trend_s: float = field(default=600.0, metadata={"help": "length of the strip at the bottom, in s"})

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise ValueError(f"port is {self.port}, must be 0..65535 (0 = any free one)")
        if not self.host:
            raise ValueError("host is empty, must be an address such as 127.0.0.1")
        for name, low, high in (("history_s", 30.0, 3600.0), ("trend_s", 60.0, 7200.0)):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} is {getattr(self, name)}, must be {low:g}..{high:g} s")

"""Parameters of web-gui."""

from dataclasses import dataclass, field

# the contract's names; capital letters are pressed with Shift
MARKER_KEYS = (
    "b=baseline_start",
    "B=baseline_end",
    "c=condition_start",
    "C=condition_end",
    "s=stimulus",
    "r=response",
    "y=sync",
    "m=mvc",
    "n=note",
)
LONGEST_NAME = 100
PAGE_KEYS = "123dglt"  # what the page itself does with a letter or digit


@dataclass(frozen=True)
class Config:
    """Where the page is served and how much it remembers."""

    host: str = field(default="127.0.0.1", metadata={"help": "address to listen on; 0.0.0.0 only behind a firewall"})
    port: int = field(default=8080, metadata={"help": "port of the page"})
    history_s: float = field(default=180.0, metadata={"help": "raw signal kept for scrolling back, in s"})
    trend_s: float = field(default=600.0, metadata={"help": "length of the strip at the bottom, in s"})
    recordings: str = field(
        default="", metadata={"help": "the recorder's directory, of which reports are served; empty: none"}
    )
    marker_keys: tuple[str, ...] = field(
        default=MARKER_KEYS, metadata={"help": "markers of the page, `key=name`; the marker `note` asks for a text"}
    )

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise ValueError(f"port is {self.port}, must be 0..65535 (0 = any free one)")
        if not self.host:
            raise ValueError("host is empty, must be an address such as 127.0.0.1")
        for name, low, high in (("history_s", 30.0, 3600.0), ("trend_s", 60.0, 7200.0)):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} is {getattr(self, name)}, must be {low:g}..{high:g} s")
        self.markers()

    def markers(self) -> list[tuple[str, str]]:
        """Return (key, name) of every marker. Raises ValueError that names the entry."""
        found: dict[str, str] = {}
        for entry in self.marker_keys:
            key, _, name = entry.partition("=")
            if len(key) != 1 or not key.isascii() or not key.isalnum() or key in PAGE_KEYS:
                raise ValueError(
                    f"marker_keys: {entry!r} must be `key=name`, the key a letter or digit not in {PAGE_KEYS}"
                )
            if not 1 <= len(name) <= LONGEST_NAME or not name.isprintable():
                raise ValueError(f"marker_keys: {entry!r} names no marker of 1 to {LONGEST_NAME} printable characters")
            if key in found:
                raise ValueError(f"marker_keys: {key!r} is given twice")
            found[key] = name
        return list(found.items())

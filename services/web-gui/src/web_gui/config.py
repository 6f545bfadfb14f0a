"""Parameters of web-gui."""

from dataclasses import dataclass

from sense4hri.schema import Schema, parameter

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
class Config(Schema):
    """Where the page is served and how much it remembers."""

    host: str = parameter(
        "127.0.0.1",
        help="address to listen on; elsewhere than on loopback the page only shows, unless an operate token is set "
        "(docs/http.md); in a container 0.0.0.0, with the port published on loopback",
        matches=".+",
        form="an address such as 127.0.0.1",
    )
    port: int = parameter(
        8080, help="port of the page; taken: exit 78; 0 = any free one, written to the log", low=0, high=65535
    )
    history_s: float = parameter(
        600.0,
        help="signal kept for scrolling back; of a stream the newest 10 MB as samples, what is older as minima and "
        "maxima of 20 ms",
        unit="s",
        low=30,
        high=3600,
    )
    trend_s: float = parameter(600.0, help="length of the strip at the bottom", unit="s", low=60, high=7200)
    recordings: str = parameter(
        "",
        help="the recorder's directory as this process sees it, of which reports are served when a session is done; "
        "empty = none",
    )
    marker_keys: tuple[str, ...] = parameter(
        MARKER_KEYS,
        help="markers of the page, `key=name` each; a capital letter is pressed with Shift; `note` asks for a text",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.markers()

    def markers(self) -> list[tuple[str, str]]:
        """Return (key, name) of every marker. Raises ValueError that names the entry."""
        found: dict[str, str] = {}
        for entry in self.marker_keys:
            key, _, name = entry.partition("=")
            if len(key) != 1 or not key.isascii() or not key.isalnum() or key in PAGE_KEYS:
                raise ValueError(
                    f"parameter 'marker_keys' holds {entry!r}, each must be `key=name`, "
                    f"the key a letter or digit not in {PAGE_KEYS}"
                )
            if not 1 <= len(name) <= LONGEST_NAME or not name.isprintable():
                raise ValueError(
                    f"parameter 'marker_keys' holds {entry!r}, each must name a marker of 1 to {LONGEST_NAME} "
                    "printable characters"
                )
            if key in found:
                raise ValueError(f"parameter 'marker_keys' gives {key!r} twice")
            found[key] = name
        return list(found.items())

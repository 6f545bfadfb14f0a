"""Parameters of the recorder."""

from dataclasses import dataclass

from sense4hri.patterns import checked
from sense4hri.schema import Schema, parameter

PATTERNS = ("/humans/**", "/study/**", "/tf*", "/rosout")
IDENTIFYING = (
    "/humans/faces/*/cropped/**",
    "/humans/faces/*/aligned/**",
    "/humans/faces/*/frontalized/**",
    "/humans/bodies/*/cropped/**",
    "/humans/voices/*/audio/**",
    "/humans/persons/*/name/**",
)


TOPIC, TOPIC_FORM = "/.*", "a full topic name or glob, with '/' in front"


@dataclass(frozen=True)
class Config(Schema):
    """The parameter schema."""

    directory: str = parameter(
        "recordings",
        help="folder of the recordings; each is a new folder in it",
        matches=".+",
        form="the name of a folder",
    )
    patterns: tuple[str, ...] = parameter(
        PATTERNS,
        help="topics to record; `*` and `?` stay between two slashes, `**` is any number of parts",
        matches=TOPIC,
        form=TOPIC_FORM,
    )
    exclude: tuple[str, ...] = parameter((), help="topics to leave out all the same", matches=TOPIC, form=TOPIC_FORM)
    record_identifying: bool = parameter(
        False, help="record also what `identifying` matches: images, voices and names of people"
    )
    identifying: tuple[str, ...] = parameter(
        IDENTIFYING,
        help="topics that identify people; left out unless record_identifying",
        matches=TOPIC,
        form=TOPIC_FORM,
    )
    record_when: str = parameter(
        "always",
        help="always: also what lies between sessions, in a folder of its own; session: only sessions",
        choices=("always", "session"),
    )
    split_mb: int = parameter(2000, help="a new file after so many MB; 0 = never", unit="MB", low=0)
    split_s: float = parameter(3600.0, help="a new file after so long; 0 = never", unit="s", low=0)
    flush_interval_s: float = parameter(
        0.2,
        help="a killed recorder loses at most about so much and 0.05 s; a fsync follows each time",
        unit="s",
        low=0.01,
        high=10,
    )
    compression: str = parameter("zstd", help="of every chunk", choices=("none", "lz4", "zstd"))
    free_floor_mb: int = parameter(
        500,
        help="with less free disk than this no recording begins; one that runs ends its file at a tenth of it, "
        "and goes on in a further file at a fifth",
        unit="MB",
        low=0,
    )
    warn_minutes: float = parameter(
        30.0, help="warn when the disk lasts no longer than this at the rate of the last minute", unit="min", low=0
    )
    reports: bool = parameter(True, help="make report.html and report.json of every recording that is closed")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.patterns:
            raise ValueError("parameter 'patterns' is empty: nothing would be recorded")
        for name in ("patterns", "exclude", "identifying"):
            checked(getattr(self, name), f"parameter {name!r}")

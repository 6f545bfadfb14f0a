"""Parameters of the recorder."""

from dataclasses import dataclass, field

PATTERNS = ("/humans/**", "/study/**", "/tf*", "/rosout")
IDENTIFYING = (
    "/humans/faces/*/cropped/**",
    "/humans/faces/*/aligned/**",
    "/humans/faces/*/frontalized/**",
    "/humans/bodies/*/cropped/**",
    "/humans/voices/*/audio/**",
    "/humans/persons/*/name/**",
)


@dataclass(frozen=True)
class Config:
    """The parameter schema."""

    directory: str = field(
        default="recordings", metadata={"help": "folder of the recordings; each is a new folder in it"}
    )
    patterns: tuple[str, ...] = field(
        default=PATTERNS,
        metadata={"help": "topics to record; * is any part of a name between slashes, ** any number of parts"},
    )
    exclude: tuple[str, ...] = field(default=(), metadata={"help": "topics to leave out all the same"})
    record_identifying: bool = field(
        default=False, metadata={"help": "record also what identifies people: images, voices, names"}
    )
    identifying: tuple[str, ...] = field(
        default=IDENTIFYING, metadata={"help": "topics that identify people; left out unless record_identifying"}
    )
    record_when: str = field(
        default="always",
        metadata={"help": "always: also what lies between sessions, in a folder of its own; session: only sessions"},
    )
    split_mb: int = field(default=2000, metadata={"help": "a new file after so many MB; 0: never"})
    split_s: float = field(default=3600.0, metadata={"help": "a new file after so long, in s; 0: never"})
    flush_interval_s: float = field(
        default=0.25, metadata={"help": "a killed recorder loses at most so much, in s; a fsync follows each time"}
    )
    compression: str = field(default="zstd", metadata={"help": "none, lz4 or zstd, of every chunk"})
    free_floor_mb: int = field(
        default=500,
        metadata={"help": "with less free disk than this, in MB, no recording begins; at a tenth a running one stops"},
    )
    warn_minutes: float = field(
        default=30.0, metadata={"help": "warn when the disk lasts no longer than this, in minutes"}
    )
    reports: bool = field(
        default=True, metadata={"help": "make report.html and report.json of every recording that is closed"}
    )

    def __post_init__(self) -> None:
        if not self.directory:
            raise ValueError("directory is empty")
        for name in ("patterns", "exclude", "identifying"):
            for pattern in getattr(self, name):
                if not pattern.startswith("/"):
                    raise ValueError(f"{name}: {pattern!r} must be a full topic name or glob, with '/' in front")
        if not self.patterns:
            raise ValueError("patterns is empty: nothing would be recorded")
        if self.record_when not in ("always", "session"):
            raise ValueError(f"record_when is {self.record_when!r}, must be always or session")
        if not 0.01 <= self.flush_interval_s <= 10.0:
            raise ValueError(f"flush_interval_s is {self.flush_interval_s}, must be 0.01 to 10")
        if self.compression not in ("none", "lz4", "zstd"):
            raise ValueError(f"compression is {self.compression!r}, must be none, lz4 or zstd")
        for name in ("split_mb", "split_s", "free_floor_mb", "warn_minutes"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} is {getattr(self, name)}, must not be negative")

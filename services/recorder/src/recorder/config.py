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
        default="recordings", metadata={"help": "folder of the recordings; each run makes a new one in it"}
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
    record_when: str = field(default="always", metadata={"help": "always: from start to end of the process"})
    flush_interval_s: float = field(
        default=0.25, metadata={"help": "a killed recorder loses at most so much, in s; a fsync follows each time"}
    )
    compression: str = field(default="zstd", metadata={"help": "none, lz4 or zstd, of every chunk"})
    warn_free_mb: int = field(default=1000, metadata={"help": "less free disk than this is logged, in MB"})

    def __post_init__(self) -> None:
        if not self.directory:
            raise ValueError("directory is empty")
        for name in ("patterns", "exclude", "identifying"):
            for pattern in getattr(self, name):
                if not pattern.startswith("/"):
                    raise ValueError(f"{name}: {pattern!r} must be a full topic name or glob, with '/' in front")
        if not self.patterns:
            raise ValueError("patterns is empty: nothing would be recorded")
        if self.record_when != "always":
            raise ValueError(f"record_when is {self.record_when!r}; this version knows only 'always'")
        if not 0.01 <= self.flush_interval_s <= 10.0:
            raise ValueError(f"flush_interval_s is {self.flush_interval_s}, must be 0.01 to 10")
        if self.compression not in ("none", "lz4", "zstd"):
            raise ValueError(f"compression is {self.compression!r}, must be none, lz4 or zstd")
        if self.warn_free_mb < 0:
            raise ValueError(f"warn_free_mb is {self.warn_free_mb}, must not be negative")

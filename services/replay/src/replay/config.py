"""Parameters of replay; with none of them it waits for `POST /play`."""

from dataclasses import dataclass, field

WHAT = ("all", "raw")


@dataclass(frozen=True)
class Config:
    """The parameter schema."""

    bag: str = field(
        default="",
        metadata={"help": "session (any of its folders, or FOLDER/ID), rosbag2 folder or file; empty: wait for /play"},
    )
    only_this_part: bool = field(default=False, metadata={"help": "leave out the other folders of a session"})
    rate: float = field(default=1.0, metadata={"help": "speed; 0 = as fast as subscribers keep up"})
    what: str = field(default="all", metadata={"help": "all, or raw: leave out what services compute from the rest"})
    topics: tuple[str, ...] = field(
        default=("/**",),
        metadata={"help": "topics to play; * is any part of a name between slashes, ** any number of parts"},
    )
    exclude: tuple[str, ...] = field(default=(), metadata={"help": "topics to leave out all the same"})
    remap: tuple[str, ...] = field(default=(), metadata={"help": "'/from:=/to'; a topic, or the beginning of several"})
    start_s: float = field(default=0.0, metadata={"help": "where to begin, in s from the first message"})
    loop: bool = field(default=False, metadata={"help": "begin again at the end"})
    clock: bool = field(default=False, metadata={"help": "publish /clock for nodes with use_sim_time"})
    most_per_s: float = field(default=2000.0, metadata={"help": "messages per s with rate 0 at most; 0 = no ceiling"})
    discovery_s: float = field(
        default=1.5, metadata={"help": "the graph must be unchanged for so long before the first message, s"}
    )
    discovery_timeout_s: float = field(default=15.0, metadata={"help": "then begin all the same, s"})
    linger_s: float = field(default=2.0, metadata={"help": "stay after the last message, for subscribers that lag, s"})
    progress: bool = field(default=False, metadata={"help": "show a line of progress on stderr"})

    def __post_init__(self) -> None:
        if not (self.rate == 0.0 or 0.01 <= self.rate <= 1000.0):
            raise ValueError(f"parameter 'rate' is {self.rate:g}, must be 0 or 0.01 to 1000")
        if self.what not in WHAT:
            raise ValueError(f"parameter 'what' is {self.what!r}, must be all or raw")
        for name in ("topics", "exclude"):
            for glob in getattr(self, name):
                if not glob.startswith("/"):
                    raise ValueError(f"parameter '{name}': {glob!r} must be a full topic name or glob, '/' in front")
        for name in ("start_s", "most_per_s", "discovery_s", "discovery_timeout_s", "linger_s"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"parameter '{name}' is {getattr(self, name)}, must not be negative")

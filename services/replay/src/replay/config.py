"""Parameters of replay; with none of them it waits for `POST /play`."""

from dataclasses import dataclass

from sense4hri.patterns import checked
from sense4hri.schema import Schema, parameter

WHAT = ("all", "raw")
SLOWEST = 0.01
TOPIC, TOPIC_FORM = "/.*", "a full topic name or glob, with '/' in front"
NODE, NODE_FORM = r"/?([A-Za-z_]\w*/)*[A-Za-z_]\w*", "a node's name"


@dataclass(frozen=True)
class Config(Schema):
    """The parameter schema."""

    bag: str = parameter(
        "",
        help="recording: a session (any of its folders, or FOLDER/ID), a rosbag2 folder (MCAP or sqlite3) or an .mcap "
        "file; empty = wait for POST /play",
    )
    only_this_part: bool = parameter(False, help="leave out the other folders of a session whose recorder was killed")
    rate: float = parameter(
        1.0,
        help=f"speed, {SLOWEST} at least; 0 = as fast as subscribers, and features computed meanwhile, keep up",
        low=0,
        high=1000,
    )
    what: str = parameter(
        "all",
        help="raw leaves out features, clock models, states, acknowledgements and /diagnostics, "
        "so that services say them again",
        choices=WHAT,
    )
    topics: tuple[str, ...] = parameter(
        ("/**",),
        help="topics to play; `*` and `?` stay between two slashes, `**` is any number of parts",
        matches=TOPIC,
        form=TOPIC_FORM,
    )
    exclude: tuple[str, ...] = parameter((), help="topics to leave out all the same", matches=TOPIC, form=TOPIC_FORM)
    remap: tuple[str, ...] = parameter((), help="`/from:=/to`: a topic, or the beginning of several up to a slash")
    start_s: float = parameter(0.0, help="where to begin, from the first message", unit="s", low=0)
    loop: bool = parameter(False, help="begin again at the end")
    clock: bool = parameter(False, help="publish /clock at 100 Hz, for nodes with use_sim_time")
    most_per_s: float = parameter(
        2000.0, help="messages per second with rate 0 at most; 0 = no ceiling", unit="1/s", low=0
    )
    discovery_s: float = parameter(
        1.5, help="the graph must be unchanged for so long before the first message", unit="s", low=0
    )
    discovery_timeout_s: float = parameter(
        15.0, help="then begin all the same; where one of wait_for is missing, do not", unit="s", low=0
    )
    wait_for: tuple[str, ...] = parameter(
        (),
        help="nodes without which nothing is played, such as those that compute from it",
        matches=NODE,
        form=NODE_FORM,
    )
    linger_s: float = parameter(2.0, help="stay after the last message, for subscribers that lag", unit="s", low=0)
    progress: bool = parameter(False, help="show a line of progress on stderr")

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.rate < SLOWEST:
            raise ValueError(f"parameter 'rate' is {self.rate}, must be 0 or {SLOWEST} to 1000")
        for name in ("topics", "exclude"):
            checked(getattr(self, name), f"parameter {name!r}")

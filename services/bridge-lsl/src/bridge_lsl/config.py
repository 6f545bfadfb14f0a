"""Parameters of bridge-lsl; every one has a default."""

from dataclasses import dataclass

from sense4hri.schema import Schema, parameter


@dataclass(frozen=True)
class Config(Schema):
    """What is offered to LSL."""

    topics: tuple[str, ...] = parameter(
        ("/humans/physiological/*/*/*/raw",),
        help="topics, or globs of topics, that become outlets: raw streams and features",
    )
    markers: bool = parameter(True, help="offer the study's markers as an outlet of text")
    session: str = parameter(
        "",
        help="LSL's SessionID; empty = that of lsl_api.cfg; `{domain}` in it is the ROS domain",
        matches=r"[\w{}-]*",
        form="letters, digits, '_', '-' and {domain}",
    )

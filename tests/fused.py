"""A study of one participant for the tests of fusion: what comes in, and the states that come of it."""

import math

from fusion_affect.align import SECOND_NS
from fusion_affect.fusion import Fusion
from fusion_affect.state import Expression, State
from fusion_affect.streams import Rate
from fusion_affect.tree import load
from sense4hri.names import StreamName

NAN = math.nan
TREE = load()
START = 1_700_000_000 * SECOND_NS
ECG, PPG = StreamName("p1", "ecg", "h10_1"), StreamName("p1", "ppg", "verity_1")
NEUTRAL = Expression("neutral", 0.9)


def at(seconds: float) -> int:
    return START + round(seconds * SECOND_NS)


def run(
    fusion: Fusion,
    seconds: float,
    *,
    ecg: float | None = 70.0,
    ppg: float | None = 72.0,
    expression: Expression | None = NEUTRAL,
    stamped: bool = True,
    faces: tuple[str, ...] | None = ("f1",),
    start: float = 0.0,
) -> list[State]:
    """Ten steps a second of a study with one participant; what is None is not sent."""
    states: list[State] = []
    for step in range(round(seconds * 10)):
        now = at(start + step / 10)
        if faces is not None:
            fusion.faces(faces, now)
        if expression and step % 5 == 0:
            fusion.expression("f1", expression, now if stamped else 0)
        if ecg is not None and step % 10 == 3:
            fusion.rate(ECG, "features", Rate(ecg, 0.9), now)
        if ppg is not None and step % 10 == 7:
            fusion.rate(PPG, "features", Rate(ppg, 0.8), now)
        states += fusion.due()
    return states

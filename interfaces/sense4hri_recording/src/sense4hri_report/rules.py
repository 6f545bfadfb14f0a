"""When a stream, and a session, is complete, usable with gaps, or broken. Every threshold of the report is here.

The verdict speaks of completeness alone. What is doubtful in other ways (contact, quality, a clock that never locked)
is a remark beside it and changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

COMPLETE, GAPS, BROKEN = "complete", "usable with gaps", "broken"
ORDER = (COMPLETE, GAPS, BROKEN)

EDGE_S = 1.0
TAIL_S = 5.0
BROKEN_COVERAGE = 0.5
SILENCE_S, SILENCE_INTERVALS = 5.0, 10.0

WEAK_QUALITY = 0.5
LOW_BATTERY_PERCENT = 15.0
WIDE_CLOCK_S = 0.02
OFF_RATE = 0.03
LITTLE_CONTACT = 0.99

RULES = (
    (BROKEN, "a stream that was expected never came, or has no sample between the session's start and stop"),
    (BROKEN, f"less than {BROKEN_COVERAGE:.0%} of the samples of the session are there, of the time in which the "
             "recorder recorded"),
    (BROKEN, "no message of the stream can be decoded"),
    (GAPS, "samples are missing between others, counted by the device's clock; without one, by receipt or by the "
           "driver"),
    (GAPS, f"the first sample is more than {EDGE_S:g} s and one message after the session's start, or the last one as "
           "long before its stop"),
    (GAPS, f"outside of a session: it ends more than {TAIL_S:g} s before the recording, though its driver sent on or "
           "said to the last that it streams"),
    (GAPS, "the device restarted, or its clock was set"),
    (GAPS, "samples came in another order than they were taken"),
    (GAPS, "the recorder counted messages that were sent and did not reach the file"),
    (GAPS, "messages that cannot be decoded, or other samples under a stamp that came before"),
    (GAPS, "a channel of the stream came for a part of the time only"),
    (GAPS, f"a required topic of another kind was silent for more than {SILENCE_S:g} s and {SILENCE_INTERVALS:g} of "
           "its mean intervals"),
    (GAPS, "session: markers, features or states were lost or cannot be decoded; nothing was recorded for a while, as "
           "with a full disk; the recording was interrupted, a file is "
           "damaged, the session never stopped, the host's clock was set, or the session goes on in another folder"),
    (COMPLETE, "nothing of this"),
)  # fmt: skip


class Problem(NamedTuple):
    """What keeps something from being complete."""

    verdict: str
    sentence: str


@dataclass
class Judgement:
    """What was found: problems decide the verdict, remarks do not."""

    problems: list[Problem] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def broken(self, sentence: str) -> None:
        """Note a problem that makes it unusable."""
        self.problems.append(Problem(BROKEN, sentence))

    def gaps(self, sentence: str) -> None:
        """Note a problem with which it can be used, with care."""
        self.problems.append(Problem(GAPS, sentence))

    def remark(self, sentence: str) -> None:
        """Note what is worth knowing and changes no verdict."""
        self.remarks.append(sentence)

    @property
    def verdict(self) -> str:
        """The verdict of the worst problem; COMPLETE where there is none."""
        return max((problem.verdict for problem in self.problems), key=ORDER.index, default=COMPLETE)

    @property
    def why(self) -> str:
        """The sentence that led to the verdict."""
        return next((p.sentence for p in self.problems if p.verdict == self.verdict), "nothing is missing")


def counted(number: int, what: str) -> str:
    """`1 gap`, `2 gaps`, `1 219 gaps`; the last word of `what` before a comma is put in the plural."""
    return f"{number:,} {what}{'' if number == 1 else 's'}".replace(",", "\u202f")


def duration(seconds: float) -> str:
    """`0.42 s`, `12.3 s`, `4 min 10 s`, `2 h 05 min`."""
    if seconds < 9.95:
        return f"{seconds:.2f} s"
    if seconds < 119.5:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 7200:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"

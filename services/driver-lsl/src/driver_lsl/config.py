"""Parameters of driver-lsl, and which devices come this way."""

import math
import re
from dataclasses import dataclass
from itertools import accumulate

from sense4hri.devices import ANY, DeviceRow, Offered
from sense4hri.lsl import InletConfig
from sense4hri.schema import parameter
from sense4hri.signal_files.choice import Wanted, parse_all

_CLOCK = "the sender's LSL stamps (its uptime in s, or a clock of its own); offset measured in both directions"
_LOSS = "LSL counts nothing: holes of the stamps where the rate is regular, exact where the stamps do not jitter"
_LINK = "Lab Streaming Layer"


def _through(device: str, vendor: str, streams: dict[str, Offered], seen_on: str = "nothing yet") -> DeviceRow:
    return DeviceRow(
        device=device, vendor=vendor, streams=streams, clock=_CLOCK, loss=_LOSS, link=_LINK, seen_on=seen_on
    )


_ANY_RATE = {name: Offered(unit, math.nan) for name, unit in (("eeg", "uV"), ("ecg", "uV"), ("eda", "uS"))}
DEVICES = (
    _through(
        "any LSL stream: signals, gaze, markers",
        "",
        {ANY: Offered("", math.nan)},
        "virtual (real liblsl outlets); a recording of a BioSemi's LSL stream whose sender rebooted",
    ),
    _through("EPOC X, EPOC Flex, Insight (EmotivPRO's LSL outlet)", "Emotiv", {"eeg": _ANY_RATE["eeg"]}),
    _through("BITalino, biosignalsplux (OpenSignals' LSL output)", "PLUX", _ANY_RATE),
    _through("EyeLink (its LSL app)", "SR Research", {"eye_tracking": Offered("px", 250, 2000)}),
    _through("Core, Neon (their LSL relays)", "Pupil Labs", {"eye_tracking": Offered("1", math.nan)}),
    _through("Pro and Nano (the community's LSL app)", "Tobii", {"eye_tracking": Offered("1", 60, 1200)}),
)


@dataclass(frozen=True, kw_only=True)
class LslConfig(InletConfig):
    """Which outlets are the device, and what of them."""

    outlets: tuple[str, ...] = parameter(
        help="an LSL predicate for each outlet of the device; exactly one stream must fit each",
        example=("name='EmotivDataStream-EEG'",),
    )
    streams: tuple[str, ...] = parameter(
        (),
        help="what of them is which signal, each as `type: channel, channel [unit] * factor`; "
        "empty = what content types, channel types and labels tell",
    )
    markers: bool = parameter(True, help="publish what outlets of events say as markers of the study")
    silence_s: float = parameter(
        5.0,
        help="an outlet of a regular rate that sends nothing for so long, or for three samples, is lost",
        unit="s",
        low=3,
        high=600,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.outlets or not all(text.strip() for text in self.outlets):
            raise ValueError("outlets: give a predicate for each outlet, as in \"type='EEG' and name='BioSemi'\"")
        for text in self.outlets:
            if wrong := wrong_predicate(text):
                raise ValueError(
                    f"outlets {text!r}: {wrong}; an LSL predicate is as in \"type='EEG' and name='BioSemi'\""
                )
        parse_all(self.streams)

    @property
    def wanted(self) -> tuple[Wanted, ...]:
        """The streams as they are asked for."""
        return parse_all(self.streams)


def wrong_predicate(text: str) -> str:
    """Return what cannot be in an XPath predicate, empty where nothing is seen: liblsl says of a wrong one nothing.

    Only quotes, brackets and a comparison or function are looked at; names are whatever the description has.
    """
    bare = re.sub(r"'[^']*'|\"[^\"]*\"", "''", text)
    if re.search(r"['\"]", bare.replace("''", "")):
        return "a quote is not closed"
    depths = list(accumulate({"(": 1, "[": 1, ")": -1, "]": -1}.get(each, 0) for each in bare))
    if depths and (min(depths) < 0 or depths[-1]):
        return "brackets do not match"
    return "" if re.search(r"[=<>(]", bare) else "it compares nothing"

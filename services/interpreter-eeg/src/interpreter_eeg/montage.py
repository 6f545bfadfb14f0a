"""Which electrode a channel is, by its name. Pure.

Names are those of the 10-20 system and its extensions to 10-10 and 10-5 (Oostenveld & Praamstra 2001), as devices write
them: `EEG Fp1-REF`, `EEG.AF3`, `FP1`, `fp1.`; the older T3, T4, T5 and T6 are T7, T8, P7 and P8. BioSemi's own (A1 to
H32) say nothing of 10-20, though some are spelled alike.
"""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

POSITION = re.compile(r"(AFP|FFC|FCC|CCP|CPP|PPO|FFT|FTT|TTP|TPP|POO|FP|AF|FT|FC|TP|CP|PO|F|T|C|P|O|I)(Z|\d{1,2}H?)")
EARS = ("A1", "A2", "M1", "M2")
OLDER = {"T3": "T7", "T4": "T8", "T5": "P7", "T6": "P8"}
SPELLED = {"FP": "Fp", "AFP": "AFp"}
REFERENCES = "REF|LER?|AVE?G?|CAR|A1|A2|A1A2|M1|M2|M1M2"
DECORATION = re.compile(rf"^(EEG|RAW)[-_ .:]*|[-_ :/]+({REFERENCES})$|[. ]+$|[ _]*[(\[].?V[)\]]$", re.IGNORECASE)
NO_SCALP = re.compile(
    r"eog|^[vh]eo|exg|ecg|ekg|emg|aux|mark|trig|stat|^sti|count|time|pulse|photic|acc|gyr|resp|ppg|eda|gsr|temp|event",
    re.IGNORECASE,
)
BIOSEMI = re.compile(r"[A-H]([1-9]|[12]\d|3[0-2])")  # of its caps: the letter is a cable's; C3 is not that of 10-20
ONLY_BIOSEMI = re.compile(r"A([3-9]|[12]\d|3[0-2])|B([1-9]|[12]\d|3[0-2])")  # no place of 10-20 has such a name

LINKED = (("A1", "A2"), ("M1", "M2"), ("TP9", "TP10"))
PAIRS = (("F3", "F4"), ("F7", "F8"), ("F5", "F6"), ("F1", "F2"), ("AF3", "AF4"), ("AF7", "AF8"), ("Fp1", "Fp2"))
FOREHEAD = (("Fp1", "AF7", "AF3"), ("Fp2", "AF8", "AF4"), ("Fpz", "AFz"))  # left, right, middle
BEHIND = ("Fz", "F1", "F2", "F3", "F4")  # where blinks are looked for without one of them
FRONTAL = ("Fz", "F1", "F2", "F3", "F4", "FCz")  # theta of theta over alpha
PARIETAL = ("Pz", "P1", "P2", "P3", "P4", "POz")  # its alpha
POPE = ("Cz", "Pz", "P3", "P4")  # of the engagement index (Pope, Bogart & Bartolome 1995)
POSTERIOR = ("O1", "Oz", "O2", "PO3", "POz", "PO4", "PO7", "PO8", "Pz", "P3", "P4")  # where alpha has its peak


class Montage(NamedTuple):
    """The channels of one stream. scalp: shape (channels,), not of the ears, the eyes or another signal."""

    names: tuple[str, ...]
    columns: dict[str, int]  # by the position's usual name
    scalp: NDArray[np.bool_]

    def present(self, positions: tuple[str, ...]) -> list[int]:
        """Return the columns of those positions that there are, in their order."""
        return [self.columns[name] for name in positions if name in self.columns]

    def pairs(self) -> list[tuple[str, str]]:
        """Return the pairs (left, right) of frontal electrodes that there are; the one to be preferred first."""
        return [pair for pair in PAIRS if len(self.present(pair)) == len(pair)]

    def has_forehead(self) -> bool:
        """True where blinks can be seen."""
        return any(self.present(side) for side in FOREHEAD)

    def linked(self) -> list[int]:
        """Return the columns of both ears or mastoids; none where a side is missing."""
        return next((found for pair in LINKED if len(found := self.present(pair)) == len(pair)), [])


def position_of(name: str) -> str:
    """Return the usual name of an electrode's position, empty where the channel's name is none of a position."""
    bare = _bare(name)
    if bare in EARS:
        return bare
    match = POSITION.fullmatch(OLDER.get(bare, bare))
    return "" if match is None else SPELLED.get(match[1], match[1]) + match[2].lower()


def _bare(name: str) -> str:
    return DECORATION.sub("", DECORATION.sub("", name.strip())).upper()


def montage_of(names: tuple[str, ...]) -> Montage:
    """Return what the names of the channels say; of two channels with one position the first counts."""
    biosemi = any(ONLY_BIOSEMI.fullmatch(_bare(name)) for name in names)
    positions = ["" if biosemi and BIOSEMI.fullmatch(_bare(name)) else position_of(name) for name in names]
    columns = {position: positions.index(position) for position in positions if position}
    scalp = [p not in EARS and (p != "" or not NO_SCALP.search(name)) for p, name in zip(positions, names, strict=True)]
    return Montage(names, columns, np.array(scalp, bool))

"""Where EEG electrodes are, as far as their names tell: by which system of places they are named.

The 21 places of the 10-20 system (Jasper 1958; T3 to T6 are T7, T8, P7, P8 today), and those of the 10-10 system
(American Clinical Neurophysiology Society, guideline 2). Positions are not made of names:
docs/decisions/no-template-positions.md.
"""

import re
from collections.abc import Iterable

SYSTEMS = (
    ("10-20", r"Fp[12z]|[FCP][34z]|F[78]|T[3-8]|P[78]|O[12z]|[AM][12]"),
    ("10-10", r"Fp[12z]|(AF|F|FC|C|CP|P|PO)([1-9]|10|z)|(FT|T|TP)([3-9]|10)|O[12z]|[NI]z|[AM][12]"),
)


def placement_scheme(electrodes: Iterable[str]) -> str:
    """Return the system that all these names belong to, the one of fewer places first; "" where there is none."""
    names = list(electrodes)
    return next((system for system, form in SYSTEMS if names and all(_is_of(form, name) for name in names)), "")


def _is_of(form: str, name: str) -> bool:
    return re.fullmatch(form, name, re.IGNORECASE) is not None

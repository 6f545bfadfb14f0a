"""Units that files use, as factors to the canonical unit of their sensor type (contract, section 5)."""

import math
import re

from sense4hri.modalities import UNCALIBRATED, modality

VOLTS = {"V": 1e6, "mV": 1e3, "uV": 1.0, "nV": 1e-3}
GRAVITY = 9.80665
FACTORS: dict[str, dict[str, float]] = {
    "uV": VOLTS,
    "uS": {"uS": 1.0, "mS": 1e3, "nS": 1e-3, "S": 1e6},
    "m/s^2": {"m/s^2": 1.0, "m/s2": 1.0, "g": GRAVITY, "mg": GRAVITY / 1000},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "dps": math.pi / 180},
    "uT": {"uT": 1.0, "T": 1e6, "mT": 1e3, "nT": 1e-3, "G": 100.0, "mG": 0.1},
    "degC": {"degC": 1.0, "C": 1.0},
    "mm": {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3},
    "deg": {"deg": 1.0, "rad": 180 / math.pi},
    "N": {"N": 1.0, "mN": 1e-3},
}
SPELT = {"microvolts": "uV", "microvolt": "uV", "volts": "V", "Volt": "V", "microsiemens": "uS", "pixels": "px",
         "pixel": "px", "normalized": "1", "normalised": "1", "millimeters": "mm", "adu": "counts", "°C": "degC",
         "ADU": "counts", "au": "a.u.", "AU": "a.u.", "NU": "a.u."}  # fmt: skip


def spelt(unit: str) -> str:
    """Return a unit as this project spells it: the micro sign is u."""
    plain = re.sub("[\u00b5\u03bc]", "u", unit.strip())
    return SPELT.get(plain, plain)


def canonical(sensor_type: str, unit: str) -> tuple[str, float] | None:
    """Return the canonical unit that a unit of this sensor type becomes, and the factor; None where it becomes none.

    A sensor type that the contract does not know keeps its unit.
    """
    plain, units = spelt(unit), modality(sensor_type).units
    for target in units:
        if (factor := FACTORS.get(target, {}).get(plain)) is not None:
            return target, factor
    return (plain, 1.0) if not units or plain in (*units, *UNCALIBRATED) else None

"""Units that files use, and what makes them the canonical unit of their sensor type (contract, section 5)."""

import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.modalities import UNCALIBRATED, modality

VOLTS = {"V": 1e6, "mV": 1e3, "uV": 1.0, "nV": 1e-3}
GRAVITY = 9.80665
FACTORS: dict[str, dict[str, float]] = {
    "uV": VOLTS,
    "uS": {"uS": 1.0, "mS": 1e3, "nS": 1e-3, "S": 1e6},
    "m/s^2": {"m/s^2": 1.0, "m/s2": 1.0, "g": GRAVITY, "G": GRAVITY, "mg": GRAVITY / 1000, "mG": GRAVITY / 1000},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "dps": math.pi / 180},
    "uT": {"uT": 1.0, "T": 1e6, "mT": 1e3, "nT": 1e-3, "G": 100.0, "mG": 0.1, "gauss": 100.0, "milligauss": 0.1},
    "degC": {"degC": 1.0, "C": 1.0},
    "mm": {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3},
    "deg": {"deg": 1.0, "rad": 180 / math.pi},
    "N": {"N": 1.0, "mN": 1e-3},
}
OVER: dict[str, dict[str, float]] = {"uS": {"ohm": 1e6, "kohm": 1e3, "Mohm": 1.0}}
"""What becomes the canonical unit as a factor over it: a resistance is one over a conductance."""
_WORDS = {
    "uV": "uv uvolt uvolts microv microvolt microvolts micro-volt micro-volts muv",
    "mV": "mv millivolt millivolts mvolt mvolts",
    "nV": "nv nanovolt nanovolts",
    "V": "v volt volts",
    "uS": "usiemens microsiemens micro-siemens microsiemen umho micromho micromhos",
    "nS": "nanosiemens",
    "mS": "millisiemens millisiemen",
    "S": "siemens",
    "ohm": "ohm ohms",
    "kohm": "kohm kohms kiloohm kiloohms kilo-ohm kilo-ohms",
    "Mohm": "mohm mohms megohm megohms megaohm megaohms mega-ohm mega-ohms",
    "m/s^2": "m/s2 m/s/s ms-2 m/sec2 meters/second2 meters_per_second_squared metres_per_second_squared",
    "g": "g-force gforce gravity",
    "mg": "milli-g millig",
    "rad/s": "radians/second radians/s rad/sec rads-1 rad_per_second radians_per_second",
    "deg/s": "degrees/second degrees/s degree/s deg/sec degs-1 dps degrees_per_second degree_per_second deg_per_second",
    "uT": "ut utesla microtesla microteslas",
    "mT": "millitesla",
    "nT": "nanotesla",
    "T": "tesla",
    "gauss": "gauss gs",
    "milligauss": "milligauss mgauss",
    "degC": "degc deg_c celsius degrees_celsius degree_celsius degreecelsius",
    "mm": "millimeter millimeters millimetre millimetres",
    "deg": "degree degrees dva",
    "rad": "radian radians",
    "px": "pixel pixels pix",
    "1": "normalized normalised norm unitless dimensionless",
    "N": "newton newtons",
    "counts": "count adu adc lsb",
    "a.u.": "au nu arbitrary arbitrary_units",
}
_BETWEEN = re.compile(r"[\s_.*^()\[\]]+")  # signs between words and exponents, which everybody writes otherwise
SPELT = {_BETWEEN.sub("", word): unit for unit, words in _WORDS.items() for word in words.split()}
KNOWN = {unit for factors in (*FACTORS.values(), *OVER.values()) for unit in factors} | {"px", "1", *UNCALIBRATED}
SIGNS = str.maketrans(
    dict(
        zip(
            "\u00b5\u03bc\u00b0\u00ba\u2103\u00b9\u00b2\u207b\u2212\u00b7\u22c5\u03a9\u2126",
            ("u", "u", "deg", "deg", "degC", "1", "^2", "-", "-", "*", "*", "ohm", "ohm"),
            strict=True,
        )
    )
)


class Scale(NamedTuple):
    """What makes a value canonical: the factor times it, or the factor over it."""

    factor: float = 1.0
    over: bool = False

    def after(self, factor: float) -> "Scale":
        """Return this scale for values that are first multiplied by another factor, both in one step."""
        return self._replace(factor=self.factor / factor if self.over else self.factor * factor)


def scaled(values: NDArray[Any], scales: Sequence[Scale]) -> NDArray[np.float64]:
    """Return values of shape (n, channels) in the canonical unit, each channel by its scale.

    NaN where a resistance cannot be: 0, below 0 or infinite.
    """
    factors, over = np.array([scale.factor for scale in scales]), [scale.over for scale in scales]
    if not any(over):
        return np.asarray(values * factors)
    ratios = factors / np.where(values, values, np.nan)
    return np.where(over, np.where(np.isfinite(values) & (ratios > 0), ratios, np.nan), values * factors)


def spelt(unit: str) -> str:
    """Return a unit as this project spells it: the micro sign is u, words, capitals and spaces do not matter."""
    plain = unit.strip().translate(SIGNS)
    return plain if plain in KNOWN else SPELT.get(_BETWEEN.sub("", plain.lower()), plain)


def canonical(sensor_type: str, unit: str) -> tuple[str, Scale] | None:
    """Return the canonical unit that a unit of this sensor type becomes, and the scale; None where it becomes none.

    A sensor type that the contract does not know keeps its unit.
    """
    plain, units = spelt(unit), modality(sensor_type).units
    for target in units:
        if (factor := FACTORS.get(target, {}).get(plain)) is not None:
            return target, Scale(factor)
        if (factor := OVER.get(target, {}).get(plain)) is not None:
            return target, Scale(factor, over=True)
    return (plain, Scale()) if not units or plain in (*units, *UNCALIBRATED) else None

"""Whether a channel only wanders, as a random walk does, or breathes, and is no skin. Stateless; on the grid of 10 Hz.

Sweat fills a duct fast and leaves it slowly, so the steep changes of skin have one sign, and within a second they are
smooth. The steps of a walk know nothing of each other: the power of its changes grows as the time between them does,
and they fall as steeply as they rise. So does what a chest moves, again and again after the same time.
"""

import numpy as np
from numpy.typing import NDArray
from sense4hri.slow import GRID_HZ

SHORT_S = 0.5  # changes over this and over twice this are compared
GROWS = (1.6, 2.6)  # power of the longer over that of the shorter changes: noise 1, a walk 2, skin 3 to 4
ALIKE = 0.7  # skewness of changes: below it falls are like rises; skin has 1.4 to 5, of either sign by the amplifier
NEEDS_S = 15.0  # of signal without a hole
SWINGS = (30.0, (2.0, 8.0)), (55.0, (8.0, 20.0))  # looked at, and periods: of breaths, of a cable or a hand that sways
EVENLY = 0.4  # autocorrelation of changes after one period and after two
DOUBT = 0.5  # by which the quality is multiplied

Floats = NDArray[np.float64]


def wanders(raw: Floats) -> bool:
    """Return whether the changes of raw, shape (n,) without NaN, are those of a random walk; False for too few."""
    if len(raw) < NEEDS_S * GRID_HZ:
        return False
    short, long = (_changes(raw, times * SHORT_S) for times in (1, 2))
    power = float(short @ short) / len(short)
    if not power > 0:
        return False
    grows = float(long @ long) / len(long) / power
    return GROWS[0] < grows < GROWS[1] and abs(_skewness(short)) < ALIKE


def breathes(raw: Floats) -> bool:
    """Return whether the newest of raw, shape (n,) without NaN, rises and falls alike and evenly, as a chest does."""
    return any(_swings(raw, look_s, period_s) for look_s, period_s in SWINGS)


def _swings(raw: Floats, look_s: float, period_s: tuple[float, float]) -> bool:
    """Return whether the newest look_s of raw rise and fall alike, and again after one and two such periods."""
    changes = _changes(raw[-round(look_s * GRID_HZ) :], SHORT_S)
    first, last = (round(each_s * GRID_HZ) for each_s in period_s)
    if len(raw) < look_s * GRID_HZ or not changes.any() or abs(_skewness(changes)) >= ALIKE:
        return False
    changes = changes - changes.mean()
    alike = np.array([np.mean(changes[lag:] * changes[: len(changes) - lag]) for lag in range(2 * last + 2)])
    alike /= max(float(alike[0]), 1e-300)
    period = first + int(np.argmax(alike[first : last + 1]))
    again = float(alike[2 * period - 1 : 2 * period + 2].max())
    return min(float(alike[period]), again) > EVENLY and float(alike[:period].min()) < 0


def _changes(raw: Floats, over_s: float) -> Floats:
    lag = round(over_s * GRID_HZ)
    return raw[lag:] - raw[:-lag]


def _skewness(values: Floats) -> float:
    """Of values, shape (n,); 0 where they do not differ."""
    off = values - values.mean()
    spread = float(off.std())
    return float(np.mean((off / spread) ** 3)) if spread > 0 else 0.0

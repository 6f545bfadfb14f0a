"""Signal quality on a ladder: whatever spoils a signal lowers it on average, step by step."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

STEPS = (0, 1, 2, 4)


def held(samples: Any, fs_hz: float, share: float, every_s: float) -> Any:
    """Samples, shape (n, ...), of a device that repeats its last value for this share of every so many seconds."""
    out, every = samples.copy(), round(every_s * fs_hz)
    for begin in range(every // 2, len(out), every):
        out[begin : begin + round(share * every)] = out[begin]
    return out


def played_once(play: Callable[..., Sequence[Any]]) -> Callable[..., Sequence[Any]]:
    """play(samples, ...), which plays equal samples with equal settings once: every ladder begins with the same signal.

    The settings must be hashable, and nobody may change the updates.
    """
    known: dict[Any, Sequence[Any]] = {}

    def updates(samples: Any, *settings: Any, **named: Any) -> Sequence[Any]:
        key = (samples.shape, samples.dtype, samples.tobytes(), settings, tuple(named.items()))
        if key not in known:
            known[key] = play(samples, *settings, **named)
        return known[key]

    return updates


def assert_falls(updates: Callable[[int], Sequence[Any]], least: float = 0.9) -> None:
    """Assert that the mean quality begins above least and falls with every step; where it is not known it counts as 0.

    updates(k): those of the signal that is spoilt k times.
    """
    means = [float(np.nan_to_num([update.signal_quality for update in updates(k)]).mean()) for k in STEPS]
    assert means[0] > least, means
    assert all(one > other for one, other in pairwise(means)), means

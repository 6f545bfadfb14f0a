"""Clock-model arithmetic (contract, section 3): device time to ROS time."""

from typing import overload

import numpy as np
from numpy.typing import NDArray

from sense4hri.stamps import SECOND_NS

EARLIEST_NS, LATEST_NS = -60 * SECOND_NS, 2 * SECOND_NS
"""Corrected time lies so far from receipt at most; beyond it the device time is of another clock, or another epoch."""


@overload
def ros_ns(device_ns: int, reference_ns: int, offset_ns: int, skew_ppm: float) -> int: ...
@overload
def ros_ns(device_ns: NDArray[np.int64], reference_ns: int, offset_ns: int, skew_ppm: float) -> NDArray[np.int64]: ...
def ros_ns(
    device_ns: int | NDArray[np.int64], reference_ns: int, offset_ns: int, skew_ppm: float
) -> int | NDArray[np.int64]:
    """Return the ROS time in ns at which a sample of device time device_ns was taken, as far as known.

    Only the difference to the reference is scaled, so int64 nanoseconds keep their last digit.
    """
    if isinstance(device_ns, np.ndarray):
        skewed = np.rint(skew_ppm * 1e-6 * (device_ns - reference_ns)).astype(np.int64)
        return device_ns + offset_ns + skewed
    return device_ns + offset_ns + round(skew_ppm * 1e-6 * (device_ns - reference_ns))


def event_ns(received_ns: int, device_ns: int | None, offset_ns: int | None) -> int:
    """Return the host's time of an event; its receipt where its device time is not of the clock that was measured.

    offset_ns: host's time less device time, as last measured; None = not yet.
    """
    if device_ns is None or offset_ns is None:
        return received_ns
    return device_ns + offset_ns if EARLIEST_NS <= device_ns + offset_ns - received_ns <= LATEST_NS else received_ns

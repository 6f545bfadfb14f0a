"""Clock-model arithmetic (contract, section 3): device time to ROS time."""

from collections.abc import Iterable
from typing import overload

import numpy as np
from numpy.typing import NDArray

from sense4hri.stamps import SECOND_NS

BEFORE_RECEIPT_NS, AFTER_RECEIPT_NS = 60 * SECOND_NS, 2 * SECOND_NS


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


def fits(corrected_ns: int, received_ns: int) -> bool:
    """Return False where corrected time is too far from receipt: the device time is of another clock, or epoch."""
    return -BEFORE_RECEIPT_NS <= corrected_ns - received_ns <= AFTER_RECEIPT_NS


def nearest_ns(corrected_ns: Iterable[int], received_ns: int) -> int | None:
    """Return that of some corrected times, one by each epoch of a device's clock, which is nearest to receipt.

    None where none fits: the device time is of another clock.
    """
    fitting = (each_ns for each_ns in corrected_ns if fits(each_ns, received_ns))
    return min(fitting, key=lambda each_ns: abs(each_ns - received_ns), default=None)


def event_ns(received_ns: int, device_ns: int | None, offset_ns: int | None) -> int:
    """Return the host's time of an event; its receipt where its device time is not of the clock that was measured.

    offset_ns: host's time less device time, as last measured; None = not yet.
    """
    if device_ns is None or offset_ns is None:
        return received_ns
    return device_ns + offset_ns if fits(device_ns + offset_ns, received_ns) else received_ns

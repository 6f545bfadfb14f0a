"""Clock-model arithmetic (contract, section 3): device time to ROS time."""

from typing import overload

import numpy as np
from numpy.typing import NDArray


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

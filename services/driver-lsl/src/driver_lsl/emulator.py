"""A device that exists only here, in its own bytes: for tests, and to run without hardware."""

import time

import numpy as np

from driver_lsl.protocol import RATE_HZ

FRAME = 2  # samples


class Emulator:
    """Sends a frame of a slow wave every fifth of a second."""

    def __init__(self) -> None:
        self._sent = 0

    def read(self) -> bytes | None:
        """Wait for the next frame and return it."""
        time.sleep(FRAME / RATE_HZ)
        return self.frame()

    def frame(self) -> bytes:
        """Return the next frame."""
        self._sent += FRAME
        index = np.arange(self._sent - FRAME, self._sent)
        counts = (5000 + 1000 * np.sin(index / 20)).astype("<u2")
        return round(self._sent * 1000 / RATE_HZ).to_bytes(4, "little") + counts.tobytes()

    def close(self) -> None:
        """Nothing to let go of."""

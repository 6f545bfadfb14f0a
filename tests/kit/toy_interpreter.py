"""An interpreter that counts samples: one update a second with the number of samples since the last one."""

import sys
from dataclasses import dataclass
from typing import NamedTuple

from sense4hri.chunk import TimedChunk
from sense4hri.grid import UpdateGrid
from sense4hri.interpreter import run_interpreter
from sense4hri.stream_info import StreamInfo
from sense4hri_msgs.msg import ECG


@dataclass(frozen=True)
class Config:
    update_interval_s: float = 1.0


class Count(NamedTuple):
    device_ns: int | None
    received_ns: int
    n: int
    device_rate: float


class Counter:
    def __init__(self, config: Config, info: StreamInfo) -> None:
        self._grid, self._n, self._rate = UpdateGrid(config.update_interval_s), 0, float("nan")

    def push(self, timed: TimedChunk) -> list[Count]:
        updates = []
        for piece, due in self._grid.split(timed):
            self._n += len(piece.times_ns)
            if due:
                updates.append(Count(piece.device_ns, piece.received_ns, self._n, self._rate))
                self._n = 0
        return updates

    def device_reported(self, name: str, value: float, received_ns: int) -> None:
        self._rate = value


def fill(message: ECG, count: Count) -> None:
    message.peak_count = count.n
    message.heart_rate_bpm = count.device_rate


if __name__ == "__main__":
    sys.exit(run_interpreter("toy_interpreter", Config, "ecg", Counter, ECG, fill))

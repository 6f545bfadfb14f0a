"""What outlets send: simulated signals of a participant by true time. Pure."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sensor_bench.lsl.machine import Outlet
from sensor_bench.signals.hearts import Rhythm
from sensor_bench.signals.sources import EcgSource, Noise, Wearing
from sensor_bench.signals.waveforms import stored

FloatArray = NDArray[np.float64]
FRONT = ("Fp1", "Fp2", "F7", "F3", "Fz", "F4", "F8", "FC5", "FC1", "FC2", "FC6", "AFz", "T7", "C3", "Cz", "C4")
BACK = ("T8", "TP9", "CP5", "CP1", "CP2", "CP6", "TP10", "P7", "P3", "Pz", "P4", "P8", "POz", "O1", "Oz", "O2")
ELECTRODES = tuple(name for pair in zip(FRONT, reversed(BACK), strict=True) for name in pair)
MARKER_S = 2.0
BLINK_S, BLINKS_S = 0.2, 4.0


class Taken(NamedTuple):
    """Samples of one outlet: true times in s since the start, shape (n,), and rows, shape (n, channels), or texts."""

    outlet: int
    times_s: FloatArray
    rows: "FloatArray | list[list[str]]"


class Feed(Protocol):
    """The outlets of one device, the sensor types that each carries (none = events), and their samples."""

    @property
    def outlets(self) -> Sequence[Outlet]: ...
    @property
    def types(self) -> Sequence[tuple[str, ...]]: ...

    def taken(self, from_s: float, to_s: float) -> list[Taken]: ...


class EcgFeed:
    """One channel in millivolts, the participant's heart."""

    types = (("ecg",),)

    def __init__(self, name: str, source_id: str, rate_hz: float, heart: Rhythm, seed: int) -> None:
        self.outlets = (Outlet(name, "ECG", source_id, rate_hz, "float32", (("I", "millivolts", "ECG"),)),)
        self._rate_hz, self._source = rate_hz, EcgSource(heart, Wearing(), stored(), seed)

    def taken(self, from_s: float, to_s: float) -> list[Taken]:
        index = within(from_s, to_s, self._rate_hz)
        if not len(index):
            return []
        return [Taken(0, index / self._rate_hz, self._source.read(int(index[0]), len(index), self._rate_hz) / 1000.0)]


class EegFeed:
    """Alpha of 10 Hz, strongest at the back of the head, and noise; a trigger channel, and an outlet of markers."""

    types = (("eeg", "markers"), ())

    def __init__(self, name: str, source_id: str, rate_hz: float, channels: int, seed: int) -> None:
        labels = [(label, "µV", "EEG") for label in ELECTRODES[:channels]]
        self.outlets = (
            Outlet(name, "EEG", source_id, rate_hz, "float32", (*labels, ("TRG", "code", "Trigger"))),
            Outlet(f"{name} Markers", "Markers", f"{source_id}-markers", 0.0, "string", (("marker", "", ""),) * 2),
        )
        self._rate_hz, self._noise = rate_hz, Noise(seed, len(labels))
        self._alpha_uv = 6.0 + 8.0 * np.linspace(0.0, 1.0, len(labels))

    def taken(self, from_s: float, to_s: float) -> list[Taken]:
        index, marks = within(from_s, to_s, self._rate_hz), within(from_s, to_s, 1 / MARKER_S)
        found = []
        if len(index):
            times_s = np.asarray(index / self._rate_hz, np.float64)
            alpha = np.sin(2 * np.pi * 10.0 * times_s)[:, None] * self._alpha_uv
            rows = alpha + 6.0 * self._noise.at(int(index[0]), len(index))
            code = (np.floor(times_s / MARKER_S) % 250 + 1)[:, None]
            found.append(Taken(0, times_s, np.hstack([rows, code]).astype(np.float64)))
        if len(marks):
            found.append(
                Taken(
                    1,
                    np.asarray(marks * MARKER_S, np.float64),
                    [["stimulus", f"face {int(number)}"] for number in marks],
                )
            )
        return found


class GazeFeed:
    """Irregular gaze over a screen, 0 to 1, with confidence; pupils in millimetres that follow the breath."""

    types = (("eye_tracking", "pupillometry"),)

    def __init__(self, name: str, source_id: str, rate_hz: float, heart: Rhythm, seed: int) -> None:
        channels = (("gaze_x", "normalized", ""), ("gaze_y", "normalized", ""), ("confidence", "", ""),
                    ("diameter_left", "millimeters", ""), ("diameter_right", "millimeters", ""))  # fmt: skip
        self.outlets = (Outlet(name, "Gaze", source_id, 0.0, "float32", channels),)
        self._rate_hz, self._heart, self._noise = rate_hz, heart, Noise(seed, 4)

    def taken(self, from_s: float, to_s: float) -> list[Taken]:
        index = within(from_s, to_s, self._rate_hz)
        if not len(index):
            return []
        noise = self._noise.at(int(index[0]), len(index))
        times_s = index / self._rate_hz
        looked = np.floor(times_s / 0.4)[:, None]  # a new place every 0.4 s
        gaze = 0.5 + 0.3 * np.sin(looked * np.array([1.7, 2.9])) + 0.002 * noise[:, :2]
        shut = (times_s % BLINKS_S < BLINK_S)[:, None]
        pupil = 3.5 + 0.2 * self._heart.breathing(times_s)[:, None] + 0.01 * noise[:, 2:]
        return [
            Taken(
                0, times_s, np.hstack([gaze, np.where(shut, 0.0, 1.0), np.where(shut, 0.0, pupil)]).astype(np.float64)
            )
        ]


def within(from_s: float, to_s: float, rate_hz: float) -> NDArray[np.int64]:
    """Return the numbers of the samples that are taken from from_s on, before to_s."""
    return np.arange(int(np.ceil(from_s * rate_hz - 1e-9)), int(np.ceil(to_s * rate_hz - 1e-9)))

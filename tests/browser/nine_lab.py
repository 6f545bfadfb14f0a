"""One person with nine modalities before the page, without ROS. Run alone it prints its address and waits for Enter."""

import sys
from typing import Any

import numpy as np
from gui_lab import HEALTH, Lab
from nine_modalities import BPM, NINE, Kind, stamps, tell_breathing_of_heart
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from web_gui.intake import plain
from web_gui.stream import Info

BEHIND_S = 1200.5  # of the devices' clock
CLOCK = {
    "device_reference": 0,
    "offset_ns": round(BEHIND_S * 1e9),
    "skew_ppm": 0.0,
    "uncertainty_s": 0.0008,
    "latency_s": 0.02,
    "segment": 1,
    "state": 1,
}
QUALITY = {"ecg": 0.97, "emg": 0.91, "eeg": 0.88, "eye_tracking": 0.93}


OF_HEART = "p1/respiration/ecg_1_ecg"


def key(sensor_type: str) -> str:
    """Return the stream of a modality."""
    return f"p1/{sensor_type}/{sensor_type}_1"


class Nine(Lab):
    """Signals and features of all of them; what happened when can be calculated (nine_modalities.py)."""

    def __init__(self) -> None:
        super().__init__()
        self._next: dict[str, int] = {}
        self._told_s = 0

    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of everything end at a time."""
        for kind in NINE:
            self._raw(kind, at_ns, seconds)
        until_s = at_ns // 10**9
        if until_s > self._told_s:
            since_s, self._told_s = self._told_s or until_s - 1, until_s
            for kind in NINE:
                self._tell(kind, since_s, until_s, at_ns)
            self._tell_breathing_of_heart(until_s, at_ns)
            self.study.take_state("p1", self._state(), at_ns)

    def _raw(self, kind: Kind, at_ns: int, seconds: float) -> None:
        stream = self.study.stream(StreamName(*key(kind.sensor_type).split("/")), at_ns)
        if stream.info is None:
            stream.learn(Info(kind.rate_hz, kind.unit, {"vendor": "Laboratory", "model": "synthetic"}))
        end = int(at_ns / 1e9 * kind.rate_hz)
        first = self._next.get(kind.sensor_type, end - round(seconds * kind.rate_hz))
        self._next[kind.sensor_type] = end
        times_s = np.arange(first, end) / kind.rate_hz
        last_ns = round(times_s[-1] * 1e9)
        stream.raw(Chunk(kind.channels, kind.make(times_s), last_ns - round(BEHIND_S * 1e9), last_ns), at_ns)
        stream.take_clock(CLOCK, at_ns)
        stream.take_health(HEALTH | {"battery_percent": 80.0}, at_ns)

    def _tell(self, kind: Kind, since_s: float, until_s: float, at_ns: int) -> None:
        told = kind.tell(since_s, until_s)
        told.signal_quality, told.window_s = QUALITY.get(kind.sensor_type, 0.95), 10.0
        told.device_timestamp = stamps(np.array([until_s]))[0]
        self.study.streams[StreamName(*key(kind.sensor_type).split("/"))].take_features(_behind(plain(told)), at_ns)

    def _tell_breathing_of_heart(self, until_s: float, at_ns: int) -> None:
        """A stream without samples: features alone."""
        told = tell_breathing_of_heart(until_s)
        told.signal_quality, told.window_s = 0.85, 30.0
        told.device_timestamp = told.header.stamp = stamps(np.array([until_s]))[0]
        self.study.stream(StreamName(*OF_HEART.split("/")), at_ns).take_features(_behind(plain(told)), at_ns)

    def _state(self) -> dict[str, Any]:
        return {
            "state": "calm_relaxed",
            "confidence": 0.8,
            "heart_rate_bpm": BPM,
            "expression": "neutral",
            "reasons": [],
        }


def _behind(told: dict[str, Any]) -> dict[str, Any]:
    """Return a features message with its times on the device's clock."""
    shift_ns = round(BEHIND_S * 1e9)
    told["device_timestamp"] -= shift_ns
    for name, value in told.items():
        if name.endswith("_timestamps"):
            told[name] = [t - shift_ns for t in value]
    return told


if __name__ == "__main__":
    with Nine() as nine:
        print(nine.address, flush=True)
        sys.stdin.readline()

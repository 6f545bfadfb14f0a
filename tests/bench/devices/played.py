"""What became of ten emulated minutes of a device: counted as the kit counts, timed as clock-sync does."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from clock_sync.estimator import ClockEstimator
from sense4hri.chunk import Break, Chunk
from sense4hri.device import ClockMeasurement, Samples
from sense4hri.holes import Holes
from sense4hri.sample_clock import SampleClock

SIGNAL_S, LOSS = 600.0, 0.01
CODEC_TIMES, TIME_P95_MS = 20.0, 2.0
SETTLED_S = 120.0
"""From then on the clock model is judged."""


class Tally:
    """Counts the samples of one stream as the kit's outlet does, and follows its clock as clock-sync does."""

    def __init__(self, nominal_hz: float) -> None:
        self.came = self.lost = self.restarts = 0
        self._clock, self._holes = SampleClock(nominal_hz), Holes(nominal_hz) if nominal_hz > 0 else None
        self._estimator = ClockEstimator()
        self.errors_ms: list[float] = []

    def take(self, samples: Samples, true_ns: int | None = None) -> None:
        """Count. true_ns: host time at which the newest sample was taken, where the device has a clock."""
        cut = samples.times_ns is not None and self._holes is not None
        for chunk in self._holes.cut(samples.chunk, samples.times_ns) if cut else [samples.chunk]:
            self._place(chunk)
        self.lost += samples.lost or 0
        if true_ns is not None and samples.chunk.device_ns is not None:
            self._estimator.packet(samples.sensor_type, samples.chunk.device_ns, samples.chunk.received_ns)
            error_ns = self._estimator.model().ros_ns(samples.chunk.device_ns) - true_ns
            self.errors_ms.append(error_ns * 1e-6)

    def measured(self, clock: ClockMeasurement) -> None:
        """Take in what the driver has measured of its device's clock in both directions."""
        self._estimator.measurement(clock.received_ns, clock.device_ns, clock.offset_ns, clock.uncertainty_s)

    def _place(self, chunk: Chunk) -> None:
        timed = self._clock.place(chunk)
        self.came += len(chunk.samples)
        self.lost += timed.lost if timed.break_ is Break.GAP else 0
        self.restarts += timed.break_ is Break.RESET

    def settled_ms(self) -> list[float]:
        """Return the errors of the clock model from the second minute on."""
        return self.errors_ms[int(SETTLED_S / SIGNAL_S * len(self.errors_ms)) :]


@dataclass(frozen=True)
class Played:
    """What became of ten emulated minutes.

    sent, lost: samples that the device took, and that were taken from its bytes. came, counted: what the driver handed
    on, and said was missing. codec_s: CPU of the codec. errors_ms: of the clock model at every frame from the second
    minute on; empty where there is no clock. uncounted: why nobody can count what the device has lost, where it is so.
    """

    device: str
    sent: int
    lost: int
    came: int
    counted: int
    codec_s: float
    errors_ms: list[float] = field(default_factory=list)
    uncounted: str = ""


class Lossy:
    """Loses packets of a pure virtual device, none while `careful`, and counts the samples of one stream."""

    def __init__(self, stream: str) -> None:
        self.sent = self.lost = 0
        self.careful = False
        self._random, self._stream = np.random.default_rng(2), stream

    def carry(self, packet: bytes, **samples: int) -> bytes:
        """The packet, or nothing."""
        count = samples.get(self._stream, 0)
        gone = not self.careful and self._random.random() < LOSS
        self.sent += count
        self.lost += count * gone
        return b"" if gone else packet


def codec_rows(played: Played) -> list[dict[str, Any]]:
    """Rows of one driver's ten emulated minutes."""
    times = SIGNAL_S / max(played.codec_s, 1e-9)
    rows = [
        _kept(played),
        row(f"{played.device}: codec", f">= {CODEC_TIMES:g}x", f"{times:.0f}x real time", times >= CODEC_TIMES),
    ]
    if played.errors_ms:
        p95 = float(np.percentile(np.abs(played.errors_ms), 95))
        what = f"{played.device}: device time after clock-sync, p95"
        rows.append(row(what, f"<= {TIME_P95_MS:g} ms", f"{p95:.2f} ms", p95 <= TIME_P95_MS))
    return rows


def _kept(played: Played) -> dict[str, Any]:
    """Row of what became of a device's samples; where losses cannot be counted, of what arrived alone."""
    sent, lost, came, counted = played.sent, played.lost, played.came, played.counted
    if played.uncounted:
        what = f"{played.device}: came, {LOSS:.0%} lost, restart; losses cannot be counted: {played.uncounted}"
        return row(what, "all that arrived, exactly", f"{came} of {sent}, {lost} lost", came == sent - lost)
    what, told = (
        f"{played.device}: came + counted, {LOSS:.0%} lost, restart",
        f"{came} + {counted} of {sent}, {lost} lost",
    )
    return row(what, "all, exactly", told, came + counted == sent and counted == lost)


def row(what: str, target: str, measured: str, ok: bool | None) -> dict[str, Any]:
    """Return a row as run.py wants it."""
    return {"what": what, "target": target, "measured": measured, "ok": ok}

"""What a sensor's firmware makes of its wearer, each value at its time: frames, pulse intervals, heart rates."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

from sensor_bench.ble.peripheral import Outgoing
from sensor_bench.ble.values import heart_rate_measurement
from sensor_bench.clock import DeviceClock, HostClock
from sensor_bench.device import Counts
from sensor_bench.polar import pmd
from sensor_bench.polar.body import Body
from sensor_bench.polar.control import ControlPoint, Settings
from sensor_bench.polar.models import FRAME_BUDGET, Stream
from sensor_bench.polar.pmd import Measurement
from sensor_bench.signals.hearts import Beat
from sensor_bench.signals.sources import Source

HEART_RATE_INTERVAL_S = 1.0
SLOW_HEART_RATE_INTERVAL_S = 5.0
"""Heart-rate notifications while the PPI algorithm runs."""
BEAT_DELAY_S = 0.4
"""A beat is known to the firmware that long after its R peak or pulse."""
RATE_BEATS = 8
"""The reported heart rate is the mean over that many RR intervals."""
MOST_SAMPLES = 64
"""A compressed frame is sent with that many samples even if more would fit."""


@dataclass
class Firmware:
    """Every method yields for ever, waiting for the time of each value; what has been asked for is in `control`."""

    body: Body
    control: ControlPoint
    host: HostClock
    clock: DeviceClock
    start_ns: int
    """Host time zero of all sources."""
    rate_factor: float = 1.0
    """Real sampling rates are the nominal ones times this, in true time."""
    ppi_delay_s: float = 25.0
    counts: dict[str, Counts] = field(default_factory=dict)
    garbled_frames: int = 0
    """So many of the next data frames are cut short."""

    def __post_init__(self) -> None:
        for stream in self.control.model.streams:
            self.counts.setdefault(stream.name, Counts())

    def now_s(self) -> float:
        return (self.host.now_ns() - self.start_ns) * 1e-9

    async def frames(self, stream: Stream, settings: Settings) -> AsyncIterator[Outgoing]:
        """Sample on the device's own grid; send a frame when its last sample has been taken."""
        fs_hz = settings.rate_hz * self.rate_factor
        source = self.body.sources[stream.name]
        counts = self.counts[stream.name]
        index = int(self.now_s() * fs_hz) + 1
        while True:
            content, count = self._content(stream, source, index, fs_hz)
            last_ns = self.start_ns + round((index + count - 1) / fs_hz * 1e9)
            await self._until(last_ns)
            frame = pmd.frame(
                stream.measurement, self.clock.read_ns(last_ns), stream.frame_type, content, stream.compressed
            )
            yield Outgoing(self._garbled(frame), last_ns, counts, count)
            index += count

    def _garbled(self, frame: bytes) -> bytes:
        if self.garbled_frames == 0:
            return frame
        self.garbled_frames -= 1
        # 13 content bytes are no whole number of samples in any raw layout, and end inside the first block of deltas
        return frame[: min(len(frame) - 1, pmd.HEADER_BYTES + 13)]

    @staticmethod
    def _content(stream: Stream, source: Source, index: int, fs_hz: float) -> tuple[bytes, int]:
        if stream.compressed:
            samples = source.read(index, MOST_SAMPLES, fs_hz)
            return pmd.fit_delta(samples, stream.sample_bytes, FRAME_BUDGET)
        samples = source.read(index, stream.frame_samples, fs_hz)
        return pmd.signed_content(samples, stream.sample_bytes), stream.frame_samples

    async def pulse_intervals(self, stream: Stream) -> AsyncIterator[Outgoing]:
        """Pulse intervals in batches of about five seconds, the first after the algorithm has settled."""
        counts = self.counts[stream.name]
        next_ns = self.host.now_ns() + round(self.ppi_delay_s * 1e9)
        since_s = self.now_s() + max(0.0, self.ppi_delay_s - SLOW_HEART_RATE_INTERVAL_S)
        while True:
            await self._until(next_ns)
            now_s = (next_ns - self.start_ns) * 1e-9
            beats = self._known_beats(since_s, now_s) if self.body.wearing.contact else []
            since_s = now_s
            if beats:
                rate = self._heart_rate_bpm(now_s)
                intervals = [pmd.PulseInterval(rate, round(beat.rr_s * 1000), 10) for beat in beats]
                taken_ns = self.start_ns + round((beats[-1].time_s + self.body.pulse_delay_s) * 1e9)
                frame = pmd.frame(stream.measurement, self.clock.read_ns(taken_ns), 0, pmd.ppi_content(intervals))
                yield Outgoing(frame, next_ns, counts, len(beats))
            next_ns += round(SLOW_HEART_RATE_INTERVAL_S * 1e9)

    async def heart_rates(self) -> AsyncIterator[Outgoing]:
        """Heart Rate Measurement values once a second, with the RR intervals that ended since the last one."""
        model, next_ns = self.control.model, self.host.now_ns()
        sent_until_s = self.now_s()
        while True:
            ppi_runs = Measurement.PPI in self.control.running
            next_ns += round(1e9 * (SLOW_HEART_RATE_INTERVAL_S if ppi_runs else HEART_RATE_INTERVAL_S))
            await self._until(next_ns)
            now_s = self.now_s()
            if self.control.sdk_mode:
                continue
            contact = self.body.wearing.contact
            beats = self._known_beats(sent_until_s, now_s) if contact else []
            sent_until_s = now_s
            value = heart_rate_measurement(
                self._heart_rate_bpm(now_s) if contact else 0,
                [min(0xFFFF, round(beat.rr_s * 1024)) for beat in beats] if model.has_rr else [],
                contact if model.contact_supported else None,
            )
            yield Outgoing(value, next_ns)

    def _heart_rate_bpm(self, now_s: float) -> int:
        beats = self._known_beats(now_s - 20.0, now_s)[-RATE_BEATS:]
        return round(60.0 * len(beats) / sum(beat.rr_s for beat in beats)) if beats else 0

    def _known_beats(self, from_s: float, to_s: float) -> list[Beat]:
        """Beats that the firmware learnt of in [from_s, to_s)."""
        delay_s = self.body.pulse_delay_s + BEAT_DELAY_S
        return self.body.heart.beats(from_s - delay_s, to_s - delay_s)

    async def _until(self, host_ns: int) -> None:
        while (wait_ns := host_ns - self.host.now_ns()) > 0:
            await asyncio.sleep(wait_ns * 1e-9)

"""What a device's firmware knows of its wearer's heart, and when."""

from dataclasses import dataclass

from sensor_bench.room import Room
from sensor_bench.signals.hearts import Beat

BEAT_DELAY_S = 0.4
"""A beat is known to the firmware that long after its R peak or pulse."""
RATE_BEATS = 8
"""The reported heart rate is the mean over that many intervals."""


@dataclass
class Beats:
    """The beats of one participant as a device sees them, pulse_delay_s after the R peak."""

    room: Room
    participant: str
    pulse_delay_s: float = 0.0

    def known(self, from_s: float, to_s: float) -> list[Beat]:
        """Beats that the firmware learnt of in [from_s, to_s) of true time."""
        delay_s = self.pulse_delay_s + BEAT_DELAY_S
        return self.room.hearts[self.participant].beats(from_s - delay_s, to_s - delay_s)

    def rate_bpm(self, now_s: float) -> int:
        """Mean rate of the newest beats; 0 while there are none."""
        beats = self.known(now_s - 20.0, now_s)[-RATE_BEATS:]
        return round(60.0 * len(beats) / sum(beat.rr_s for beat in beats)) if beats else 0

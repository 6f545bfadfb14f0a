"""Why a rate of good quality may be none, or another one: what one stream shows, and for how long that holds."""

import numpy as np
from sense4hri.lasting import Lasting
from sense4hri.stamps import SECOND_NS

from interpreter_ppg import features
from interpreter_ppg.channel import Channel
from interpreter_ppg.window import Window

SURE, LASTING_S = 0.7, 2.0  # quality of a sure rate, once it has lasted: three pulses, or steps, are alike by chance
TWO_RHYTHMS_S = 3.0  # after they were seen the last time
HALF_WITHIN = 0.05  # of the rate told: a line so near to half of it is that of a pulse of two waves
JUMPS_PER_PULSE = 0.75  # no pulse jumps; a level does now and then
SLOW = f"signal_quality: below {features.SLOWEST_BPM:g} /min it may be breathing or movements"
SHORT = f"signal_quality: good for less than {LASTING_S:g} s"
TWO_RHYTHMS = "signal_quality: two rhythms, the pulse may be the other one"
SINE = "signal_quality: the wave has no overtones, it may be flicker or a tremor"
JUMPS = "signal_quality: the level jumps with every pulse, it may be a lamp or a contact"
IRREGULAR = "signal_quality: the intervals have no order, pulses too low to be seen may be missing"


class Doubts:
    """The doubts of one stream about the rate it tells."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._lasting = Lasting(SURE)
        self.restart(0)

    def restart(self, first_ns: int) -> None:
        """Forget everything; a new segment begins at first_ns."""
        self._until_ns = dict.fromkeys((TWO_RHYTHMS, SINE, JUMPS, IRREGULAR), first_ns - 1)
        self._lasting.restart()

    @property
    def two_rhythms_to_ns(self) -> int:
        """Until when there are two, as far as is known."""
        return self._until_ns[TWO_RHYTHMS]

    def see(self, channel: Channel, end_ns: int, window: Window, rate_bpm: float) -> list[str]:
        """Return why the rate told of the window that ends at end_ns may be wrong.

        channel: the chosen one, of whose pulses the window is.
        """
        self._see_two_rhythms(channel, end_ns, window, rate_bpm)
        if channel.overtones() < features.LEAST_OVERTONES:  # a sine has no clear polarity: it is held while that turns
            self._hold(SINE, end_ns, self._window_s)
        if channel.jumps_per_s() > JUMPS_PER_PULSE * rate_bpm / 60:
            self._hold(JUMPS, end_ns, self._window_s)
        if features.irregular(window.rr_ms):
            self._hold(IRREGULAR, end_ns, self._window_s)
        seen = {
            SLOW: rate_bpm < features.SLOWEST_BPM,
            SHORT: self._lasting.too_short(channel.quality, end_ns, LASTING_S),
            TWO_RHYTHMS: features.vanishes(channel.heights, window.trusted),
        }
        in_order = (SLOW, SHORT, *self._until_ns)
        return [reason for reason in in_order if seen.get(reason) or end_ns <= self._until_ns.get(reason, -np.inf)]

    def _see_two_rhythms(self, channel: Channel, end_ns: int, window: Window, rate_bpm: float) -> None:
        """Take what a window shows of a second rhythm.

        A pulse of two waves alike stays one, and so does a motion that adds to the pulses: there is doubt until all
        that is told of it has left the window.
        """
        share = channel.second_rhythm_hz(rate_bpm / 60) * 60 / rate_bpm  # of the rate told; NaN where there is none
        rr_ms, alike = window.rr_ms, features.two_waves(window.rr_ms) or abs(share - 0.5) < HALF_WITHIN
        if alike or channel.another_rhythm():
            self._hold(TWO_RHYTHMS, end_ns, self._window_s)
        elif np.isfinite(share) or features.alternate(rr_ms) or features.doubled(rr_ms, window.trusted):
            self._hold(TWO_RHYTHMS, end_ns, TWO_RHYTHMS_S)

    def _hold(self, reason: str, end_ns: int, hold_s: float) -> None:
        self._until_ns[reason] = max(self._until_ns[reason], end_ns + round(hold_s * SECOND_NS))

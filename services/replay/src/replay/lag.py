"""How far features are behind their raw stream, by the stamps of both. Asks no clock."""

from dataclasses import dataclass

from sense4hri.stamps import SECOND_NS

# features come once a second, up to 2 s apart where a segment begins, and a frame may last another half
LEAST_LAG_NS = 5 * SECOND_NS // 2
GAP_NS = SECOND_NS  # without raw data; then features begin anew


@dataclass
class Lag:
    """One stream. Stamps in ns of recorded ROS time; 0 = none yet. since_ns: of the first message after a gap."""

    since_ns: int = 0
    sent_ns: int = 0
    spoke_ns: int = 0
    interval_ns: int = SECOND_NS
    given_up: bool = False

    def begin(self) -> None:
        """Playing begins, or goes on elsewhere."""
        self.since_ns = self.sent_ns = self.spoke_ns = 0

    def sent(self, at_ns: int) -> None:
        """A raw message with this stamp has been played."""
        if at_ns - self.sent_ns > GAP_NS:
            self.since_ns, self.spoke_ns = at_ns, 0
        self.sent_ns = at_ns

    def spoke(self, at_ns: int) -> None:
        """Features with this stamp have come."""
        if at_ns < self.since_ns:
            return
        if self.spoke_ns and at_ns > self.spoke_ns:
            self.interval_ns = at_ns - self.spoke_ns
        self.spoke_ns, self.given_up = at_ns, False

    def behind(self) -> bool:
        """True where playback is to wait for it; the first features are waited for as those after them."""
        heard_ns = self.spoke_ns or self.since_ns
        return not self.given_up and self.sent_ns - heard_ns > max(LEAST_LAG_NS, self.interval_ns + SECOND_NS)

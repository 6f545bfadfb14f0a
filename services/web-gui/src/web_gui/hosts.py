"""The clocks of the study's hosts, as the reference host's clock-sync tells them. Pure.

Everything on the page's axis is in the reference host's time: what a sensor's driver stamps, and what this host's own
clock shows.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

from sense4hri.host_clocks import MOST_HOSTS, HostClocks, SensorHosts, this_host
from sense4hri.stamps import SECOND_NS

from web_gui.intake import shown
from web_gui.problem_log import Problem
from web_gui.rules import RULES

FRESH_NS = 10 * SECOND_NS
WARMUP, LOCKED = 0, 1  # HostClock
PAGE = "web-gui"  # the source of the markers that are set on the page


class Told(NamedTuple):
    """What is told of one host's clock."""

    host: str
    reference: str
    offset_s: float
    round_trip_s: float
    state: int


class Hosts:
    """What `/study/host_clocks` said last. A study on one host has none.

    sensors: on which host each sensor's driver runs. here: the name of this host.
    """

    def __init__(self, here: str = "") -> None:
        self.sensors = SensorHosts(HostClocks())
        self._here = here or this_host()
        self._entries: list[Told] = []
        self._at_ns = 0

    def take(self, message: Any, now_ns: int) -> None:
        """Take a HostClockArray in."""
        clocks = message.clocks[:MOST_HOSTS]
        self._entries = [
            Told(shown(c.host), shown(c.reference), c.offset_ns * 1e-9, c.round_trip_s, int(c.state)) for c in clocks
        ]
        self._at_ns = now_ns
        self.sensors.clocks.take(message, now_ns / SECOND_NS)

    def of_here_ns(self, host_ns: int) -> int:
        """Return the reference host's time when the clock of this host shows host_ns."""
        return self.sensors.clocks.reference_ns(self._here, host_ns)

    def marked_ns(self, source: str, stamp_ns: int) -> int:
        """Return the reference host's time of a marker that a sensor or this page has stamped; of others the stamp."""
        if not stamp_ns:
            return 0
        return self.of_here_ns(stamp_ns) if source == PAGE else self.sensors.reference_ns(source, stamp_ns)

    def problems(self, now_ns: int) -> Iterator[Problem]:
        """Yield whose clock is off, who answers slowly and who no longer does; nothing of what is no longer told."""
        if now_ns - self._at_ns > FRESH_NS:
            return
        for host, reference, offset_s, round_trip_s, state in self._entries:
            if RULES["HostUnanswering"].broken(state):
                text = f"host {host} no longer answers clock-sync: its clock is taken to go on as it did"
                yield Problem.of("HostUnanswering", f"host {host}", text)
            if state != WARMUP and RULES["HostClocksApart"].broken(abs(offset_s)):
                off = f"{abs(offset_s) * 1e3:.1f} ms off that of {reference}"
                text = f"the clock of host {host} is {off}; times are corrected, set it all the same"
                yield Problem.of("HostClocksApart", f"clock of {host}", text)
            if state == LOCKED and RULES["NetworkSlow"].broken(round_trip_s):
                took = f"a message to host {host} and its answer take {round_trip_s * 1e3:.0f} ms"
                yield Problem.of("NetworkSlow", f"way to {host}", f"{took}: the network between holds data back")

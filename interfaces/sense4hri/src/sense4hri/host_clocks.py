"""The clocks of several hosts (contract, section 9): from the wall clock of a host to that of the reference host. Pure.

`header.stamp`, and what a clock model makes of device time, are of the driver's host. Whoever lays streams of two hosts
side by side asks here; a host that nobody has measured has offset 0, and `doubt` says so.
"""

from __future__ import annotations

import os
import re
import socket
from bisect import bisect_right
from collections.abc import Iterable
from itertools import takewhile
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from sense4hri import clock_model
from sense4hri.intake import LARGEST_DIFFERENCE_NS, LARGEST_PPM
from sense4hri.modalities import MODALITIES
from sense4hri.stamps import SECOND_NS, to_ns

TOPIC = "/study/host_clocks"
PROBES = "/study/clock_probes"
MOST_HOSTS = 100
FRESH_S = 10.0
"""Each host is told of every second; one that has not been for so long makes room where others come."""
WAS_THERE = 10
"""Entries of a host in a recording that has it keep it for good."""
MOST_SENSORS = 4096
APART_S = 1e-3
"""Clocks of two hosts that differ by more are told: that is an alarm."""
HOLDS_NS = 86_400 * SECOND_NS
"""A measured line says nothing of stamps further from it, before or after, as those of an old recording are.

No session lasts as long, so a host that has fallen silent is corrected to its end: two crystals change by some 1 ppm
against each other, 0.09 s in a day. Beyond it hosts have been off and their clocks set, of which no line knows.
"""


def sanitised(host: str) -> str:
    """Return a host's name as it stands in messages and names of nodes: `Lab-A.local` becomes `lab_a_local`."""
    return re.sub(r"[^a-z0-9]+", "_", host.lower()).strip("_")[:63] or "host"


def this_host() -> str:
    """Return the name of this host: SENSE4HRI_HOST, which a study file's `host` sets, else the machine's own."""
    return os.environ.get("SENSE4HRI_HOST") or socket.gethostname()


def unmeasured(host: str, reference: str) -> str:
    """Return the sentence for a host without an entry."""
    return f"nobody has measured the clock of host {host} against that of {reference}: its offset is taken as 0"


def out_of_reach(host: str) -> str:
    """Return the sentence for stamps of a host that its entries say nothing of."""
    apart = "were taken more than a day from when its clock was measured"
    return f"stamps of host {host} {apart}, as in a replay: its offset is taken as 0"


class HostClock(NamedTuple):
    """One entry of HostClockArray: a line in the host's own time."""

    host: str
    reference: str
    offset_ns: int
    skew_ppm: float
    measured_at_ns: int
    uncertainty_s: float

    def holds(self, host_ns: int) -> bool:
        """Return whether the line says anything of the moment in which the host's clock shows host_ns."""
        return abs(host_ns - self.measured_at_ns) <= HOLDS_NS

    def reference_ns(self, host_ns: int) -> int:
        """The reference's clock when the host's shows host_ns."""
        return clock_model.ros_ns(host_ns, self.measured_at_ns, self.offset_ns, self.skew_ppm)


class HostClocks:
    """What `/study/host_clocks` has said. history: keep all of it, for a recording; else each host's newest entry.

    Of MOST_HOSTS at once; a flood of made-up ones keeps no host out once it is over, and pushes out none that is told.
    """

    def __init__(self, history: bool = False) -> None:
        self._history = history
        self._entries: dict[str, list[HostClock]] = {}
        self._told_s: dict[str, float] = {}  # when each was told of last, the longest ago first
        self.reference = ""
        """The reference host; empty until an entry names it."""

    def take(self, message: Any, now_s: float) -> None:
        """Take a HostClockArray in. An entry that no clock can have tells nothing of its host.

        now_s: when it came, on any clock that goes on.
        """
        for entry in message.clocks:
            host = sanitised(entry.host)
            if not (abs(entry.skew_ppm) <= LARGEST_PPM and abs(entry.offset_ns) <= LARGEST_DIFFERENCE_NS):
                continue  # of a recording; a live one is refused where it enters
            if host not in self._entries and not self._has_room(now_s):
                continue
            self.reference = sanitised(entry.reference)
            clock = HostClock(
                host,
                self.reference,
                int(entry.offset_ns),
                float(entry.skew_ppm),
                to_ns(entry.measured_at),
                float(entry.uncertainty_s),
            )
            self._told_s.pop(host, None)
            self._told_s[host] = now_s
            known = self._entries.setdefault(host, [])
            if self._history and known and known[-1].measured_at_ns < clock.measured_at_ns:
                known.append(clock)
            elif self._history and known and known[-1].measured_at_ns > clock.measured_at_ns + SECOND_NS:
                self._set_back(known, clock)
            else:
                known[-1:] = [clock]

    def _has_room(self, now_s: float) -> bool:
        """Whether one more can be kept: where as many are as may be, one that is told of no more makes room.

        Of a recording none that has WAS_THERE entries: what they say of a host that left holds for its time.
        """
        if len(self._entries) < MOST_HOSTS:
            return True
        silent = takewhile(lambda host: now_s - self._told_s[host] > FRESH_S, self._told_s)
        gone = next((host for host in silent if len(self._entries[host]) < WAS_THERE), None)
        if gone is not None:
            del self._entries[gone], self._told_s[gone]
        return gone is not None

    @staticmethod
    def _set_back(known: list[HostClock], clock: HostClock) -> None:
        """A host's clock was set back: what it shows from then on, it has shown before. The newer word counts."""
        del known[bisect_right(known, clock.measured_at_ns, key=lambda one: one.measured_at_ns) :]
        known.append(clock)

    @property
    def measured(self) -> bool:
        """Whether any clock has been: on one machine none is."""
        return bool(self._entries)

    def knows(self, host: str) -> bool:
        """Return whether the clock of this host has been measured; that of the reference need not be."""
        return bool(host) and sanitised(host) in self._entries

    def clock(self, host: str, host_ns: int) -> HostClock | None:
        """Return the entry that holds when this host's clock shows host_ns; None where nothing is known of it then."""
        known = self._entries.get(sanitised(host))
        if not known:
            return None
        clock = known[max(0, bisect_right(known, host_ns, key=lambda one: one.measured_at_ns) - 1)]
        return clock if clock.holds(host_ns) else None

    @overload
    def reference_ns(self, host: str, host_ns: int) -> int: ...
    @overload
    def reference_ns(self, host: str, host_ns: NDArray[np.int64]) -> NDArray[np.int64]: ...
    def reference_ns(self, host: str, host_ns: int | NDArray[np.int64]) -> int | NDArray[np.int64]:
        """Return the reference host's time, ns, when the clock of this host shows host_ns; the same where unknown."""
        if not self.knows(host):
            return host_ns
        if isinstance(host_ns, np.ndarray):
            return self._many(sanitised(host), host_ns)
        clock = self.clock(host, host_ns)
        return host_ns if clock is None else clock.reference_ns(host_ns)

    def _many(self, host: str, host_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        known = self._entries[host]
        begins = np.array([clock.measured_at_ns for clock in known], np.int64)
        which = np.maximum(np.searchsorted(begins, host_ns, "right") - 1, 0)
        offset = np.array([clock.offset_ns for clock in known], np.int64)[which]
        skew = np.array([clock.skew_ppm for clock in known])[which] * 1e-6
        since_ns = host_ns - begins[which]
        corrected_ns = host_ns + offset + np.rint(skew * since_ns).astype(np.int64)
        return np.where(np.abs(since_ns) <= HOLDS_NS, corrected_ns, host_ns)

    def doubt(self, host: str, stamps_ns: Iterable[int] = ()) -> str:
        """Return why the times of this host are not corrected; empty where they are, or need not be.

        stamps_ns: what its clock showed, where it is asked of these moments too.
        """
        if not self.reference or not host or sanitised(host) == self.reference:
            return ""
        if not self.knows(host):
            return unmeasured(host, self.reference)
        return "" if all(self.clock(host, each_ns) for each_ns in stamps_ns) else out_of_reach(host)


class SensorHosts:
    """The host of every sensor's driver, by its own word, else the registry's: whose clock stamps what it tells.

    Of MOST_SENSORS at once; a flood of made-up ones pushes out whoever was silent longest.
    """

    def __init__(self, clocks: HostClocks) -> None:
        self.clocks = clocks
        self._hosts: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._hosts)

    def told(self, sensor_id: str, host: str) -> None:
        """A driver says on which host it runs."""
        self._hosts.pop(sensor_id, None)
        self._hosts[sensor_id] = sanitised(host) if host else ""
        if len(self._hosts) > MOST_SENSORS:
            del self._hosts[next(iter(self._hosts))]

    def registered(self, sensor_id: str, host: str) -> None:
        """The registry says it; the driver's own word counts more."""
        if not self._hosts.get(sensor_id):
            self.told(sensor_id, host)

    def host(self, sensor_id: str) -> str:
        """Return the host that stamps; of a derived stream (`h10_1_ecg`) that of its source, empty where not known."""
        if sensor_id in self._hosts:
            return self._hosts[sensor_id]
        sources = (sensor_id.removesuffix(f"_{kind}") for kind in MODALITIES if sensor_id.endswith(f"_{kind}"))
        return next((self._hosts[source] for source in sources if source in self._hosts), "")

    @overload
    def reference_ns(self, sensor_id: str, host_ns: int) -> int: ...
    @overload
    def reference_ns(self, sensor_id: str, host_ns: NDArray[np.int64]) -> NDArray[np.int64]: ...
    def reference_ns(self, sensor_id: str, host_ns: int | NDArray[np.int64]) -> int | NDArray[np.int64]:
        """Return the reference host's time, ns, of a stamp of the sensor's driver; the same where nothing is known."""
        return self.clocks.reference_ns(self.host(sensor_id), host_ns) if self.clocks.measured else host_ns

    def doubt(self, sensor_id: str, stamps_ns: Iterable[int] = ()) -> str:
        """Return why these stamps of the sensor's driver are not corrected; empty where they are, or need not be."""
        return self.clocks.doubt(self.host(sensor_id), stamps_ns)

"""A study on three hosts of one machine, on a bad network: what arrived, what was lost and what was told of it.

Host `drive` has the drivers, on a wall clock of its own; `keep` the recorder, the reference; `other` only a clock-sync.
"""

import os
import time
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

from processes import Process, poll
from sense4hri.cdr import read_raw
from sense4hri.stamps import to_ns
from sense4hri_recording.reader import Reader
from sense4hri_report.collect import collect
from sense4hri_report.summary import summarise
from slow_network import SlowNetwork
from wall_clock import WallClock

TOY = Path(__file__).parent / "kit" / "toy_driver.py"
PROFILES = Path(__file__).resolve().parents[1] / "compose" / "several_hosts.xml"
SENSORS = ("toy_1", "toy_2")
SECOND = 1_000_000_000


def surroundings(network: SlowNetwork, host: str, domain: int) -> dict[str, str]:
    """Return the environment of a process on a host."""
    env = {"SENSE4HRI_HOST": host, "ROS_STATIC_PEERS": network.peers(host), "ROS_DOMAIN_ID": str(domain)}
    env |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    return env | {"PATH": os.environ["PATH"], "FASTRTPS_DEFAULT_PROFILES_FILE": str(PROFILES)}


class Account(NamedTuple):
    """Of one stream, in samples. span: from the first to the last that arrived, by their own numbers."""

    span: int
    arrived: int
    told_lost: int
    received_s: list[float]
    """The recorder's clock when each message came."""
    last_s: float
    """When the last sample was taken, as the report has it."""


class HostsStudy:
    """Begun with `begin`, ended with `end`; faults in between. ahead_s, ppm: of the drivers' host."""

    def __init__(self, folder: Path, domain: int, ahead_s: float = 0.25, ppm: float = 50.0) -> None:
        self.folder, self.recordings = folder, folder / "recordings"
        self.network = SlowNetwork("drive", "keep", "other")
        self.clock = WallClock(folder)
        self.clock.step(ahead_s)
        self.clock.drift(ppm)
        self.clocks_set: list[tuple[int, int, int]] = []  # monotonic time, and the clock's offset and rate from then on
        self.processes: dict[str, Process] = {}
        self._domain = domain

    def begin(self) -> None:
        """Start everything, the recorder first; return when the drivers' samples are being written."""
        self._note()
        self._start("keep", "recorder", "recorder", directory=str(self.recordings))
        for host in ("keep", "drive", "other"):
            self._start(f"{host}", f"clock_{host}", "clock_sync", reference_host="keep")
        self.processes["recorder"].until("metrics on port")
        for sensor in SENSORS:
            self._start("drive", sensor, str(TOY), sensor_id=sensor, human_id="p1")
        poll(lambda: self._size() > 60_000, "a recording that grows")

    def step(self, seconds: float) -> None:
        """Set the clock of the drivers' host."""
        self.clock.step(seconds)
        self._note()

    def end(self) -> None:
        """End the drivers, then the rest, the recorder last."""
        for name in (*SENSORS, "clock_keep", "clock_drive", "clock_other", "recorder"):
            if name in self.processes:
                self.processes[name].end()
        self.network.close()

    def accounts(self) -> dict[str, Account]:
        """Return the account of every stream, from the recording and from its report."""
        report = summarise(collect([self._folder()]), time.time_ns())
        told = {entry["stream"]: entry for entry in report["streams"] if "lost_samples" in entry}
        numbers: dict[str, list[float]] = defaultdict(list)
        received: dict[str, list[float]] = defaultdict(list)
        for record in self._reader().messages([f"/humans/physiological/p1/ecg/{sensor}/raw" for sensor in SENSORS]):
            raw, sensor = read_raw(record.data), record.topic.split("/")[5]
            numbers[sensor] += raw.samples[:, 0].tolist()
            received[sensor].append(record.log_ns / SECOND)
        found = {}
        for sensor, values in numbers.items():
            entry, span = told[f"p1/ecg/{sensor}"], round(max(values) - min(values)) + 1
            last_s = entry["last"]["ros_ns"] / SECOND
            found[sensor] = Account(span, len(set(values)), entry["lost_samples"], received[sensor], last_s)
        return found

    def host_errors(self, host: str) -> list[tuple[float, float]]:
        """Return by how much each LOCKED entry of `/study/host_clocks` was off where measured, and may be, in s."""
        reader, errors = self._reader(), []
        for record in reader.messages(["/study/host_clocks"]):
            for entry in reader.decode(record).clocks:
                if entry.host == host and entry.state == entry.LOCKED:
                    ahead_ns = self._ahead_ns(to_ns(entry.measured_at)) if host == "drive" else 0
                    errors.append(((entry.offset_ns + ahead_ns) / SECOND, entry.uncertainty_s))
        return errors

    def _ahead_ns(self, host_ns: int) -> int:
        """How far the drivers' clock was ahead when it showed host_ns; steps go forward, so that is one moment."""
        wall_minus_monotonic_ns = time.time_ns() - time.monotonic_ns()
        found = 0
        for since_ns, offset_ns, rate_ppb in self.clocks_set:
            monotonic_ns = host_ns - offset_ns - wall_minus_monotonic_ns
            if monotonic_ns >= since_ns or not found:
                found = offset_ns + (monotonic_ns - since_ns) * rate_ppb // SECOND
        return found

    def _note(self) -> None:
        now_ns = time.monotonic_ns()
        _, rate_ppb, _ = self.clock._read()
        self.clocks_set.append((now_ns, self.clock.ahead_ns(now_ns), rate_ppb))

    def _reader(self) -> Reader:
        return Reader(self._folder())

    def _folder(self) -> Path:
        (folder,) = {path.parent for path in self.recordings.rglob("*.mcap")}
        return folder

    def _size(self) -> int:
        return sum(path.stat().st_size for path in self.recordings.rglob("*.mcap"))

    def _start(self, host: str, name: str, command: str, **parameters: Any) -> None:
        env = surroundings(self.network, host, self._domain) | (self.clock.env if host == "drive" else {})
        log, before = self.folder / f"{name}.log", self.network.inside(host)
        self.processes[name] = Process(log, command, env=env, parameters=parameters, before=before)

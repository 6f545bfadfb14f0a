"""The offline clock fit against the live models, on simulated links with known truth.

    .venv/bin/python tests/bench/bench_offline_clock.py

Every profile of the link simulator, two devices each over 20 minutes, and two devices on different links (a chest
strap and an EEG headset); then what the fit costs.
"""

import time
from itertools import pairwise
from typing import Any

import numpy as np
from clock_sync import links
from clock_sync.estimator import ClockEstimator
from numpy.typing import NDArray
from sense4hri_session.clock_fit import Packets, fit_clock

Row = dict[str, Any]
PROFILES = ("strap", "eeg", "bad", "congestion", "serial")
SEEDS = range(7000, 7012)
PUBLISH_NS = 500_000_000
TOLERANCE_MS = 0.01  # of "no worse than live": the links' polling leaves both the same unknown


class Errors:
    """Errors in ms of both ways at every packet of one link. The live model is the newest published."""

    def __init__(self, profile: str, seed: int) -> None:
        self.link = links.simulate(profile, seed)
        begun = time.process_time()
        fit = fit_clock({"ecg": Packets(self.link.device_ns, self.link.received_ns)})
        self.cost_s = time.process_time() - begun
        self.offline = self.link.error_ms(fit.segments[0].ros_ns(self.link.device_ns))
        self.online = self.link.error_ms(follow(self.link))


def follow(link: links.Link) -> NDArray[np.int64]:
    """ROS time of every packet by the newest model published live."""
    estimator, published = ClockEstimator(), 0
    ros = np.empty(len(link.true_s), np.int64)
    for i, (device, received) in enumerate(zip(link.device_ns.tolist(), link.received_ns.tolist(), strict=True)):
        if estimator.packet("ecg", device, received) or received - published >= PUBLISH_NS:
            model, published = estimator.model(), received
        ros[i] = model.ros_ns(device)
    return ros


def alignment(one: Errors, other: Errors) -> tuple[float, float]:
    """p95 over true time of the difference of two devices' errors in ms: offline, live."""
    found = []
    for a, b in ((one.offline, other.offline), (one.online, other.online)):
        found.append(float(np.percentile(np.abs(a - np.interp(one.link.true_s, other.link.true_s, b)), 95)))
    return found[0], found[1]


def row(what: str, pairs: list[tuple[Errors, Errors]]) -> Row:
    offline, online = (np.array(column) for column in zip(*(alignment(*pair) for pair in pairs), strict=True))
    worse = int(np.sum(offline > online + TOLERANCE_MS))
    return {
        "what": f"offline fit, two devices' relative alignment, p95: {what}",
        "target": "<= 1 ms, no worse than live on every one",
        "measured": f"{np.median(offline):.2f} ms (at most {offline.max():.2f}), live {np.median(online):.2f} "
        f"(at most {online.max():.2f}); worse than live on {worse} of {len(pairs)}",
        "ok": bool(offline.max() <= 1.0 and worse == 0),
    }


def rows() -> list[Row]:
    """Measure."""
    found, every = [], {}
    for profile in PROFILES:
        every[profile] = [Errors(profile, seed) for seed in SEEDS]
        found.append(row(f"{profile}, {len(SEEDS) - 1} pairs", list(pairwise(every[profile]))))
    found.append(row("strap against eeg", list(zip(every["strap"], every["eeg"], strict=True))))
    dearest = max((e.cost_s / len(e.link.true_s) * 1e6, name) for name, es in every.items() for e in es)
    found.append(
        {
            "what": "offline fit, CPU per message",
            "target": "none set",
            "measured": f"{dearest[0]:.0f} us ({dearest[1]}, the dearest)",
            "ok": True,
        }
    )
    return found


if __name__ == "__main__":
    print("| what | target | measured | |\n|---|---|---|---|")
    for item in rows():
        print(f"| {item['what']} | {item['target']} | {item['measured']} | {item['ok']} |")

"""The offline clock fit against the live models, on simulated links with known truth.

    .venv/bin/python tests/bench/bench_offline_clock.py

Every profile of the link simulator, two devices each over 20 minutes, and two devices on different links (a chest
strap and an EEG headset); then what the fit costs.

Packets in step with a radio's polling (47 ms against 30 ms here, to the nanosecond) meet only delays 1 ms apart; where
between two of them the smallest lies is in no stamp. Both ways take the middle, so that constant is in both alike and a
pair tells them apart by what the packets do say.
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
    return _p95(one, other, one.offline, other.offline), _p95(one, other, one.online, other.online)


def wander(one: Errors, other: Errors) -> tuple[float, float]:
    """The same with each error's median set aside: what packets can tell, not the constant they cannot."""
    offline = (error - np.median(error) for error in (one.offline, other.offline))
    online = (error - np.median(error) for error in (one.online, other.online))
    return _p95(one, other, *offline), _p95(one, other, *online)


def _p95(one: Errors, other: Errors, a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.percentile(np.abs(a - np.interp(one.link.true_s, other.link.true_s, b)), 95))


def row(what: str, pairs: list[tuple[Errors, Errors]]) -> Row:
    offline, online = np.array([alignment(*pair) for pair in pairs]).T
    worse = np.maximum(offline - online - TOLERANCE_MS, 0.0)
    apart, apart_online = np.array([wander(*pair) for pair in pairs]).T
    by = f" (by {worse.max():.2f} ms; constants set aside, on {np.sum(apart > apart_online + TOLERANCE_MS)})"
    return {
        "what": f"offline fit, two devices' relative alignment, p95: {what}",
        "target": "<= 1 ms, no worse than live on every one",
        "measured": f"{np.median(offline):.2f} ms (at most {offline.max():.2f}), live {np.median(online):.2f} "
        f"(at most {online.max():.2f}); worse than live on {np.sum(worse > 0)} of {len(pairs)}{by * bool(worse.any())}",
        "ok": bool(offline.max() <= 1.0 and not worse.any()),
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

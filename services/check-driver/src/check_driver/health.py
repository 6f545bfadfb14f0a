"""What a driver says of its streams once a second, against what came (contract, section 4)."""

import math
import time
from itertools import pairwise
from typing import Any

import numpy as np
from sense4hri.host_clocks import this_host
from sense4hri.stream_info import long_s
from sense4hri_msgs.msg import StreamHealth

from check_driver import times
from check_driver.findings import Findings
from check_driver.heard import Health, Heard

AROUND_S = 1.5
"""Between what was counted and when we heard of it."""
SLOWEST_PER_S, FASTEST_PER_S, LEAST_S = 0.6, 1.5, 4.0
OFF, RATE_WINDOW_S = 0.2, 10.0
STREAMING_S = 3.0
"""After so long a silence of its samples a stream does not stream."""
STEP_NS = 1_000_000_000
NOT_LEFT = 3
"""Accounts in a row, between which samples came, that tell a wrong state from one that was left meanwhile."""
FINITE = ("nominal_rate_hz", "measured_rate_hz", "latency_s", "rssi_dbm")
UNKNOWN = ("battery_percent", "rssi_dbm", "contact", "latency_s")
TOTALS = ("samples_total", "lost_samples_total", "gaps_total", "duplicates_total", "reconnects_total")


def check(heard: Heard, rate_hz: float, span_s: tuple[float, float], sound_stamps: bool, findings: Findings) -> None:
    """Find what is wrong with the health of a stream.

    span_s: from when until when it was listened to, on the monotonic clock. sound_stamps: by them losses are counted.
    """
    topic = heard.name.topic("health")
    _pace(heard.health, max(span_s[0], heard.since_s), span_s[1], topic, findings)
    for each in heard.health:
        _values(each.message, rate_hz, topic, findings)
        _state(each, heard, topic, findings)
    _streams_all_the_same(heard, topic, findings)
    for total in TOTALS:
        values = [getattr(each.message, total) for each in _known(heard, total)]
        if any(after < before for before, after in pairwise(values)):
            findings.wrong(4, topic, f"{total} falls")
    if len(heard.health) > 2 and rate_hz >= 0:
        _counts(heard, times.lost(heard.frames, rate_hz) if sound_stamps else None, topic, findings)


def _known(heard: Heard, total: str) -> list[Health]:
    """Return the accounts that know this total; -1 is none."""
    return [each for each in heard.health if getattr(each.message, total) >= 0]


def _pace(health: list[Health], since_s: float, until_s: float, topic: str, findings: Findings) -> None:
    seconds, count = until_s - since_s, sum(since_s < each.heard_s < until_s for each in health)
    if seconds >= LEAST_S and not SLOWEST_PER_S < count / seconds < FASTEST_PER_S:
        findings.wrong(2, topic, f"{count} messages in {seconds:.0f} s, must be one a second")


def _values(message: Any, rate_hz: float, topic: str, findings: Findings) -> None:
    if message.state not in range(5):
        findings.wrong(4, topic, f"state {message.state} is none")
    if not message.host:
        findings.wrong(4, topic, "host is empty")
    for name, low, high in (("battery_percent", 0, 100), ("contact", 0, 1), ("latency_s", 0, math.inf)):
        value = getattr(message, name)
        if not (math.isnan(value) or low <= value <= high):
            findings.wrong(4, topic, f"{name} is {value:g}, must be {low} to {high:g}, or NaN where it is not known")
    for name in FINITE:
        if math.isinf(getattr(message, name)):
            findings.wrong(4, topic, f"{name} is infinite: what is not known is NaN")
    if all(getattr(message, name) == 0 for name in UNKNOWN):
        findings.wrong(4, topic, f"{', '.join(UNKNOWN)} are all 0: what is not known is NaN")
    for total in TOTALS:
        if (count := getattr(message, total)) < -1:
            findings.wrong(4, topic, f"{total} is {count}, must be -1 where it is not known")
    if rate_hz >= 0 and message.nominal_rate_hz != rate_hz:
        findings.wrong(4, topic, f"nominal_rate_hz is {message.nominal_rate_hz:g}, the parameter says {rate_hz:g}")
    offset_ns = time.time_ns() - time.monotonic_ns()
    if message.host == this_host() and abs(message.realtime_minus_monotonic_ns - offset_ns) > STEP_NS:
        findings.wrong(4, topic, "realtime_minus_monotonic_ns is not what this host's clocks say")


def _state(health: Health, heard: Heard, topic: str, findings: Findings) -> None:
    streaming = health.message.state == StreamHealth.STREAMING
    ages_s = [health.heard_s - frame.heard_s for frame in heard.frames if frame.heard_s <= health.heard_s]
    nominal_hz = health.message.nominal_rate_hz
    if streaming and nominal_hz > 0 and ages_s and min(ages_s) > long_s(STREAMING_S, nominal_hz) + AROUND_S:
        findings.wrong(4, topic, "STREAMING, though no sample has come for a while")
    elif not streaming and not health.message.reasons:
        findings.wrong(4, topic, f"state {health.message.state} and reasons is empty")


def _streams_all_the_same(heard: Heard, topic: str, findings: Findings) -> None:
    """Samples came between several accounts in a row, and none of them said STREAMING."""
    for some in zip(*(heard.health[first:] for first in range(NOT_LEFT)), strict=False):
        idle = all(each.message.state != StreamHealth.STREAMING for each in some)
        if idle and all(_came_between(heard, *two) for two in pairwise(some)):
            findings.wrong(4, topic, f"state {some[-1].message.state} while samples come, must be STREAMING")


def _came_between(heard: Heard, before: Health, after: Health) -> bool:
    return any(before.heard_s < frame.heard_s < after.heard_s for frame in heard.frames)


def _counts(heard: Heard, missing: list[tuple[float, int]] | None, topic: str, findings: Findings) -> None:
    """Hold what the driver has counted against what came and, unless it is None, what is missing by device time.

    From the first sample that came on: samples may be found on the graph later than health.
    """
    came = [(frame.heard_s, frame.n) for frame in heard.frames]
    last = heard.health[-1]
    first = next((each for each in heard.health if not came or each.heard_s > came[0][0]), last)
    _against("samples_total", "samples came", came, first, last, topic, findings)
    if last.message.lost_samples_total >= 0 and missing is not None:
        known = _known(heard, "lost_samples_total")[0]
        _against("lost_samples_total", "samples are missing by device time", missing, known, last, topic, findings)
    newest = [frame for frame in heard.frames if last.heard_s - RATE_WINDOW_S < frame.heard_s <= last.heard_s]
    streaming = last.message.state == StreamHealth.STREAMING
    if streaming and last.message.nominal_rate_hz > 0 and times.long_enough(newest):
        measured_hz, came_hz = last.message.measured_rate_hz, times.paces(newest)
        if not (1 - OFF) * came_hz.min() < measured_hz < (1 + OFF) * came_hz.max():
            median_hz = np.median(came_hz)
            findings.wrong(4, topic, f"measured_rate_hz is {measured_hz:.4g}, {median_hz:.4g} samples/s came")


def _against(
    total: str,
    what: str,
    seen: list[tuple[float, int]],
    first: Health,
    last: Health,
    topic: str,
    findings: Findings,
) -> None:
    counted = getattr(last.message, total) - getattr(first.message, total)
    least = sum(n for at, n in seen if first.heard_s + AROUND_S < at < last.heard_s - AROUND_S)
    most = sum(n for at, n in seen if first.heard_s - AROUND_S < at < last.heard_s + AROUND_S)
    if not least <= counted <= most:
        findings.wrong(4, topic, f"{total} has grown by {counted}, {least} to {most} {what}")

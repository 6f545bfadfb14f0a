"""What the samples of a stream say of its completeness."""

from __future__ import annotations

from collections import Counter

from sense4hri_report import rules
from sense4hri_report.driver_losses import DriverLoss, judge_driver_losses, lost_in
from sense4hri_report.outages import cost_samples
from sense4hri_report.raw_findings import RawFindings
from sense4hri_report.rules import Judgement, counted, duration
from sense4hri_report.watch import Span
from sense4hri_report.window import Json, Window, at

STANDS_IN = "the recorder's own time stands in, but for a stream's first message"


def judge_samples(
    raw: RawFindings,
    unseen: list[DriverLoss],
    entry: Json,
    window: Window,
    outages: list[Span],
    judgement: Judgement,
) -> None:
    """How many of the window's samples are there; of those missing while the recorder recorded, half are too many.

    unseen: what only the driver counted; a rate measured by receipt is of the samples that came, without these.
    """
    rate_hz = raw.measured_hz or raw.rate_hz or 0.0
    expected = rate_hz * window.seconds + (lost_in(unseen, window) if rate_hz else 0.0)
    missing = _missing(raw, entry, window, rate_hz) + lost_in(unseen, window)
    coverage = min(max(1.0 - missing / expected, 0.0), 1.0) if expected > 0 else None
    entry |= {"missing_in_session": round(missing), "coverage": None if coverage is None else round(coverage, 6)}
    recorded = window.without((span.from_ns, span.to_ns) for span in outages if cost_samples(span, [raw]))
    hidden = lost_in(unseen, recorded)
    wanted = rate_hz * recorded.seconds + (hidden if rate_hz else 0.0)
    if raw.last_ns < window.from_ns or raw.first_ns > window.to_ns:
        which, at_ns = ("last", raw.last_ns) if raw.last_ns < window.from_ns else ("first", raw.first_ns)
        judgement.broken(f"no sample in the session: the {which} one came {at(at_ns, window)}")
    elif wanted > 0 and 1.0 - (_missing(raw, entry, recorded, rate_hz) + hidden) / wanted < rules.BROKEN_COVERAGE:
        judgement.broken(f"only {coverage:.1%} of the session's samples are there")
    inside = [(hole, share) for hole in raw.holes if (share := window.share(hole.from_ns, hole.to_ns)) > 0]
    if inside:
        lost = sum(hole.lost * share for hole, share in inside)
        percent = f" ({(missing - lost_in(unseen, window)) / expected:.2%})" if expected > 0 else ""
        about = "about " if any(hole.estimated for hole, _ in inside) else ""
        longest = duration(max((hole.to_ns - hole.from_ns) * 1e-9 for hole, _ in inside))
        number = f"{counted(len(inside), 'gap')}, {about}{counted(round(lost), 'sample')} missing{percent}"
        judgement.gaps(f"{number}, the longest {longest}")
    judge_driver_losses(unseen, expected, window, judgement)


def _missing(raw: RawFindings, entry: Json, window: Window, rate_hz: float) -> float:
    """Samples that are missing in a window, before the first and after the last one too."""
    lost = sum(hole.lost * window.share(hole.from_ns, hole.to_ns) for hole in raw.holes)
    late = (window.from_ns, raw.first_ns) if _is_late(raw, entry["late_start_s"]) else (0, 0)
    early = (raw.last_ns, window.to_ns) if _is_late(raw, entry["early_end_s"]) else (0, 0)
    edges_s = sum(window.share(*span) * (span[1] - span[0]) * 1e-9 for span in (late, early) if span[1] > span[0])
    return lost + edges_s * rate_hz


def _is_late(raw: RawFindings, seconds: float | None) -> bool:
    return (seconds or 0.0) > rules.EDGE_S + raw.frame_s


def judge_edges(raw: RawFindings, entry: Json, window: Window, since: str, end: str, judgement: Judgement) -> None:
    """since, end: what the window's edges are called."""
    if _is_late(raw, entry["late_start_s"]):
        judgement.gaps(f"begins {duration(min(entry['late_start_s'], window.seconds))} after {since}")
    if _is_late(raw, entry["early_end_s"]):
        judgement.gaps(f"ends {duration(min(entry['early_end_s'], window.seconds))} before {end}")


def judge_raw(raw: RawFindings, window: Window, judgement: Judgement) -> None:
    happened = Counter(event.kind for event in raw.events if window.has(event.at_ns))
    _judge_order(happened, judgement)
    _judge_messages(raw, happened, judgement)
    _judge_channels(raw, happened, judgement)
    _remark_on_times(raw, window, judgement)
    _remark_on_rate(raw, judgement)


def _judge_order(happened: Counter[str], judgement: Judgement) -> None:
    """What the device did to its clock, and in which order its messages came."""
    if happened["reboot"]:
        judgement.gaps(f"the device restarted {counted(happened['reboot'], 'time')}")
    if happened["clock_reset"]:
        judgement.gaps(f"the device's clock was set {counted(happened['clock_reset'], 'time')}")
    if happened["reorder"]:
        judgement.gaps(f"{counted(happened['reorder'], 'message')} came after newer ones")
    if happened["backwards"]:
        judgement.gaps(f"stamps went back {counted(happened['backwards'], 'time')}")
    if happened["conflict"]:
        judgement.gaps(f"{counted(happened['conflict'], 'message')} with other samples under a stamp that came before")


def _judge_messages(raw: RawFindings, happened: Counter[str], judgement: Judgement) -> None:
    """Messages that cannot be used, or not wholly."""
    if raw.mixed:
        judgement.gaps(f"{counted(raw.mixed, 'message')} {'without' if raw.has_device_time else 'with'} device time, "
                       "unlike the others; not counted")  # fmt: skip
    if raw.lost_within:
        judgement.gaps(
            f"{counted(raw.lost_within, 'sample')} missing inside of messages, which are stretched over them"
        )
    if raw.undecodable:
        judgement.gaps(f"{counted(raw.undecodable, 'message')} cannot be decoded")
    if happened["duplicate"]:
        judgement.remark(f"{counted(happened['duplicate'], 'message')} came again and were left out")


def _judge_channels(raw: RawFindings, happened: Counter[str], judgement: Judgement) -> None:
    if happened["channels"]:
        partly = [name for name, always in raw.channels.items() if not always]
        changed = f"its channels changed {counted(happened['channels'], 'time')}"
        if partly:
            judgement.gaps(f"{changed}: {', '.join(partly)} came for a part of the time")
        else:
            judgement.remark(f"{changed}, in their order")


def _remark_on_times(raw: RawFindings, window: Window, judgement: Judgement) -> None:
    if raw.untimed:
        judgement.remark(f"{counted(raw.untimed, 'message')} without device time: taken to follow those before")
    if raw.receipts.odd:
        odd = counted(raw.receipts.odd, "receipt stamp")
        judgement.remark(f"{odd} more than an hour off the others, as where a clock was set: {STANDS_IN}")
    before = sum(window.share(hole.from_ns, hole.to_ns) <= 0 for hole in raw.holes)
    if before:
        judgement.remark(f"{counted(before, 'gap')} outside of the session")


def _remark_on_rate(raw: RawFindings, judgement: Judgement) -> None:
    if raw.declared_hz and raw.measured_hz and abs(raw.measured_hz / raw.declared_hz - 1) > rules.OFF_RATE:
        judgement.remark(f"declared as {raw.declared_hz:g} Hz, measured {raw.measured_hz:.2f} Hz")
    if raw.declared_hz is None:
        judgement.remark("nobody declared its rate; gaps are judged by the rate it had")
    if not raw.has_device_time:
        judgement.remark("the device gives no time: losses below about a second cannot be seen")

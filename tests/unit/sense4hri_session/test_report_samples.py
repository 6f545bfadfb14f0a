"""What a report says of a stream by its samples: holes, stamps, channels."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest
from reported_session import (
    ECG,
    ECG_TOPIC,
    EDA,
    EDA_TOPIC,
    EPOCH_NS,
    LENGTH_S,
    SECOND,
    at,
    entry,
    finish,
    health,
    stamp,
    stream,
    told,
)
from sense4hri.cdr import RawMessage
from sense4hri_report import make_report
from sense4hri_report.sequence import RawAccount


def test_half_of_the_samples_is_the_border_of_use(study):
    """A stream with 60 % of its samples has gaps, one with 40 % is broken; both shares are exact."""
    stream(study, ECG, without=range(100, 220))
    stream(study, EDA, without=range(100, 280))
    summary = make_report(finish(study, session=told()))
    assert entry(summary, ECG)["coverage"] == pytest.approx(0.6, abs=1e-4)
    assert entry(summary, EDA)["coverage"] == pytest.approx(0.4, abs=1e-4)
    assert [entry(summary, key)["verdict"] for key in (ECG, EDA)] == ["usable with gaps", "broken"]


def test_what_is_missing_outside_of_the_session_is_not_held_against_it(study):
    """A gap before the start and a message lost after the stop leave the session complete, and are remarked."""
    stream(study, ECG, -10.0, without=range(10, 20))
    stream(study, EDA)
    loss = {"after_ns": at(31), "before_ns": at(31.1), "count": 1, "cause": "queue"}
    summary = make_report(finish(study, session=told(), lost=[(EDA_TOPIC, {"lost": 1, "losses": [loss]})]))
    assert (summary["verdict"], summary["problems"]) == ("complete", [])
    assert "1 gap outside of the session" in entry(summary, ECG)["remarks"]
    assert any("outside of the session" in remark for remark in entry(summary, EDA)["remarks"])


def test_a_hole_is_laid_to_the_one_who_made_it(study):
    """Of three holes one lies where the recorder's disk lost messages, one where the link was lost, one before both."""
    stream(study, ECG, without={50, *range(100, 140), 250})
    for second in range(30):
        lost = 8 <= second < 12
        health(study, ECG, second, 5, state=3 if lost else 2, reasons=["no packet for 2 s"] if lost else [])
    loss = {"after_ns": at(3.0), "before_ns": at(3.2), "count": 1, "cause": "disk"}
    summary = make_report(finish(study, session=told(), lost=[(ECG_TOPIC, {"lost": 1, "losses": [loss]})]))
    assert [(gap["lost_samples"], gap["cause"]) for gap in entry(summary, ECG)["gaps"]] == [
        (13, "recorder: disk"),
        (520, "link: LOST: no packet for 2 s"),
        (13, "before the recorder: sensor, radio or driver"),
    ]


@pytest.mark.parametrize(
    ("later", "verdict", "said", "channels"),
    [
        (("b", "c"), "usable with gaps", "its channels changed 1 time: a, c came for a part of the time", "abc"),
        (("b", "a"), "complete", "its channels changed 1 time, in their order", "ab"),
    ],
)
def test_a_stream_that_changes_its_channels_is_named_with_them(study, later, verdict, said, channels):
    """A channel that came for a part of the time is a gap, another order is none; the event says from what to what."""
    for i in range(320):
        names = ("a", "b") if i < 170 else later
        samples = {name: np.full(13, 100.0 * ord(name) + i) for name in names}
        study.raw(ECG, at(i * 0.1 - 1.0), EPOCH_NS + i * SECOND // 10, samples)
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    found = entry(summary, ECG)
    assert (found["verdict"], found["channels"]) == (verdict, list(channels))
    assert said in found["problems"] + found["remarks"]
    assert (found["messages"], found["samples"], found["lost_samples"]) == (320, 320 * 13, 0)
    assert [(e["kind"], e["what"]) for e in found["events"]] == [
        ("channels", f"channels changed from a, b to {', '.join(later)}")
    ]


@pytest.mark.parametrize("days", [-1, 1, 365 * 3])
def test_one_receipt_stamp_that_is_days_off_changes_no_verdict(study, days):
    """A stream with device time is complete, lies where it did, and the odd stamp is remarked."""
    stream(study, ECG)
    log_ns, number, topic, kind, values = study.messages[200]
    header = {"stamp": stamp(log_ns + days * 86_400 * SECOND), "frame_id": ""}
    study.messages[200] = (log_ns, number, topic, kind, values | {"header": header})
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    own = entry(summary, ECG)
    assert (summary["verdict"], own["coverage"], own["gaps_total"]) == ("complete", 1.0, 0)
    assert abs(own["last"]["since_start_s"] - (LENGTH_S + 2)) < 0.1
    assert any("1 receipt stamp more than an hour off" in remark for remark in own["remarks"])


OUTSIDE: dict[str, Any] = {"session": None}
STREAMING, STOPPING = 2, 4


@pytest.mark.parametrize(
    ("health_to_s", "counts_on", "last_state", "said"),
    [
        (29, True, STREAMING, "before the recording's end; meanwhile its driver sent about 1"),
        (20, True, STREAMING, "before the recording's end; the last that its driver said is that it streams"),
        (29, False, STOPPING, ""),
        (20, True, STOPPING, ""),
    ],
)
def test_outside_a_session_a_lost_tail_is_missed(study, health_to_s, counts_on, last_state, said):
    """A stream that ends 10 s early is complete only where its driver stopped, not where it sent or streamed on."""
    stream(study, ECG, 0.0, 20.0)
    stream(study, EDA, 0.0, 30.0)
    for second in range(health_to_s + 1):
        state = last_state if second == health_to_s else STREAMING if second <= 20 or counts_on else last_state
        total = 130 * (second if counts_on else min(second, 20))
        health(study, ECG, float(second), 0, samples_total=total, state=state)
    study.messages.sort()
    summary = make_report(finish(study, "20261121T093000Z", **OUTSIDE))
    own = entry(summary, ECG)
    assert own["verdict"] == summary["verdict"] == ("usable with gaps" if said else "complete")
    assert not said or (said in own["why"] and own["why"].startswith("ends 10.0 s"))
    assert entry(summary, EDA)["verdict"] == "complete"


@pytest.mark.parametrize("without", [(200,), (0,), (50, 51, 52)])
def test_a_message_without_a_time_among_others_is_no_reset_and_no_loss(study, without):
    """A device stamp of exactly 0 is an unknown time: the samples count, nothing is lost, and a remark says so."""
    stream(study, ECG)
    for i in without:
        log_ns, number, topic, kind, values = study.messages[i]
        study.messages[i] = (log_ns, number, topic, kind, values | {"device_timestamp": stamp(0)})
    own = entry(make_report(finish(study, session=told(required_streams=[ECG_TOPIC]))), ECG)
    assert (own["gaps_total"], own["resets"], own["device_time"]) == (0, 0, True)
    if without[0]:
        assert (own["verdict"], own["samples"]) == ("complete", own["messages"] * 13)
        assert f"{len(without)} message" in own["remarks"][0]


@pytest.mark.parametrize("lost", [0, 1, 3])
@pytest.mark.parametrize("jitter_samples", [0.0, 0.4])
def test_a_hole_inside_a_message_is_counted_where_the_stamps_are_exact(study, lost, jitter_samples):
    """Of one or three of 73 samples that a message lacks the report tells; where the stamps jitter, nobody can."""
    dice, taken = random.Random(1), 0
    for i in range(60):
        taken += 73 + (lost if i == 40 else 0)
        device_ns = EPOCH_NS + round((taken + dice.uniform(-1, 1) * jitter_samples) / 130 * SECOND)
        study.raw(ECG, at(taken / 130 - 2), device_ns, {"c": np.arange(73.0)})
    own = entry(make_report(finish(study, session=None)), ECG)
    told = lost if not jitter_samples else 0
    assert (own["lost_within_messages"], own["lost_samples"], own["resets"]) == (told, 0, 0)
    assert own["verdict"] == ("usable with gaps" if told else "complete")


def test_a_message_lost_among_the_first_is_dated_where_it_was_lost():
    """Whether it was late or lost messages later ones tell; the hole is before it, and none of the measured rate."""
    true_hz, taken, dice = 54.8, 0, random.Random(1)
    account = RawAccount(55.0)
    for i in range(25):
        taken += 49
        if i != 14:
            end_ns = EPOCH_NS + round((taken + dice.uniform(-0.2, 0.2)) / true_hz * SECOND)
            account.take(RawMessage(end_ns, end_ns, ("c",), np.zeros((49, 1))), end_ns)
    account.finish()
    (hole,) = account.holes
    assert hole.lost == pytest.approx(49, abs=1)
    assert hole.from_ns == pytest.approx(EPOCH_NS + 14 * 49 / true_hz * SECOND, abs=0.05 * SECOND)
    assert hole.to_ns - hole.from_ns == pytest.approx(49 / true_hz * SECOND, abs=0.05 * SECOND)
    assert account.measured_hz == pytest.approx(true_hz, abs=0.1)


def clockless(study, lost, from_s=-2.0, pauses=(), clock=0):
    """130 Hz without device time, in messages of 13; health each second, its count of losses by lost(second).

    pauses: from and to, in s, when no message comes. clock: 1 = with device time, in which nothing is missing.
    """
    for i in range(round((LENGTH_S + 4) * 10)):
        end_s = -2.0 + (i + 1) * 0.1
        if any(begin < end_s <= end for begin, end in pauses):
            continue
        device_ns = clock * (EPOCH_NS + round((end_s + 100) * SECOND))
        study.raw(ECG, at(end_s + 0.02), device_ns, {"c": np.full(13, float(i))})
    for half in range(round(2 * from_s), round(2 * LENGTH_S) + 3, 2):
        second = half / 2
        health(study, ECG, second, 5, samples_total=round(130 * (second + 2)), lost_samples_total=lost(second))
    return entry(make_report(finish(study, session=told(required_streams=[ECG_TOPIC]))), ECG)


def share(own):
    """Missing samples and the share that is there; the two always belong to each other, but for rounding."""
    assert own["coverage"] == pytest.approx(1 - own["missing_in_session"] / (130 * LENGTH_S), abs=2e-3)
    return own["missing_in_session"]


@pytest.mark.parametrize(
    ("clock", "lost_at_s", "missing", "why"),
    [
        (0, 10, 44, "44 samples missing (1.12%), as its driver counted; where cannot be told"),
        (0, -1, 0, "nothing is missing"),
        (1, 10, 0, "nothing is missing"),
    ],
)
def test_what_a_driver_counted_is_missing_where_no_gap_can_show_it(study, clock, lost_at_s, missing, why):
    """Frames lost within a session of a device without clock; before it, or with a clock that shows none, nothing."""
    own = clockless(study, lambda second: 44 if second >= lost_at_s else 0, clock=clock)
    assert (own["why"], own["driver"]["lost_samples"], share(own)) == (why, 44, missing)
    assert own["verdict"] == ("usable with gaps" if missing else "complete")


@pytest.mark.parametrize(
    ("counted_before", "counted_in_pause", "missing"),
    [(0, 0, 390), (0, 390, 390), (44, 390, 434), (44, 0, 434), (0, 380, 390), (0, 400, 400)],
)
def test_a_loss_that_shows_as_a_pause_and_was_counted_is_one_loss(study, counted_before, counted_in_pause, missing):
    """A pause of 3 s without device time holds 390 samples, also where the driver counted them once they went on."""
    own = clockless(
        study,
        lambda second: counted_before * (second >= 5) + counted_in_pause * (second >= 18),
        pauses=[(14.0, 17.0)],
    )
    extra = missing - 390
    assert share(own) == missing
    assert (own["verdict"], own["gaps_total"], own["lost_samples_counted"]) == ("usable with gaps", 1, extra)
    told = [each.split(" (")[0] for each in own["problems"] if "as its driver counted" in each]
    assert told == ([f"{extra} samples missing"] if extra else [])


@pytest.mark.parametrize(("told_at_s", "missing"), [(0.5, 22), (LENGTH_S + 0.5, 22)])
def test_a_loss_told_in_an_account_across_start_or_stop_counts_by_its_share(study, told_at_s, missing):
    """An account of the second in which the session began or ended says not when in it: half of it is inside."""
    own = clockless(study, lambda second: 44 if second >= told_at_s else 0, from_s=-1.5)
    assert (share(own), own["verdict"]) == (missing, "usable with gaps")


def test_a_stream_of_which_the_driver_counted_most_as_lost_is_broken(study):
    """Half of the samples is the border of use, however they were counted: 60 of 130 a second came."""
    own = clockless(study, lambda second: round(70 * (second + 2) * 4))
    assert (own["verdict"], own["coverage"] < 0.5) == ("broken", True)


@pytest.mark.parametrize(("declared_hz", "true_hz"), [(30.0, 15), (60.0, 25), (30.0, 30)])
def test_a_wrong_declared_rate_makes_no_gaps_where_the_device_gives_no_time(study, declared_hz, true_hz):
    """A camera at half the rate its driver declares: nothing is missing, and the two rates are remarked."""
    late = np.random.default_rng(2)
    for i in range(round((LENGTH_S + 4) * true_hz)):
        study.raw(ECG, at((i + 1) / true_hz - 2 + late.exponential(0.003)), 0, {"c": np.zeros(1)})
    sensor = study.sensor(ECG, declared_hz, "uV", ["c"], 14)
    study.add("/study/sensors", "SensorInfoArray", at(-2), header={"stamp": stamp(at(-2))}, sensors=[sensor])
    found = entry(make_report(finish(study, session=told(required_streams=[ECG_TOPIC]))), ECG)
    assert (found["verdict"], found["gaps_total"], found["problems"]) == ("complete", 0, [])
    assert any("declared as" in remark for remark in found["remarks"]) == (declared_hz != true_hz)


def test_lost_messages_that_newer_ones_make_up_for_are_a_remark_of_all_of_them(study):
    """The session is complete; how many, and of how many topics, is told: no topic with a loss goes unmentioned."""
    for key in (ECG, EDA):
        stream(study, key)
        for second in range(30):
            health(study, key, second, 5)
    loss = {"after_ns": at(3.0), "before_ns": at(6.0), "cause": "middleware"}
    lost = [
        (topic.replace("/raw", "/health"), {"lost": count, "losses": [loss | {"count": count}]})
        for topic, count in ((ECG_TOPIC, 3), (EDA_TOPIC, 4))
    ]
    summary = make_report(finish(study, session=told(), lost=lost))
    assert summary["verdict"] == "complete"
    said = f"7 messages of {ECG_TOPIC.replace('/raw', '/health')} and 1 more sent and not recorded"
    assert summary["remarks"] == [f"{said}, of which newer ones say all: no loss"]

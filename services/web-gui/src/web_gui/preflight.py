"""What must be in order before a session, and a word on how to mend what is not. Pure.

The bounds are those of the alerts (`rules.RULES`). Whether a session starts is the session-coordinator's to say.
"""

from collections.abc import Iterator
from typing import NamedTuple

from sense4hri.beats import END_ONE, TWO_NODES

from web_gui.model import DRIVER, Study
from web_gui.readings import number
from web_gui.rules import RULES
from web_gui.stream import Stream
from web_gui.stream_problems import condition

COORDINATOR, RECORDER = "session_coordinator", "recorder"  # their nodes
BYTES_PER_VALUE = 10.0  # of a recording: 8 of the value, and its share of the message, clock, health and features


class Item(NamedTuple):
    """One thing. found: how it stands; mend: what to do, empty where it is in order."""

    what: str
    ok: bool
    found: str
    mend: str = ""


def of_stream(stream: Stream, now_ns: int) -> list[Item]:
    """Return what a required stream needs: samples at their rate, a locked clock, battery and contact."""
    return [_streaming(stream, now_ns), _clock(stream, now_ns), _battery(stream, now_ns), _contact(stream, now_ns)]


def of_study(study: Study, now_ns: int) -> list[Item]:
    """Return who must answer, each as one node: coordinator, recorder, and everybody who takes part in sessions."""
    items = [_coordinator(study), _recorder(study, now_ns), *_services(study, now_ns)]
    twins = study.services.twins(now_ns)
    return [Item(item.what, False, TWO_NODES, END_ONE) if item.ok and item.what in twins else item for item in items]


def bytes_per_s(study: Study) -> float:
    """Return about how fast a recording of all that streams now grows."""
    told = [
        (s.info.sampling_frequency_hz, len(s.history.channels)) for s in study.streams.values() if s.info and s.history
    ]
    return sum(BYTES_PER_VALUE * rate_hz * channels for rate_hz, channels in told)


def _streaming(stream: Stream, now_ns: int) -> Item:
    status, ratio = stream.status(now_ns), condition("RateLow", stream, now_ns)
    if status not in ("streaming", "derived"):
        return Item(
            "signal", False, status, "switch the sensor on, put it on, and bring it near; is its driver running?"
        )
    if ratio is not None and RULES["RateLow"].broken(ratio):
        mend = "bring the sensor nearer to the receiver, away from other radios"
        return Item("signal", False, f"{100 * ratio:.0f} % of its rate", mend)
    return Item("signal", True, status)


def _clock(stream: Stream, now_ns: int) -> Item:
    if stream.history is not None and not stream.history.device_time:
        return Item("clock", True, "host time")
    clock = stream.fresh_clock(now_ns)
    if clock is None:
        return Item("clock", False, "no clock model", "start clock-sync, or wait for it")
    state = number(clock.get("state"))
    if RULES["ClockNotFound"].broken(state):
        return Item("clock", False, "clock in warm-up", "wait: it locks by itself within a minute of steady signal")
    if RULES["ClockUnlocked"].broken(state):
        return Item("clock", False, "clock in hold-over", "bring the sensor nearer; its link is congested")
    return Item("clock", True, "clock locked")


def _battery(stream: Stream, now_ns: int) -> Item:
    charge = condition("BatteryLow", stream, now_ns)
    if charge is None:
        return Item("battery", True, "battery unknown")
    low = RULES["BatteryLow"].broken(charge)
    return Item("battery", not low, f"battery {100 * charge:.0f} %", "charge it, or take another one" if low else "")


def _contact(stream: Stream, now_ns: int) -> Item:
    contact = condition("ContactLost", stream, now_ns)
    if contact is None:
        return Item("contact", True, "contact unknown")
    if RULES["ContactLost"].broken(contact):
        return Item("contact", False, "off the skin", "moisten the electrodes or tighten the strap")
    return Item("contact", True, "on the skin")


def _coordinator(study: Study) -> Item:
    there = study.session.coordinator
    return Item(COORDINATOR, there, "answers" if there else "not there", "" if there else "start session-coordinator")


def _recorder(study: Study, now_ns: int) -> Item:
    status = study.session.recorder.newest(now_ns)
    if status is None:
        return Item(RECORDER, False, "says nothing", "start the recorder: without one nothing is recorded")
    if status.level == "error":
        return Item(RECORDER, False, status.message, "mend what it says; it goes on by itself")
    return Item(RECORDER, True, status.message or "answers")


def _services(study: Study, now_ns: int) -> Iterator[Item]:
    services = study.services
    troubles, answering, unseen = services.troubles(now_ns), services.answering(now_ns), study.unseen(now_ns)
    unready = {name: why for name, why in services.not_ready(now_ns).items() if not name.startswith(DRIVER)}
    for name in sorted(services.expected - {COORDINATOR, RECORDER}):
        if name in troubles:
            yield Item(name, False, troubles[name], "it is started again by itself; else start it")
        elif name in unready:
            yield Item(name, False, unready[name], "its log says more")
        elif name in unseen:
            yield Item(name, False, unseen[name], "switch the sensor on, put it on, and bring it near")
        else:
            yield Item(name, True, "answers" if name in answering else "there, has no heartbeat")

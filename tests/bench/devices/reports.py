"""Devices that only report: beats of a strap, measurements of an oximeter. Their values carry no number and no time.

So nobody can count what the air has lost, and the driver does not (health says -1). What came is compared with what the
virtual device has sent, value by value.
"""

import asyncio
import time
from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np
from bumble.link import LocalLink
from sense4hri.device import Item, Reported
from sense4hri.stamps import SECOND_NS
from sensor_bench.clock import HostClock
from sensor_bench.heart_rate.oximeter import Oximeter
from sensor_bench.heart_rate.reporter import INTERVAL_S, Reporter, ReporterKeys
from sensor_bench.heart_rate.strap import Strap, make_strap
from sensor_bench.room import Participant, Room
from sensor_bench.signals.hearts import Heart

from devices.played import LOSS, SIGNAL_S, Played

BEGUN_NS = 1_700_000_000 * SECOND_NS
R = TypeVar("R", bound=Reporter)
UNCOUNTED = "its reports carry no number"


def heart_rate_strap() -> Played:
    """RR intervals in 1/1024 s, as many in a report as there were beats; the strap is put on anew in the middle."""
    from sense4hri.gatt import decode_heart_rate, heart_rate_items

    def sent(strap: Strap, since_s: float, now_s: float) -> list[float]:
        return [round(beat.rr_s * 1024) * 1000 / 1024 for beat in strap.beats.known(since_s, now_s)]

    def decode(value: bytes, received_ns: int) -> Iterable[Item]:
        return heart_rate_items(decode_heart_rate(value), "ecg", received_ns)

    return _played("driver-ble-heart-rate, beats of a strap", make_strap, sent, decode, ("rr_interval",))


def pulse_oximeter() -> Played:
    """Saturation and pulse rate, three pairs each second; the oximeter is put on anew in the middle."""
    from driver_ble_heart_rate.protocol import PAIRS, decode_continuous

    def sent(oximeter: Oximeter, since_s: float, now_s: float) -> list[float]:
        return [oximeter.spo2_percent, float(oximeter.beats.rate_bpm(now_s))] * len(PAIRS)

    def decode(value: bytes, received_ns: int) -> Iterable[Item]:
        measured = decode_continuous(value)
        return [Reported("ppg", received_ns, measured.device_ns, measured.features)]

    names = tuple(f"{name}{which}" for which in PAIRS for name in ("spo2", "heart_rate"))
    return _played("driver-ble-heart-rate, pairs of an oximeter", Oximeter, sent, decode, names)


def _played(
    device: str,
    make: Callable[[Room, ReporterKeys], R],
    told: Callable[[R, float, float], list[float]],
    decode: Callable[[bytes, int], Iterable[Item]],
    names: tuple[str, ...],
) -> Played:
    """Play a device twice for half of the time. told: values of its report. names: of the features that carry them."""
    random, codec_s, sent, arrived, came = np.random.default_rng(14), 0.0, 0, list[float](), list[float]()
    for half in range(2):
        virtual = asyncio.run(_made(make))
        for number in range(int(SIGNAL_S / INTERVAL_S / 2)):
            since_s = half * SIGNAL_S / 2 + number * INTERVAL_S
            value, values = virtual.report(since_s, since_s + INTERVAL_S), told(virtual, since_s, since_s + INTERVAL_S)
            sent += len(values)
            if random.random() < LOSS:
                continue
            arrived += values
            begun_s = time.process_time()
            items = list(decode(value, BEGUN_NS + round((since_s + INTERVAL_S) * SECOND_NS)))
            codec_s += time.process_time() - begun_s
            came += _values(items, names)
    right = sum(a == b for a, b in zip(arrived, came, strict=True))
    return Played(device, sent, sent - len(arrived), right, 0, codec_s, uncounted=UNCOUNTED)


async def _made(make: Callable[[Room, ReporterKeys], R]) -> R:
    """Make the device, alone in its room; the radio that it does not use here wants a running loop."""
    host = HostClock()
    room = Room({"p1": Participant()}, 1, host, host.now_ns(), LocalLink(), None, {"p1": Heart(1)})  # type: ignore
    keys = {"sensor": "device_1", "model": "any", "participant": "p1", "address": "C0:00:00:00:00:01", "name": "any"}
    return make(room, ReporterKeys(**keys))


def _values(items: Iterable[Item], names: tuple[str, ...]) -> list[float]:
    features = [feature for item in items if isinstance(item, Reported) for feature in item.features]
    return [value for name in names for each in features if each.name == name for value in each.values]

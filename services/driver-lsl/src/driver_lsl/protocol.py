"""What an LSL stream's XML says, and what its samples become; no network, no clock.

<info><name/><type/><channel_count/><channel_format/><source_id/><nominal_srate/><hostname/><uid/>
  <desc><manufacturer/><channels><channel><label/><unit/><type/></channel>...</channels></desc></info>
"""

import math
import xml.etree.ElementTree as ElementTree
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri import lsl
from sense4hri.device import Identity, Stream
from sense4hri.errors import ConfigError, DeviceLost
from sense4hri.intake import LONGEST_NAME
from sense4hri.lsl_types import channel_type
from sense4hri.signal_files.choice import CONFIDENCE, Chosen, Wanted, place, told, unique, unit_of
from sense4hri.signal_files.units import Scale

BITS = {"int8": 8, "int16": 16, "int32": 32, "int64": 64}
FASTEST_HZ = 1e6
EXACT, EXACT_SHARE, UNUSUAL, FEW_STEPS = 0.1, 0.98, 200, 100
"""Stamps are exact where so many of the last steps that are not 1 sample are that near, in samples, to more of them."""
RESTART_S, RESTART_SAMPLES = 1.0, 10  # a step of more than both, forth or back, tells of a pause or another clock


class Outlet(NamedTuple):
    """One outlet as its XML describes it; units and types are empty where it does not tell them.

    rate_hz: 0 where samples come irregularly.
    """

    name: str
    host: str
    rate_hz: float
    bits: int
    channels: tuple[str, ...]
    units: tuple[str, ...]
    types: tuple[str, ...]
    events: bool
    identity: Identity


class Picked(NamedTuple):
    """One raw stream: which outlet, numbers of its channels there, what makes each canonical."""

    sensor_type: str
    outlet: int
    numbers: tuple[int, ...]
    scales: tuple[Scale, ...]
    stream: Stream


def parse(xml: str) -> Outlet:
    """Read a stream's XML. Raises DeviceLost where it is none, ConfigError where it says what cannot be."""
    try:
        info = ElementTree.fromstring(xml)
        count, rate_hz = int(lsl.text_of(info, "channel_count")), float(lsl.text_of(info, "nominal_srate") or 0)
    except (ElementTree.ParseError, ValueError) as err:
        raise DeviceLost(f"the description of the outlet cannot be read: {err}") from err
    name, host, form = (lsl.text_of(info, key) for key in ("name", "hostname", "channel_format"))
    kind = lsl.sensor_type(lsl.text_of(info, "type"))
    if count < 1 or not 0 <= rate_hz < FASTEST_HZ:
        raise ConfigError(f"outlets: stream {name!r} has {count} channels at {rate_hz:g} Hz")
    events = form == "string" or (kind == lsl.MARKERS and not rate_hz)
    channels = _channels(info, count, kind)
    return Outlet(name, host, rate_hz, BITS.get(form, 0), *channels, events, _identity(info, name))


def _channels(
    info: ElementTree.Element, count: int, kind: str
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """(labels, units, types) of so many channels, described or not; kind: the stream's sensor type."""
    described = info.findall("desc/channels/channel")[:count]
    described += [ElementTree.Element("channel")] * (count - len(described))
    labels = unique([lsl.text_of(each, "label") or str(number) for number, each in enumerate(described)])
    units = tuple(lsl.text_of(each, "unit") for each in described)
    types = tuple(
        channel_type(kind, lsl.text_of(each, "type"), label, unit)
        for each, label, unit in zip(described, labels, units, strict=True)
    )
    return labels, units, types


def _identity(info: ElementTree.Element, name: str) -> Identity:
    serial_number = _first(info, "serial_number", "acquisition/serial_number") or lsl.text_of(info, "source_id")
    return Identity(
        vendor=_first(info, "manufacturer", "acquisition/manufacturer"),
        model=_first(info, "model", "acquisition/model") or name or None,
        serial_number=serial_number or None,
    )


def pick(outlets: Sequence[Outlet], wanted: tuple[Wanted, ...]) -> list[Picked]:
    """Return the wanted streams, or those that the descriptions tell. Raises ConfigError: what is missing."""
    signals = [number for number, outlet in enumerate(outlets) if not outlet.events]
    described = [outlets[number] for number in signals]
    asked = wanted or told(described)
    where = ", ".join(repr(outlet.name) for outlet in outlets)
    if signals and not asked:
        names = ", ".join(name for outlet in described for name in outlet.channels)
        raise ConfigError(f"streams: {where} does not tell what its channels are, say it: {names}")
    found = []
    for each in asked:
        chosen = place(where, described, each)
        found.append(_picked(where, described[chosen.place], signals[chosen.place], each, chosen, bool(wanted)))
    return found


def _picked(where: str, outlet: Outlet, number: int, wanted: Wanted, chosen: Chosen, asked: bool) -> Picked:
    numbers, names = chosen.numbers, chosen.names
    plain = [name != CONFIDENCE for name in names]
    said = [outlet.units[column] for column, is_plain in zip(numbers, plain, strict=True) if is_plain]
    try:
        scaled = unit_of(where, wanted, said)
    except ConfigError:
        if asked:
            raise
        scaled = "a.u.", [Scale()] * len(said)  # channels of several units under one type: as they were sent
    unit, plain_scales = scaled or ("counts", [Scale()] * len(said))
    rest = iter(plain_scales)
    scales = tuple(next(rest).after(wanted.factor) if is_plain else Scale() for is_plain in plain)
    stream = Stream(outlet.rate_hz, unit, math.nan, math.nan, outlet.bits, names)
    return Picked(wanted.sensor_type, number, numbers, scales, stream)


def left_out(outlets: Sequence[Outlet], picked: Sequence[Picked]) -> str:
    """Return the sentence about channels of signals that no stream has; empty where there are none."""
    taken = {(each.outlet, number) for each in picked for number in each.numbers}
    names = [
        f"{name} of {outlet.name!r}"
        for place, outlet in enumerate(outlets)
        if not outlet.events
        for number, name in enumerate(outlet.channels)
        if (place, number) not in taken
    ]
    return (
        f"left out, as nothing tells which signal they are: {', '.join(names)}; `streams` can say it" if names else ""
    )


def words(row: Sequence[str], outlet: str) -> tuple[str, str]:
    """Return name and value of an event: its first channel that says something, and the others behind each other.

    A text that is no name for its length is the value, under the outlet's name. Empty where no channel says anything.
    """
    name, *others = [each for each in row if each] or [""]
    if len(name) > LONGEST_NAME:
        return outlet[:LONGEST_NAME], " ".join([name, *others])
    return name, " ".join(others)


class Evenness:
    """Tells whether a stream's stamps are exact to the sample, so that each hole among them is a loss.

    Judged by the steps that are not 1 sample, as senders of chunks space the stamps inside a chunk evenly and jitter at
    its edges alone: losses make whole numbers above 1, jitter any. Where they jitter, the kit's `SampleClock` tells
    jitter from loss frame by frame.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._odd: deque[bool] = deque(maxlen=UNUSUAL)
        self._steps = 0
        self._last_s = math.nan

    def exact(self, stamps_s: NDArray[np.float64]) -> bool:
        """Take the stamps of a frame in; True where stamps of this stream have been exact so far."""
        steps = np.diff(stamps_s, prepend=self._last_s) * self._rate_hz
        self._last_s = float(stamps_s[-1])
        steps = steps[np.abs(steps) <= max(RESTART_S * self._rate_hz, RESTART_SAMPLES)]
        self._steps += len(steps)
        unusual = steps[np.abs(steps - 1) > EXACT]
        self._odd.extend(((unusual < 1) | (np.abs(unusual - np.rint(unusual)) > EXACT)).tolist())
        return self._steps >= FEW_STEPS and sum(self._odd) <= (1 - EXACT_SHARE) * len(self._odd)


def _first(info: ElementTree.Element, *paths: str) -> str | None:
    return next((text for path in paths if (text := lsl.text_of(info, f"desc/{path}"))), None)

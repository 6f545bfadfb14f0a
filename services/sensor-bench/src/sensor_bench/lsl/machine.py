"""A machine with LSL outlets: a process of its own, so that it can be switched off, and can have a clock of its own.

`python -m sensor_bench.lsl.machine` reads pickles from its standard input: first a `Machine`, then `Frame`s to
push, until the end. It writes a line with 1 or 0 whenever somebody begins or ceases to listen.
"""

import pickle
import sys
from typing import Any, NamedTuple

import numpy as np
import pylsl
from numpy.typing import NDArray
from pylsl.lib import lib


class Outlet(NamedTuple):
    """What an outlet says of itself; channels: label, unit and type of each, empty where it does not tell."""

    name: str
    content_type: str
    source_id: str
    rate_hz: float
    form: str
    channels: tuple[tuple[str, str, str], ...]
    manufacturer: str = "Sense4HRI bench"


class Machine(NamedTuple):
    """What it offers, and the text of its lsl_api.cfg."""

    settings: str
    outlets: tuple[Outlet, ...]


class Frame(NamedTuple):
    """Samples of one outlet: stamps in s of its machine's clock, shape (n,); rows, shape (n, channels), or texts."""

    outlet: int
    stamps_s: NDArray[np.float64]
    rows: "NDArray[np.float64] | list[list[str]]"


def opened(outlet: Outlet) -> Any:
    """Offer an outlet on the network."""
    info = pylsl.StreamInfo(
        outlet.name, outlet.content_type, len(outlet.channels), outlet.rate_hz, outlet.form, outlet.source_id
    )
    info.desc().append_child_value("manufacturer", outlet.manufacturer)
    channels = info.desc().append_child("channels")
    for parts in outlet.channels:
        channel = channels.append_child("channel")
        for tag, text in zip(("label", "unit", "type"), parts, strict=True):
            if text:
                channel.append_child_value(tag, text)
    return pylsl.StreamOutlet(info)


def main() -> None:
    settings, described = pickle.load(sys.stdin.buffer)
    if settings:
        lib.lsl_set_config_content(settings.encode())
    outlets = [opened(each) for each in described]
    heard = False
    print(int(heard), flush=True)
    while True:
        try:
            number, stamps_s, rows = pickle.load(sys.stdin.buffer)
        except (EOFError, pickle.UnpicklingError):
            return
        for stamp_s, row in zip(stamps_s.tolist(), rows, strict=True):
            outlets[number].push_sample(row, stamp_s)
        if (listening := any(outlet.have_consumers() for outlet in outlets)) != heard:
            heard = listening
            print(int(heard), flush=True)


if __name__ == "__main__":
    main()

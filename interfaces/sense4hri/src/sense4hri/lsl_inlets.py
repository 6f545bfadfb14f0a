"""Outlets of the Lab Streaming Layer on the network, through liblsl: found, opened, heard, their clock measured.

The only place that knows pylsl for a driver; drivers that use it declare `pylsl`, the kit does not. Blocking, for
`from_thread`: `Link.read` returns what came, or None after a moment without anything.
"""

import ctypes
import math
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pylsl
from numpy.typing import NDArray
from pylsl.lib import lib
from pylsl.util import LostError
from pylsl.util import TimeoutError as NoAnswer  # pylsl's own, not Python's

from sense4hri import lsl
from sense4hri.errors import DeviceLost
from sense4hri.stamps import SECOND_NS

LOOK_S, LOOKS = 1.0, 10  # each look lasts so long; after so many without the outlet it is told what was heard
OPEN_S = 1.5  # within which an outlet that was heard answers
MEASURE_S = 0.5  # how often liblsl is asked for its newest estimate; it makes one every 2 s
FIRST_TRY_S, FIRST_TRIES = 0.5, 4
CLOCK_SILENCE_S = 20.0  # an outlet whose clock has answered before and is silent for so long is gone
MOST_SAMPLES, MOST_NUMBERS, MOST_TEXTS = 4096, 1 << 17, 64  # taken at once; numbers of all channels
PULL_S = 0.1  # how often the inlets are emptied: what liblsl holds of an outlet is gone with it
MOST_SHOWN = 12
HELD_S, LEAST_HELD, MOST_HELD = 60, 16, 1 << 21  # what an inlet holds of a stream: as long, and of how many samples
HELD_IRREGULAR = 360  # hundreds of samples
lib.lsl_time_correction_ex.restype = ctypes.c_double


class News:
    """What comes of the outlets."""


@dataclass(frozen=True)
class Opened(News):
    """All outlets are connected: the XML of each, in the order of the predicates."""

    descriptions: tuple[str, ...]


@dataclass(frozen=True)
class Pulled(News):
    """Samples of an outlet, shape (n, channels), and LSL's stamp of each in s, as sent, shape (n,).

    samples: float64; of an outlet of int64 as they are, for a float64 has 53 bits.
    """

    outlet: int
    samples: NDArray[Any]
    stamps_s: NDArray[np.float64]


@dataclass(frozen=True)
class Told(News):
    """Rows of text of an outlet, and LSL's stamp of each in s, as sent, shape (n,)."""

    outlet: int
    rows: list[list[str]]
    stamps_s: NDArray[np.float64]


@dataclass(frozen=True)
class Measured(News):
    """At remote_ns on the sender's LSL clock this host's wall clock showed remote_ns + offset_ns."""

    remote_ns: int
    offset_ns: int
    uncertainty_s: float


class Link:
    """A connection to all outlets of one device; predicates: one for each, which exactly one stream must fit."""

    def __init__(self, config: lsl.InletConfig, predicates: Sequence[str]) -> None:
        text = lsl.settings(config.known_peers, config.session)
        if text:
            lib.lsl_set_config_content(text.encode())
        self._news = _listen(predicates, config.frame_s)

    def read(self) -> News | None:
        """Return what came, or None after a moment without anything. Raises DeviceLost."""
        try:
            return next(self._news)
        except LostError as err:
            raise DeviceLost("the outlet is gone") from err
        except NoAnswer as err:
            raise DeviceLost("the outlet was heard and does not answer: its program hangs, or a firewall") from err

    def close(self) -> None:
        """Let go of the outlets."""
        self._news.close()


def _listen(predicates: Sequence[str], frame_s: float) -> Generator[News | None, None, None]:
    inlets: list[pylsl.StreamInlet] = []
    for predicate in predicates:
        info = yield from _found(predicate)
        held = _held(info.nominal_srate())
        inlets.append(pylsl.StreamInlet(info, held, recover=False, processing_flags=pylsl.proc_none))
        inlets[-1].open_stream(OPEN_S)
        yield None
    descriptions = []
    for inlet in inlets:
        descriptions.append(_xml(inlet.info(OPEN_S)))
        yield None
    yield Opened(tuple(descriptions))
    clock = _Clock(inlets[0])
    yield from clock.first()  # what comes meanwhile waits in the inlets
    while True:
        yield from _gathered(inlets, frame_s)
        yield clock.measured()


def _gathered(inlets: Sequence[pylsl.StreamInlet], frame_s: float) -> Iterator[Pulled | Told]:
    """Yield texts as they come, and the samples of frame_s together. Raises LostError, after all that has come."""
    waiting: list[Pulled] = []
    gone: LostError | None = None
    end_s = time.monotonic() + frame_s
    while not gone and time.monotonic() < end_s:
        time.sleep(min(PULL_S, frame_s))
        for number, inlet in enumerate(inlets):
            try:
                for news in _pulled(number, inlet):
                    if isinstance(news, Told):
                        yield news
                    else:
                        waiting.append(news)
            except LostError as err:
                gone = err
    for number, inlet in enumerate(inlets):
        yield from _joined([each for each in waiting if each.outlet == number], _most(inlet))
    if gone:
        raise gone


def _joined(parts: Sequence[Pulled], most: int) -> Iterator[Pulled]:
    """Yield what came of one outlet in as few parts as messages can hold."""
    if not parts:
        return
    samples, stamps_s = np.concatenate([each.samples for each in parts]), np.concatenate([e.stamps_s for e in parts])
    for at in range(0, len(stamps_s), most):
        yield Pulled(parts[0].outlet, samples[at : at + most], stamps_s[at : at + most])


def _found(predicate: str) -> Generator[None, None, pylsl.StreamInfo]:
    """Return the one stream that fits. Raises DeviceLost that says what was heard, where none or several fit."""
    for _ in range(LOOKS):
        fitting = pylsl.resolve_bypred(lsl.meant(predicate), 2, LOOK_S)  # a look ends at two, so the echoes stay out
        if len(fitting) == 1 and not fitting[0].channel_count():
            raise DeviceLost(f"what fits {predicate} is a stream whose description cannot be read")
        if len(fitting) == 1:
            return fitting[0]
        if fitting:
            raise DeviceLost(f"several streams fit {predicate}: {_names(fitting)}; say more")
        yield None
    raise DeviceLost(f"no stream fits {predicate}; heard: {_names(pylsl.resolve_streams(LOOK_S)) or 'none at all'}")


def _held(rate_hz: float) -> int:
    """Return how much an inlet holds, as liblsl wants it: s of a stream with a rate, else hundreds of samples.

    liblsl takes the memory for all of it at once, here and in the sender, and halts both where it is of no sample.
    """
    if not rate_hz:
        return HELD_IRREGULAR
    return math.ceil(min(max(HELD_S, LEAST_HELD / rate_hz), MOST_HELD / rate_hz))


def _names(infos: list[pylsl.StreamInfo]) -> str:
    more = f"; and {len(infos) - MOST_SHOWN} more" if len(infos) > MOST_SHOWN else ""
    return "; ".join(sorted(lsl.shown(_xml(info)) for info in infos)[:MOST_SHOWN]) + more


def _xml(info: pylsl.StreamInfo) -> str:
    """Return what an outlet says of itself, empty where that is no text."""
    try:
        return str(info.as_xml())
    except UnicodeDecodeError:
        return ""


def _pulled(number: int, inlet: pylsl.StreamInlet) -> Iterator[Pulled | Told]:
    """Yield all that waits, in parts of which a message holds one: services refuse more than 4 MiB."""
    is_text, most = inlet.channel_format == pylsl.cf_string, _most(inlet)
    while True:
        rows, stamps_s = inlet.pull_chunk(timeout=0.0, max_samples=most, as_numpy=True)
        if len(stamps_s):
            stamps_s = np.array(stamps_s)
            if is_text:
                yield Told(number, [[_text(each) for each in row] for row in rows], stamps_s)
            else:
                kept = np.int64 if rows.dtype == np.int64 else np.float64
                yield Pulled(number, rows.astype(kept), stamps_s)
        if len(stamps_s) < most:
            return


def _most(inlet: pylsl.StreamInlet) -> int:
    """Return how many samples are taken at once."""
    if inlet.channel_format == pylsl.cf_string:
        return MOST_TEXTS
    return max(1, min(MOST_SAMPLES, MOST_NUMBERS // inlet.channel_count))


def _text(octets: bytes) -> str:
    return octets.decode("utf-8", "replace")


class _Clock:
    """The sender's clock against this host's, as liblsl measures it: the quickest of eight round trips every 2 s."""

    def __init__(self, inlet: pylsl.StreamInlet) -> None:
        self._inlet = inlet
        self._told_s, self._asked_at_s, self._changed_at_s = 0.0, 0.0, 0.0

    def first(self) -> Iterator[Measured | None]:
        """Wait a moment for the first estimate, so that the first events have their time too."""
        for _ in range(FIRST_TRIES):
            yield (found := self.measured(FIRST_TRY_S))
            if found is not None:
                return

    def measured(self, wait_s: float = 0.001) -> Measured | None:
        """Return liblsl's estimate where it is a new one. Raises DeviceLost where the sender has fallen silent."""
        now_s = time.monotonic()
        if self._told_s and now_s - self._asked_at_s < MEASURE_S:
            return None
        self._asked_at_s = now_s
        remote_s, width_s, error = ctypes.c_double(), ctypes.c_double(), ctypes.c_int()
        correction_s = lib.lsl_time_correction_ex(
            self._inlet.obj, ctypes.byref(remote_s), ctypes.byref(width_s), ctypes.c_double(wait_s), ctypes.byref(error)
        )
        if error.value or remote_s.value == self._told_s:
            if self._told_s and now_s - self._changed_at_s > CLOCK_SILENCE_S:
                raise DeviceLost(f"the clock of the outlet's machine has not answered for {CLOCK_SILENCE_S:g} s")
            return None
        self._told_s, self._changed_at_s = remote_s.value, now_s
        wall = lsl.wall(pylsl.local_clock)
        offset_ns = round(correction_s * SECOND_NS) + wall.offset_ns
        return Measured(round(remote_s.value * SECOND_NS), offset_ns, width_s.value / 2 + wall.uncertainty_s)

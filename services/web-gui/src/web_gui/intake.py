"""What came from the graph, fit to be kept and shown: short texts and lists, nothing hidden. Pure.

Everybody on the graph may publish; nothing of what they send may keep a browser from its next message. That numbers
are NaN or such as can be measured, the kit has seen to (`sense4hri.intake`).
"""

from functools import lru_cache
from typing import Any

import numpy as np
from sense4hri.cdr import read_raw
from sense4hri.chunk import Chunk
from sense4hri.intake import LARGEST
from sense4hri.stamps import to_ns

LONGEST_TEXT, LONGEST_SENTENCE = 300, 600
MOST_ITEMS, MOST_REASONS = 1000, 10
MOST_CHANNELS, MOST_VALUES = 1024, 1 << 19  # of one raw message: 1024 channels, 4 MB
DEEPEST = 8
_JOINERS = "\u200c\u200d"  # without them Persian, Hindi and many an emoji read wrongly
_REST = "…"


@lru_cache(4096)
def shown(text: str, longest: int = LONGEST_TEXT) -> str:
    """Return a text of at most `longest` characters in which each can be seen: `\\u202e` for one that turns writing."""
    cut = text if len(text) <= longest else text[: longest - 1] + _REST
    return cut if cut.isprintable() else "".join(map(_visible, cut))[:longest]


def plain(message: Any, depth: int = 0) -> dict[str, Any]:
    """Return a message as plain values: times in ns, nested messages as dicts, arrays as lists."""
    found = {name: _value(getattr(message, name), depth) for name in message.get_fields_and_field_types()}
    if "reasons" in found:
        found["reasons"] = found["reasons"][:MOST_REASONS]
    return found


def chunk_of(cdr: bytes) -> Chunk:
    """Return a serialised `raw` message as a chunk whose channels have names that can be shown.

    Read from its bytes, which costs a tenth of what its class does. Raises ValueError that says why it cannot be kept:
    it is none, its channels differ in length, or it is too large.
    """
    told = read_raw(cdr)
    if len(told.channels) > MOST_CHANNELS:
        raise ValueError(f"{len(told.channels)} channels in one message, at most {MOST_CHANNELS} are shown")
    if told.samples.size > MOST_VALUES:
        raise ValueError(f"{told.samples.size} values in one message, at most {MOST_VALUES} are shown")
    if np.any(np.abs(told.samples) > LARGEST):
        raise ValueError(f"a number beyond {LARGEST:g}")
    return Chunk(tuple(map(shown, told.channels)), told.samples, told.device_ns or None, told.received_ns)


def _value(value: Any, depth: int) -> Any:
    if isinstance(value, str):
        return shown(value)
    if isinstance(value, bool | int | float):
        return value
    if isinstance(value, bytes):
        return int.from_bytes(value, "little")
    if hasattr(value, "nanosec"):
        return to_ns(value)
    if hasattr(value, "get_fields_and_field_types"):
        return plain(value, depth + 1) if depth < DEEPEST else {}
    return [_value(entry, depth) for entry in _items(value)]


def _items(value: Any) -> list[Any]:
    few = value[:MOST_ITEMS]
    return list(few.tolist()) if hasattr(few, "tolist") else list(few)


def _visible(character: str) -> str:
    if character.isprintable() or character in _JOINERS:
        return character
    return " " if character in "\t\n\r" else f"\\u{ord(character):04x}"

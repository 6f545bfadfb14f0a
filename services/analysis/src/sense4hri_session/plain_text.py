"""Text that anybody may have sent, made harmless for files that programs interpret. Parquet has it as it came."""

from __future__ import annotations

import re

_PICTURES = {code: 0x2400 + code for code in range(0x20)} | {0x7F: 0x2421}  # a newline is shown as U+240A
_UNSHOWN = dict.fromkeys([*range(0x80, 0xA0), *range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x2028, 0x2029], 0xFFFD)
_TABLE = _PICTURES | _UNSHOWN | dict.fromkeys(range(0xD800, 0xE000), 0xFFFD)
_FORMULA = ("=", "+", "-", "@", "'")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def plain(text: str) -> str:
    """One line of visible characters: every control character as its picture, what has none as U+FFFD."""
    return text.translate(_TABLE)


def cell(text: str) -> str:
    """A cell of CSV or TSV that no spreadsheet takes for a formula: `'` goes before one, and before another `'`."""
    shown = plain(text)
    return f"'{shown}" if shown.startswith(_FORMULA) and not _NUMBER.fullmatch(shown) else shown


def ascii_only(text: str) -> str:
    """Printable ASCII, as in an EDF header."""
    return plain(text).replace("µ", "u").encode("ascii", "replace").decode()

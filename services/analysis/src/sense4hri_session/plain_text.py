"""Text that anybody may have sent, made harmless for files that programs interpret. Parquet has it as it came."""

from __future__ import annotations

import re

from sense4hri.plain_text import plain

_FORMULA = ("=", "+", "-", "@", "'")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def cell(text: str) -> str:
    """A cell of CSV or TSV that no spreadsheet takes for a formula: `'` goes before one, and before another `'`."""
    shown = plain(text)
    return f"'{shown}" if shown.startswith(_FORMULA) and not _NUMBER.fullmatch(shown) else shown


def ascii_only(text: str) -> str:
    """Printable ASCII, as in an EDF header."""
    return plain(text).replace("µ", "u").encode("ascii", "replace").decode()

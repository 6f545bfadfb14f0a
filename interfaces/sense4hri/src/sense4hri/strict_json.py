"""JSON that somebody else wrote: read whole or refused in one sentence. Pure."""

import json
import math
from collections import Counter
from typing import Any

from sense4hri.errors import Refusal

DEEPEST, LARGEST_INTEGER, MOST_BYTES = 32, 2**63 - 1, 1 << 20
LONGEST_NAME = 80


def parse(text: bytes | str, what: str = "the body", most_bytes: int = MOST_BYTES) -> Any:
    """Return the value; an empty text is an empty object. what: how the text is called where it is refused.

    Raises Refusal, a ValueError, for what is longer than most_bytes, no UTF-8, no JSON, nested deeper than DEEPEST, or
    holds a name twice, half of a surrogate pair, the character NUL, at which a message would end, NaN, infinity or a
    whole number beyond 64 bits. What is returned can be written as JSON, stored as UTF-8 and put into any message.
    """
    if len(text) > most_bytes:
        raise Refusal(f"{what} is longer than {most_bytes} bytes")
    try:
        decoded = text if isinstance(text, str) else text.decode()
        value = json.loads(decoded or "{}", object_pairs_hook=_object)
    except Refusal:
        raise
    except RecursionError:
        raise Refusal(f"{what} is nested deeper than {DEEPEST} levels") from None
    except ValueError as err:
        raise Refusal(f"{what} is not JSON: {err}") from err
    _check(value, what, "", 0)
    return value


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        twice = Counter(name for name, _ in pairs).most_common(1)[0][0][:LONGEST_NAME]
        raise Refusal(f"{twice!r} is given twice", twice)
    return found


def _check(value: Any, what: str, field: str, depth: int) -> None:
    """Refuse what a program behind would stumble over."""
    if depth > DEEPEST:
        raise Refusal(f"{what} is nested deeper than {DEEPEST} levels")
    if isinstance(value, dict):
        for name, item in value.items():
            _check(name, what, field, depth)
            _check(item, what, f"{field}.{name}" if field else name, depth + 1)
    elif isinstance(value, list):
        for item in value:
            _check(item, what, field, depth + 1)
    elif isinstance(value, str) and any(0xD800 <= ord(character) < 0xE000 for character in value):
        raise _refused(what, field, "holds half of a surrogate pair")
    elif isinstance(value, str) and "\0" in value:
        raise _refused(what, field, "holds the character NUL")
    elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise _refused(what, field, "is a whole number beyond 64 bits")
    elif isinstance(value, float) and not math.isfinite(value):
        raise _refused(what, field, f"is {value}, which is no finite number")


def _refused(what: str, field: str, why: str) -> Refusal:
    """field: as far as it can be told; a name that cannot be written is left out."""
    told = field.encode("ascii", "backslashreplace").decode()[:LONGEST_NAME]
    return Refusal(f"{told or what} {why}", told)

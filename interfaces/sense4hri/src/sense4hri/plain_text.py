"""Text that anybody may have sent, as one line that every program shows and every XML holds. Pure."""

_PICTURES = {code: 0x2400 + code for code in range(0x20)} | {0x7F: 0x2421}  # a newline is shown as U+240A
_UNSHOWN = dict.fromkeys([*range(0x80, 0xA0), *range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x2028, 0x2029], 0xFFFD)
_NO_CHARACTERS = dict.fromkeys([*range(0xD800, 0xE000), 0xFFFE, 0xFFFF], 0xFFFD)  # no XML may hold them
_TABLE = _PICTURES | _UNSHOWN | _NO_CHARACTERS


def plain(text: str) -> str:
    """One line of visible characters: every control character as its picture, what has none as U+FFFD."""
    return text.translate(_TABLE)

"""The one error a reader of recordings has to expect."""


class SessionError(Exception):
    """The recording cannot be opened or exported; the text says which file, why, and what can be done."""

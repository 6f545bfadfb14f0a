"""Three deliberate ways to fail; anything else crashes loudly and is restarted. And one way to say no."""


class Sense4HriError(Exception):
    """Base of every error this project raises on purpose."""


class ConfigError(Sense4HriError):
    """The operator must act. The kit logs one line and the process exits with status 78."""


class DeviceLost(Sense4HriError):
    """The link went away. The kit backs off and asks the device for a new stream, for ever."""


class FrameError(Sense4HriError):
    """One frame could not be decoded. It is counted and skipped, never guessed."""


class Refusal(Sense4HriError, ValueError):
    """What somebody asked for cannot be done. Over HTTP: the status, the sentence, and the field that is wrong."""

    def __init__(self, error: str, field: str = "", status: int = 400) -> None:
        super().__init__(error)
        self.field, self.status = field, status


class Refused(Sense4HriError):
    """A topic, a message or a parameter of somebody's cannot be used, and why. It is said once; all else goes on."""

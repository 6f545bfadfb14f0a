"""Three deliberate ways to fail; anything else crashes loudly and is restarted."""


class Sense4HriError(Exception):
    """Base of every error this project raises on purpose."""


class ConfigError(Sense4HriError):
    """The operator must act. The kit logs one line and the process exits with status 78."""


class DeviceLost(Sense4HriError):
    """The link went away. The kit backs off and asks the device for a new stream, for ever."""


class FrameError(Sense4HriError):
    """One frame could not be decoded. It is counted and skipped, never guessed."""

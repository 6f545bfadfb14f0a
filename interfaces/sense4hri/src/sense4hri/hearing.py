"""A message on its way to the handler of a subscription: what it has to be, and who is told where it is not."""

from collections.abc import Callable
from typing import Any, NamedTuple

from rclpy.serialization import deserialize_message

from sense4hri import intake
from sense4hri.errors import FrameError, Refused


class Hearing(NamedTuple):
    """One subscription; see `Service.subscribe`. refuse: as `Service.refuse`."""

    message: type
    topic: str
    handler: Callable[..., None]
    refuse: Callable[[str, str, str], None]
    raw: bool
    with_info: bool

    def checked(self, cdr: bytes, info: dict[str, Any]) -> tuple[Any, ...]:
        """Return what the handler is called with, on the thread that receives; empty where the message is refused."""
        try:
            taken = _taken(self.message, cdr, self.raw)
        except Refused as err:
            self.refuse(self.topic, self.message.__name__, str(err))
            return ()
        return (taken, info) if self.with_info else (taken,)

    def handle(self, *taken: Any) -> None:
        """Call the handler, on the main thread; what it finds wrong (FrameError) is refused."""
        try:
            self.handler(*taken)
        except FrameError as err:
            self.refuse(self.topic, self.message.__name__, str(err))


def _taken(kind: type, cdr: bytes, raw: bool) -> Any:
    """Return a message, or with raw its bytes. Raises Refused."""
    intake.check_bytes(cdr)
    if raw:
        if intake.has_both_stamps(kind):
            intake.check_stamps(cdr)
        return cdr
    try:
        message = deserialize_message(cdr, kind)
    except (RuntimeError, ValueError, MemoryError):
        raise Refused(f"its {len(cdr)} bytes are no {kind.__name__}") from None
    intake.check(message)
    return message

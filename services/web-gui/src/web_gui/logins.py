"""What the open pages of one browser may do: all of them follow its login, in whichever it is changed."""

import math
from dataclasses import dataclass
from time import monotonic

DAY_S = 86_400


@dataclass(frozen=True)
class Standing:
    """What whoever asks may do: nobody, view or operate.

    why: what keeps them from operating, empty where nothing. by_token: they brought one, and may leave.
    """

    role: str
    why: str
    by_token: bool = False


class Login:
    """The login of one browser, which its open pages share. everybody: what is open to it without one."""

    def __init__(self, everybody: Standing) -> None:
        self._everybody = self._standing = everybody
        self._until_s = math.inf

    def enter(self, standing: Standing) -> None:
        """Count for as long as the browser keeps the cookie that it is given now."""
        self._standing, self._until_s = standing, monotonic() + DAY_S

    def leave(self) -> None:
        """Fall back on what is open to everybody."""
        self._standing, self._until_s = self._everybody, math.inf

    def seen(self, standing: Standing, by_cookie: bool) -> None:
        """Take what a request shows; how old its cookie is nobody knows but who has given it."""
        self._standing = standing
        if by_cookie and self._until_s == math.inf:
            self._until_s = monotonic() + DAY_S

    @property
    def expired(self) -> bool:
        """Whether the browser has thrown its cookie away by now."""
        return monotonic() >= self._until_s

    @property
    def standing(self) -> Standing:
        """What the browser may do at this moment."""
        return self._everybody if self.expired else self._standing

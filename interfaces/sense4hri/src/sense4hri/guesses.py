"""How many wrong tokens may be tried from one address, so that a short one is not found by trying.

Why a long one is let in all the same: `docs/decisions/guesses-of-a-token.md`.
"""

import hashlib
import threading
import time
from collections.abc import Callable, Iterable
from ipaddress import IPv6Address, ip_address

from sense4hri.access import Access, Denied, Role

MOST_WRONG, WITHIN_S = 10, 60.0
MOST_SOURCES = 1000  # the newest
UNGUESSABLE = 20  # characters


class Guesses:
    """Counts the different wrong tokens that each address has tried; asked from any thread."""

    def __init__(self, access: Access, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._access, self._clock_s = access, clock_s
        self._lock = threading.Lock()
        self._wrong: dict[str, dict[bytes, float]] = {}
        """By source, the newest last: fingerprints of wrong tokens, and when each was tried first."""

    def denied(self, source: str, tokens: Iterable[str]) -> Denied | None:
        """Return why tokens from this address are not looked at, None where they are; to be asked before they count.

        A wrong token that is sent again and again, as by a browser with an old cookie, is one guess.
        """
        access, tokens = self._access, [*tokens]
        if not tokens or not (access.operate_token or access.view_token):
            return None
        if any(len(token) >= UNGUESSABLE and access.bearer(token) for token in tokens):
            return None
        with self._lock:
            return self._counted(_place(source), tokens)

    def _counted(self, place: str, tokens: list[str]) -> Denied | None:
        now_s = self._clock_s()
        tried = self._wrong.pop(place, {})
        wrong = {token: at_s for token, at_s in tried.items() if now_s - at_s < WITHIN_S}
        denied = None
        for token in tokens:
            fingerprint = hashlib.sha256(token.encode(errors="replace")).digest()
            if fingerprint in wrong:
                continue
            if len(wrong) >= MOST_WRONG:
                denied = Denied(429, f"{MOST_WRONG} wrong tokens came from this address: wait {WITHIN_S:g} s")
            elif self._access.bearer(token) is Role.NOBODY:
                wrong[fingerprint] = now_s
        if wrong:
            self._wrong[place] = wrong
        if len(self._wrong) > MOST_SOURCES:
            del self._wrong[next(iter(self._wrong))]
        return denied


def _place(source: str) -> str:
    """Return what one guesser has of addresses: an IPv4 address, or the half of an IPv6 one that its network gives."""
    try:
        address = ip_address(source)
    except ValueError:
        return source
    if not isinstance(address, IPv6Address):
        return source
    return str(address.ipv4_mapped or int(address) >> 64)

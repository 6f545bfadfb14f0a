"""Who may do what over HTTP: section 10 of the contract as one decision. Pure; every HTTP interface asks it.

Two roles: *view* reads, *operate* changes state. Whoever carries a token has its role. Whoever carries none has what
the process leaves open: viewing where no view token is set, and operating only where no token is set at all and the
process listens on loopback alone. That no page of the web can steer a study is checked besides: the `Host` of a
request without a token, the `Origin` of every request, and JSON as the only content type that changes anything.
"""

import hmac
import os
import re
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple, Protocol
from urllib.parse import urlsplit

from sense4hri.errors import ConfigError

OPERATE_TOKEN, VIEW_TOKEN, ALLOWED_HOSTS = "SENSE4HRI_OPERATE_TOKEN", "SENSE4HRI_VIEW_TOKEN", "ALLOWED_HOSTS"
ANYWHERE = ("", "0.0.0.0", "::")
JSON = "application/json"
HOW_TO_SET = f"set {OPERATE_TOKEN}, or {OPERATE_TOKEN}_FILE to a file that holds it, and start again"
_PORT = re.compile(r":([0-9]{1,5})\Z")
_TOKEN = re.compile(r"[A-Za-z0-9._~+/=-]{1,512}")


class Role(IntEnum):
    """What somebody may do; the higher includes the lower."""

    NOBODY = 0
    VIEW = 1
    OPERATE = 2


class Headers(Protocol):
    """The header fields of a request, as http.server or aiohttp has them."""

    def get(self, name: str, /) -> str | None: ...


class Asked(NamedTuple):
    """What a request says of itself: its header fields of these names, empty where it has none."""

    host: str = ""
    origin: str = ""
    content_type: str = ""
    authorization: str = ""
    cookie: str = ""

    @classmethod
    def by(cls, headers: Headers) -> "Asked":
        """Read the header fields of a request; headers must not care for upper and lower case."""
        names = ("Host", "Origin", "Content-Type", "Authorization", "Cookie")
        return cls(*(headers.get(name) or "" for name in names))

    @property
    def tokens(self) -> tuple[str, ...]:
        """The tokens it brings, in its header and as the page's cookie."""
        scheme, _, token = self.authorization.partition(" ")
        brought = (token.strip() if scheme.lower() == "bearer" else "", _cookie(self.cookie, self.cookie_name))
        return tuple(filter(None, brought))

    @property
    def cookie_name(self) -> str:
        """The name of the page's cookie: a browser sends one to every port of a host, each may be another study's."""
        port = _PORT.search(self.host)
        return f"sense4hri_token_{port[1]}" if port else "sense4hri_token"


class Denied(NamedTuple):
    """A refusal: status 401 (a token is missing or wrong), 403, 415 or 429, and why in one sentence."""

    status: int
    error: str


@dataclass(frozen=True)
class Access:
    """The rules of one process. listens_on: the address it serves; hosts: further names it may be called by."""

    listens_on: str = "127.0.0.1"
    operate_token: str = ""
    view_token: str = ""
    hosts: frozenset[str] = frozenset()

    @classmethod
    def from_environment(cls, listens_on: str, environment: Mapping[str, str] = os.environ) -> "Access":
        """Read the tokens and ALLOWED_HOSTS (separated by commas or blanks). Raises ConfigError that names which."""
        named = environment.get(ALLOWED_HOSTS, "").replace(",", " ").lower().split()
        hosts = {_name(in_url(host)) or host for host in named} | {socket.gethostname().lower()}
        return cls(listens_on, _token(OPERATE_TOKEN, environment), _token(VIEW_TOKEN, environment), frozenset(hosts))

    def notice(self) -> str:
        """Return what to say at the start of a process whose state nobody may change; empty where somebody may."""
        if self.operate_token or self.role(Asked()) is Role.OPERATE:
            return ""
        return f"nobody may change anything over HTTP on {self.listens_on}: {HOW_TO_SET}"

    def bearer(self, token: str) -> Role:
        """Return the role of whoever has this token; how long that takes says nothing of the right one."""
        given = token.encode(errors="replace")
        operates = hmac.compare_digest(given, self.operate_token.encode())
        views = hmac.compare_digest(given, self.view_token.encode())
        if operates and self.operate_token:
            return Role.OPERATE
        return Role.VIEW if views and self.view_token else Role.NOBODY

    def role(self, asked: Asked) -> Role:
        """Return what a request may do at most, by its token or by what this process leaves open."""
        if not (self.operate_token or self.view_token) and is_loopback(self.listens_on):
            return Role.OPERATE
        left_open = Role.NOBODY if self.view_token else Role.VIEW
        return max(self.carried(asked), left_open)

    def decide(self, needed: Role, asked: Asked) -> Denied | None:
        """Return why a request that needs this role is refused, None where it may go on."""
        denied = self.stranger(asked)
        if denied is None and needed is Role.OPERATE:
            denied = not_json(asked)
        return denied or self.short_of(needed, asked)

    def stranger(self, asked: Asked) -> Denied | None:
        """Return why a request comes from somewhere it must not come from: a foreign name or another site's page."""
        if asked.origin and not _same_origin(asked):
            return Denied(403, "another site's page may not talk to this process: Origin and Host differ")
        if self.carried(asked) is Role.NOBODY and not self._is_ours(asked.host):
            return Denied(403, f"without a token this Host is not answered; {ALLOWED_HOSTS} lists further ones")
        return None

    def short_of(self, needed: Role, asked: Asked) -> Denied | None:
        """Return what keeps a request from this role, None where it has it."""
        role = self.role(asked)
        if role >= needed:
            return None
        if needed is Role.OPERATE and not self.operate_token:
            return Denied(403, f"this process changes nothing over HTTP without an operate token: {HOW_TO_SET}")
        if self.carried(asked) is Role.VIEW:
            return Denied(403, "this token may view, not operate")
        return Denied(401, f"a token to {needed.name.lower()} is needed, as Authorization: Bearer ...")

    def carried(self, asked: Asked) -> Role:
        """Return the role of the token that a request brings, in its header or as the page's cookie."""
        return max(map(self.bearer, asked.tokens), default=Role.NOBODY)

    def _is_ours(self, netloc: str) -> bool:
        name = _name(netloc)
        own = {self.listens_on.lower()} - set(ANYWHERE)
        return bool(name) and (is_loopback(name) or name in own or name in self.hosts)


def not_json(asked: Asked) -> Denied | None:
    """Return why a body is refused unread: a form of any site can send everything but JSON without asking first."""
    if asked.content_type.partition(";")[0].strip().lower() == JSON:
        return None
    return Denied(415, f"what changes something must have the Content-Type {JSON}")


def in_url(host: str) -> str:
    """Return a host as it stands in a URL: an IPv6 address in brackets, spelt as browsers do."""
    try:
        return f"[{address}]" if (address := ip_address(host.strip("[]"))).version == 6 else host
    except ValueError:
        return host


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches a process that listens on this address."""
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def authorization(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the header fields with which a program operates where these tokens are set: its own environment's."""
    token = _token(OPERATE_TOKEN, environment) or _token(VIEW_TOKEN, environment)
    return {"Authorization": f"Bearer {token}"} if token else {}


def _token(name: str, environment: Mapping[str, str]) -> str:
    """Return the token of this name or in the file of name_FILE; empty where neither is set."""
    token, path = environment.get(name, ""), environment.get(f"{name}_FILE", "")
    if path:
        name, token = f"{name}_FILE", _content(f"{name}_FILE", path)
    if (path or token) and not _TOKEN.fullmatch(token):
        raise ConfigError(f"{name} must hold 1 to 512 letters, digits or . _ ~ + / = -")
    return token


def _content(name: str, path: str) -> str:
    try:
        return Path(path).read_text("utf-8").strip()
    except OSError as err:
        raise ConfigError(f"{name} is {path!r}, which cannot be read: {err.strerror}") from err
    except UnicodeDecodeError as err:
        raise ConfigError(f"{name} is {path!r}, which holds no text") from err


def _name(netloc: str) -> str:
    """Return the name in `name:port`, in small letters; empty where it is none."""
    try:
        parts = urlsplit(f"//{netloc}")
        return (parts.hostname or "") if parts.netloc == netloc and "@" not in netloc else ""
    except ValueError:
        return ""


def _same_origin(asked: Asked) -> bool:
    host = asked.host.lower()
    return bool(host) and asked.origin.lower() in (f"http://{host}", f"https://{host}")


def _cookie(header: str, wanted: str) -> str:
    """Return the token among the cookies; other programs on this host may have set others, however odd."""
    pairs = (pair.strip().partition("=") for pair in header.split(";"))
    return next((value.strip('"') for name, _, value in pairs if name == wanted), "")

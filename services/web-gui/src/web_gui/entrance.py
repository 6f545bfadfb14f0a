"""Who may come in, and who may operate: the kit's rules for the page, and a token exchanged for a cookie."""

import json
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from aiohttp import web
from sense4hri.access import COOKIE, Access, Asked, Denied, Role, not_json
from sense4hri.errors import Refusal
from sense4hri.routes import Route, Routes
from sense4hri.schema import parameter
from sense4hri.shapes import plain, read
from sense4hri.strict_json import parse

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
NEED_VIEW = ("/ws", "/reports/", "/openapi.json")
DAY_S = 86_400


@dataclass(frozen=True)
class TokenWish:
    """A token, typed or from the address's fragment."""

    token: str = parameter(help="the operate or the view token of this study")


@dataclass(frozen=True)
class Standing:
    """What whoever asks may do: nobody, view or operate.

    why: what keeps them from operating, empty where nothing. by_token: they brought one, and may leave.
    """

    role: str
    why: str
    by_token: bool = False


@dataclass(frozen=True)
class Leaving:
    """Nothing has to be said to leave."""


class Entrance:
    """Guards every request, and answers `/access`, `/token` and `/openapi.json`."""

    def __init__(self, access: Access, version: str) -> None:
        self.access, self._version = access, version
        self._routes = Routes()

    def add_to(self, app: web.Application) -> None:
        """Serve the routes."""
        for route in (
            Route("GET", "/access", Role.NOBODY, self._access, None, Standing),
            Route("POST", "/token", Role.NOBODY, self._exchange, TokenWish, Standing),
            Route("POST", "/leave", Role.NOBODY, self._leave, Leaving, Standing),
            Route("GET", "/openapi.json", Role.VIEW, self._describe, None, dict[str, Any]),
        ):
            self._routes.add(route)
            app.router.add_route(route.method, route.path, route.handler)

    def standing(self, request: web.Request) -> Standing:
        """Return what a request may do."""
        return self._standing(Asked.by(request.headers))

    def _standing(self, asked: Asked) -> Standing:
        short = self.access.short_of(Role.OPERATE, asked)
        by_token = self.access.carried(asked) is not Role.NOBODY
        return Standing(self.access.role(asked).name.lower(), "" if short is None else short.error, by_token)

    @web.middleware
    async def guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse strangers, and the study to whoever may not view; the page's own files hold nothing of it."""
        asked = Asked.by(request.headers)
        denied = self.access.decide(Role.VIEW if request.path.startswith(NEED_VIEW) else Role.NOBODY, asked)
        if denied is None and request.method == "POST":
            denied = not_json(asked)
        if denied is not None:
            return _refused(denied)
        try:
            return await handler(request)
        except web.HTTPClientError as err:
            return _refused(Denied(err.status, (err.text or err.reason).strip()))

    async def _access(self, request: web.Request) -> web.Response:
        """What whoever asks may do."""
        return _json(self.standing(request))

    async def _exchange(self, request: web.Request) -> web.Response:
        """Exchange a token for a cookie, which the page's scripts cannot read."""
        try:
            token = read(TokenWish, parse(await request.read())).token
        except Refusal as err:
            return _refused(Denied(err.status, str(err)), err.field)
        role = self.access.bearer(token)
        if role is Role.NOBODY:
            return _refused(Denied(401, "this is no token of this study"), "token")
        why = "" if role is Role.OPERATE else "this token may view, not operate"
        answer = _json(Standing(role.name.lower(), why, by_token=True))
        answer.set_cookie(COOKIE, token, max_age=DAY_S, httponly=True, samesite="Strict", secure=request.secure)
        return answer

    async def _leave(self, request: web.Request) -> web.Response:
        """Take the cookie back; what this connection then may do is what is open to everybody."""
        answer = _json(self._standing(Asked(host=request.host)))
        answer.del_cookie(COOKIE, httponly=True, samesite="Strict")
        return answer

    async def _describe(self, request: web.Request) -> web.Response:
        """This description, OpenAPI 3.1; the WebSocket `/ws` is described in the service's README."""
        return _json(self._routes.openapi("web_gui: the page", self._version))


def _json(value: Any, status: int = 200) -> web.Response:
    return web.json_response(plain(value), status=status, dumps=lambda told: json.dumps(told, allow_nan=False))


def _refused(denied: Denied, field_name: str = "") -> web.Response:
    return _json({"error": denied.error, "field": field_name}, denied.status)

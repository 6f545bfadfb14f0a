"""Who may come in, and who may operate: the kit's rules for the page, and a token exchanged for a cookie."""

import functools
import json
import secrets
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any
from weakref import WeakValueDictionary

from aiohttp import web
from sense4hri.access import Access, Asked, Denied, Role, not_json
from sense4hri.errors import Refusal
from sense4hri.guesses import Guesses
from sense4hri.routes import Route, Routes, WrongMethod
from sense4hri.schema import parameter
from sense4hri.shapes import plain, read
from sense4hri.strict_json import parse

from web_gui.logins import DAY_S, Login, Standing

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
NEED_VIEW = ("/ws", "/reports/", "/openapi.json")
MOST_LOGINS = 1000  # known while no page of theirs is open, the newest; a program may enter once a second
BROWSER = "sense4hri_browser"
"""Names a browser, so that its open pages are known when its login changes; says nothing of who may do what."""

_TOKEN_NEEDED = {
    Role.NOBODY: "a token is needed to see this study; whoever runs it has one",
    Role.VIEW: "a token to operate is needed; whoever runs the study has it",
}


@dataclass(frozen=True)
class TokenWish:
    """A token, typed or from the address's fragment."""

    token: str = parameter(help="the operate or the view token of this study")


@dataclass(frozen=True)
class Leaving:
    """Nothing has to be said to leave."""


class Entrance:
    """Guards every request, and answers `/access`, `/token` and `/openapi.json`."""

    def __init__(self, access: Access, version: str) -> None:
        self.access, self._guesses, self._version = access, Guesses(access), version
        self._routes = Routes()
        self._logins: WeakValueDictionary[str, Login] = WeakValueDictionary()
        self._entered: dict[str, Login] = {}
        """Those by token that have not expired, kept also while none of their pages is open; newest last."""

    def add_to(self, app: web.Application) -> None:
        """Serve the routes."""
        for route in (
            Route("GET", "/access", Role.NOBODY, self._access, None, Standing),
            Route("POST", "/token", Role.NOBODY, self._exchange, TokenWish, Standing),
            Route("POST", "/leave", Role.NOBODY, self._leave, Leaving, Standing),
            Route("GET", "/openapi.json", Role.VIEW, self._describe, None, dict[str, Any]),
        ):
            self._routes.add(route)
            add = app.router.add_get if route.method == "GET" else app.router.add_post  # add_get answers HEAD as well
            add(route.path, route.handler)

    def login(self, request: web.Request) -> Login:
        """Return the login of the browser that asks for a WebSocket, as this request shows it."""
        login = self._login(request, request.cookies.get(BROWSER, ""))
        asked = Asked.by(request.headers)
        login.seen(self._standing(asked), asked.cookie_name in request.cookies)
        return login

    def _login(self, request: web.Request, browser: str) -> Login:
        login = self._logins.get(browser) or Login(self._everybody(request))
        if browser:
            self._logins[browser] = login
        return login

    def _everybody(self, request: web.Request) -> Standing:
        return self._standing(Asked(host=request.host))

    def _standing(self, asked: Asked) -> Standing:
        short = self.access.short_of(Role.OPERATE, asked)
        by_token = self.access.carried(asked) is not Role.NOBODY
        role = self.access.role(asked)
        why = "" if short is None else _TOKEN_NEEDED[role] if short.status == 401 else short.error
        return Standing(role.name.lower(), why, by_token)

    @web.middleware
    async def guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse strangers, and the study to whoever may not view; the page's own files hold nothing of it."""
        asked = Asked.by(request.headers)
        needed = Role.VIEW if request.path.startswith(NEED_VIEW) else Role.NOBODY
        denied = self._guesses.denied(request.remote or "", asked.tokens) or self.access.decide(needed, asked)
        if denied is None and request.method == "POST":
            denied = not_json(asked)
        if denied is not None:
            return _refused(denied)
        try:
            return await handler(request)
        except web.HTTPMethodNotAllowed as err:
            wrong = WrongMethod(err.method, err.allowed_methods - {"HEAD"})
            return _refused(Denied(wrong.status, str(wrong)), headers={"Allow": wrong.allow})
        except web.RequestPayloadError:
            return _refused(Denied(400, "the body cannot be read: its Content-Encoding or its chunks are broken"))
        except web.HTTPClientError as err:
            return _refused(Denied(err.status, (err.text or err.reason).strip()))

    async def _access(self, request: web.Request) -> web.Response:
        """What whoever asks may do."""
        answer = _json(self._standing(Asked.by(request.headers)))
        _name(request, answer)
        return answer

    async def _exchange(self, request: web.Request) -> web.Response:
        """Exchange a token for a cookie, which the page's scripts cannot read."""
        try:
            token = read(TokenWish, parse(await request.read())).token
        except Refusal as err:
            return _refused(Denied(err.status, str(err)), err.field)
        if (denied := self._guesses.denied(request.remote or "", (token,))) is not None:
            return _refused(denied, "token")
        role = self.access.bearer(token)
        if role is Role.NOBODY:
            return _refused(Denied(401, "this is no token of this study"), "token")
        why = "" if role is Role.OPERATE else "this token may view, not operate"
        standing = Standing(role.name.lower(), why, by_token=True)
        answer = _json(standing)
        name = Asked.by(request.headers).cookie_name
        answer.set_cookie(name, token, max_age=DAY_S, httponly=True, samesite="Strict", secure=request.secure)
        browser = _name(request, answer)
        login = self._login(request, browser)
        login.enter(standing)
        lasting = [(name, one) for name, one in self._entered.items() if not one.expired and name != browser]
        self._entered = dict([*lasting, (browser, login)][-MOST_LOGINS:])
        return answer

    async def _leave(self, request: web.Request) -> web.Response:
        """Take the cookie back, also from the browser's other pages; what they then may do is open to everybody."""
        browser = request.cookies.get(BROWSER, "")
        if login := self._entered.pop(browser, None) or self._logins.get(browser):
            login.leave()
        answer = _json(self._everybody(request))
        answer.del_cookie(Asked.by(request.headers).cookie_name, httponly=True, samesite="Strict")
        return answer

    async def _describe(self, request: web.Request) -> web.Response:
        """This description, OpenAPI 3.1; the WebSocket `/ws` is described in the service's README."""
        return _json(self._routes.openapi("web_gui: the page", self._version))


def _name(request: web.Request, answer: web.Response) -> str:
    """Return the name of the browser that asks; one without is given one with the answer."""
    if name := request.cookies.get(BROWSER):
        return name
    name = secrets.token_urlsafe(16)
    answer.set_cookie(BROWSER, name, httponly=True, samesite="Strict", secure=request.secure)
    return name


def _json(value: Any, status: int = 200, headers: Mapping[str, str] | None = None) -> web.Response:
    as_text = functools.partial(json.dumps, allow_nan=False)
    return web.json_response(plain(value), status=status, headers=headers, dumps=as_text)


def _refused(denied: Denied, field_name: str = "", headers: Mapping[str, str] | None = None) -> web.Response:
    return _json({"error": denied.error, "field": field_name}, denied.status, headers)

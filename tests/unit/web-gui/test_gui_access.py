"""Who may see and order on the page: roles on its routes and on every message of its WebSocket."""

import asyncio
import functools
import gc
import json
from contextlib import asynccontextmanager

import pytest
from aiohttp import ClientSession, CookieJar, DummyCookieJar, WSMsgType, WSServerHandshakeError
from processes import DEADLINE_S
from sense4hri.access import Access
from sense4hri.guesses import MOST_WRONG
from web_gui import entrance, logins
from web_gui.config import Config
from web_gui.model import Study
from web_gui.server import Site, serve

GUARDED = Access("0.0.0.0", operate_token="may/operate=", view_token="may-view")
OPERATED = Access("0.0.0.0", operate_token="may/operate=")
CLOSED = Access("0.0.0.0")
START = {"type": "start", "number": 1, "study": "demo"}
ASSIGN = {"type": "assign", "sensor_id": "h10_1", "human_id": "p3"}


def awaited(test):
    """Run a test that waits."""

    @functools.wraps(test)
    def run(*arguments, **more):
        asyncio.run(test(*arguments, **more))

    return run


class Answer:
    ok, text = True, ""


class Desk:
    """Remembers what it was told to do."""

    def __init__(self):
        self.done = []

    async def start(self, wish):
        self.done.append(wish)
        return Answer()

    async def stop(self, wish):
        self.done.append(wish)
        return Answer()

    async def assign(self, wish):
        self.done.append(wish)
        return Answer()

    def mark(self, press):
        self.done.append(press)


@asynccontextmanager
async def page(access):
    """(site, a browser at its address) of a page with these rules."""
    config = Config(port=0)
    site = Site(Study(), config, Desk(), access=access, version="1")
    runner, port = await serve(site, config)
    try:
        async with ClientSession(f"http://127.0.0.1:{port}", cookie_jar=CookieJar(unsafe=True)) as browser:
            yield site, browser
    finally:
        await runner.cleanup()


async def standing(browser, address=""):
    async with browser.get(f"{address}/access") as answer:
        return (await answer.json())["role"]


async def enter(browser, token):
    """The answer to a token, and its cookie's text."""
    async with browser.post("/token", json={"token": token}) as answer:
        return answer.status, await answer.json(), answer.headers.get("Set-Cookie", "")


async def order(browser, message):
    """What becomes of one order on a WebSocket of its own."""
    async with browser.ws_connect("/ws") as socket, asyncio.timeout(5):
        await socket.send_str(json.dumps(message))
        while True:
            told = json.loads(await socket.receive_str())
            if told["type"] == "answer":
                return told


@awaited
async def test_without_the_view_token_only_the_empty_page_is_served():
    """Its files hold nothing of a study; signals, reports and the description are refused."""
    async with page(GUARDED) as (_, browser):
        for path in ("/", "/js/main.js"):
            async with browser.get(path) as answer:
                assert answer.status == 200
        for path in ("/reports/a/report.html", "/openapi.json", "/ws"):
            async with browser.get(path) as answer:
                assert answer.status == 401
                assert (await answer.json()).keys() == {"error", "field"}
        with pytest.raises(WSServerHandshakeError) as refused:
            await browser.ws_connect("/ws")
        assert refused.value.status == 401
        assert await standing(browser) == "nobody"


@pytest.mark.parametrize(("token", "role", "obeyed"), [("may-view", "view", False), ("may/operate=", "operate", True)])
@awaited
async def test_a_token_becomes_a_cookie_that_counts_for_every_message(token, role, obeyed):
    """HttpOnly and SameSite=Strict. Whoever may only view sees everything; their orders are answered, not done."""
    async with page(GUARDED) as (site, browser):
        status, told, cookie = await enter(browser, token)
        assert (status, told["role"]) == (200, role)
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        assert await standing(browser) == role
        for number, message in enumerate((START, {"type": "stop"}, ASSIGN, {"type": "marker", "name": "sync"})):
            more = {"number": number, "at_ms": site.page.now_ns() / 1e6, "uncertainty_ms": 1}
            answer = await order(browser, message | more)
            assert answer["ok"] == obeyed
            assert obeyed or "may view, not operate" in answer["text"]
        assert len(site.page.desk.done) == (4 if obeyed else 0)


@awaited
async def test_a_wrong_token_gives_nothing():
    """401 and no cookie; a body of another kind or shape is refused like everywhere."""
    async with page(GUARDED) as (_, browser):
        status, told, cookie = await enter(browser, "guess")
        assert (status, told["field"], cookie) == (401, "token", "")
        for body, headers, wanted in [
            (b'{"token": "may-view"}', {"Content-Type": "text/plain"}, 415),
            (b'{"token": "may-view"}', {"Content-Type": "application/json", "Origin": "http://evil.example"}, 403),
            (b"[" * 50_000, {"Content-Type": "application/json"}, 400),
            (b'{"token": 5}', {"Content-Type": "application/json"}, 400),
        ]:
            async with browser.post("/token", data=body, headers=headers) as answer:
                assert answer.status == wanted
                assert "Set-Cookie" not in answer.headers
        assert await standing(browser) == "nobody"


@pytest.mark.parametrize("access", [CLOSED, OPERATED])
@awaited
async def test_elsewhere_than_on_loopback_a_browser_without_a_token_only_sees(access):
    """The page is told why with the first message; an order is answered with the same sentence and does nothing."""
    async with page(access) as (site, browser):
        async with browser.ws_connect("/ws") as socket:
            hello = json.loads(await socket.receive_str(timeout=5))
        answer = await order(browser, START)
        assert hello["why_not_operate"]
        assert (answer["ok"], answer["text"]) == (False, hello["why_not_operate"])
        assert site.page.desk.done == []


@awaited
async def test_the_page_describes_its_routes():
    """`/openapi.json` of the page, beside that of its metrics port."""
    async with page(Access()) as (_, browser), browser.get("/openapi.json") as answer:
        told = await answer.json()
    assert (told["openapi"], sorted(told["paths"])) == ("3.1.0", ["/access", "/leave", "/openapi.json", "/token"])


@awaited
async def test_who_leaves_has_no_cookie_any_more():
    """That they came by a token is told; afterwards nothing may be seen."""
    async with page(GUARDED) as (_, browser):
        _, told, _ = await enter(browser, "may/operate=")
        assert (told["role"], told["by_token"], await standing(browser)) == ("operate", True, "operate")
        async with browser.post("/leave", json={}) as answer:
            told = await answer.json()
        assert (told["role"], told["by_token"], await standing(browser)) == ("nobody", False, "nobody")


@awaited
async def test_two_studies_on_one_host_have_each_a_login_of_their_own():
    """A browser sends every cookie to every port of a host: entering or leaving one page changes nothing on another."""
    other = Access("0.0.0.0", operate_token="other-operate", view_token="other-view")
    async with page(GUARDED) as (_, browser), page(other) as (_, elsewhere):
        address = str(elsewhere._base_url).rstrip("/")
        await enter(browser, "may/operate=")
        async with browser.post(f"{address}/token", json={"token": "other-view"}) as answer:
            assert answer.status == 200
        assert [await standing(browser), await standing(browser, address)] == ["operate", "view"]
        async with browser.post(f"{address}/leave", json={}):
            assert [await standing(browser), await standing(browser, address)] == ["operate", "nobody"]


async def next_role(socket):
    """The role that an open page is told next; "closed" where its connection ends."""
    async with asyncio.timeout(DEADLINE_S):
        while True:
            message = await socket.receive()
            if message.type is not WSMsgType.TEXT:
                return "closed"
            told = json.loads(message.data)
            if told["type"] == "hello":
                return told["role"]


async def obeyed(socket):
    """Whether an order on an open page is carried out."""
    await socket.send_str(json.dumps(START))
    async with asyncio.timeout(DEADLINE_S):
        while True:
            told = json.loads(await socket.receive_str())
            if told["type"] == "answer":
                return told["ok"]


@awaited
async def test_every_open_page_of_a_browser_follows_its_login():
    """In and out at once, in whichever of its pages; other browsers with the same token stay what they are."""
    async with page(OPERATED) as (site, browser), ClientSession(cookie_jar=CookieJar(unsafe=True)) as other:
        assert await standing(browser) == "view"
        async with browser.ws_connect("/ws") as first, browser.ws_connect("/ws") as second:
            assert [await next_role(first), await next_role(second)] == ["view", "view"]
            await enter(browser, "may/operate=")
            assert [await next_role(first), await next_role(second)] == ["operate", "operate"]
            assert await obeyed(second)
            address = str(browser._base_url)
            async with other.post(f"{address}/token", json={"token": "may/operate="}):
                pass
            async with other.ws_connect(f"{address}/ws") as elsewhere, browser.post("/leave", json={}):
                assert not await obeyed(second)
                assert await next_role(first) == "view"
                assert await obeyed(elsewhere)
    assert len(site.page.desk.done) == 2


@awaited
async def test_who_leaves_sees_nothing_more_on_any_open_page():
    """Where viewing needs a token the connections end."""
    async with page(GUARDED) as (_, browser):
        await enter(browser, "may-view")
        async with browser.ws_connect("/ws") as socket:
            assert await next_role(socket) == "view"
            async with browser.post("/leave", json={}):
                assert await next_role(socket) == "closed"


@awaited
async def test_an_open_page_outlives_its_cookie_by_nothing(monkeypatch):
    """A day after the token was typed it may do what everybody may, however late the page was opened."""
    now_s = [1000.0]
    monkeypatch.setattr(logins, "monotonic", lambda: now_s[0])
    async with page(OPERATED) as (_, browser):
        await enter(browser, "may/operate=")
        now_s[0] += 0.9 * logins.DAY_S
        async with browser.ws_connect("/ws") as socket:
            assert await next_role(socket) == "operate"
            now_s[0] += 0.1 * logins.DAY_S
            assert not await obeyed(socket)
            assert await next_role(socket) == "view"


@awaited
async def test_a_program_that_enters_again_and_again_is_not_remembered_each_time(monkeypatch):
    """Without a cookie each time is another browser; those that entered last are known, and may leave."""
    monkeypatch.setattr(entrance, "MOST_LOGINS", 3)

    def known():
        gc.collect()
        return sum(isinstance(one, logins.Login) for one in gc.get_objects())

    before = known()
    async with page(OPERATED) as (_, browser), ClientSession(cookie_jar=DummyCookieJar()) as program:
        await enter(browser, "may/operate=")
        for _ in range(5):
            async with program.post(f"{browser._base_url}/token", json={"token": "may/operate="}):
                pass
        await enter(browser, "may/operate=")
        assert known() - before == 3
        async with browser.ws_connect("/ws") as socket, browser.post("/leave", json={}):
            assert not await obeyed(socket)


@awaited
async def test_a_token_is_not_found_by_typing() -> None:
    """After some wrong ones `/token` and the cookie are told to wait alike; a page that is open goes on."""
    async with page(GUARDED) as (_, browser):
        await enter(browser, "may/operate=")
        async with browser.ws_connect("/ws") as socket, asyncio.timeout(5):
            assert {(await enter(browser, f"wrong{n}"))[0] for n in range(MOST_WRONG)} == {401}
            status, told, cookie = await enter(browser, "may-view")
            assert (status, told.keys(), cookie) == (429, {"error", "field"}, "")
            async with browser.get("/openapi.json") as answer:
                assert answer.status == 429
            await socket.send_str(json.dumps(START))
            while json.loads(await socket.receive_str())["type"] != "answer":
                pass

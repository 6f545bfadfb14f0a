"""HTTP and WebSocket of the page, without ROS: what is served, what is refused, what a slow browser costs."""

import asyncio
import json
import os
import re
import tracemalloc
from contextlib import asynccontextmanager
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import numpy as np
import pytest
from aiohttp import ClientSession, WSMsgType, WSServerHandshakeError
from processes import DEADLINE_S
from sense4hri.chunk import Chunk
from sense4hri.errors import ConfigError
from sense4hri.names import StreamName
from web_gui import door, server
from web_gui.browser import MOST_UNANSWERED
from web_gui.config import Config
from web_gui.frames import decode
from web_gui.model import Study
from web_gui.server import Site, page_address, serve
from web_gui.stream import Info

NAME = StreamName("p1", "ecg", "h10_1")
VIEW = {"type": "view", "view": 1, "columns": 500, "window_s": 5, "lanes": [{"stream": "p1/ecg/h10_1"}]}


def feed(study, now_ns, n=130):
    """Some signal that ends now."""
    stream = study.stream(NAME, now_ns)
    stream.learn(Info(130.0, "uV", {}))
    stream.raw(Chunk(("ecg",), np.random.default_rng(1).standard_normal((n, 1)), None, now_ns), now_ns)


def with_site(test):
    """Run test(site, port) against a served page."""

    async def run():
        site, config = Site(Study(), Config(port=0)), Config(port=0)
        runner, port = await serve(site, config)
        try:
            await test(site, port)
        finally:
            await runner.cleanup()

    asyncio.run(run())


async def raw_http(port, request):
    """Return the status line that answers some bytes."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(request)
    await writer.drain()
    line = await asyncio.wait_for(reader.readline(), DEADLINE_S)
    writer.close()
    await writer.wait_closed()
    return line.decode()


def test_every_file_of_the_page_is_served_with_a_strict_policy():
    """No inline script, no other origin, no framing; a file that is not the page's is not found."""

    async def check(site, port):
        async with ClientSession(f"http://127.0.0.1:{port}") as session:
            for path in ("/", "/index.html", "/style.css", "/js/main.js", "/mark.svg"):
                async with session.get(path) as answer:
                    assert answer.status == 200
                    policy = answer.headers["Content-Security-Policy"]
                    assert "default-src 'none'" in policy
                    assert "unsafe" not in policy
                    assert answer.headers["X-Content-Type-Options"] == "nosniff"
            for path in ("/../config.py", "/%2e%2e/server.py", "/js/", "/js/none.js", "/server.py"):
                async with session.get(path) as answer:
                    assert answer.status == 404

    with_site(check)


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "", "a b", "[::1"])
def test_a_foreign_host_name_is_refused(host):
    """A page that rebinds its own name to this address reads nothing."""

    async def check(site, port):
        request = f"GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
        assert re.search(r" (400|403) ", await raw_http(port, request.encode()))

    with_site(check)


def test_a_foreign_origin_gets_no_signals():
    """Another site open in the same browser cannot read the study over the WebSocket."""

    async def check(site, port):
        async with ClientSession() as session:
            for origin in ("http://evil.example", f"http://localhost:{port}", "null", "http://["):
                with pytest.raises(WSServerHandshakeError) as refused:
                    await session.ws_connect(f"http://127.0.0.1:{port}/ws", headers={"Origin": origin})
                assert refused.value.status == 403
            own = f"http://127.0.0.1:{port}"
            async with session.ws_connect(f"{own}/ws", headers={"Origin": own}) as socket:
                assert json.loads((await socket.receive(5)).data)["type"] == "hello"

    with_site(check)


def test_a_method_that_is_not_served_is_told_those_that_are():
    """In the header `Allow`, as every service does; what answers GET answers HEAD."""

    async def check(site, port):
        async with ClientSession(f"http://127.0.0.1:{port}") as session:
            for path in ("/", "/access", "/openapi.json", "/js/main.js"):
                async with session.head(path) as answer:
                    assert (answer.status, await answer.read()) == (200, b"")
                async with session.delete(path) as answer:
                    told = await answer.json()
                    assert (answer.status, answer.headers["Allow"]) == (405, "GET, HEAD")
                    assert told == {"error": "this path answers GET, not DELETE", "field": ""}
            async with session.delete("/token") as answer:
                assert "POST" in answer.headers["Allow"]

    with_site(check)


@pytest.mark.parametrize(
    "request_bytes",
    [
        b"\x00\xff\xfe\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\nHost: 127.0.0.1\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -5\r\n\r\n",
        b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"DELETE /index.html HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://[\r\n\r\n",
    ],
)
def test_malformed_http_is_an_error_and_the_page_lives_on(request_bytes):
    """Whatever comes, the answer is a 4xx and the next reader is served."""

    async def check(site, port):
        assert re.match(r"HTTP/1.[01] 4\d\d ", await raw_http(port, request_bytes))
        assert " 200 " in await raw_http(port, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")

    with_site(check)


@pytest.mark.parametrize("wrong", [{"metadata_json": "x" * 33_000}, {"required_streams": ["/a"] * 1001}, {"study": 5}])
def test_an_order_that_cannot_be_taken_is_answered(wrong):
    """By its number, with what is wrong; the page stays connected."""

    async def check(site, port):
        async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
            await socket.send_str(json.dumps({"type": "start", "number": 7} | wrong))
            await socket.send_str('{"type": "ping", "number": 8}')
            told = []
            while not told or told[-1]["type"] != "pong":
                told.append(json.loads(await socket.receive_str(timeout=DEADLINE_S)))
            answer = next(one for one in told if one["type"] == "answer")
            assert (answer["number"], answer["ok"]) == (7, False)
            assert next(iter(wrong)) in answer["text"]

    with_site(check)


@pytest.mark.parametrize("message", ["", "{", "[]", '{"type": "view"}', '{"type": "x"}', "[" * 30_000, b"\x00\x01"])
def test_a_malformed_message_is_answered_and_the_connection_closed(message):
    """The error says what is wrong; nobody else notices."""

    async def check(site, port):
        async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
            await (socket.send_bytes(message) if isinstance(message, bytes) else socket.send_str(message))
            texts = [m.data async for m in socket if m.type is WSMsgType.TEXT]
            assert any(json.loads(text)["type"] == "error" for text in texts)
            assert socket.close_code == 1008
        await until(lambda: site.clients == 0)

    with_site(check)


def test_a_message_that_is_too_long_closes_the_connection():
    """A client cannot make the server hold what it likes."""

    async def check(site, port):
        async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
            await socket.send_str("x" * 100_000)
            async for _ in socket:
                pass
            assert socket.close_code == 1009

    with_site(check)


def test_more_browsers_than_the_page_is_for_are_told_so(monkeypatch):
    """One too many is refused with a sentence, and let in when another one has gone."""
    monkeypatch.setattr(server, "MOST_CLIENTS", 2)

    async def check(site, port):
        async with ClientSession(f"http://127.0.0.1:{port}") as session:
            first, second = [await session.ws_connect("/ws") for _ in range(2)]
            with pytest.raises(WSServerHandshakeError) as refused:
                await session.ws_connect("/ws")
            assert refused.value.status == 429
            async with session.get("/ws") as answer:
                assert (await answer.json())["error"] == "2 browsers show this page already; close one of them"
            await first.close()
            await until(lambda: site.clients == 1)
            async with session.ws_connect("/ws"):
                await second.close()

    with_site(check)


def test_slow_connections_keep_nobody_out(monkeypatch):
    """Where too many are open the oldest that is no browser's goes: who talks stays, who comes is served."""
    monkeypatch.setattr(door, "MOST_CONNECTIONS", 10)

    async def check(site, port):
        async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
            slow = [await asyncio.open_connection("127.0.0.1", port) for _ in range(30)]
            for _, writer in slow:
                writer.write(b"GET / HTTP/1.1\r\nHost: ")
            assert " 200 " in await raw_http(port, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            assert await asyncio.wait_for(slow[0][0].read(), DEADLINE_S) == b""
            await socket.send_str('{"type": "ping", "number": 2}')
            assert (await answer_to(socket, "pong", 2))["type"] == "pong"
            for _, writer in slow:
                writer.close()

    with_site(check)


@asynccontextmanager
async def unread(directory):
    """(runner, port) of a page, one of whose clients reads nothing of a report too large for every buffer."""
    (directory / "s1").mkdir()
    with open(directory / "s1" / "report.html", "wb") as file:
        file.truncate(64 * 2**20)
    config = Config(port=0, recordings=str(directory))
    runner, port = await serve(Site(Study(), config), config)
    try:
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1000)
        writer.write(b"GET /reports/s1/report.html HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert b"200" in await asyncio.wait_for(reader.readline(), DEADLINE_S)
        yield runner, port
        writer.transport.abort()
    finally:
        await runner.cleanup()


@pytest.mark.parametrize("at_once", [1, 30])
def test_there_are_never_more_connections_than_told(monkeypatch, tmp_path, at_once):
    """However many come at once, and though the oldest has not read its answer: the next one makes room."""
    monkeypatch.setattr(door, "MOST_CONNECTIONS", 10)

    async def check():
        async with unread(tmp_path) as (runner, port):
            idle = []
            for _ in range(60 // at_once):
                idle += await asyncio.gather(*[asyncio.open_connection("127.0.0.1", port) for _ in range(at_once)])
            assert " 200 " in await raw_http(port, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            open_ones = [each for each in runner.server.connections if each.transport is not None]
            assert len(open_ones) <= 10
            for _, writer in idle:
                writer.close()

    asyncio.run(check())


def test_who_does_not_read_is_let_go(monkeypatch, tmp_path):
    """What is sent to them takes memory; a browser that has stopped would take it for ever."""
    monkeypatch.setattr(door, "UNREAD_S", 1)

    async def check():
        async with unread(tmp_path) as (runner, _):
            assert len(runner.server.connections) == 1
            await until(lambda: not runner.server.connections)

    asyncio.run(check())


def test_a_client_that_sends_no_http_or_breaks_off_is_one_count_and_no_line_in_the_log(capfd):
    """The log of a study is not for strangers to write."""
    broken = []

    async def check():
        runner, port = await serve(Site(Study(), Config(port=0)), Config(port=0), lambda: broken.append(1))
        try:
            for request in (b"\x16\x03\x01garbage\r\n\r\n", b"GET / HTTP/1.1\r\nContent-Length: -1\r\n\r\n"):
                assert " 400 " in await raw_http(port, request)
            post = b"POST /token HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
            packed = post + b"Content-Encoding: gzip\r\nContent-Length: 5\r\n\r\nplain"
            assert " 400 " in await raw_http(port, packed)
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(post + b"Content-Length: 99\r\nExpect: 100-continue\r\n\r\n{")
            assert b"100 Continue" in await asyncio.wait_for(reader.readline(), DEADLINE_S)  # it waits for the rest
            writer.transport.abort()
            await until(lambda: len(broken) == 4)
        finally:
            await runner.cleanup()

    asyncio.run(check())
    assert "Traceback" not in capfd.readouterr().err


def test_signals_arrive_in_binary_frames():
    """A client that asks for a lane gets its points; the newest at the right time."""

    async def check(site, port):
        async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
            feed(site.page.study, site.page.now_ns())
            await socket.send_str(json.dumps(VIEW))
            while (message := await socket.receive(5)).type is not WSMsgType.BINARY:
                pass
            frame = decode(message.data)
            assert frame.view == 1
            assert len(frame.lanes[0].line.times_ns) == 130

    with_site(check)


def test_a_browser_that_does_not_answer_is_not_sent_more():
    """Frames for a slow browser are dropped, not kept: without answers it gets a handful and the server holds none."""

    async def check(site, port):
        async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
            await socket.send_str(json.dumps(VIEW))
            for _ in range(40):
                feed(site.page.study, site.page.now_ns())
                await asyncio.sleep(0.05)
            assert site.page.frames_total <= MOST_UNANSWERED
            await socket.send_str('{"type": "ack", "number": 4294967295}')
            feed(site.page.study, site.page.now_ns())
            await until(lambda: site.page.frames_total > MOST_UNANSWERED)

    with_site(check)


def test_a_port_that_is_taken_is_a_configuration_error():
    """The operator reads which port, and the process ends with status 78."""

    async def check(site, port):
        with pytest.raises(ConfigError, match=f"port {port}"):
            await serve(Site(Study(), Config(port=port)), Config(port=port))
        with pytest.raises(ConfigError, match=r"no\.such\.host"):
            await serve(site, Config(port=0, host="no.such.host.invalid"))

    with_site(check)


@pytest.mark.parametrize("wrong", [{"port": 70_000}, {"port": -1}, {"host": ""}, {"history_s": 1.0}, {"trend_s": 1e9}])
def test_a_wrong_parameter_is_named(wrong):
    """Each parameter is checked before anything starts."""
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Config(**wrong)


def test_the_address_that_is_told_can_be_opened():
    """0.0.0.0 and :: are no addresses for a browser."""
    assert page_address("0.0.0.0", 8080) == "http://127.0.0.1:8080"
    assert page_address("::", 8080) == "http://[::1]:8080"
    assert page_address("::1", 80) == "http://[::1]:80"


def test_the_page_has_no_inline_code_and_names_no_other_machine():
    """Nothing in the page's files needs the internet, and nothing turns text into markup."""
    static = files("web_gui") / "static"
    sources = [entry for folder in (static, static / "js") for entry in folder.iterdir() if entry.is_file()]
    assert len(sources) > 10
    for source in sources:
        text = source.read_text()
        hosts = {urlsplit(url).netloc for url in re.findall(r"https?://[^\s\"'`<>)]+", text)}
        assert hosts <= {"www.w3.org"}, source.name
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text)
        if source.name.endswith(".html"):
            assert not re.search(r"<script(?![^>]*src=)|\son\w+=|style=", text)


class Answer(NamedTuple):
    """What a desk answers."""

    ok: bool
    text: str


class SlowDesk:
    """Takes its time over a start, as a coordinator may; remembers what it was told."""

    def __init__(self):
        self.go_on = asyncio.Event()
        self.marked, self.started, self.assigned = [], [], []

    async def start(self, wish):
        self.started.append(wish)
        await self.go_on.wait()
        return Answer(True, "session 's1' is being prepared")

    async def stop(self, wish):
        return Answer(False, "no session is running")

    async def assign(self, wish):
        self.assigned.append(wish)
        await self.go_on.wait()
        return Answer(True, "sensor_id 'h10_1' is assigned to human_id 'p3'")

    def mark(self, press):
        self.marked.append(press)


def with_desk(test, **config):
    """Run test(site, socket, port) for a page that may start sessions."""

    async def run():
        site = Site(Study(), Config(port=0, **config), SlowDesk())
        runner, port = await serve(site, Config(port=0))
        try:
            async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
                await test(site, socket, port)
        finally:
            await runner.cleanup()

    asyncio.run(run())


async def answer_to(socket, kind, number):
    """Return the next message of this kind and number, within 5 s."""
    async with asyncio.timeout(5):
        while True:
            message = await socket.receive()
            told = json.loads(message.data) if message.type is WSMsgType.TEXT else {}
            if (told.get("type"), told.get("number")) == (kind, number):
                return told


def test_a_start_that_takes_its_time_holds_nothing_up():
    """Meanwhile pings are answered, signals flow and a second start is refused; then the answer comes in words."""

    async def check(site, socket, port):
        await socket.send_str(json.dumps({"type": "start", "number": 1, "study": "demo"}))
        await socket.send_str('{"type": "ping", "number": 2}')
        assert abs((await answer_to(socket, "pong", 2))["host_ms"] - site.page.now_ns() / 1e6) < 2000
        feed(site.page.study, site.page.now_ns())
        await socket.send_str(json.dumps(VIEW))
        await until(lambda: site.page.frames_total > 0)
        await socket.send_str(json.dumps({"type": "start", "number": 3, "study": "demo"}))
        assert not (await answer_to(socket, "answer", 3))["ok"]
        site.page.desk.go_on.set()
        assert (await answer_to(socket, "answer", 1))["text"] == "session 's1' is being prepared"
        assert len(site.page.desk.started) == 1
        await socket.send_str('{"type": "stop", "number": 4}')
        assert await answer_to(socket, "answer", 4) == {
            "type": "answer", "number": 4, "ok": False, "text": "no session is running",
        }  # fmt: skip

    with_desk(check)


def test_a_sensor_that_moves_slowly_keeps_no_session_from_stopping():
    """One id that is none is answered and asked of nobody; a second order waits; a stop is answered meanwhile."""

    async def check(site, socket, port):
        for number, human_id in enumerate(("p 3", "p3", "p4")):
            order = {"type": "assign", "number": number, "sensor_id": "h10_1", "human_id": human_id}
            await socket.send_str(json.dumps(order))
        assert "'p 3' is no pseudonym" in (await answer_to(socket, "answer", 0))["text"]
        assert "not been answered yet" in (await answer_to(socket, "answer", 2))["text"]
        await socket.send_str('{"type": "stop", "number": 3}')
        assert (await answer_to(socket, "answer", 3))["text"] == "no session is running"
        site.page.desk.go_on.set()
        assert await answer_to(socket, "answer", 1) == {
            "type": "answer", "number": 1, "ok": True, "text": "sensor_id 'h10_1' is assigned to human_id 'p3'",
        }  # fmt: skip
        assert [(wish.sensor_id, wish.human_id) for wish in site.page.desk.assigned] == [("h10_1", "p3")]

    with_desk(check)


def test_a_marker_of_a_wrong_clock_is_refused():
    """A press from the future or from yesterday is answered, not published."""

    async def check(site, socket, port):
        now_ms = site.page.now_ns() / 1e6
        for number, at_ms in enumerate((now_ms - 20, now_ms + 5000, now_ms - 86_400_000)):
            press = {"type": "marker", "number": number, "name": "sync", "at_ms": at_ms, "uncertainty_ms": 1}
            await socket.send_str(json.dumps(press))
            assert (await answer_to(socket, "answer", number))["ok"] == (number == 0)
        assert [press.at_ns for press in site.page.desk.marked] == [round((now_ms - 20) * 1e6)]

    with_desk(check)


def test_another_site_starts_nothing():
    """Neither over a WebSocket of its own nor by any other request."""

    async def check(site, socket, port):
        async with ClientSession() as session:
            with pytest.raises(WSServerHandshakeError) as refused:
                await session.ws_connect(f"http://127.0.0.1:{port}/ws", headers={"Origin": "http://evil.example"})
            assert refused.value.status == 403
            with pytest.raises(WSServerHandshakeError) as refused:
                await session.ws_connect(f"http://127.0.0.1:{port}/ws", headers={"Host": f"evil.example:{port}"})
            assert refused.value.status == 403
            for path in ("/", "/ws", "/start", "/study/start_session"):
                headers = {"Origin": "http://evil.example"}
                async with session.post(f"http://127.0.0.1:{port}{path}", data="{}", headers=headers) as answer:
                    assert answer.status == 403
        assert site.page.desk.started == []

    with_desk(check)


def test_a_page_without_a_desk_only_shows():
    """Orders are answered, nothing is done."""

    async def check(site, port):
        async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
            press = {
                "type": "marker",
                "number": 2,
                "name": "sync",
                "at_ms": site.page.now_ns() / 1e6,
                "uncertainty_ms": 1,
            }
            for order in ({"type": "start", "number": 1}, press):
                await socket.send_str(json.dumps(order))
                assert not (await answer_to(socket, "answer", order["number"]))["ok"]

    with_site(check)


def test_a_report_is_served_in_a_sandbox_and_nothing_beside_it(tmp_path):
    """No script, no other origin, also where a report tries; encoded traversal finds nothing."""
    folder = tmp_path / "recordings" / "s1"
    folder.mkdir(parents=True)
    (folder / "report.html").write_text("<h1>complete</h1>")
    (folder / "s1_0.mcap").write_text("data")
    (tmp_path / "report.html").write_text("outside")

    async def check(site, socket, port):
        site.page.study.session.take_state({"phase": 0, "directory": str(folder)})
        await site.look_for_report()
        address = f"http://127.0.0.1:{port}{site.page.study.session.report}"
        async with ClientSession() as session, session.get(address) as answer:
            assert (answer.status, await answer.text()) == (200, "<h1>complete</h1>")
            policy = answer.headers["Content-Security-Policy"]
            assert policy.startswith("sandbox")
            assert "default-src 'none'" in policy
            assert "script" not in policy
        for path in (
            "s1/s1_0.mcap",
            "../report.html",
            "%2e%2e/report.html",
            "s1/..%2f..%2freport.html",
            "s1/",
            "s1%00",
        ):
            request = f"GET /reports/{path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
            assert " 404 " in await raw_http(port, request.encode())

    with_desk(check, recordings=str(tmp_path / "recordings"))


def test_a_report_that_nobody_reads_costs_no_memory(tmp_path):
    """It is read from the disk as it is sent, and closed however its reader leaves."""
    size = 64 * 2**20
    (tmp_path / "s1").mkdir()
    with open(tmp_path / "s1" / "report.html", "wb") as file:
        file.truncate(size)
    request = b"GET /reports/s1/report.html HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"

    def is_open():
        return any(path.endswith("report.html") for path in map(os.path.realpath, Path("/proc/self/fd").iterdir()))

    async def check(site, socket, port):
        tracemalloc.start()
        readers = [await asyncio.open_connection("127.0.0.1", port, limit=1000) for _ in range(4)]
        for reader, writer in readers:
            writer.write(request)
            assert b"200" in await asyncio.wait_for(reader.readline(), DEADLINE_S)
        assert is_open()
        async with ClientSession(f"http://127.0.0.1:{port}") as session:
            async with session.head("/reports/s1/report.html") as answer:
                assert answer.content_length == size
            async with session.get("/reports/s1/report.html") as answer:
                assert sum([len(part) async for part in answer.content.iter_any()]) == size
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < size / 2
        for _, writer in readers:
            writer.transport.abort()
        await until(lambda: not is_open())

    with_desk(check, recordings=str(tmp_path))


async def until(condition, seconds=DEADLINE_S):
    """Wait for something to become true."""
    deadline = asyncio.get_running_loop().time() + seconds
    while not condition():
        assert asyncio.get_running_loop().time() < deadline, "did not happen in time"
        await asyncio.sleep(0.02)

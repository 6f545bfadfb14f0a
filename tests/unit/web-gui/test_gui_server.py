"""HTTP and WebSocket of the page, without ROS: what is served, what is refused, what a slow browser costs."""

import asyncio
import json
import re
from importlib.resources import files
from urllib.parse import urlsplit

import numpy as np
import pytest
from aiohttp import ClientSession, WSMsgType, WSServerHandshakeError
from sense4hri.chunk import Chunk
from sense4hri.errors import ConfigError
from sense4hri.names import StreamName
from web_gui.config import Config
from web_gui.frames import decode
from web_gui.model import Study
from web_gui.server import MOST_UNANSWERED, Site, page_address, serve
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
    line = await asyncio.wait_for(reader.readline(), 5)
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


def test_signals_arrive_in_binary_frames():
    """A client that asks for a lane gets its points; the newest at the right time."""

    async def check(site, port):
        async with ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/ws") as socket:
            feed(site.study, site.now_ns())
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
                feed(site.study, site.now_ns())
                await asyncio.sleep(0.05)
            assert site.frames_total <= MOST_UNANSWERED
            await socket.send_str('{"type": "ack", "number": 4294967295}')
            feed(site.study, site.now_ns())
            await until(lambda: site.frames_total > MOST_UNANSWERED)

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
    """0.0.0.0 is no address for a browser."""
    assert page_address("0.0.0.0", 8080) == "http://127.0.0.1:8080"
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


async def until(condition, seconds=5.0):
    """Wait for something to become true."""
    deadline = asyncio.get_running_loop().time() + seconds
    while not condition():
        assert asyncio.get_running_loop().time() < deadline, "did not happen in time"
        await asyncio.sleep(0.02)

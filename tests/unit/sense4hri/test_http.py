"""The kit's HTTP port: bodies checked field by field, one form of refusal, its own description, nobody hangs it up."""

import http.client
import json
import math
import re
import socket
import struct
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

import jsonschema
import pytest
from processes import poll
from sense4hri.errors import ConfigError, Refusal
from sense4hri.guesses import MOST_WRONG
from sense4hri.http import LARGEST_BODY, MOST_CONNECTIONS, PATIENCE_S, Http
from sense4hri.metrics import Metrics
from sense4hri.schema import parameter
from sense4hri.shapes import plain, read, schema

DEADLINE_S = 20.0


@dataclass(frozen=True)
class Place:
    """Where."""

    x: float
    y: float = 0.0


@dataclass(frozen=True)
class Wish:
    """What is wished for."""

    name: str
    count: int = parameter(1, help="how many", low=1, high=9)
    speed: float | None = None
    on: bool = False
    tags: tuple[str, ...] = ()
    place: Place | None = None
    kind: str = parameter("a", help="which", choices=("a", "b"))
    anything: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Limited:
    """What has limits within: a list, and what need not be given."""

    topics: tuple[str, ...] = parameter((), help="", matches="/[a-z]+")
    what: str | None = parameter(None, help="", choices=("all", "raw"))
    rates: tuple[float, ...] | None = parameter(None, help="", low=0)


@dataclass(frozen=True)
class Told:
    """What came of it."""

    value: float
    place: Place


class Caller:
    """An Http, what its handlers have been given, and a client."""

    def __init__(self, set_up: bool = True) -> None:
        self.wishes: list[Any] = []
        self.warnings: list[str] = []
        self.missing: list[str] = []
        self.silent: list[str] = []
        self.http = Http(
            "toy",
            "1.2",
            Metrics("toy"),
            lambda function: function(),
            silent=lambda: self.silent,
            missing=lambda: self.missing,
            warn=self.warnings.append,
        )
        threading.Thread(target=self.http.serve, daemon=True).start()
        self.http.get("/told", lambda: Told(math.nan, Place(math.inf)), Told)
        self.http.get("/things/{thing}", self._thing, list[str])
        self.http.post("/wish", self._take, Wish, dict[str, str])
        self.http.post("/things/{thing}/end", self._end, None, dict[str, str])
        if set_up:
            self.http.all_served()

    def _take(self, wish: Wish) -> dict[str, str]:
        """Take a wish."""
        self.wishes.append(wish)
        if wish.name == "busy":
            raise Refusal("not now", status=409)
        return {"name": wish.name}

    def _thing(self, thing: str) -> list[str]:
        if thing == "!":
            raise Refusal("'!' is no name of a thing", "thing")
        return [thing]

    def _end(self, thing: str) -> dict[str, str]:
        self.wishes.append(thing)
        return {}

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
        connection = http.client.HTTPConnection("127.0.0.1", self.http.port, timeout=DEADLINE_S)
        sent = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        given = {"Content-Type": "application/json"} | {name.replace("_", "-"): text for name, text in headers.items()}
        try:
            connection.request(method, path, sent, given)
            answer = connection.getresponse()
            text = answer.read().decode()
        finally:
            connection.close()
        return answer.status, json.loads(text) if answer.getheader("Content-Type") == "application/json" else text

    def raw(self, request: bytes) -> bytes:
        with socket.create_connection(("127.0.0.1", self.http.port), DEADLINE_S) as line:
            line.sendall(request)
            parts = []
            while part := line.recv(65536):
                parts.append(part)
            return b"".join(parts)


@pytest.fixture(scope="module")
def served():
    caller = Caller()
    yield caller
    caller.http.close()


@pytest.fixture
def caller(served):
    """As new: what the tests before did to it is forgotten."""
    served.wishes, served.missing, served.silent = [], [], []
    return served


def refused(told: Any) -> bool:
    return told.keys() == {"error", "field"} and bool(told["error"])


def test_a_body_comes_to_the_handler_as_its_dataclass(caller):
    """Whole numbers are taken where a real one is meant; what is not given has its default."""
    body = {"name": "n", "speed": 2, "tags": ["t"], "place": {"x": 1}, "kind": "b", "anything": {"deep": [1, None]}}
    assert caller.ask("POST", "/wish", body) == (200, {"name": "n"})
    wish = Wish("n", 1, 2.0, False, ("t",), Place(1.0), "b", {"deep": [1, None]})
    assert caller.wishes == [wish]
    assert isinstance(caller.wishes[0].speed, float)


@pytest.mark.parametrize(
    ("body", "field", "words"),
    [
        (b"", "name", "name is missing"),
        (b"{", "", "not JSON"),
        (b"\xff\xfe", "", "not JSON"),
        (b"[]", "", "JSON object"),
        (b"null", "", "JSON object"),
        ({}, "name", "name is missing"),
        ({"name": 3}, "name", "must be a string"),
        ({"name": None}, "name", "must be a string"),
        ({"name": "n", "colour": 1}, "colour", "'colour' is not a field"),
        (b'{"name": "a", "name": "b"}', "name", "given twice"),
        ({"name": "n", "count": 1.5}, "count", "must be a whole number"),
        ({"name": "n", "count": True}, "count", "must be a whole number"),
        ({"name": "n", "count": 0}, "count", "must be 1 to 9"),
        ({"name": "n", "count": 10**400}, "count", "64 bits"),
        (b'{"name": "n", "count": ' + b"9" * 5000 + b"}", "", "not JSON"),
        ({"name": "n", "speed": 10**400}, "speed", "64 bits"),
        ({"name": "n", "speed": "fast"}, "speed", "must be a number"),
        ({"name": "n", "speed": True}, "speed", "must be a number"),
        (b'{"name": "n", "speed": NaN}', "speed", "no finite number"),
        (b'{"name": "n", "speed": -Infinity}', "speed", "no finite number"),
        (b'{"name": "n", "speed": 1e999}', "speed", "no finite number"),
        ({"name": "n", "on": 1}, "on", "true or false"),
        ({"name": "n", "tags": "t"}, "tags", "list of strings"),
        ({"name": "n", "tags": ["t", 3]}, "tags", "must be a string"),
        ({"name": "n", "place": {}}, "place.x", "place.x is missing"),
        ({"name": "n", "place": {"x": 1, "z": 1}}, "place.z", "not a field"),
        ({"name": "n", "place": 3}, "place", "must be an object"),
        ({"name": "n", "kind": "c"}, "kind", "one of a, b"),
        ({"name": "n", "kind": ["a"]}, "kind", "must be a string"),
        ({"name": "n", "anything": {"a": [{"b": 10**400}]}}, "anything.a.b", "64 bits"),
        (b'{"name": "\\ud800"}', "name", "surrogate"),
        (b'{"name": "n", "anything": ' + b'{"a":' * 50 + b"1" + b"}" * 51, "", "deeper"),
        (b"[" * 200_000, "", "deeper"),
        (b'{"a":' * 200_000, "", "deeper"),
    ],
)
def test_a_wrong_body_is_a_400_that_names_the_field(caller, body, field, words):
    """One sentence, the field, and no handler is called."""
    status, told = caller.ask("POST", "/wish", body)
    assert (status, told["field"]) == (400, field), told
    assert words in told["error"]
    assert refused(told)
    assert caller.wishes == []
    assert caller.ask("GET", "/healthz")[0] == 200


def test_refusals_have_one_form_whatever_the_reason(caller):
    """No such path, another method, a body too long or without length, not now, no HTTP at all."""
    for (status, told), wanted in [
        (caller.ask("GET", "/nothing"), 404),
        (caller.ask("GET", "/wish"), 405),
        (caller.ask("POST", "/told", {}), 405),
        (caller.ask("POST", "/metrics", {}), 405),
        (caller.ask("DELETE", "/wish"), 405),
        (caller.ask("OPTIONS", "/wish"), 405),
        (caller.ask("BREW", "/wish"), 405),
        (caller.ask("POST", "/wish", b" " * (LARGEST_BODY + 1)), 413),
        (caller.ask("POST", "/wish", b"{}", Content_Length="many"), 400),
        (caller.ask("POST", "/wish", {"name": "busy"}), 409),
        (caller.ask("POST", "/wish", {"name": "n"}, Content_Type="text/plain"), 415),
        (caller.ask("GET", "/told", Host="evil.example"), 403),
        (caller.ask("POST", "/wish", {"name": "n"}, Origin="http://evil.example"), 403),
        (caller.ask("POST", "/things/a/end", {"b": 1}), 400),
    ]:
        assert status == wanted, told
        assert refused(told)
    assert [wish.name for wish in caller.wishes] == ["busy"]
    assert b'{"error": ' in caller.raw(b"nonsense\r\n\r\n")
    chunked = b"POST /wish HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
    assert b" 411 " in caller.raw(chunked)


@pytest.mark.parametrize(
    ("method", "path", "allow"),
    [
        ("GET", "/wish", b"POST"),
        ("POST", "/told", b"GET, HEAD"),
        ("DELETE", "/metrics", b"GET, HEAD"),
        ("OPTIONS", "/things/a", b"GET, HEAD"),
    ],
)
def test_a_wrong_method_is_told_the_right_ones(caller, method, path, allow):
    """A 405 names the methods of its path in the header Allow, as RFC 9110 demands; other answers have none."""
    said = caller.raw(f"{method} {path} HTTP/1.0\r\nHost: localhost\r\n\r\n".encode())
    assert b" 405 " in said
    assert b"\r\nAllow: " + allow + b"\r\n" in said
    assert b"Allow" not in caller.raw(b"GET /nothing HTTP/1.0\r\nHost: localhost\r\n\r\n")


def test_a_stranger_does_not_learn_which_routes_there_are(caller):
    """What is there and what is not answer a foreign Host alike."""
    answers = [caller.ask("GET", path, Host="evil.example") for path in ("/told", "/nothing", "/openapi.json")]
    assert answers[0][0] == 403
    assert answers.count(answers[0]) == 3


def test_a_path_may_carry_parameters(caller):
    """Decoded; a slash in one is another path. A request that says all by its path may have no body."""
    assert caller.ask("GET", "/things/a%20b") == (200, ["a b"])
    assert caller.ask("GET", "/things/a/b")[0] == 404
    assert caller.ask("POST", "/things/a/end")[0] == 200
    assert caller.ask("POST", "/things/b/end", {})[0] == 200
    assert caller.wishes == ["a", "b"]


def test_what_cannot_be_computed_is_null(caller):
    """JSON has no NaN; no answer is ever something a strict reader refuses."""
    assert caller.ask("GET", "/told") == (200, {"value": None, "place": {"x": None, "y": 0.0}})
    assert plain({"a": (1, math.nan), "b": -math.inf}) == {"a": [1, None], "b": None}


def test_head_is_get_without_the_body(caller):
    """Status and length, nothing more."""
    head = caller.raw(b"HEAD /told HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert head.startswith(b"HTTP/1.0 200 ")
    assert head.endswith(b"\r\n\r\n")
    assert b"Content-Length: " in head


def test_probes_are_open_and_say_what_is_missing(caller):
    """/healthz is the main loop's own answer; /readyz names what it waits for; neither asks for Host or token."""
    for path in ("/metrics", "/healthz", "/readyz"):
        assert caller.ask("GET", path, Host="evil.example", Origin="http://evil.example")[0] == 200
    caller.missing.append("no device")
    assert caller.ask("GET", "/readyz") == (503, "not ready: no device\n")
    caller.silent = ["the main thread"]
    assert caller.ask("GET", "/healthz")[0] == 503


def test_the_interface_describes_itself(caller):
    """OpenAPI 3.1: every route, every field with its kind and sentence, every reference leads somewhere."""
    status, told = caller.ask("GET", "/openapi.json")
    assert (status, told["openapi"], told["info"]) == (200, "3.1.0", {"title": "toy", "version": "1.2"})
    assert {(method, path) for path, methods in told["paths"].items() for method in methods} == {
        ("get", "/openapi.json"),
        ("get", "/told"),
        ("get", "/things/{thing}"),
        ("post", "/wish"),
        ("post", "/things/{thing}/end"),
    }
    wish = told["components"]["schemas"]["Wish"]
    assert wish["required"] == ["name"]
    assert wish["properties"]["count"] == {"type": "integer", "description": "how many", "minimum": 1, "maximum": 9}
    assert told["components"]["schemas"]["Told"]["properties"]["value"] == {"type": ["number", "null"]}
    assert told["paths"]["/wish"]["post"]["summary"] == "Take a wish."
    for name in re.findall(r"#/components/schemas/(\w+)", json.dumps(told)):
        assert told["components"]["schemas"][name]["type"] == "object"


def test_every_refusal_is_described(caller):
    """Of a path that names nothing, of a body too long or without its length, as of all others."""
    paths = caller.ask("GET", "/openapi.json")[1]["paths"]
    answered = [
        (caller.ask("GET", "/things/!")[0], paths["/things/{thing}"]["get"]),
        (caller.ask("POST", "/wish", b" " * (LARGEST_BODY + 1))[0], paths["/wish"]["post"]),
        (caller.ask("POST", "/wish", b"{}", Transfer_Encoding="chunked")[0], paths["/wish"]["post"]),
    ]
    assert [status for status, _ in answered] == [400, 413, 411]
    assert [str(status) in described["responses"] for status, described in answered] == [True] * 3


@pytest.mark.parametrize(
    ("field", "value", "right"),
    [
        ("topics", ["/a", "/b"], True),
        ("topics", ["/a", "b"], False),
        ("topics", ["/a1"], False),
        ("what", None, True),
        ("what", "raw", True),
        ("what", "none", False),
        ("rates", None, True),
        ("rates", [0, 1], True),
        ("rates", [1, -1], False),
    ],
)
def test_what_the_description_allows_is_what_is_taken(field, value, right):
    """A rule holds for each entry of a list, as a whole text, and not for null."""
    known = {}
    schema(Limited, known)
    assert jsonschema.Draft202012Validator(known["Limited"]).is_valid({field: value}) == right
    with nullcontext() if right else pytest.raises(Refusal, match=field):
        read(Limited, {field: value})


def test_elsewhere_than_on_loopback_it_says_at_once_that_nobody_may_operate(monkeypatch):
    """One warning however many routes; with a token there is none, and the token is what counts."""
    monkeypatch.setenv("METRICS_HOST", "0.0.0.0")
    caller = Caller()
    assert caller.ask("POST", "/wish", {"name": "n"})[0] == 403
    assert caller.ask("GET", "/told")[0] == 200
    caller.http.close()
    assert [text for text in caller.warnings if "SENSE4HRI_OPERATE_TOKEN" in text] == caller.warnings
    assert len(caller.warnings) == 1
    monkeypatch.setenv("SENSE4HRI_OPERATE_TOKEN", "secret")
    caller = Caller()
    assert caller.ask("POST", "/wish", {"name": "n"})[0] == 401
    assert caller.ask("POST", "/wish?token=secret", {"name": "n"})[0] == 401
    assert caller.wishes == []
    assert caller.ask("POST", "/wish", {"name": "n"}, Authorization="Bearer secret")[0] == 200
    caller.http.close()
    assert caller.warnings == []


def test_who_asks_before_the_routes_are_there_waits_for_them(monkeypatch):
    """A service that is still being set up says so where that lasts, not that there is nothing; probes are answered."""
    caller = Caller(set_up=False)
    with ThreadPoolExecutor() as pool:
        early = pool.submit(caller.ask, "GET", "/late")
        assert caller.ask("GET", "/healthz")[0] == 200
        caller.http.get("/late", lambda: ["here"], list[str])
        caller.http.all_served()
        assert early.result(DEADLINE_S) == (200, ["here"])
    caller.http.close()
    monkeypatch.setattr("sense4hri.http.SET_UP_S", 0.1)
    caller = Caller(set_up=False)
    status, told = caller.ask("GET", "/told")
    caller.http.close()
    assert (status, told["error"]) == (503, "the service is still being set up: ask again")


def test_clients_that_hang_or_go_away_stop_nobody(caller, capfd):
    """More silent connections than are allowed at once: the next request is answered; nothing is printed."""
    silent = [socket.create_connection(("127.0.0.1", caller.http.port)) for _ in range(2 * MOST_CONNECTIONS)]
    for line in silent[::2]:
        line.sendall(b"POST /wish HTTP/1.1\r\nContent-Length: 100\r\n\r\n{")
    assert caller.ask("POST", "/wish", {"name": "n"}) == (200, {"name": "n"})
    deadline = time.monotonic() + PATIENCE_S / 2  # or they would have ended by themselves
    while sum("process_request" in thread.name for thread in threading.enumerate()) > MOST_CONNECTIONS + 1:
        assert time.monotonic() < deadline, "connections that were replaced still hold their threads"
        time.sleep(0.02)
    for line in silent:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # close with a reset
        line.close()
    assert caller.ask("GET", "/told")[0] == 200
    assert [wish.name for wish in caller.wishes] == ["n"]
    assert capfd.readouterr().err == ""


def test_half_a_body_orders_nothing(caller):
    """A client that goes away before it has sent everything gets no answer, though what came is a wish by itself."""
    with socket.create_connection(("127.0.0.1", caller.http.port), DEADLINE_S) as line:
        line.sendall(b"POST /wish HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n")
        line.sendall(b'Content-Length: 100\r\n\r\n{"name": "half"}')
        line.shutdown(socket.SHUT_WR)
        assert line.recv(1000) == b""
    assert caller.wishes == []


def test_a_token_is_not_found_by_trying(monkeypatch):
    """After some wrong ones this address is told to wait; probes go on."""
    monkeypatch.setenv("SENSE4HRI_OPERATE_TOKEN", "right")
    caller = Caller()
    try:
        answers = [caller.ask("POST", "/wish", {"name": "n"}, Authorization=f"Bearer {n}") for n in range(MOST_WRONG)]
        assert {status for status, _ in answers} == {401}
        status, told = caller.ask("POST", "/wish", {"name": "n"}, Authorization="Bearer right")
        assert status == 429
        assert refused(told)
        assert caller.ask("GET", "/healthz", Authorization="Bearer right")[0] == 200
    finally:
        caller.http.close()
    assert caller.wishes == []


def test_zeros_before_a_length_change_nothing(caller, capfd):
    """However many: the limit of a body stays what it is, and no request ends in an error of the service."""
    body = b'{"name": "n"}'
    assert caller.ask("POST", "/wish", body, Content_Length="0" * 5000 + str(len(body)))[0] == 200
    with socket.create_connection(("127.0.0.1", caller.http.port), DEADLINE_S) as line:
        line.sendall(b"POST /wish HTTP/1.1\r\nHost: localhost\r\nContent-Length: %020d%d\r\n\r\n{" % (0, 10**11))
        line.shutdown(socket.SHUT_WR)
        assert b" 413 " in line.recv(1000)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("port", ["http", "-1", "65536"])
def test_a_wrong_port_is_a_configuration_error(monkeypatch, port):
    """The line names METRICS_PORT."""
    monkeypatch.setenv("METRICS_PORT", port)
    with pytest.raises(ConfigError, match="METRICS_PORT"):
        Caller()


def test_one_of_several_shapes_is_taken_and_the_fault_inside_an_object_is_said():
    """`{"x": "y"}` is a Place with a wrong x, not something else altogether."""
    shape = dict[str, Place | float]
    assert read(shape, {"a": 1, "b": {"x": 2}}) == {"a": 1.0, "b": Place(2.0)}
    with pytest.raises(Refusal, match=r"b\.x is 'y', must be a number"):
        read(shape, {"b": {"x": "y"}})


def test_a_client_that_breaks_off_is_one_count_and_no_line_in_the_log(caller, capfd):
    """Gone in the middle of its request, or with a reset before its answer."""
    before = broken(caller)
    for _ in range(5):
        with socket.create_connection(("127.0.0.1", caller.http.port), DEADLINE_S) as line:
            line.sendall(b"POST /wish HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 10\r\n\r\n{")
        with socket.create_connection(("127.0.0.1", caller.http.port), DEADLINE_S) as line:
            line.sendall(b"POST /wish HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 10\r\n\r\n{")
            line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    poll(lambda: broken(caller) == before + 10, lambda: f"{broken(caller) - before} of 10 counted")
    assert capfd.readouterr().err == ""


def broken(caller: Caller) -> float:
    found = re.search(r"broken_connections_total{.*} (\S+)", caller.ask("GET", "/metrics")[1])
    return float(found.group(1)) if found else 0.0

"""Section 10 of the contract on running services: what a page of the web may try changes nothing."""

import json
from pathlib import Path

import pytest
from processes import Process, poll

START = json.dumps({"study": "stolen"}).encode()
JSON = {"Content-Type": "application/json"}
TOKEN = {"Authorization": "Bearer of-this-test"}


@pytest.fixture
def begin(start, tmp_path: Path):
    """begin(env) starts a session-coordinator and waits until it answers."""

    def begun(**env: str) -> Process:
        process = start("session_coordinator", env=env, state_file=str(tmp_path / "session.json"))
        poll(lambda: process.get("/readyz")[0] == 200, "ready")
        return process

    return begun


def phase(coordinator: Process, headers: dict[str, str] = JSON) -> str:
    """The phase of the session as it is told to whoever may view."""
    status, text = coordinator.request("/session", headers=headers)
    assert status == 200, text
    return json.loads(text)["phase"]


def test_no_page_of_the_web_steers_a_study(begin):
    """Cross-site forms, foreign names and foreign origins are refused and start nothing; the machine's own user may."""
    coordinator = begin()
    foreign = {"Host": "evil.example"}
    for headers, wanted in [
        ({"Content-Type": "application/x-www-form-urlencoded"}, 415),
        ({"Content-Type": "text/plain", "Origin": "http://evil.example"}, 403),
        (JSON | {"Origin": "http://evil.example"}, 403),
        (JSON | {"Origin": "null"}, 403),
        (JSON | foreign, 403),
        (JSON | foreign | {"Origin": "http://evil.example"}, 403),
    ]:
        status, text = coordinator.request("/start", START, headers=headers)
        assert status == wanted, (headers, text)
        assert json.loads(text).keys() == {"error", "field"}
    assert coordinator.request("/session", headers=foreign)[0] == 403
    assert coordinator.request("/openapi.json", headers=foreign)[0] == 403
    assert phase(coordinator) == "IDLE"
    assert coordinator.request("/start", START)[0] == 200
    assert phase(coordinator) != "IDLE"


def test_elsewhere_than_on_loopback_only_the_token_operates(begin):
    """Without one the service says how to set it and refuses; with one it asks for it, and never logs it."""
    closed = begin(METRICS_HOST="0.0.0.0")
    closed.until("set SENSE4HRI_OPERATE_TOKEN")
    assert closed.request("/start", START)[0] == 403
    assert phase(closed) == "IDLE"
    closed.stop()
    operated = begin(METRICS_HOST="0.0.0.0", SENSE4HRI_OPERATE_TOKEN="of-this-test")
    for headers in (JSON, JSON | {"Authorization": "Bearer another"}):
        assert operated.request("/start", START, headers=headers)[0] == 401
    assert operated.request("/start?token=of-this-test", START)[0] == 401
    assert phase(operated) == "IDLE"
    assert operated.request("/start", START, headers=JSON | TOKEN)[0] == 200
    assert phase(operated) != "IDLE"
    assert "of-this-test" not in operated.log() + operated.get("/metrics")[1]


def test_probes_and_metrics_stay_open_where_viewing_is_not(begin):
    """Prometheus and the orchestrator carry no token; what they read names nobody."""
    coordinator = begin(METRICS_HOST="0.0.0.0", SENSE4HRI_VIEW_TOKEN="of-this-test")
    assert coordinator.request("/session")[0] == 401
    assert phase(coordinator, TOKEN) == "IDLE"
    for path in ("/metrics", "/healthz", "/readyz"):
        assert coordinator.request(path, headers={"Host": "session-coordinator:9464"})[0] == 200

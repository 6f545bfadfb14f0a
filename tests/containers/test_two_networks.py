"""A study of two participants on two machines on two networks, from the page alone, and everything that befalls it.

The tests build on each other. Of each fault the page tells in words, an alert fires and ends, a dashboard's own query
shows it; at the end what was lost is what is told to be lost.
"""

from __future__ import annotations

import json
import re
import statistics
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import asked
import host_override
import pytest
import scripted_study
import tls_checks
from docker_study import docker, get, post
from laboratory import DESK, RADIO, Laboratory
from playwright.sync_api import Browser, Page, expect
from processes import poll, wait_for
from sense4hri.cdr import read_raw
from sense4hri.http import OPEN
from sense4hri_recording.reader import Reader
from slow_network import why_not

WHY_NOT = why_not()
pytestmark = [pytest.mark.timeout(600), pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)]
HEALTHY_S = 180
TELLS_S = 90
LOSS, DELAY_S, CUT_S, STEP_S = 0.05, 0.1, 10.0, 2.0
RECORDING, HOLDOVER = 2.0, 2.0
STREAMS = {"p1": "h10_1", "p2": "h10_2"}
STEERING = {"post /start", "post /stop", "post /markers", "post /assign", "post /devices/x/knobs"}


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Laboratory]:
    with pytest.MonkeyPatch.context() as patch:
        laboratory = Laboratory(tmp_path_factory.mktemp("laboratory"), patch)
        try:
            yield laboratory
        finally:
            laboratory.close()


@pytest.fixture(scope="module")
def page(chromium: Browser, laboratory: Laboratory) -> Iterator[Page]:
    """The operator's page, which has not logged in; it must end without an error of its own."""
    errors: list[str] = []
    context = chromium.new_context(ignore_https_errors=True)  # tls_checks looks at the certificate
    page = context.new_page()
    page.on("pageerror", lambda error: errors.append(f"{error.message}\n{error.stack}"))
    page.goto(laboratory.page)
    yield page
    context.close()
    assert not errors


def told(page: Page, text: str, *, over: bool = False) -> None:
    """Wait until the page's log has a sentence that this expression finds; over: and none of these lasts."""
    found = page.locator("#log li").filter(has=page.locator(".sentence", has_text=re.compile(text)))
    if over:
        expect(found.filter(has=page.locator(".lasted", has_text="lasts"))).to_have_count(0)
    expect(found.first).to_be_attached()


def fires(laboratory: Laboratory, alert: str, **labels: str) -> None:
    poll(lambda: laboratory.firing(alert, **labels), lambda: f"{alert} {labels}: {laboratory.alerts()}", TELLS_S, 0.3)


def ends(laboratory: Laboratory, alert: str, **labels: str) -> None:
    """Wait until no such alert fires; of what is counted within two minutes it does for as long."""
    still = f"the end of {alert} {labels}"
    poll(lambda: not laboratory.firing(alert, **labels), lambda: f"{still}: {laboratory.alerts()}", 120 + TELLS_S, 0.3)


def test_every_service_is_healthy_and_asked(laboratory: Laboratory) -> None:
    """On both machines, and Prometheus asks all of them."""
    for part in laboratory.parts.values():
        for service in part.services():
            wait_for(lambda part=part, name=service: part.healthy(name), HEALTHY_S, service)
    everything = sum(map(len, host_override.targets(laboratory.study).values()))
    assert everything == 10
    poll(lambda: len(laboratory.query('up{job="sense4hri"} == 1')) == everything, "all are asked", TELLS_S, 0.3)
    hosts = laboratory.query("count by (host) (sense4hri_ready)")
    assert {one["metric"]["host"] for one in hosts} == {"lab_a", "lab_b"}


def test_samples_become_features_on_the_other_machine_whose_clock_is_known(laboratory: Laboratory) -> None:
    """What rules and panels ask of several hosts is answered, and the clock is measured to 1 ms."""
    quality = 'sense4hri_signal_quality_ratio{sensor_id="h10_1"} > 0.5'
    poll(lambda: laboratory.query(quality), "features", TELLS_S, 0.3)
    clocks = 'sense4hri_host_clock_offset_seconds{field="lab_b"}'
    poll(lambda: laboratory.query(f"abs({clocks}) < 1e-3"), lambda: f"{laboratory.query(clocks)}", TELLS_S, 0.3)
    of_both = [each for each in asked.everything("h10_1", "ecg") if asked.OF_SEVERAL_HOSTS in each]
    assert of_both

    def missing() -> list[str]:
        return asked.unanswered(of_both, laboratory.query)

    poll(lambda: not missing(), lambda: f"no data for {missing()}", TELLS_S, 0.3)


def test_the_page_is_behind_https_and_nothing_else_is_open(laboratory: Laboratory) -> None:
    """From elsewhere each machine answers at the ports of its nodes, and lab-a at that of HTTPS."""
    part = laboratory.parts[DESK]
    certificate = laboratory.folder / "ca.crt"
    docker("cp", f"{part.container('tls')}:/certs/ca.crt", str(certificate))
    tls_checks.holds(laboratory.network.address[DESK], 8443, certificate, part.tokens["operate"])
    for host, more in ((DESK, {8443}), (RADIO, set())):
        ports = {int(address.rpartition(":")[2]) for address in laboratory.nodes(host)}
        assert laboratory.open_ports(host) == ports | more
    for port in (8080, 9090):
        with pytest.raises(OSError, match="refused"):
            get(f"http://{laboratory.network.address[DESK]}:{port}")


def test_a_session_of_two_is_begun_on_the_page(laboratory: Laboratory, page: Page) -> None:
    """Log in, say who wears the second strap, start, mark."""
    expect(page.locator("#access")).to_be_visible()
    page.locator("#access-token").fill(laboratory.parts[DESK].tokens["operate"])
    page.keyboard.press("Enter")
    expect(page.locator("#access-button")).to_have_text("Operator")
    page.locator("#participants .card[aria-label='worn by nobody']").get_by_role(
        "button", name=re.compile("^h10_2:")
    ).click()
    expect(page.locator("#details h2")).to_contain_text("h10_2")
    page.locator("#wearer").select_option(label="somebody new…")
    page.get_by_label("pseudonym of somebody new").fill("p2")
    page.get_by_role("button", name="Assign", exact=True).click()
    expect(page.locator(".wearer .said")).to_have_text("sensor_id 'h10_2' is assigned to human_id 'p2'")
    for human, sensor in STREAMS.items():
        card = page.locator(f"#participants .card[aria-label='participant {human}']")
        expect(card.get_by_role("button", name=f"{sensor}: streaming")).to_be_visible()
    page.locator("#session-button").click()
    page.locator("#start-study").fill("two-networks")
    page.locator("#start-session").fill("bad_day")
    expect(page.locator("#start-humans input:checked")).to_have_count(2)
    expect(page.locator("#start-streams input:checked")).to_have_count(2)
    page.locator("#start-warmup").check()
    page.locator("#start-send").click()
    expect(page.locator("#recording")).to_have_text(re.compile("^● REC "))
    expect(page.locator("#session-said")).to_have_text("bad_day")
    poll(lambda: laboratory.shown("sense4hri_session_phase") == [RECORDING], "the session's phase", TELLS_S, 0.3)
    mark(page, "s")


def mark(page: Page, key: str) -> None:
    """Set a marker and wait until the page has it."""
    count = "() => globalThis.sense4hri.lanes.markers.length"
    before = page.evaluate(count)
    page.locator("#lanes").focus()
    page.keyboard.press(key)
    page.wait_for_function(f"(before) => ({count})() > before", arg=before)


def test_a_killed_driver(laboratory: Laboratory, page: Page) -> None:
    """It is missed, and back once it is begun again; the other participant's goes on."""
    there = laboratory.shown("sense4hri:processes:count", service="driver_polar")
    laboratory.kill("h10-1")
    told(page, "p1 / h10_1: no data for")
    fires(laboratory, "ServiceDown", service="driver_polar")
    assert laboratory.shown("sense4hri:processes:count", service="driver_polar") == [there[0] - 1]
    laboratory.begin("h10-1")
    ends(laboratory, "ServiceDown", service="driver_polar")
    fires(laboratory, "ServiceRestarting", service="driver_polar")
    told(page, "p1 / h10_1: no data for", over=True)
    told(page, "driver_polar_h10_1 was killed or failed", over=True)


def test_a_network_that_loses_and_delays(laboratory: Laboratory, page: Page) -> None:
    """5 % of all packets, and 100 ms on the way: what comes late is told, and what nobody sends twice as lost."""
    laboratory.network.loss, laboratory.network.delay_s = LOSS, DELAY_S
    told(page, "after its receipt.*: a machine or the network is too busy")
    told(page, r"recorder: \d+ messages lost within a minute")
    fires(laboratory, "MessagesLost", service="recorder")
    told(page, r"a message to host lab_b and its answer take 2\d\d ms")
    fires(laboratory, "NetworkSlow", field="lab_b")

    def trips() -> list[float]:
        return laboratory.shown("sense4hri_host_clock_round_trip_seconds")

    poll(lambda: trips() and min(trips()) >= 2 * DELAY_S, lambda: f"a round trip of {trips()} s", TELLS_S, 0.3)


def test_a_partition(laboratory: Laboratory, page: Page) -> None:
    """10 s, on the network that loses and delays: lab-b is missed, and its samples come once it is over."""
    begun_s = time.monotonic()
    laboratory.network.cut(RADIO)
    told(page, "host lab_b no longer answers clock-sync")
    fires(laboratory, "HostUnanswering", field="lab_b")
    fires(laboratory, "ServiceUnanswering")
    assert laboratory.shown("sense4hri_host_clock_state", field="lab_b") == [HOLDOVER]
    poll(lambda: time.monotonic() - begun_s >= CUT_S, "the cut lasts for a while")
    laboratory.network.heal(RADIO)
    ends(laboratory, "HostUnanswering", field="lab_b")
    ends(laboratory, "ServiceUnanswering")
    told(page, "host lab_b no longer answers clock-sync", over=True)
    laboratory.network.loss = laboratory.network.delay_s = 0.0
    ends(laboratory, "NetworkSlow", field="lab_b")
    told(page, "a message to host lab_b and its answer take", over=True)


def test_a_stepped_clock(laboratory: Laboratory, page: Page) -> None:
    """lab-b's is set 2 s ahead, measured to 1 ms, and set back."""

    def offset() -> list[float]:
        return laboratory.shown("sense4hri_host_clock_offset_seconds", field="lab_b")

    laboratory.clock.step(STEP_S)
    told(page, r"the clock of host lab_b is (1999|2000)\.\d ms off that of lab_a")
    fires(laboratory, "HostClocksApart", field="lab_b")
    poll(lambda: abs(abs(offset()[0]) - STEP_S) < 1e-3, lambda: f"an offset of {offset()} s", TELLS_S, 0.3)
    laboratory.clock.step(-STEP_S)
    ends(laboratory, "HostClocksApart", field="lab_b")
    told(page, "the clock of host lab_b is", over=True)


def test_an_outsider_neither_reads_nor_steers(laboratory: Laboratory, page: Page, chromium: Browser) -> None:
    """Without a token, or with a wrong one, every port refuses; the page shows nothing; the session goes on."""
    everything = set()
    for host, part in laboratory.parts.items():
        for address in laboratory.nodes(host):
            for method, path in routes(address, part.tokens["view"]):
                assert [status(method, address + path, token) for token in ("", "guess")] == [401, 401], address + path
                everything.add(f"{method} {path}")
    assert everything >= STEERING
    context = chromium.new_context(ignore_https_errors=True)
    outside = context.new_page()
    outside.goto(laboratory.page)
    expect(outside.locator("#access")).to_be_visible()
    outside.locator("#access-token").fill("guess")
    outside.keyboard.press("Enter")
    expect(outside.locator("#access-said")).to_have_text("this is no token of this study")
    expect(outside.locator(".lane")).to_have_count(0)
    context.close()
    expect(page.locator("#recording")).to_have_text(re.compile("^● REC "))
    expect(page.locator("#session-said")).to_have_text("bad_day")


def routes(address: str, token: str) -> Iterator[tuple[str, str]]:
    """Yield method and path of each route of a node but those that are open to all."""
    for path, methods in json.loads(get(f"{address}/openapi.json", token)[1])["paths"].items():
        yield from ((method, re.sub("{.*?}", "x", path)) for method in methods if path not in OPEN)


def status(method: str, address: str, token: str) -> int:
    return get(address, token)[0] if method == "get" else post(address, {}, token)


def test_what_was_lost_is_told(laboratory: Laboratory, page: Page, tmp_path: Path) -> None:
    """Stopped on the page: the report names every sample that is missing, and when the driver was away."""
    mark(page, "r")
    page.locator("#session-button").click()
    page.locator("#stop-send").click()
    expect(page.locator("#session-said")).to_contain_text("complete")
    expect(page.locator("#report")).to_be_visible()
    laboratory.parts[DESK].copy_volume("recordings", tmp_path / "recordings")
    (folder,) = scripted_study.folders(tmp_path / "recordings")
    report = json.loads((folder / "report.json").read_text())
    assert report["session"]["session_id"] == "bad_day"
    entries = {entry["stream"]: entry for entry in report["streams"]}
    for human, sensor in STREAMS.items():
        span, arrived = account(folder, f"/humans/physiological/{human}/ecg/{sensor}/raw")
        lost = entries[f"{human}/ecg/{sensor}"]["lost_samples"]
        print(f"{sensor}: span {span}, arrived {arrived}, told lost {lost}")
        assert span > 3000
        assert arrived + lost == span, sensor
    assert entries["p1/ecg/h10_1"]["lost_samples"] > 0
    steps = [(step["host"], step["step_s"]) for step in report["host_clock_steps"]]
    assert steps == [(RADIO, pytest.approx(STEP_S, abs=0.01)), (RADIO, pytest.approx(-STEP_S, abs=0.01))]
    markers = [
        marker.name
        for reader in [Reader(folder)]
        for record in reader.messages(["/study/markers"])
        if (marker := reader.decode(record)).source == "web-gui"
    ]
    assert markers == ["stimulus", "response"]


def account(folder: Path, topic: str) -> tuple[int, int]:
    """Return how many samples the device took from the first to the last that were recorded, and how many these are.

    By its own clock, at the rate that most messages have.
    """
    raws = sorted((read_raw(record.data) for record in Reader(folder).messages([topic])), key=lambda raw: raw.device_ns)
    rates = [len(raw.samples) / (raw.device_ns - before.device_ns) for before, raw in pairwise(raws)]
    gone_ns = raws[-1].device_ns - raws[0].device_ns
    return len(raws[0].samples) + round(gone_ns * statistics.median(rates)), sum(len(raw.samples) for raw in raws)


def test_what_is_told_for_minutes_has_ended(laboratory: Laboratory) -> None:
    """The alerts of the other faults ended with them."""
    ends(laboratory, "MessagesLost", service="recorder")
    ends(laboratory, "ServiceRestarting", service="driver_polar")

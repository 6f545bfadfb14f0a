"""Every driver in a study of its own: its device played, a session recorded, its report, features, contract, metrics.

`compose/studies/<name>.yaml` is the study of driver-<name> where its devices are virtual; whoever writes it has it
tested here, and no list is kept. One alone: `pytest tests/graph/test_device_studies.py -k bitalino`.
"""

import json
import re
import signal
import time
import urllib.request
from pathlib import Path
from typing import Any, NamedTuple

import metrics_table
import pytest
import study_file
from driver_check import DriverCheck
from prometheus_client.parser import text_string_to_metric_families

ROOT = Path(__file__).resolve().parents[2]
SECONDS, LISTENED_S = 12, 7
BUSY = 0.6
"""Share of the session's seconds for each of which there must be features: the first few come late."""
IN_FLIGHT_S = 2.0
"""Of samples that the bench has sent and the driver has not yet counted, on a busy machine."""
IN_THE_DEMO = ("polar",)
"""Drivers of which the virtual study is the demo, and compose/studies/<name>.yaml one of real sensors."""
INTERPRETERS = {"accelerometer": "interpreter_motion"}
"""Of sensor types after which theirs is not named."""


def studies() -> list[str]:
    """Names of the studies that play one driver's devices."""
    drivers = sorted(path.name.removeprefix("driver-") for path in (ROOT / "services").glob("driver-*"))
    return [name for name in drivers if name not in IN_THE_DEMO and (study_file.STUDIES / f"{name}.yaml").is_file()]


class Counted(NamedTuple):
    """What the bench has sent and not lost of one stream, and what its driver has counted, at one moment."""

    sent: int
    came: int


def told(port: int, path: str) -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=20) as answer:
        return answer.read().decode()


def counted(logs: Path) -> dict[tuple[str, str], Counted]:
    """By sensor and sensor type, of the streams that both the bench and a driver count."""
    came: dict[tuple[str, str], int] = {}
    truth: dict[str, Any] = {}
    for port in metrics_table.ports(logs):
        for family in text_string_to_metric_families(told(port, "/metrics")):
            if family.name == "sense4hri_samples":
                keys = {(each.labels["sensor_id"], each.labels["sensor_type"]): each.value for each in family.samples}
                came |= {key: round(value) for key, value in keys.items()}
        if "/truth" in json.loads(told(port, "/openapi.json"))["paths"]:
            truth = json.loads(told(port, "/truth"))["devices"]
    sent = {
        (sensor, sensor_type): stream["samples_sent"] - stream["samples_lost"]
        for sensor, device in truth.items()
        for sensor_type, stream in device.get("streams", {}).items()
    }
    both = sent.keys() & came.keys()
    assert {sensor for sensor, _ in both} == {sensor for sensor, _ in sent}, f"sent {[*sent]}, came {[*came]}"
    return {key: Counted(sent[key], came[key]) for key in both}


def departing(before: dict[tuple[str, str], Counted], after: dict[tuple[str, str], Counted], rates: Any) -> list[str]:
    """A sentence for each stream of which more or less has come meanwhile than was sent."""
    found = []
    for key in before.keys() & after.keys():
        sent, came = (after[key][i] - before[key][i] for i in range(2))
        if abs(sent - came) > IN_FLIGHT_S * (rates[key] or sent / SECONDS):  # of irregular samples: as they came
            found.append(f"{'/'.join(key)}: {sent} samples sent, {came} came")
    return found


@pytest.mark.slow(
    reason="test_stranger: contract, page, report, no sample lost; test_written_study: a report that is complete"
)
@pytest.mark.parametrize("name", studies())
def test_a_device_goes_the_whole_way(demo, name):
    """Nothing is lost from device to recording, its driver keeps the contract, the report is complete."""
    study = study_file.read(study_file.find(name))
    run = demo("--study", name)
    run.until("the page:", 120)
    checks = [DriverCheck(sensor.sensor_id, LISTENED_S) for sensor in study.sensors]
    run.until("records, into", 120)
    assert metrics_table.lacking(metrics_table.scraped(run.logs), metrics_table.written()) == []
    before, begun_s = counted(run.logs), time.monotonic()
    departures = [line for check in checks for line in check.departures()]
    time.sleep(max(0.0, SECONDS - (time.monotonic() - begun_s)))  # a session has a length
    after, seconds = counted(run.logs), time.monotonic() - begun_s
    run.process.send_signal(signal.SIGINT)
    assert run.wait(120) == 0, "\n".join(run.lines)
    assert departures == []
    report = report_of(run.lines)
    assert report["verdict"] == "complete", report["problems"]
    streams = {entry["stream"]: entry for entry in report["streams"] if entry["kind"] == "raw"}
    recorded = {entry["stream"].split("/")[2] for entry in report["streams"] if entry["kind"] in ("raw", "device")}
    for sensor in study.sensors:
        assert sensor.sensor_id in recorded, f"nothing of {sensor.sensor_id}"
    for key, entry in streams.items():
        lost = entry["lost_samples"], entry["driver"]["lost_samples"]  # without device time only the driver can know
        if entry["declared_hz"]:  # of irregular samples nobody can
            assert lost in ((0, 0), (None, 0)), key
        assert (entry["duplicates"], entry["reordered"]) == (0, 0), key
        sensor_type = key.split("/")[1]
        if INTERPRETERS.get(sensor_type, f"interpreter_{sensor_type}") in study.packages:
            assert entry["features_messages"] > BUSY * seconds, key
    rates = {tuple(reversed(key.split("/")[1:])): entry["declared_hz"] or 0.0 for key, entry in streams.items()}
    assert departing(before, after, rates) == []


def report_of(lines: list[str]) -> dict[str, Any]:
    """The report of the session that a demo has recorded."""
    folder = next(found[1] for line in lines if (found := re.search(r"records, into (\S+)", line)))
    return json.loads((Path(folder) / "report.json").read_text())

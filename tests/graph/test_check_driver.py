"""`sense4hri-check-driver`: a right driver of plain rclpy passes, each single fault of one is named."""

import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from processes import Process, claimed_domain
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri_msgs.msg import PhysioRaw

DRIVER = str(Path(__file__).resolve().parents[1] / "plain_driver.py")
NAMED = {
    "node name": (2, "its node is belt, must be driver_<kind>_"),
    "best effort": (2, "is best effort, must be reliable"),
    "latched": (2, "is latched (transient local), must be volatile"),
    "no health": (2, "must be one a second"),
    "frame id": (3, "header.frame_id is 'belt', must be the sensor_id"),
    "first sample": (3, "stamps must be of the last sample"),
    "stamps go back": (3, "device_timestamp goes back"),
    "invented time": (3, "where the device gives no time it must be zero"),
    "counts": (4, "samples_total has grown by"),
    "loss in silence": (4, "samples are missing by device time"),
    "unit": (5, "unit 'mV' of respiration"),
    "whole number": (6, "respiration.range_max must be a double"),
    "missing parameter": (6, "respiration.resolution_bits is not there"),
    "rate": (6, "samples/s came, 50 Hz are declared"),
    "sensor id settable": (6, "sensor_id can be set at run time"),
    "wearer stays": (6, "no raw came under it"),
}
FAULTS = list(NAMED)
SENSOR, SECONDS, AT_ONCE = "belt_1", 8, 6
MOVED = ("--human-id", "p8")


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, dict[str, Any]]]:
    """By fault, empty = none: status of the command and what it told; each on a graph of its own."""
    folder, faults = tmp_path_factory.mktemp("belts"), ["", *FAULTS]
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return dict(zip(faults, pool.map(lambda fault: played(fault, folder), faults), strict=True))


def played(fault: str, folder: Path) -> tuple[int, dict[str, Any]]:
    """Play a driver with this fault and check it."""
    with claimed_domain() as domain:
        environment = graph(domain)
        driver = Process(folder / f"{fault or 'right'}.log", DRIVER, SENSOR, fault, env=environment)
        try:
            return checked(SENSOR, environment, *(MOVED if fault in ("", "wearer stays") else ()))
        finally:
            driver.end()


def graph(domain: int) -> dict[str, str]:
    """Return what puts a process onto a graph."""
    return {"ROS_DOMAIN_ID": str(domain), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}


def checked(sensor: str, environment: dict[str, str], *options: str) -> tuple[int, dict[str, Any]]:
    """Run the command; return its status and what it told."""
    command = [sys.executable, "-m", "check_driver", sensor, "--json", "--seconds", str(SECONDS), *options]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=150, check=False, env={**os.environ, **environment}
    )
    assert done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout)


def test_a_driver_that_keeps_the_contract_passes(told):
    """Of plain rclpy, without the kit, with a change of wearer and back: nothing departs, status 0."""
    status, found = told[""]
    assert (status, found["departures"]) == (0, [])


@pytest.mark.parametrize("fault", FAULTS)
def test_a_single_fault_is_named(told, fault):
    """With its section and a sentence that says it; status 1, and nothing else is wrong."""
    section, sentence = NAMED[fault]
    status, found = told[fault]
    lines = [(each["section"], each["what"]) for each in found["departures"]]
    assert status == 1
    assert [line for line in lines if line[0] == section and sentence in line[1]], lines
    assert {line for line in lines if sentence not in line[1]} == set(), "one fault is one line"


def test_a_sensor_that_nobody_has_is_said():
    """No topic under its name: one sentence, status 1."""
    with claimed_domain() as domain:
        status, found = checked("nobody_1", graph(domain), "--wait", "3")
    (only,) = found["departures"]
    assert status == 1
    assert "nothing is published" in only["what"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_one_that_is_interrupted_says_so_and_puts_back_who_wears_it(ears, tmp_path, number):
    """Ctrl-C or SIGTERM while the sensor is on somebody else: it is on whom it was on, one sentence, status 130."""
    topics = [StreamName(human_id, "respiration", SENSOR).topic("raw") for human_id in ("p9", "p8")]
    was, moved = (ears.hear(PhysioRaw, topic, qos.RAW) for topic in topics)
    driver = Process(tmp_path / "belt.log", DRIVER, SENSOR, "")
    check = Process(tmp_path / "check.log", "check_driver", SENSOR, "--seconds", "1", *MOVED)
    try:
        ears.until(lambda: moved, "the sensor is on somebody else", 60)
        check.child.send_signal(number)
        assert check.wait() == 130
        assert check.log() == f"{SENSOR}: ended before everything was looked at, so nothing is said of it\n"
        was.clear()
        ears.until(lambda: was, "the sensor is back", 20)
    finally:
        check.end()
        driver.end()

"""`sense4hri-check-driver SENSOR_ID`: where a running driver, in any language, departs from the contract."""

import argparse
import json
import math
import os
import signal
import sys
import time
from contextlib import closing
from typing import Any

from sense4hri.line import Line
from sense4hri.names import HUMAN_ID_FORM, is_human_id
from sense4hri.stream_info import long_s

from check_driver import health, parameters, times
from check_driver.findings import Findings
from check_driver.probes import Probes
from check_driver.topics import Topics

SECONDS, WAIT_S, LOOK_S = 60.0, 60.0, 0.5
INTERRUPTED = 130


def check(line: Line, options: argparse.Namespace) -> Findings:
    """Listen, ask, do what was asked for; return what was found."""
    findings = Findings()
    topics = Topics(line.node, options.sensor_id, findings)
    if not line.until(topics.look, options.wait):
        findings.wrong(2, options.sensor_id, f"nothing is published under this sensor_id within {options.wait:g} s")
        return findings
    _listen(line, topics, 2.0)  # topics come one by one
    begun_s = time.monotonic()
    _listen(line, topics, options.seconds)
    ended_s = time.monotonic()
    node = _node(topics, options.sensor_id, findings)
    if node is None:
        return findings
    sampled = [name for name, heard in topics.streams.items() if f"{name.topic('raw')}" in topics.published()]
    topics.beside(node)
    values = parameters.check(line, node, sampled, findings)
    _judge(topics, values, node, (begun_s, ended_s), findings)
    probes = Probes(line, topics, node, findings)
    if not options.passive:
        probes.fixed(options.sensor_id)
    if options.human_id:
        probes.wearer(options.human_id)
    if options.stop_pid:
        probes.unplugged(options.stop_pid)
    return findings


def _listen(line: Line, topics: Topics, seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        topics.look()
        line.until(lambda: None, min(LOOK_S, until_s - time.monotonic()))


def _node(topics: Topics, sensor_id: str, findings: Findings) -> str | None:
    """Return the one node that publishes all of the driver's topics."""
    nodes = sorted({node for names in topics.published().values() for node in names})
    if len(nodes) > 1:
        findings.wrong(2, sensor_id, f"several nodes publish it: {', '.join(nodes)}; one driver is one device")
    for node in nodes:
        name = node.rpartition("/")[2]
        if not (name.startswith("driver_") and name.endswith(f"_{sensor_id}")):
            findings.wrong(2, sensor_id, f"its node is {name}, must be driver_<kind>_{sensor_id}")
    if not nodes:
        findings.wrong(2, sensor_id, "was published and no node publishes it any more: the driver has ended meanwhile")
    humans = _wearers(topics)
    if len(humans) > 1:
        findings.wrong(2, sensor_id, f"is on {' and '.join(humans)} at once")
    return nodes[0] if nodes else None


def _wearers(topics: Topics) -> list[str]:
    """Return on whom the sensor is now; somebody may have moved it while it was listened to."""
    return sorted({topic.split("/")[3] for topic in topics.published()})


def _judge(topics: Topics, values: dict[str, Any], node: str, span_s: tuple[float, float], findings: Findings) -> None:
    """Hold what came on every stream against what is said of it."""
    published, wearers = topics.published(), _wearers(topics)
    for name, heard in topics.streams.items():
        if name.human_id not in wearers:
            findings.remark(node, f"{name.sensor_id} is no longer on {name.human_id}: moved meanwhile?")
            continue
        rate_hz = values.get(f"{name.sensor_type}.sampling_frequency_hz", math.nan)
        sound = False
        if name.topic("raw") in published:
            if not heard.frames:
                _nothing_came(name.topic("raw"), rate_hz, span_s[1] - span_s[0], findings)
            sound = times.check(heard.frames, rate_hz, name.topic("raw"), findings)
            parameters.agree(values, heard, node, findings)
        if name.topic("health") in published:
            health.check(heard, rate_hz, span_s, sound, findings)
        else:
            findings.wrong(2, name.topic("health"), "is not published, must be once a second")


def _nothing_came(topic: str, rate_hz: float, listened_s: float, findings: Findings) -> None:
    """An event may not happen in this time, nor the next sample of a slow stream come."""
    if rate_hz == 0 or listened_s < long_s(0.0, rate_hz):
        findings.remark(topic, f"nothing came within {listened_s:.0f} s")
    else:
        findings.wrong(2, topic, "nothing came")


def seconds(text: str) -> float:
    """Return how long to listen. Raises ValueError, or ArgumentTypeError where nothing would be heard."""
    if not (given_s := float(text)) > 0:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return given_s


def process(text: str) -> int:
    """Return the id of a process. Raises ValueError, or ArgumentTypeError where there is none that may be stopped."""
    pid = int(text)
    try:
        if pid > 0:  # 0 and below are many processes at once
            os.kill(pid, 0)
            return pid
    except (OSError, OverflowError):
        pass
    raise argparse.ArgumentTypeError(f"{text} is no process of yours")


def main(arguments: list[str] | None = None) -> int:
    """Check one driver; return 0 where it keeps the contract, 1 where it does not, INTERRUPTED where nobody waited."""
    parser = argparse.ArgumentParser(
        prog="sense4hri-check-driver",
        description="Listen to a running driver and say, line by line, where it departs from sections 2 to 6 of "
        "interfaces/CONTRACT.md. ROS_DOMAIN_ID must be that of the driver. Status 0: nowhere; 1: departures.",
    )
    parser.add_argument("sensor_id", help="of the driver's sensor, such as h10_1")
    parser.add_argument(
        "--seconds", type=seconds, default=SECONDS, metavar="S", help="how long to listen (%(default)g)"
    )
    parser.add_argument("--wait", type=float, default=WAIT_S, metavar="S", help="for its first topic (%(default)g)")
    parser.add_argument("--human-id", default="", metavar="ID", help="also put it on this person, and back")
    parser.add_argument(
        "--stop-pid", type=process, default=0, metavar="PID", help="also stop this process of it for 8 s"
    )
    parser.add_argument("--passive", action="store_true", help="only listen and ask; try no change that it must refuse")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    options = parser.parse_args(arguments)
    if options.human_id and not is_human_id(options.human_id):
        parser.error(f"--human-id {options.human_id!r} is no pseudonym: {HUMAN_ID_FORM}")
    try:
        with closing(Line("sense4hri-check-driver", "driver")) as line:
            signal.signal(signal.SIGTERM, line.interrupt)  # as Ctrl-C: what was changed is put back
            findings = check(line, options)
    except KeyboardInterrupt:
        print(f"{options.sensor_id}: ended before everything was looked at, so nothing is said of it", file=sys.stderr)
        return INTERRUPTED
    _tell(options, findings)
    return 1 if findings.departures() else 0


def _tell(options: argparse.Namespace, findings: Findings) -> None:
    departures, remarks = findings.departures(), findings.remarks()
    if options.json:
        told = {"sensor_id": options.sensor_id, "departures": [each._asdict() for each in departures]}
        print(json.dumps(told | {"remarks": [each._asdict() for each in remarks]}, indent=1))
        return
    for each in [*departures, *remarks]:
        print(each.line())
    print(f"{options.sensor_id}: {len(departures)} departures from the contract, {len(remarks)} remarks")


if __name__ == "__main__":
    sys.exit(main())

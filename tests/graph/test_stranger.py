"""What the house is for: a stranger's device, two files of code and a study file, and nothing else edited."""

import asyncio
import json
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import aiohttp
import pandas as pd
import pytest
from driver_check import DriverCheck
from processes import DEADLINE_S
from virtual_skinbox import VirtualSkinBox

ROOT = Path(__file__).resolve().parents[2]
SKINBOX = ROOT / "tests" / "kit" / "skinbox"
WRISTBAND = ROOT / "tests" / "kit" / "wristband"
STREAM = "p1/eda/box_1"
SEED, SECONDS, LISTENED_S = 47, 10, 7


def far_away(example: Path, folder: Path) -> Path:
    """The example's files, far from the repository: its study file."""
    shutil.copytree(example, folder, ignore=shutil.ignore_patterns("__pycache__"))
    study = folder / "study.yaml"
    study.write_text(study.read_text().replace("../../../compose/compose.yaml", str(ROOT / "compose" / "compose.yaml")))
    return study


@pytest.fixture
def study(tmp_path):
    """The stranger's folder: driver.py, protocol.py, study.yaml; the box is plugged in."""
    study, port = far_away(SKINBOX, tmp_path / "skinbox"), tmp_path / "port"
    study.write_text(study.read_text().replace("/dev/ttyUSB0", str(port)))
    box = VirtualSkinBox(port)
    yield study
    box.unplug()


async def shown(address: str) -> dict[str, Any]:
    """What the page is told of the stream, once its samples flow there."""
    async with (
        asyncio.timeout(DEADLINE_S),
        aiohttp.ClientSession() as session,
        session.ws_connect(f"{address}/ws") as page,
    ):
        async for message in page:
            told = json.loads(message.data) if message.type is aiohttp.WSMsgType.TEXT else {}
            for stream in told.get("streams", ()):
                if stream["key"] == STREAM and stream["status"] == "streaming" and stream["shown"]:
                    return stream
    raise AssertionError("the page ended its connection")


def recorded(folder: Path) -> tuple[dict[str, Any], list[pd.DataFrame]]:
    """The report of the one session in this folder, which must be complete, and its tables as exported."""
    (report,) = (folder / "recordings").rglob("report.json")
    told = json.loads(report.read_text())
    assert told["verdict"] == "complete", told
    out = folder / "export"
    command = [sys.executable, "-m", "sense4hri_session", str(report.parent), "--out", str(out), "--formats", "csv"]
    subprocess.run([*command, "--quiet"], check=True, timeout=DEADLINE_S)
    return told, [pd.read_csv(table) for table in out.rglob("*.csv")]


@pytest.mark.timeout(1200)
def test_it_is_on_the_page_in_the_report_and_in_the_export(demo, study, tmp_path):
    """Two files and a study: live, true to the contract, recorded without a gap, told in the report, exported."""
    run = demo("--study", str(study), "--duration", "20")
    run.until("the page:", 120)
    check = DriverCheck("box_1", 8)
    address = next(re.search(r"http://\S+", line)[0] for line in run.lines if "the page:" in line).rstrip("/")
    stream = asyncio.run(shown(address))
    assert (stream["unit"], stream["channels"], stream["type"]) == ("µS", ["eda"], "eda")
    assert check.departures() == []
    assert run.wait(120) == 0, "\n".join(run.lines)
    told, tables = recorded(tmp_path)
    assert STREAM in json.dumps(told)
    (levels,) = [table["eda"] for table in tables if "eda" in table]
    assert len(levels) >= 20 * 50 * 0.95
    steps = levels.diff().dropna()
    assert ((steps - 0.01).abs() < 1e-9).all(), "samples carry their number in 0.01 uS: none is missing, none twice"


class Signal(NamedTuple):
    """What one characteristic of a band that nobody knows notifies; count: samples in a notification."""

    sensor_type: str
    unit: str
    channels: tuple[str, ...]
    rate_hz: int
    count: int
    form: str
    scale: float


SKINS = [("eda", "uS"), ("temperature", "degC"), ("sweat_rate", "a.u."), ("skin_ph", "a.u.")]
MOTIONS = [("accelerometer", "m/s^2"), ("gyroscope", "rad/s"), ("magnetometer", "uT")]
CLOCKS = [(1024, 16), (1000, 16), (32768, 24), (1000, 32), (1_000_000, 32)]
"""Ticks per second, bits."""
FORMS = {"<u2": "H", "<i2": "h", "<u4": "I", "<i4": "i"}


def drawn(draw: random.Random, kinds: list[tuple[str, str]], channels: tuple[str, ...] | None = None) -> Signal:
    """One of these kinds, in a layout of its own."""
    sensor_type, unit = draw.choice(kinds)
    rate_hz = draw.choice([10, 16, 25, 32, 50, 64, 100])
    scale = round(draw.uniform(0.0005, 0.01), 4)
    form = draw.choice(list(FORMS))
    return Signal(sensor_type, unit, channels or (sensor_type,), rate_hz, draw.choice([1, 3, 5, 8]), form, scale)


def put(file: Path, lines: dict[str, str]) -> None:
    """Put another line in the place of the one that begins with each of these words."""
    text = file.read_text()
    for begin, line in lines.items():
        text, times = re.subn(rf"^( *){re.escape(begin)}.*$", rf"\g<1>{line}", text, count=1, flags=re.M)
        assert times == 1, f"{begin} in {file}"
    file.write_text(text)


def band(folder: Path, seed: int) -> tuple[Path, tuple[Signal, ...]]:
    """The page's wristband with another clock, other signals, rates, forms and scales: its study, what it sends."""
    draw, study = random.Random(seed), far_away(WRISTBAND, folder)
    signals = drawn(draw, SKINS), drawn(draw, MOTIONS, ("x", "y", "z"))
    ticks_hz, bits = draw.choice(CLOCKS)
    layouts = [f"Layout{(s.sensor_type, s.rate_hz, s.unit, s.channels, s.form, s.scale)}," for s in signals]
    clock = {"TICKS_HZ,": f"TICKS_HZ, BITS = {ticks_hz}, {bits}"}
    put(folder / "protocol.py", clock | {"SKIN:": f"SKIN: {layouts[0]}", "MOTION:": f"MOTION: {layouts[1]}"})
    sent = ", ".join(
        f"{name}: ({s.rate_hz}, {s.count}, {FORMS[s.form]!r}, {len(s.channels)})"
        for name, s in zip(("SKIN", "MOTION"), signals, strict=True)
    )
    types = f"{{SKIN: {signals[0].sensor_type!r}, MOTION: {signals[1].sensor_type!r}}}"
    clock = {"TICKS_HZ,": f"TICKS_HZ, BYTES = {ticks_hz}, {bits // 8}"}
    others = {"SENT ": f"SENT = {{{sent}}}", "NOTIFIES,": f"NOTIFIES, WRITTEN = {types}, (COMMAND,)"}
    put(folder / "emulator.py", clock | others)
    text = study.read_text()
    for before, sent_as in zip(("eda", "accelerometer"), signals, strict=True):
        text = text.replace(f"p1/{before}/band_1", f"p1/{sent_as.sensor_type}/band_1")
    study.write_text(text)
    return study, signals


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", [SEED])
def test_a_band_that_nobody_knows_is_recorded_to_the_sample(demo, tmp_path, seed):
    """Two characteristics of drawn layouts on a drawn clock that wraps: the contract kept, no sample lost or twice."""
    study, signals = band(tmp_path / "band", seed)
    run = demo("--study", str(study))
    run.until("records, into", 180)
    begun_s = time.monotonic()
    departures = DriverCheck("band_1", LISTENED_S).departures()
    time.sleep(max(0.0, SECONDS - (time.monotonic() - begun_s)))  # a session has a length
    run.process.send_signal(signal.SIGINT)
    assert run.wait(180) == 0, "\n".join(run.lines)
    assert departures == []
    told, tables = recorded(tmp_path)
    streams = {entry["stream"]: entry for entry in told["streams"]}
    for each in signals:
        entry = streams[f"p1/{each.sensor_type}/band_1"]
        lost = entry["lost_samples"], entry["duplicates"], entry["reordered"]
        assert (entry["declared_hz"], lost) == (each.rate_hz, (0, 0, 0)), entry
        (table,) = [table for table in tables if {*each.channels} <= {*table}]
        assert len(table) >= SECONDS * each.rate_hz * 0.95
        for channel in each.channels:
            assert ((table[channel].diff().dropna() - each.scale).abs() < 1e-9).all(), channel

"""What the house is for: a stranger's serial device, two files of code and a study file, and nothing else edited."""

import asyncio
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import aiohttp
import pandas as pd
import pytest
from driver_check import DriverCheck
from processes import DEADLINE_S
from virtual_skinbox import VirtualSkinBox

ROOT = Path(__file__).resolve().parents[2]
SKINBOX = ROOT / "tests" / "kit" / "skinbox"
STREAM = "p1/eda/box_1"


@pytest.fixture
def study(tmp_path):
    """The stranger's folder, far from the repository: driver.py, protocol.py, study.yaml; the box is plugged in."""
    folder, port = tmp_path / "skinbox", tmp_path / "port"
    shutil.copytree(SKINBOX, folder, ignore=shutil.ignore_patterns("__pycache__"))
    text = (folder / "study.yaml").read_text()
    text = text.replace("../../../compose/compose.yaml", str(ROOT / "compose" / "compose.yaml"))
    (folder / "study.yaml").write_text(text.replace("/dev/ttyUSB0", str(port)))
    box = VirtualSkinBox(port)
    yield folder / "study.yaml"
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


@pytest.mark.timeout(600)
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
    (report,) = (tmp_path / "recordings").rglob("report.json")
    told = json.loads(report.read_text())
    assert told["verdict"] == "complete", told
    assert STREAM in json.dumps(told)
    out = tmp_path / "export"
    command = [sys.executable, "-m", "sense4hri_session", str(report.parent), "--out", str(out), "--formats", "csv"]
    subprocess.run([*command, "--quiet"], check=True, timeout=DEADLINE_S)
    (levels,) = [table["eda"] for table in map(pd.read_csv, out.rglob("*.csv")) if "eda" in table]
    assert len(levels) >= 20 * 50 * 0.95
    steps = levels.diff().dropna()
    assert ((steps - 0.01).abs() < 1e-9).all(), "samples carry their number in 0.01 uS: none is missing, none twice"

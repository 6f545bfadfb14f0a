"""The page: what the server costs and how often the browser draws.

A third-party driver publishes over DDS a 64-channel stream at 1 kHz, which one Chromium shows whole, 10 s wide.
"""

import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "browser"))

from gui_browser import ARGUMENTS, chromium_path
from gui_stage import Stage, environment
from processes import claimed_domain, poll
from sense4hri.chunk import Break, TimedChunk
from web_gui.history import History

SECONDS = 10.0
TICKS_PER_S = 100
LANE = "globalThis.sense4hri?.lanes.lanes.values().next().value"
COUNT = """(seconds) => new Promise((done) => {
    const lanes = globalThis.sense4hri.lanes, frames = lanes.frames, start = performance.now(), gaps = [];
    let before = start;
    const step = (now) => {
        gaps.push(now - before);
        before = now;
        if (now - start < 1000 * seconds) requestAnimationFrame(step);
        else done({ gaps: gaps.slice(1), frames: lanes.frames - frames, took: now - start });
    };
    requestAnimationFrame(step);
})"""
DRAW = f"""() => {{
    const lanes = globalThis.sense4hri.lanes, lane = {LANE}, times = [];
    const draw = lane.draw.bind(lane);
    lane.draw = (pen, now) => {{ const t = performance.now(); draw(pen, now); times.push(performance.now() - t); }};
    return new Promise((done) => setTimeout(() => {{ delete lane.draw; done(times); }}, 3000));
}}"""


def rows() -> list[dict[str, Any]]:
    """Return the measured rows."""
    return [*on_the_page(), decimation()]


def on_the_page() -> list[dict[str, Any]]:
    """Measure server, wire and browser together, all on this machine."""
    path = chromium_path()
    if path is None:
        text = "no Chromium: install the Debian package `chromium`"
        return [{"what": "web-gui: 64 channels at 1 kHz", "target": "smooth", "measured": text, "ok": None}]
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, claimed_domain() as domain, sync_playwright() as playwright:
        stage = Stage(Path(folder), environment(domain))
        gui, address = stage.gui()
        study = stage.study("--participants", "1", "--cap", "64")
        try:
            browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.goto(address)
            filled = f"() => ({LANE}?.line.newest - {LANE}?.line.times[{LANE}.line.start]) > 9000"
            poll(lambda: page.evaluate(filled), "a full window")
            alone = cpu_s(gui.popen.pid)
            counted = page.evaluate(COUNT, SECONDS)
            server = (cpu_s(gui.popen.pid) - alone) / (counted["took"] / 1000)
            drawing = np.array(page.evaluate(DRAW))
            browser.close()
            memory = resident_mb(gui.popen.pid)
        finally:
            study.tell("quit")
            study.stop()
            gui.stop()
    pictures = len(counted["gaps"]) / (counted["took"] / 1000)
    frames = counted["frames"] / (counted["took"] / 1000)
    slow = float(np.percentile(counted["gaps"], 99))
    drawn, worst = float(np.median(drawing)), float(np.percentile(drawing, 99))
    return [
        row(
            "pictures per second in Chromium without a GPU",
            "smooth, >= 30/s",
            f"{pictures:.0f}/s, p99 gap {slow:.0f} ms",
            pictures >= 30,
        ),
        row("drawing one picture", "< 16 ms", f"p50 {drawn:.1f} ms, p99 {worst:.1f} ms", worst < 16),
        row("binary frames per second", "<= 30/s", f"{frames:.0f}/s", frames <= 30.5),
        row("server's CPU, DDS included", "", f"{100 * server:.0f} % of a core, {memory:.0f} MB", None),
    ]


def decimation() -> dict[str, Any]:
    """Measure the most a client can ask for at once: all of a 30 s window of 64 channels at 1 kHz."""
    channels = tuple(f"C{c}" for c in range(64))
    history, samples = History(channels, 180.0, device_time=False), np.random.default_rng(1).standard_normal((1000, 64))
    for second in range(60):
        times = second * 10**9 + np.arange(1000, dtype=np.int64) * 10**6
        history.push(TimedChunk(channels, samples, times, None, int(times[-1]), None if second else Break.FIRST, 0))
    took = []
    for _ in range(20):
        begun = time.perf_counter()
        history.columns(30 * 10**9, 60 * 10**9, 30 * 10**9 // 1200, list(range(64)))
        took.append(1000 * (time.perf_counter() - begun))
    return row("min/max of a whole 30 s window, 1200 columns", "", f"p50 {np.median(took):.0f} ms", None)


def row(what: str, target: str, measured: str, ok: bool | None) -> dict[str, Any]:
    """Return one row of the table."""
    return {"what": f"web-gui, 64 channels at 1 kHz: {what}", "target": target, "measured": measured, "ok": ok}


def cpu_s(pid: int) -> float:
    """Return the CPU time a process has used, in s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def resident_mb(pid: int) -> float:
    """Return the memory of a process in MB."""
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    return int(found.group(1)) / 1024 if found else float("nan")


if __name__ == "__main__":
    print("| what | target | measured | ok |\n|---|---|---|---|")
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |")

"""The page under load: what the server costs and how often the browser draws.

Third-party drivers publish over DDS one 64-channel stream at 1 kHz, which one Chromium shows whole, 10 s wide; then
eight of 32 channels each, of which it shows those of one participant, and then, in columns, all.
"""

import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "browser"))

from gui_stage import ARGUMENTS, Stage, chromium_path, environment
from processes import claimed_domain, poll
from sense4hri.chunk import Break, TimedChunk
from tqdm import tqdm
from web_gui.history import History

SECONDS = 10.0
TICKS_PER_S = 100
FILLED_S = 150.0  # at most, until a window is full: on a busy machine 256 channels come late
FULL_S, MEMORY_S = 60.0, 3600.0  # after which the history is full; for so long memory is watched then
LOOK_S, ENDS = 10.0, 60  # memory is looked at so often; so many looks are told as one
FLAT_MB = 5.0
LANE = "globalThis.sense4hri.lanes.lanes.values().next().value"
ALL_FULL = "[...sense4hri.lanes.lanes.values()].every((l) => l.line.newest - l.line.times[l.line.start] > 9000)"
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
    return [*on_the_page(), decimation(), *eight_participants()]


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


def eight_participants() -> list[dict[str, Any]]:
    """Measure 256 channels at 1 kHz over eight participants: the lanes of one in view, then all, then memory."""
    path = chromium_path()
    if path is None:
        return []  # the rows before say so
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, claimed_domain() as domain, sync_playwright() as playwright:
        stage = Stage(Path(folder), environment(domain))
        gui, address = stage.gui(history_s=30.0)
        study = stage.study("--participants", "8", "--cap", "32")
        try:
            browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.goto(address)
            poll(lambda: page.evaluate("() => globalThis.sense4hri?.lanes.lanes.size") == 8, "eight lanes")
            page.keyboard.press("v")  # full lanes: compact ones are all in view
            filled = f"() => ({LANE}?.line.newest - {LANE}?.line.times[{LANE}.line.start]) > 9000"
            poll(lambda: page.evaluate(filled), "a full window", FILLED_S)
            one = watched(page, gui.popen.pid)
            page.keyboard.press("o")
            page.keyboard.press("o")
            page.wait_for_function(f"() => {ALL_FULL}", timeout=1000 * FILLED_S)
            all_ = watched(page, gui.popen.pid)
            time.sleep(max(0.0, FULL_S - (time.time() - gui.started_s)))
            looks_mb = memory_watched(gui.popen.pid)
            browser.close()
        finally:
            study.tell("quit")
            study.stop()
            gui.stop()
    parts_mb = [float(np.median(looks_mb[at : at + ENDS])) for at in range(0, len(looks_mb), ENDS)]
    grown_mb = parts_mb[-1] - parts_mb[0]
    every = ", ".join(f"{part_mb:.1f}" for part_mb in parts_mb)
    memory = f"{grown_mb:+.1f} MB from its first ten minutes to its last; medians of ten minutes {every} MB"
    return [
        load_row("pictures/s, one participant's 32 lanes in view", ">= 30/s", one.pictures_told, one.pictures >= 30),
        load_row("frames/s of those", "", f"{one.frames:.0f}/s of {one.lanes} streams", None),
        load_row("pictures/s, all 256 in view", ">= 10/s", all_.pictures_told, all_.pictures >= 10),
        load_row("frames/s of all", ">= 10/s", f"{all_.frames:.0f}/s of {all_.lanes} streams", all_.frames >= 10),
        load_row("server's CPU, one in view", "<= 25 % of a core", f"{100 * one.server:.0f} %", one.server <= 0.25),
        load_row("server's CPU, all in view", "<= 25 % of a core", f"{100 * all_.server:.0f} %", all_.server <= 0.25),
        load_row(
            f"memory over {MEMORY_S / 60:.0f} min, 30 s kept",
            f"flat (<= {FLAT_MB:g} MB)",
            memory,
            grown_mb <= FLAT_MB,
        ),
    ]


def memory_watched(pid: int) -> list[float]:
    """Resident memory of a process in MB, each LOOK_S for MEMORY_S."""
    looks_mb = []
    for _ in tqdm(range(int(MEMORY_S / LOOK_S)), desc="memory", leave=False):
        looks_mb.append(resident_mb(pid))
        time.sleep(LOOK_S)
    return looks_mb


class Watched(NamedTuple):
    """What one view cost: pictures and frames per s, server's share of a core; lanes: streams that were sent."""

    pictures: float
    slow_ms: float
    frames: float
    server: float
    lanes: int

    @property
    def pictures_told(self) -> str:
        """In words."""
        return f"{self.pictures:.0f}/s, p99 gap {self.slow_ms:.0f} ms"


def watched(page: Any, pid: int) -> Watched:
    """Count for SECONDS."""
    before_s = cpu_s(pid)
    counted = page.evaluate(COUNT, SECONDS)
    took_s = counted["took"] / 1000
    server = (cpu_s(pid) - before_s) / took_s
    lanes = page.evaluate("() => globalThis.sense4hri.lanes.asked.length")
    slow_ms = float(np.percentile(counted["gaps"], 99))
    return Watched(len(counted["gaps"]) / took_s, slow_ms, counted["frames"] / took_s, server, lanes)


def load_row(what: str, target: str, measured: str, ok: bool | None) -> dict[str, Any]:
    """Return one row of the table of eight participants."""
    return {"what": f"web-gui, 8 x 32 channels at 1 kHz: {what}", "target": target, "measured": measured, "ok": ok}


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

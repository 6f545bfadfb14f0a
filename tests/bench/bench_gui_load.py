"""The page under load: what the server costs, how often the browser draws, and whether memory grows in an hour.

Third-party drivers publish over DDS eight streams of 32 channels at 1 kHz. One Chromium shows those of one participant,
and then, in columns, all.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "browser"))

from bench_gui import COUNT, LANE, SECONDS, cpu_s, resident_mb
from gui_browser import ARGUMENTS, chromium_path
from gui_stage import Stage, environment
from processes import claimed_domain, poll
from tqdm import tqdm

FILLED_S = 150.0  # at most, until a window is full: on a busy machine 256 channels come late
FULL_S, MEMORY_S = 60.0, 3600.0  # after which the history is full; for so long memory is watched then
LOOK_S, ENDS = 10.0, 60  # memory is looked at so often; so many looks are told as one
FLAT_MB = 5.0
ALL_FULL = "[...sense4hri.lanes.lanes.values()].every((l) => l.line.newest - l.line.times[l.line.start] > 9000)"


def rows() -> list[dict[str, Any]]:
    """Measure 256 channels at 1 kHz over eight participants: the lanes of one in view, then all, then memory."""
    path = chromium_path()
    if path is None:
        return [load_row("on the page", "smooth", "no Chromium: install the Debian package `chromium`", None)]
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


if __name__ == "__main__":
    print("| what | target | measured | ok |\n|---|---|---|---|")
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |")

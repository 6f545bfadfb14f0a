"""Each driver in its own study (compose/studies/<name>.yaml): its CPU, its device switched off and on again."""

import json
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from bench_nine_modalities import Study
from bench_scaling import cpu_s

from devices.played import row

CPU_PERCENT, BACK_S = 2.0, 5.0
SETTLE_S, MEASURE_S, AWAY_S, LONGEST_BACK_S = 10.0, 20.0, 3.0, 60.0
STREAMING = 2.0
"""Of the metric `state`."""


def live_rows(name: str) -> list[dict[str, Any]]:
    """CPU of a driver in its own study, and how soon it streams again once its device is back."""
    with tempfile.TemporaryDirectory() as folder:
        study = Study(Path(folder), name)
        try:
            drivers = [each for each in study.study.sensors if each.sensor_id]
            for driver in drivers:
                if _until_more(study.port(driver.name), 0) == float("inf"):
                    raise RuntimeError(f"{driver.name} has never streamed")
            time.sleep(SETTLE_S)
            first = {each.name: cpu_s(study.children[each.name].pid) for each in drivers}
            time.sleep(MEASURE_S)
            used = {
                each.sensor_id: 100 * (cpu_s(study.children[each.name].pid) - first[each.name]) / MEASURE_S
                for each in drivers
            }
            back = [back_s(study, each.name, each.sensor_id) for each in drivers if study.study.of("sensor_bench")]
        finally:
            study.end()
    what, listed = f"driver-{name} in its study", ", ".join(f"{each} {used[each]:.1f} %" for each in used)
    enough = max(used.values()) <= CPU_PERCENT
    rows = [row(f"{what}: CPU per device", f"<= {CPU_PERCENT:g} % of a core", listed, enough)]
    if back:
        rows.append(row(f"{what}: streams again", f"<= {BACK_S:g} s", f"{max(back):.1f} s", max(back) <= BACK_S))
    return rows


def back_s(study: Study, driver: str, sensor: str) -> float:
    """Switch a device off and on again; return the seconds until its driver has new samples, inf without any."""
    bench, port = study.port(study.study.of("sensor_bench").name), study.port(driver)
    _knob(bench, sensor, down=True)
    time.sleep(AWAY_S)
    before = _samples(port)
    _knob(bench, sensor, down=False)
    return _until_more(port, before)


def _until_more(port: int, before: float) -> float:
    begun_s = time.monotonic()
    while not _samples(port) > before:
        if time.monotonic() - begun_s > LONGEST_BACK_S:
            return float("inf")
        time.sleep(0.05)
    return time.monotonic() - begun_s


def _samples(port: int) -> float:
    """Return how many samples a driver has published; of one that only reports, 1 while it streams."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=20) as answer:
        lines = answer.read().decode().splitlines()
    values = {name: [float(line.rpartition(" ")[2]) for line in lines if line.startswith(f"sense4hri_{name}{{")]
              for name in ("samples_total", "state")}  # fmt: skip
    return sum(values["samples_total"]) or float(STREAMING in values["state"])


def _knob(port: int, sensor: str, **knobs: Any) -> None:
    body, headers = json.dumps(knobs).encode(), {"Content-Type": "application/json"}
    request = urllib.request.Request(f"http://127.0.0.1:{port}/devices/{sensor}/knobs", body, headers)
    urllib.request.urlopen(request, timeout=20).close()


def studies() -> list[str]:
    """Names of the studies that play one driver's devices; of driver-polar it is the demo."""
    root = Path(__file__).resolve().parents[3]
    drivers = sorted(path.name.removeprefix("driver-") for path in (root / "services").glob("driver-*"))
    return [name for name in drivers if name != "polar" and (root / "compose" / "studies" / f"{name}.yaml").is_file()]

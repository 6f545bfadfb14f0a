"""The demo study in containers: time to the first feature and to a changed service, memory, CPU, size of the base."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS), str(TESTS / "containers"), str(TESTS.parent / "compose")]

import study_file  # noqa: E402
from docker_study import DOCKER, ROOT, Study, cpu_s, docker, resident_mb  # noqa: E402
from processes import wait_for  # noqa: E402

MEASURE_S = 20.0
FIRST_FEATURE_TARGET_S = 30.0
BASE_TARGET_MB = 300.0
SENSORS = [service.name for service in study_file.read(study_file.find("demo")).sensors]
SENSOR_BENCH = "sensor-bench"
CHANGED = "fusion-affect"


def changed_s(study: Study) -> float:
    """Seconds from one more line in a running service's source to its new container, built and healthy."""
    images = Path("compose", "images.sh")
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder)
        subprocess.run(["git", "clone", "--quiet", str(ROOT), folder], check=True)
        with (clone / "services" / CHANGED / "src" / CHANGED.replace("-", "_") / "__main__.py").open("a") as source:
            source.write("# one more line\n")
        before, begun = study.container(CHANGED), time.monotonic()
        try:
            subprocess.run([clone / images, CHANGED], check=True, stdout=subprocess.DEVNULL)
            study.up(CHANGED)
            wait_for(lambda: study.container(CHANGED) != before and study.healthy(CHANGED), 120, f"{CHANGED} is back")
            return time.monotonic() - begun
        finally:
            subprocess.run([ROOT / images, CHANGED], check=True, stdout=subprocess.DEVNULL)


def image_mb(image: str) -> float:
    """Size of an image, MB."""
    return json.loads(docker("image", "inspect", image))[0]["Size"] / 1e6


def usage(study: Study, services: list[str]) -> dict[str, tuple[float, float]]:
    """Resident MB and per cent of a core of each service, over MEASURE_S."""
    pids = {service: study.processes(service) for service in services}
    begun, before = time.monotonic(), {service: sum(map(cpu_s, pids[service])) for service in services}
    time.sleep(MEASURE_S)
    lasted_s = time.monotonic() - begun
    return {
        service: (
            sum(map(resident_mb, pids[service])),
            100 * (sum(map(cpu_s, pids[service])) - before[service]) / lasted_s,
        )
        for service in services
    }


def figures(used: dict[str, tuple[float, float]]) -> str:
    """A line per service would be too long for the table: names with MB and per cent."""
    return "; ".join(f"{name} {mb:.0f} MB {cpu:.1f} %" for name, (mb, cpu) in sorted(used.items()))


def row(what: str, target: str, measured: str, ok: bool | None) -> dict:
    return {"what": what, "target": target, "measured": measured, "ok": ok}


def rows() -> list[dict]:
    """Bring the study up, measure, take it down."""
    if subprocess.run([DOCKER, "version"], capture_output=True, check=False).returncode != 0:
        return [row("demo study in containers", "", "not run: no Docker Engine answers", None)]
    above_mb = image_mb("sense4hri/base") - image_mb("debian:bookworm-slim")
    results = [row("base image above Debian", "<= 300 MB", f"{above_mb:.0f} MB", above_mb <= BASE_TARGET_MB)]
    study = Study("demo")
    try:
        study.start()
        features = lambda: [name for name in study.first_s if name.endswith("/features")]  # noqa: E731
        wait_for(lambda: len(features()) == len(SENSORS), 120, "features of all sensors")
        first_s = min(study.first_s[name] for name in features()) - study.started_s
        all_s = max(study.first_s[name] for name in features()) - study.started_s
        results.append(
            row("first feature after `up`", "<= 30 s", f"{first_s:.1f} s", first_s <= FIRST_FEATURE_TARGET_S)
        )
        results.append(row("features of all four sensors after `up`", "reported", f"{all_s:.1f} s", None))
        services = study.services()
        used = usage(study, services)
        total_mb, total_cpu = (sum(values) for values in zip(*used.values(), strict=True))
        results.append(
            row("all containers, four sensors streaming", "reported", f"{total_mb:.0f} MB {total_cpu:.0f} %", None)
        )
        results.append(row("each of them", "reported", figures(used), None))
        changed = f"{changed_s(study):.1f} s"
        results.append(row("one line changed in a service: built, started, healthy", "seconds", changed, None))
        study.compose("stop", *SENSORS, SENSOR_BENCH)
        idle = usage(study, [name for name in services if name not in (*SENSORS, SENSOR_BENCH)])
        ours = {name: values for name, values in idle.items() if name != "prometheus"}
        total_mb, total_cpu = (sum(values) for values in zip(*idle.values(), strict=True))
        results.append(row("the rest, idle (no sensor)", "reported", f"{total_mb:.0f} MB {total_cpu:.1f} %", None))
        results.append(
            row("idle service in a container", "< 1 %", figures(ours), max(cpu for _, cpu in ours.values()) < 1.0)
        )
    finally:
        study.remove()
    return results


if __name__ == "__main__":
    print("| what | target | measured |\n|---|---|---|")
    for found in rows():
        print(f"| {found['what']} | {found['target']} | {found['measured']} |")

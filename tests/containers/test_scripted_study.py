"""The study to which everything happens, in Docker."""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import scripted_study
from docker_study import Study, on_clock
from processes import wait_for
from scripted_study import LATE

LEFT_OUT = {LATE, "verity_2", "prometheus", "web_gui"}


class ContainerLab:
    """The demo study whose containers share one wall clock; what is not played with is left out."""

    def __init__(self, folder: Path) -> None:
        services = [service for service in Study("demo").services() if service != "prometheus"]
        self.clock, override = on_clock(folder, services)
        self.study = Study("demo", override)
        self.study.start(*(service for service in services if service.replace("-", "_") not in LEFT_OUT))

    def session(self, *arguments: str) -> subprocess.Popen[str]:
        return self.study.begin("session-coordinator", "sense4hri-session", *arguments)

    def start(self, sensor: str) -> None:
        self.study.up(_service(sensor))

    def kill(self, service: str) -> None:
        self.study.kill(_service(service))

    def knobs(self, sensor: str, **values: Any) -> None:
        self.study.knobs(sensor, **values)

    def samples(self, topic: str) -> int:
        return self.study.count(topic)

    def parts(self) -> int:
        looking = self.study.begin("recorder", "find", "/recordings", "-path", "*bad_day*", "-name", "recorder.json")
        return len(looking.communicate(timeout=120)[0].splitlines())

    def until_reported(self, session_id: str) -> None:
        """Wait for the reports of both folders."""

        def made() -> bool:
            looking = self.study.begin(
                "recorder", "find", "/recordings", "-path", f"*{session_id}*", "-name", "report.html"
            )
            return len(looking.communicate(timeout=120)[0].splitlines()) == 2

        wait_for(made, 180, "the report of both folders")


def _service(name: str) -> str:
    return name.replace("_", "-")


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[ContainerLab]:
    tmp_path.chmod(0o755)
    lab = ContainerLab(tmp_path / "wall_clock")
    try:
        yield lab
    finally:
        lab.study.remove()


@pytest.mark.timeout(1200)
def test_the_report_says_what_was_done(lab, tmp_path):
    """Killed containers, a cut link and a stepped clock stand in the reports, nothing else does; the export opens."""
    story = scripted_study.play(lab)
    lab.until_reported(story.session_id)
    lab.study.stop()
    lab.study.copy_volume("recordings", tmp_path / "recordings")
    scripted_study.check(tmp_path / "recordings", story, tmp_path / "exports")

"""What `make k8s` writes, against the committed files and against what was measured."""

import re
from pathlib import Path

import pytest
import render_study
import workloads
from study_file import StudyError

ROOT = Path(__file__).resolve().parents[3]
HEAD = "x-study: {name: trial}\nservices:\n"


@pytest.mark.parametrize("study", ["demo", "polar"])
def test_the_committed_files_are_those_of_the_study_file(study):
    """`make k8s` would change no committed file, add none and remove none."""
    folder = ROOT / "k8s" / study
    committed = {
        str(path.relative_to(folder)): path.read_text()
        for part in render_study.FOLDERS
        for path in (folder / part).iterdir()
    }
    assert committed == render_study.texts(study)


def mebibytes(text: str) -> float:
    return float(text.removesuffix("Mi"))


def test_requests_are_above_what_was_measured_and_limits_far_above():
    """A service asks for the memory and CPU that docs/benchmarks.md says of its container; limits are twice that."""
    rows = (ROOT / "docs" / "benchmarks.md").read_text().splitlines()
    (row,) = (row for row in rows if row.startswith("| containers | each of them |"))
    measured = re.findall(r"([\w-]+) (\d+) MB ([\d.]+) %", row)
    assert len(measured) > 10
    for name, megabytes, percent in measured:
        memory, cpu = workloads.MEASURED.get(name, workloads.MEASURED["default"])
        assert mebibytes(memory) * 1.048576 >= float(megabytes), name
        assert float(cpu.removesuffix("m")) >= 10 * float(percent), name
        assert mebibytes(workloads.LIMITS["memory"]) >= 2 * float(megabytes), name


@pytest.mark.parametrize(
    ("service", "sentence"),
    [
        ("{image: x, devices: [/dev/ttyUSB0]}", "services.belt.devices: a device of this machine reaches no pod"),
        ("{image: x, volumes: [./driver:/driver:ro]}", "driver is of this machine; a pod has none of it"),
    ],
)
def test_what_no_cluster_can_run_is_refused(tmp_path, service, sentence):
    """A device and a folder of this machine are refused in a sentence that names the service and the key."""
    file = tmp_path / "study.yaml"
    file.write_text(f"{HEAD}  belt: {service}\n")
    with pytest.raises(StudyError, match=re.escape(sentence)):
        render_study.texts(str(file))

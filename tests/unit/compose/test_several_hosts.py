"""One study file, several machines: what each runs, and with what."""

import re
import subprocess
from pathlib import Path

import pytest
import several_hosts
import study_file
from study_file import StudyError

HOSTS = "  hosts: {lab-a: 10.0.0.1, lab-b: 10.0.0.2, lab-c: box.local}\n"
STUDY = f"""
x-study:
  name: trial
{HOSTS}
services:
  strap: {{command: python -m driver_x --ros-args -p sensor_id:=x_1, x-host: lab-b}}
  recorder: {{command: python -m recorder}}
  clock-sync: {{command: python -m clock_sync, environment: {{ROS_DOMAIN_ID: 7}}}}
  page:
    image: page
    x-host: lab-c
    ports: ["80:80"]
    command: python -m web_gui --ros-args -p host:=0.0.0.0 -p "title:=a$$b"
    x-process: -p host:=127.0.0.1
    environment: {{ROS_DOMAIN_ID: 7}}
  hint: {{image: prometheus, x-host: lab-c}}
"""


def study(folder, text=STUDY):
    (folder / "study.yaml").write_text(text)
    return study_file.read(folder / "study.yaml", {})


def names(part):
    return [service.name for service in part.services]


def test_every_machine_runs_its_part_and_a_clock_sync(tmp_path):
    """What names no machine runs on the first; nothing runs twice but clock-sync, and nothing is left out."""
    parts = {host: names(several_hosts.part(study(tmp_path), host)) for host in ("lab-a", "lab-b", "lab-c")}
    assert parts == {
        "lab-a": ["recorder", "clock-sync"],
        "lab-b": ["strap", "clock-sync"],
        "lab-c": ["clock-sync", "page", "hint"],
    }


def test_everybody_knows_its_machine_the_others_and_the_reference(tmp_path):
    """Names and peers come in the environment; the reference is the recorder's machine."""
    part = several_hosts.part(study(tmp_path), "lab-b")
    for service in part.services:
        assert service.environment["SENSE4HRI_HOST"] == "lab-b"
        assert service.environment["ROS_STATIC_PEERS"] == "10.0.0.1;box.local"
    assert part.services[1].command[-2:] == ("-p", "reference_host:=lab-a")
    assert part.services[0].command[-2:] == ("-p", "sensor_id:=x_1")


def test_a_study_on_one_machine_is_as_before(tmp_path):
    """Nothing is added to it, and there is no machine to be chosen."""
    text = re.sub(r"(, |\n    )x-host: lab-.", "", STUDY.replace(HOSTS, ""))
    plain = study(tmp_path, text)
    assert several_hosts.part(plain, "") is plain
    with pytest.raises(StudyError, match="HOST=lab-a is none of its machines"):
        several_hosts.part(plain, "lab-a")


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("x-host: lab-b", "x-host: lab-d", "services.strap.x-host: 'lab-d' is no machine of the study"),
        ("lab-a: 10.0.0.1", "lab-a: 7", "x-study.hosts: is"),
        ("x-host: lab-b", "x-host: 7", "x-host: is 7, must be a text"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, before, after, told):
    """File, key and what is allowed."""
    with pytest.raises(StudyError, match=told):
        study(tmp_path, STUDY.replace(before, after))


@pytest.mark.parametrize("host", ["", "lab-d"])
def test_a_study_on_several_machines_is_started_on_one_of_them(tmp_path, host):
    """Without HOST, or with another's name, nothing starts."""
    with pytest.raises(StudyError, match="lab-a, lab-b, lab-c"):
        several_hosts.part(study(tmp_path), host)


def test_containers_of_a_machine_are_not_begun_without_what_knows_its_part() -> None:
    """`make up HOST=`: what works the part out, and refuses another machine's name, is made before the images."""
    command = ["make", "-n", "up", "HOST=lab-d"]
    told = subprocess.run(command, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=True).stdout
    asked = ["--compose --host 'lab-d'", "host_override.py"]
    words = ["environment.py", "images.sh", "check_study.py", *asked, "up --detach"]
    assert [told.find(word) for word in words] == sorted(told.find(word) for word in words)
    assert "environment.py" in told

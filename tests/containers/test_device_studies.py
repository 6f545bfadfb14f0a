"""Drivers and interpreters that are not in the demo, in containers: from a device's wire to features and a recording.

As processes each of them is judged by tests/graph/test_device_studies.py; here it is seen that images, volumes, sockets
and the study's network let them through.
"""

from pathlib import Path

import pytest
import study_file
from docker_study import Study
from processes import poll
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from sense4hri.names import StreamName

pytestmark = pytest.mark.timeout(1200)
STUDIES = {"every driver": str(Path(__file__).with_name("device_lab.yaml")), "every modality": "nine-modalities"}
UNNECESSARY = ("analysis", "fusion-affect", "metadata-registry", "session-coordinator", "web-gui")
"""For a recording with features; the demo has them."""
BENCH = "sensor-bench"
SECONDS = 3
"""How much of everything must have come: most of it comes once a second or faster."""


def awaited(about: study_file.Study) -> set[str]:
    """The required streams, and their features where the study has an interpreter of them."""
    raw = {topic: StreamName.parse(topic)[0] for topic in about.required_streams}
    computed = {topic for topic, stream in raw.items() if f"interpreter_{stream.sensor_type}" in about.packages}
    return {*raw, *(raw[topic].topic("features") for topic in computed)}


@pytest.mark.parametrize("name", STUDIES.values(), ids=STUDIES)
def test_devices_in_containers(name, tmp_path):
    """Every driver streams, every interpreter of the study computes, and all of it is recorded."""
    about, study = study_file.read(study_file.find(name)), Study(name)
    wanted = awaited(about)
    services = [service for service in study.services() if service not in UNNECESSARY]
    sensors = {sensor.sensor_id for sensor in about.sensors}

    def missing() -> list[str]:
        came = {topic for topic in study.seen if study.count(topic) >= SECONDS}
        silent = sensors - {topic.split("/")[5] for topic in came if topic.endswith(("/raw", "/device"))}
        return sorted(wanted - came) + sorted(silent)

    try:
        if BENCH in services:  # devices are there before anybody looks for them
            study.up(BENCH)
            poll(lambda: study.healthy(BENCH), "the bench is ready", 60, 0.2)
        study.start(*services)
        poll(lambda: study.seen and not missing(), lambda: f"nothing came yet of {missing()}", 120, 0.2)
        last = max(study.first_s, key=lambda topic: study.first_s[topic])
        print(f"all {study.first_s[last] - study.started_s:.0f} s after up, the last one {last}")
        study.compose("stop", "recorder")
        study.copy_volume("recordings", tmp_path / "recordings")
    finally:
        study.remove()
    (bag,) = {path.parent for path in (tmp_path / "recordings").rglob("metadata.yaml")}
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        recorded = {connection.topic: connection.msgcount for connection in reader.connections}
    assert sorted(topic for topic in wanted if recorded.get(topic, 0) < SECONDS) == []

"""The demo study in Docker: up, watched from inside its network, hurt, taken down. The tests build on each other."""

import json
import os
import signal
import urllib.parse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import asked
import pytest
import study_file
from docker_study import ROOT, Study, docker, get, post, watched
from processes import poll, wait_for
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from sense4hri.chunk import Chunk
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import StreamHealth

pytestmark = pytest.mark.timeout(1200)
DEMO = study_file.read(study_file.find("demo"))
SENSORS = [service.sensor_id for service in DEMO.sensors]
UNTOUCHED = "h10_2"
WATCHING = {"prometheus": 9090, "alertmanager": 9093}


def topic(sensor: str, field: str) -> str:
    """A field of the sensor's first required stream, the one that has features."""
    raw = next(name for name in DEMO.required_streams if f"/{sensor}/" in name)
    return f"{raw.rpartition('/')[0]}/{field}"


@pytest.fixture(scope="module")
def study() -> Iterator[Study]:
    study = Study("demo", profiles="alertmanager")
    try:
        study.start()
        yield study
    finally:
        study.remove()


def flowing_after(study: Study, name: str, stamp_s: float) -> bool:
    return study.newest_s(name) > stamp_s


def test_features_and_states_arrive_for_both_participants(study):
    """Soon after `up`, features of all four sensors, their clocks and both participants' states are on DDS."""
    wanted = [topic(sensor, field) for sensor in SENSORS for field in ("raw", "features", "clock", "health")]
    wanted += [f"/humans/physiological/{human_id}/state" for human_id in DEMO.participants]
    wait_for(lambda: all(study.count(name) for name in wanted), 120, f"{wanted} seen")
    first_s = min(study.first_s[topic(sensor, "features")] for sensor in SENSORS) - study.started_s
    print(f"first feature {first_s:.1f} s after up")  # `make bench` has the target


def test_every_container_is_healthy_and_confined(study):
    """Non-root, read-only, no capabilities, no new privileges, init, bounded in all they use, on loopback only."""
    for service in study.services():
        wait_for(lambda s=service: study.healthy(s), 60, f"{service} healthy")
        found = study.inspect(service)
        host = found["HostConfig"]
        assert found["Config"]["User"] not in ("", "0", "root"), service
        assert host["ReadonlyRootfs"], service
        assert host["Init"], service
        assert host["CapDrop"] == ["ALL"], service
        assert host["CapAdd"] is None, service
        assert "no-new-privileges:true" in host["SecurityOpt"], service
        assert host["RestartPolicy"]["Name"] == "unless-stopped", service  # also after a reboot of the machine
        assert 0 < host["Memory"] <= 2**30, service
        assert 0 < host["PidsLimit"] <= 512, service
        assert host["Tmpfs"]["/tmp"].startswith("size="), service
        bindings = [binding for port in (host["PortBindings"] or {}).values() for binding in port]
        assert all(binding["HostIp"] == "127.0.0.1" for binding in bindings), service


def test_page_and_prometheus_answer_on_this_machine(study):
    """The page is served, and Prometheus scrapes every service without a list of them."""
    assert get(study.published("web-gui", 8080))[0] == 200
    others = set(study.services()) - set(WATCHING)
    wait_for(
        lambda: len(query(study, 'up{job="sense4hri"} == 1')) == len(others), 60, f"{len(others)} services scraped"
    )


def test_the_rules_pass_their_own_tests(study):
    """In the image's own promtool."""
    folder = ROOT / "compose" / "prometheus"
    tool = ("run", "--rm", "--network", "none", "-v", f"{folder}:/rules:ro", "--entrypoint", "promtool")
    docker(*tool, "sense4hri/prometheus", "test", "rules", "/rules/rules_test.yml")


def test_every_rule_panel_and_choice_has_data(study):
    """Every question of a study on one host finds something in the study's Prometheus; test_two_networks asks the rest.

    Nobody has looked at the dashboards in Grafana.
    """
    queries = [each for each in asked.everything(UNTOUCHED, "ecg") if asked.OF_SEVERAL_HOSTS not in each]
    poll(
        lambda: not asked.unanswered(queries, lambda each: query(study, each)),
        lambda: f"nothing for {asked.unanswered(queries, lambda each: query(study, each))}",
        90,
        0.3,
    )
    for path, one in zip(asked.of_choices(UNTOUCHED), (UNTOUCHED, "ecg"), strict=True):
        assert one in json.loads(shown(study, "prometheus", path))["data"]


def shown(study: Study, service: str, path: str) -> bytes:
    """What Prometheus or Alertmanager answers to who may view."""
    return watched(study.published(service, WATCHING[service]) + path, study.tokens["view"])[1]


def query(study: Study, expression: str) -> list[dict[str, Any]]:
    """What the study's Prometheus answers."""
    words = urllib.parse.urlencode({"query": expression})
    return json.loads(shown(study, "prometheus", f"/api/v1/query?{words}"))["data"]["result"]


def fires(study: Study, alert: str, sensor_id: str) -> bool:
    """True while an alert about a sensor fires."""
    return bool(query(study, f'ALERTS{{alertname="{alert}", sensor_id="{sensor_id}", alertstate="firing"}}'))


def arrives(study: Study, alert: str, sensor_id: str) -> bool:
    """True while Alertmanager has an alert about a sensor."""
    found = [one["labels"] for one in json.loads(shown(study, "alertmanager", "/api/v2/alerts"))]
    return any((one["alertname"], one.get("sensor_id")) == (alert, sensor_id) for one in found)


def test_an_outsider_neither_reads_nor_steers(study):
    """A container listens on all its addresses: without a token of the study it refuses; the view token reads alone."""
    for service, path in (("metadata-registry", "/participants"), ("session-coordinator", "/session")):
        address = study.published(service, 9464) + path
        assert [get(address, token)[0] for token in ("", "another", study.tokens["view"])] == [401, 401, 200]
    for service, path in (("prometheus", "/api/v1/query?query=up"), ("alertmanager", "/api/v2/silences")):
        address = study.published(service, WATCHING[service]) + path
        assert [watched(address, token)[0] for token in ("", "another", study.tokens["view"])] == [401, 401, 200]
    assert post(f"{study.published('session-coordinator', 9464)}/markers", {"name": "x"}, study.tokens["view"]) == 403


def test_no_token_is_in_what_docker_shows_or_in_a_log(study):
    """Neither an environment, a command, a label, nor a line of any service's log holds a token."""
    shown = study.compose("logs") + "".join(json.dumps(study.inspect(service)) for service in study.services())
    assert not any(token in shown for token in study.tokens.values())


def test_only_the_token_changes_anything(study):
    """A container listens on all its addresses: without the study's token it refuses unread."""
    assign = f"{study.published('metadata-registry', 9464)}/assign"
    wish = {"sensor_id": "nobody", "human_id": "p1"}
    assert post(assign, wish) == 401
    assert post(assign, wish, "another") == 401
    assert post(assign, wish, study.tokens["operate"]) == 400


def test_killed_driver_comes_back(study):
    """A driver killed with SIGKILL is restarted and its features flow again, the other sensor's never stopped."""
    before = study.inspect("h10-1")["RestartCount"]
    for pid in study.processes("h10-1"):
        os.kill(pid, signal.SIGKILL)
    wait_for(lambda: study.inspect("h10-1")["RestartCount"] > before, 60, "driver restarted")
    back_s = study.newest_s(topic("h10_1", "raw")) + 2
    wait_for(lambda: flowing_after(study, topic("h10_1", "features"), back_s), 60, "features of h10_1 again")
    wait_for(lambda: flowing_after(study, topic(UNTOUCHED, "features"), back_s - 2), 60, f"{UNTOUCHED} went on")


def test_stopped_service_is_ended_and_comes_back(study):
    """A process that takes connections and answers none is ended by its health check, and works again after that."""
    stopped = "interpreter-ppg"
    before = study.inspect(stopped)["RestartCount"]
    for pid in study.processes(stopped):
        os.kill(pid, signal.SIGSTOP)
    wait_for(lambda: study.inspect(stopped)["RestartCount"] > before, 120, f"{stopped} restarted")
    back_s = study.newest_s(topic("verity_1", "raw")) + 2
    wait_for(lambda: flowing_after(study, topic("verity_1", "features"), back_s), 60, "features of verity_1 again")


def others(study: Study, seconds: float) -> None:
    """Wait until another sensor has gone on for so long."""
    until_s = study.newest_s(topic("verity_2", "raw")) + seconds
    wait_for(lambda: flowing_after(study, topic("verity_2", "raw"), until_s), 60, "verity_2 undisturbed")


def test_cut_link_heals(study):
    """While a sensor is out of reach its health says so and an alert fires; its signal comes back by itself."""
    study.knobs("verity_1", down=True)
    gone = (StreamHealth.LOST, StreamHealth.CONNECTING)
    health = topic("verity_1", "health")
    wait_for(lambda: study.seen[health].get("state") in gone, 60, "health LOST")
    others(study, 2.0)  # what was on its way is there
    lost_s = study.newest_s(topic("verity_1", "raw"))
    wait_for(lambda: fires(study, "StreamSilent", "verity_1"), 90, "the alert")
    wait_for(lambda: arrives(study, "StreamSilent", "verity_1"), 60, "the alert at Alertmanager")
    others(study, 3.0)
    assert study.newest_s(topic("verity_1", "raw")) == lost_s
    study.knobs("verity_1", down=False)
    wait_for(lambda: flowing_after(study, topic("verity_1", "features"), lost_s + 3), 60, "features of verity_1 again")
    wait_for(lambda: not fires(study, "StreamSilent", "verity_1"), 90, "the alert's end")
    assert not fires(study, "StreamSilent", "verity_2")
    assert study.inspect("verity-1")["RestartCount"] == 0


def test_wrong_configuration_does_not_loop_for_ever(study):
    """A service whose configuration is wrong says so in one line and ends with 78; the study lives on."""
    command = ("run", "--rm", "--no-deps", "-T", "clock-sync", "python", "-m", "clock_sync")
    with pytest.raises(AssertionError, match="publish_interval_s"):
        study.compose(*command, "--ros-args", "-p", "publish_interval_s:=7.0")


def test_down_loses_nothing(study, tmp_path):
    """After `down` the recording is readable, reaches to the end, and the untouched strap's ECG has no hole."""
    last_s = study.newest_s(topic(UNTOUCHED, "raw"))
    study.stop()
    study.copy_volume("recordings", tmp_path / "recordings")
    bags = sorted(path.parent for path in (tmp_path / "recordings").rglob("metadata.yaml"))
    assert len(bags) == 1
    clock = SampleClock(130.0)
    newest_s = 0.0
    with AnyReader([Path(bags[0])], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        recorded = {connection.topic for connection in reader.connections}
        assert {topic(sensor, field) for sensor in SENSORS for field in ("raw", "features", "clock")} <= recorded
        chosen = [connection for connection in reader.connections if connection.topic == topic(UNTOUCHED, "raw")]
        for connection, _, data in reader.messages(connections=chosen):
            message = reader.deserialize(data, connection.msgtype)
            samples = message.channels[0].samples.reshape(-1, 1)
            clock.place(Chunk(("ecg",), samples, to_ns(message.device_timestamp), to_ns(message.header.stamp)))
            newest_s = max(newest_s, to_ns(message.header.stamp) * 1e-9)
    assert (clock.gaps_total, clock.lost_samples_total, clock.resets_total) == (0, 0, 0)
    assert newest_s >= last_s - 1e-6  # stamps in s as floats

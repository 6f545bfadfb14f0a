"""What Compose runs of a study on one of its several machines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import host_override
import pytest
import study_file
import yaml
from study_file import Study, StudyError

STUDY = """
x-study:
  name: trial
  hosts: {lab-a: 10.0.0.1, lab-b: 10.0.0.2, lab-c: box.local}
x-graph: &graph {ROS_DOMAIN_ID: 7}
services:
  strap: {command: python -m driver_x --ros-args -p sensor_id:=x_1, x-host: lab-b, environment: *graph}
  recorder: {command: python -m recorder, environment: *graph}
  clock-sync: {command: python -m clock_sync, environment: *graph}
  page:
    image: page
    x-host: lab-c
    ports: ["80:80"]
    command: python -m web_gui --ros-args -p host:=0.0.0.0 -p "title:=a$$b"
    x-process: -p host:=127.0.0.1 -p port:=8090
    environment: *graph
  prometheus: {image: sense4hri/prometheus, x-host: lab-c}
  alertmanager: {image: sense4hri/alertmanager, x-host: lab-c, profiles: [alertmanager]}
  grafana: {image: "grafana/grafana:11.6.0", x-host: lab-c, profiles: [grafana]}
  radio: {image: bluetooth, x-host: lab-c}
"""


class Loader(yaml.SafeLoader):
    """Reads what Compose alone knows, as the word."""


Loader.add_constructor("!reset", lambda loader, node: "reset")


def study(folder: Path, text: str = STUDY) -> Study:
    (folder / "study.yaml").write_text(text)
    return study_file.read(folder / "study.yaml", {})


def services_of(folder: Path, host: str, tls: bool = False) -> dict[str, Any]:
    file = host_override.write(study(folder), host, folder, tls)
    services: dict[str, Any] = yaml.load(file.read_text(), Loader)["services"]
    return services


def test_the_compose_file_of_a_machine_has_its_part_alone(tmp_path: Path) -> None:
    """The others are taken out, and its own are on the machine's network, where the other machines reach them."""
    services = services_of(tmp_path, "lab-c")
    assert {name for name, keys in services.items() if keys == "reset"} == {"strap", "recorder"}
    assert services["page"]["network_mode"] == "host"
    assert services["page"]["ports"] == services["page"]["networks"] == "reset"
    assert services["clock-sync"]["environment"]["ROS_STATIC_PEERS"] == "10.0.0.1;10.0.0.2"
    assert services["clock-sync"]["command"][-1] == "reference_host:=lab-a"
    assert "radio" not in services
    elsewhere = services_of(tmp_path, "lab-b")
    asked = ("page", "recorder", "prometheus", "alertmanager", "grafana")
    assert {name: elsewhere[name] for name in asked} == dict.fromkeys(asked, "reset")


def test_every_node_answers_at_its_machine_on_a_port_of_its_own_and_the_page_on_loopback(tmp_path: Path) -> None:
    """The image's METRICS_HOST would open it on every network of the machine, its METRICS_PORT is free once."""
    services = services_of(tmp_path, "lab-c")
    own = [services[name]["environment"] for name in ("clock-sync", "page")]
    assert {each["METRICS_HOST"] for each in own} == {"box.local"}
    assert len({each["METRICS_PORT"] for each in own}) == 2
    assert services["page"]["command"][-4:-2] == ["-p", "host:=127.0.0.1"]
    assert "title:=a$$b" in services["page"]["command"]


def test_prometheus_asks_every_node_of_all_machines_where_it_answers(tmp_path: Path) -> None:
    """What is scraped, by machine, is what its own file says, no more and no less; clock-sync on each of them."""
    answering = {host: _answering(tmp_path, host.replace("_", "-")) for host in ("lab_a", "lab_b", "lab_c")}
    file, target, _ = services_of(tmp_path, "lab-c")["prometheus"]["volumes"][0].split(":")
    scraping = yaml.safe_load(Path(file).read_text())
    jobs = {job["job_name"]: job for job in scraping["scrape_configs"]}
    configs = jobs["sense4hri"]["static_configs"]
    assert {config["labels"]["host"]: set(config["targets"]) for config in configs} == answering
    assert sum(map(len, answering.values())) == 6
    known = {"username": "study", "password_file": "/run/secrets/view"}
    at = [{"targets": ["127.0.0.1:9093"]}]
    assert scraping["alerting"]["alertmanagers"] == [{"basic_auth": known, "static_configs": at}]
    assert jobs["prometheus"] == {
        "job_name": "prometheus",
        "basic_auth": known,
        "static_configs": [{"targets": ["localhost:9090"]}],
    }
    assert "dns_sd" not in json.dumps(scraping)
    assert target == "/etc/prometheus/prometheus.yml"


def _answering(folder: Path, host: str) -> set[str]:
    environments = [keys["environment"] for keys in services_of(folder, host).values() if keys != "reset"]
    return {f"{each['METRICS_HOST']}:{each['METRICS_PORT']}" for each in environments if "METRICS_PORT" in each}


def test_what_shows_is_on_loopback(tmp_path: Path) -> None:
    """Prometheus, Alertmanager and Grafana are on the machine's network, where nobody else reaches them."""
    services = services_of(tmp_path, "lab-c")
    listens = {
        "prometheus": "PROMETHEUS_LISTEN",
        "alertmanager": "ALERTMANAGER_LISTEN",
        "grafana": "GF_SERVER_HTTP_ADDR",
    }
    for name, variable in listens.items():
        assert services[name]["network_mode"] == "host"
        assert services[name]["environment"][variable].startswith("127.0.0.1")


def test_https_goes_before_the_page_where_it_runs(tmp_path: Path) -> None:
    """There by its loopback; on another machine it is refused, with the machine that has the page."""
    assert services_of(tmp_path, "lab-c", tls=True)["tls"]["environment"]["PAGE"] == "127.0.0.1:8090"
    assert "tls" not in services_of(tmp_path, "lab-c")
    with pytest.raises(StudyError, match="goes before the page, which runs on lab-c, not on lab-a"):
        host_override.write(study(tmp_path), "lab-a", tmp_path, tls=True)


def test_a_machine_that_is_none_of_the_study_has_no_part(tmp_path: Path) -> None:
    """The sentence names those it has."""
    with pytest.raises(StudyError, match="HOST=lab-d is none of its machines; it names lab-a, lab-b, lab-c"):
        host_override.write(study(tmp_path), "lab-d", tmp_path)


def test_what_works_together_on_loopback_is_on_one_machine(tmp_path: Path) -> None:
    """Prometheus on one, Grafana on another would see nothing: refused, with what is where."""
    text = STUDY.replace('"grafana/grafana:11.6.0", x-host: lab-c', '"grafana/grafana:11.6.0", x-host: lab-a')
    with pytest.raises(StudyError, match="prometheus on lab-c, alertmanager on lab-c, grafana on lab-a"):
        host_override.write(study(tmp_path, text), "lab-c", tmp_path)


def test_a_folder_that_takes_no_file_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sentence, as of all else that keeps a machine's part from being started."""
    (tmp_path / "build").touch()
    (tmp_path / "study.yaml").write_text(STUDY)
    words = ["--study", f"{tmp_path}/study.yaml", "--host", "lab-a", "--folder", f"{tmp_path}/build"]
    monkeypatch.setattr("sys.argv", ["host_override.py", *words])
    assert host_override.main() == host_override.WRONG
    assert capsys.readouterr().err == f"{tmp_path}/build cannot be written to: File exists\n"

"""Prometheus, Alertmanager and Grafana: each asks for the view token, and each finds it where `make up` lays it."""

import re
from pathlib import Path

import yaml
from study_tokens import INSIDE, roles_of

COMPOSE = Path(__file__).resolve().parents[3] / "compose"
SERVICES = yaml.safe_load((COMPOSE / "compose.yaml").read_text())["services"]
PROMETHEUS = yaml.safe_load((COMPOSE / "prometheus" / "prometheus.yml").read_text())
FILE = f"{INSIDE}/view"
KNOWN = {"username": "study", "password_file": FILE}


def test_what_watches_names_the_file_of_the_view_token():
    """So that it gets it and no other; without it none of them starts."""
    for name in ("prometheus", "alertmanager", "grafana"):
        assert roles_of(SERVICES[name]["environment"]) == ("view",)
    for name in ("prometheus", "alertmanager"):
        assert SERVICES[name]["environment"]["SENSE4HRI_VIEW_TOKEN_FILE"] == FILE


def test_prometheus_gives_the_password_to_what_asks_for_it_alone():
    """Alertmanager and itself: the services' metrics are open, and no token of the study goes to their ports."""
    assert [one.get("basic_auth") for one in PROMETHEUS["alerting"]["alertmanagers"]] == [KNOWN]
    jobs = {job["job_name"]: job.get("basic_auth") for job in PROMETHEUS["scrape_configs"]}
    assert jobs == {"sense4hri": None, "prometheus": KNOWN}


def test_nobody_looks_into_grafana_without_logging_in():
    """Its user and password are those of Prometheus, nobody is let in unasked, and no other account is made."""
    given = SERVICES["grafana"]["environment"]
    assert given["GF_SECURITY_ADMIN_USER"] == "study"
    assert given["GF_SECURITY_ADMIN_PASSWORD"] == f"$$__file{{{FILE}}}"  # as Compose reads it; Grafana reads the file
    assert [name for name in given if re.match("GF_(AUTH|USERS)_", name)] == []
    assert "GF_SECURITY_DISABLE_INITIAL_ADMIN_CREATION" not in given


def test_grafana_gets_in_at_prometheus():
    """By the password from the file, which stands in no configuration."""
    (source,) = yaml.safe_load((COMPOSE / "grafana/provisioning/datasources/prometheus.yml").read_text())["datasources"]
    assert (source["basicAuth"], source["basicAuthUser"]) == (True, "study")
    assert source["secureJsonData"] == {"basicAuthPassword": f"$__file{{{FILE}}}"}

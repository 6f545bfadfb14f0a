"""Who gets in at Prometheus and Alertmanager, started as in their images: whoever has the study's view token, alone."""

import os
import secrets
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from monitoring import CONFIG, ROOT, Monitoring, known
from processes import poll

STARTS = {name: ROOT / "compose" / name / "start.sh" for name in ("prometheus", "alertmanager")}
PATHS = {
    "prometheus": [
        ("GET", "/"),
        ("GET", "/graph"),
        ("GET", "/metrics"),
        ("GET", "/federate?match[]=up"),
        ("GET", "/-/healthy"),
        ("GET", "/-/ready"),
        ("GET", "/debug/pprof/cmdline"),
        ("GET", "/api/v1/query?query=up"),
        ("GET", "/api/v1/status/config"),
        ("OPTIONS", "/api/v1/query"),
        ("POST", "/api/v1/query"),
        ("POST", "/api/v1/admin/tsdb/delete_series?match[]=up"),
        ("POST", "/-/reload"),
        ("POST", "/-/quit"),
    ],
    "alertmanager": [
        ("GET", "/"),
        ("GET", "/metrics"),
        ("GET", "/-/healthy"),
        ("GET", "/-/ready"),
        ("GET", "/debug/pprof/cmdline"),
        ("GET", "/api/v1/alerts"),
        ("GET", "/api/v2/alerts"),
        ("GET", "/api/v2/silences"),
        ("OPTIONS", "/api/v2/silences"),
        ("POST", "/api/v1/silences"),
        ("POST", "/api/v2/silences"),
        ("POST", "/api/v2/alerts"),
        ("DELETE", "/api/v2/silence/0"),
        ("POST", "/-/reload"),
    ],
}
READ = {"prometheus": "/api/v1/query?query=up", "alertmanager": "/api/v2/silences"}
FOREIGN = {"Host": "evil.example", "Origin": "http://evil.example"}


@pytest.fixture(scope="module")
def watch(bin_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Monitoring]:
    """Both, with a webhook where nobody listens, and the longest token that there may be."""
    token = secrets.token_urlsafe(384)
    assert len(token) == 512
    running = Monitoring(tmp_path_factory.mktemp("monitoring"), bin_folder, "http://127.0.0.1:9/", token)
    try:
        poll(
            lambda: asked(running, "alertmanager", "/-/ready", known(running.token))[0] == 200, "Alertmanager is ready"
        )
        yield running
    finally:
        running.close()


def asked(
    watch: Monitoring, service: str, path: str, headers: dict[str, str], method: str = "GET"
) -> tuple[int, dict[str, str], str]:
    """Status, header fields and body of an answer; status 0 where nobody listens."""
    address = {"prometheus": watch.address, "alertmanager": watch.alertmanager}[service]
    body = b"{}" if method == "POST" else None
    request = urllib.request.Request(f"{address}{path}", body, headers, method=method)
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status, dict(answer.headers), answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, dict(error.headers), error.read().decode()
    except urllib.error.URLError:
        return 0, {}, ""


@pytest.mark.parametrize("service", PATHS)
def test_without_the_token_every_path_is_closed(watch, service):
    """Also to probes and to a browser's question before another site's request; a page brought here by DNS rebinding
    has no password either, and no other user or scheme has one."""
    strangers = [{}, FOREIGN, known("another"), known(""), known(watch.token, "admin"), known(watch.token, "")]
    strangers.append({"Authorization": f"Bearer {watch.token}"})
    for headers in strangers:
        answers = {(method, path): asked(watch, service, path, headers, method)[0] for method, path in PATHS[service]}
        assert answers == dict.fromkeys(PATHS[service], 401), headers


@pytest.mark.parametrize("service", PATHS)
def test_the_view_token_lets_in(watch, service):
    """As the password of the user `study`."""
    for path in (READ[service], "/-/healthy", "/-/ready"):
        assert asked(watch, service, path, known(watch.token))[0] == 200


def test_no_other_sites_page_reads_what_prometheus_answers(watch):
    """Also where the browser sends the password along: no origin is allowed."""
    for origin in ("http://evil.example", "null", "http://127.0.0.1:8080"):
        status, headers, _ = asked(watch, "prometheus", READ["prometheus"], known(watch.token) | {"Origin": origin})
        assert status == 200
        assert "Access-Control-Allow-Origin" not in headers
        assert "Access-Control-Allow-Credentials" not in headers


def test_nobody_stops_prometheus_or_deletes_from_it_over_http(watch):
    """What would change it is off, for the view token too."""
    refusals = {"/-/reload": "Lifecycle API is not enabled", "/-/quit": "Lifecycle API is not enabled"}
    refusals["/api/v1/admin/tsdb/delete_series?match[]=up"] = "admin APIs disabled"
    for path, sentence in refusals.items():
        assert sentence in asked(watch, "prometheus", path, known(watch.token), "POST")[2]


def test_prometheus_gets_in_at_itself_and_at_alertmanager(watch):
    """It scrapes itself, and what it sends to Alertmanager arrives, with the password from the file."""
    poll(lambda: watch.query('up{job="prometheus"} == 1'), "Prometheus scrapes itself", 30)
    managers = watch.answer("/api/v1/alertmanagers")["activeAlertmanagers"]
    assert [one["url"] for one in managers] == [f"{watch.alertmanager}/api/v2/alerts"]


def test_the_token_is_in_nothing_that_is_shown(watch):
    """No command line, environment, metric, shown configuration or flag has it; no file or log, but its own."""
    told = {"prometheus": ("/api/v1/status/config", "/api/v1/status/flags", "/metrics")}
    told |= {"alertmanager": ("/api/v2/status", "/api/v1/status", "/metrics")}
    shown = [asked(watch, name, path, known(watch.token))[2] for name, paths in told.items() for path in paths]
    assert "password_file: " in shown[0]
    processes = [Path(f"/proc/{child.pid}") for child in watch.children]
    shown += [(each / name).read_bytes().decode() for each in processes for name in ("cmdline", "environ")]
    assert [text for text in shown if watch.token in text] == []
    files = [file for file in watch.folder.rglob("*") if file.is_file()]
    assert [file.name for file in files if watch.token.encode() in file.read_bytes()] == ["view"]
    with_hash = [file for file in files if b"basic_auth_users" in file.read_bytes()]
    assert [file.stat().st_mode & 0o777 for file in with_hash] == [0o600, 0o600]


@pytest.mark.parametrize("service", STARTS)
@pytest.mark.parametrize(
    ("token", "sentence"),
    [
        ("", "must name a file with 1 to 512 letters, digits or . _ ~ + / = -, not 'FILE'"),
        ("two words", "must name a file with 1 to 512 letters, digits or . _ ~ + / = -, not 'FILE'"),
        ("x" * 513, "must name a file with 1 to 512 letters, digits or . _ ~ + / = -, not 'FILE'"),
    ],
)
def test_with_a_token_that_is_none_neither_starts(tmp_path, service, token, sentence):
    """Status 78 and one sentence with the name of the variable, never a service that is open by a mistake."""
    (tmp_path / "view").write_text(token)
    told = f"SENSE4HRI_VIEW_TOKEN_FILE {sentence}\n".replace("FILE'", f"{tmp_path}/view'")
    assert started(service, tmp_path) == (78, "", told)


def test_without_a_token_alertmanager_does_not_start(tmp_path):
    """It takes silences."""
    status, _, told = started("alertmanager", tmp_path)
    assert status == 78
    assert "must name the file with the study's view token, as `make up` does; " in told


def test_without_tokens_prometheus_is_open_and_says_so(bin_folder, tmp_path):
    """As our own services are for viewing: so a study file is started by Docker as it is. Its health check passes."""
    open_one = Monitoring(tmp_path, bin_folder, token="")
    try:
        assert asked(open_one, "prometheus", READ["prometheus"], {})[0] == 200
        check = [CONFIG / "ready", open_one.address.rpartition(":")[2]]
        for given in ({"SENSE4HRI_VIEW_TOKEN_FILE": f"{tmp_path}/view"}, {}):  # as compose.yaml has it, and unnamed
            assert subprocess.run(check, env={"PATH": os.environ["PATH"], **given}, check=False).returncode == 0
        assert "no view token: whoever reaches this port may read" in (tmp_path / "prometheus.log").read_text()
    finally:
        open_one.close()


def started(service: str, folder: Path) -> tuple[int, str, str]:
    """Status and output of a start with the token in a folder's `view`; the programs themselves are stand-ins."""
    for program in ("prometheus", "prometheus-alertmanager"):
        (folder / program).write_text("#!/bin/sh\necho started\n")
        (folder / program).chmod(0o755)
    given = {"PATH": f"{folder}:{CONFIG}:{os.environ['PATH']}", "TMPDIR": str(folder)}
    given |= {"ALERTMANAGER_CONFIG": str(CONFIG / "alertmanager.yml"), "ALERTMANAGER_FOLDER": str(folder)}
    given |= {"SENSE4HRI_VIEW_TOKEN_FILE": f"{folder}/view"}
    done = subprocess.run([STARTS[service]], env=given, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def test_the_health_check_asks_with_the_token(watch):
    """It passes where the service is ready, and fails where nobody listens and where it would not be let in."""
    own = os.environ | {"SENSE4HRI_VIEW_TOKEN_FILE": f"{watch.folder}/view"}
    foreign = own | {"SENSE4HRI_VIEW_TOKEN_FILE": "/dev/null"}
    for address in (watch.address, watch.alertmanager):
        check = [CONFIG / "ready", address.rpartition(":")[2]]
        assert subprocess.run(check, env=own, check=False).returncode == 0
        assert subprocess.run(check, env=foreign, check=False).returncode == 1
    assert subprocess.run([CONFIG / "ready", "9"], env=own, capture_output=True, check=False).returncode == 1

"""What holds for every folder in services/: files, headings, imports, configuration, metrics, a clean end."""

import ast
import dataclasses
import json
import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import generate
import http_fuzz
import metrics_table
import new
import package_files
import pytest
import yaml
from processes import Process, poll
from sense4hri import schema

REQUESTS = 300
"""Of strangers, to every port; `tests/bench/bench_http_fuzz.py` sends 10 000."""
MOST_UNANSWERED = 0.4
"""Share of them whose sender went away first, or of which nobody could tell what was asked."""
ROOT = Path(__file__).resolve().parents[2]
SERVICES = sorted(path for path in (ROOT / "services").iterdir() if (path / "pyproject.toml").is_file())


def project(service: Path) -> dict[str, Any]:
    return tomllib.loads((service / "pyproject.toml").read_text())


def package(service: Path) -> str:
    return project(service)["project"]["name"]


def is_node(service: Path) -> bool:
    """False where pyproject.toml declares `kind = "commands"`: nothing that runs until it is stopped."""
    return project(service).get("tool", {}).get("sense4hri", {}).get("kind") != "commands"


PACKAGES = {package(path) for path in SERVICES}
SAME = {"## Method": "## Wire format"}
"""What a README is about: of one service what it computes, of another its bytes."""
HEADINGS = ("## Publishes", "## Parameters", "## Known limits", "## Run it without hardware", *SAME, *SAME.values())
ROLE_FILES = {
    "driver": ("config.py", "protocol.py", "transport.py", "device.py", "__main__.py"),
    "interpreter": ("config.py", "features.py", "stream.py", "__main__.py"),
}
COMMON_FILES = ("README.md", "package.xml", "pyproject.toml")
TRANSPORTS = {"bleak", "dbus_fast", "pylsl", "serial", "usb", "bumble", "zmq"}
NODES = [path for path in SERVICES if is_node(path)]
each_service = pytest.mark.parametrize("service", SERVICES, ids=lambda path: path.name)
STAND_FOR_OTHERS = ("driver-polar", "interpreter-ecg")
"""What else serves nothing but the kit's HTTP, and has a file in tests/graph that begins and ends it, is slow here."""
each_node = pytest.mark.parametrize("service", NODES, ids=lambda path: path.name)


def modules(service: Path) -> list[Path]:
    return sorted((service / "src" / package(service)).rglob("*.py"))


@cache
def imports(module: Path) -> set[str]:
    """Return the top-level names a module imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add((node.module or "").split(".")[0])
    return names


@each_service
def test_the_same_files_and_headings_everywhere(service):
    """A service has the files of its role, and its README the agreed headings in order."""
    role = service.name.partition("-")[0]
    wanted = [*COMMON_FILES, f"resource/{package(service)}", f"src/{package(service)}/__main__.py"]
    if is_node(service):
        wanted += ["config/default.yaml", f"launch/{package(service)}.launch.py"]
        wanted += [f"src/{package(service)}/{name}" for name in ROLE_FILES.get(role, ("config.py",))]
    assert [name for name in wanted if not (service / name).is_file()] == []
    readme = (service / "README.md").read_text()
    found = re.findall(rf"^({'|'.join(HEADINGS)})", readme, re.M)
    wanted = re.findall(r"^## .*$", template_of(role, "README.md"), re.M)
    assert [SAME.get(each, each) for each in found] == [SAME.get(each, each) for each in wanted]
    assert readme.startswith(f"# {service.name}\n")


def template_of(role: str, file: str) -> str:
    """The template's text of a file, for a driver, an interpreter or any other service."""
    kind = role if role in ROLE_FILES else "service"
    return next(path for path in new.sources(kind, "bare") if path.name == f"{file}.in").read_text()


@each_service
def test_it_begins_and_ends_as_the_template_says(service):
    """__main__.py has `main() -> int` with the template's docstring, and ends as the template's does."""
    role, text = service.name.partition("-")[0], (service / "src" / package(service) / "__main__.py").read_text()
    template = template_of(role, "__main__.py")
    head = re.search(r'^def main\(\) -> int:\n    """[^.]*', template, re.M)[0]  # its status may be said beside
    assert text.endswith(template[template.index("\n\nif __name__") :])
    if is_node(service):
        assert head in text


@each_node
def test_compose_runs_it_as_the_template_says(service):
    """Image, build, command and the way to Bluetooth are the template's; what a service has beside them is its own."""
    text = (ROOT / "compose" / "compose.yaml").read_text()
    anchors = text[: text.index("\nservices:")]
    bluetooth = any("sense4hri.bluetooth_le" in module.read_text() for module in modules(service))
    wanted = yaml.safe_load(f"{anchors}\nservices:\n{new.compose_entry(service.name, bluetooth)}")["services"]
    entry = yaml.safe_load(text)["services"][service.name]
    command, environment = wanted[service.name].pop("command", []), wanted[service.name].pop("environment")
    assert entry.get("command", [])[: len(command)] == command
    assert environment.items() <= entry["environment"].items()
    assert wanted[service.name].items() <= entry.items()


@pytest.mark.parametrize("folder", generate.packages(), ids=lambda path: path.name)
def test_packaging_files_are_those_of_the_template(folder):
    """pyproject.toml, package.xml, setup files, marker, launch file and the module's sentence are the template's."""
    differing = [path.name for path, text in package_files.files(folder).items() if path.read_text() != text]
    assert differing == [], "make generate"


@pytest.mark.parametrize("folder", generate.packages(), ids=lambda path: path.name)
def test_dependencies_are_what_is_imported(folder):
    """A package declares each distribution that its modules import, and no other."""
    assert package_files.declared_dependencies(folder) == package_files.needed(folder)


@each_service
def test_no_service_imports_another(service):
    """A service imports its own package, the interface packages and published libraries, never another service."""
    for module in modules(service):
        assert imports(module) & (PACKAGES - {package(service)}) == set(), module


@pytest.mark.parametrize(
    "service", [path for path in SERVICES if path.name.startswith("driver-")], ids=lambda path: path.name
)
def test_a_driver_imports_its_transport_in_one_place(service):
    """Only transport.py of a driver imports the library that reaches the device."""
    users = [module.name for module in modules(service) if imports(module) & TRANSPORTS]
    assert set(users) <= {"transport.py"}


@each_service
def test_the_service_is_in_the_status_table_and_in_compose(service):
    """services/README.md has a row for it and compose.yaml an entry."""
    assert re.search(rf"^\| \[?`?{service.name}", (ROOT / "services" / "README.md").read_text(), re.M)
    assert service.name in yaml.safe_load((ROOT / "compose" / "compose.yaml").read_text())["services"]


@pytest.fixture(scope="module")
def differing() -> list[Path]:
    """Every file that is not as `make generate` writes it, relative to the root."""
    return [path.relative_to(ROOT) for path in generate.differing()]


@each_node
def test_parameters_are_written_once(service, differing):
    """config/default.yaml and the README's table say what the Config's fields say: no drift, no second place."""
    assert [str(path) for path in differing if service.name in path.parts] == [], "make generate"


@each_node
def test_the_default_configuration_names_every_parameter(service):
    """config/default.yaml, read as YAML, sets each parameter to its default, or to an example of what is required."""
    given = yaml.safe_load((service / "config" / "default.yaml").read_text())["/**"]["ros__parameters"]
    known = {each.name: each for each in schema.parameters_of(schema.schema_of(package(service)))}
    assert list(given) == list(known)
    for name, value in given.items():
        expected = known[name].default if known[name].rule.example is None else known[name].rule.example
        comparable = str(value).strip() if isinstance(expected, str) else value
        assert comparable == (expected.strip() if isinstance(expected, str) else _plain(expected)), name


def _plain(value):
    return list(value) if isinstance(value, tuple) else value


@each_node
def test_every_parameter_has_its_sentence(service):
    """No field of a Config without a sentence, and none whose default breaks its own rule."""
    for each in schema.parameters_of(schema.schema_of(package(service))):
        assert each.rule.help, each.name
        if each.default is not dataclasses.MISSING:
            schema.check(each.name, each.kind, each.rule, each.default)


def stood_for(service: Path) -> bool:
    """True where others of its role are begun, and its default configuration is checked, in a quick run as well."""
    role = service.name.partition("-")[0]
    in_graph = (ROOT / "tests" / "graph" / f"test_{package(service)}.py").exists()
    return role in ROLE_FILES and in_graph and service.name not in STAND_FOR_OTHERS


@pytest.mark.parametrize(
    "service",
    [
        pytest.param(
            path,
            id=path.name,
            marks=pytest.mark.slow(reason=f"{' and '.join(STAND_FOR_OTHERS)}, its file in tests/graph")
            if stood_for(path)
            else (),
        )
        for path in NODES
    ],
)
def test_it_runs_on_its_default_configuration_and_ends_cleanly(service, start, tmp_path, monkeypatch):
    """It shows metrics without identities, withstands strangers without a traceback, and SIGTERM ends it with 0."""
    monkeypatch.chdir(tmp_path)
    options = ["--ros-args", "--params-file", str(service / "config" / "default.yaml")]
    bus = {"DBUS_SYSTEM_BUS_ADDRESS": f"unix:path={tmp_path}/no-bus"}
    process = start(package(service), *options, env=bus, **overrides(service, tmp_path))
    status, text = process.get("/metrics")
    assert status == 200
    names = set(re.findall(r"^# TYPE (\w+)", text, re.M))
    assert names
    assert all(name.startswith(("sense4hri_", "process_")) for name in names), names
    assert "human_id" not in text
    assert metrics_table.lacking(metrics_table.rows_of(text), metrics_table.written()) == []
    describes_itself(process)
    for port in ports(process, service):
        withstands_strangers(process, port)
    assert process.stop_within() == 0, process.log()
    assert "Traceback" not in process.log()


def describes_itself(process: Process) -> None:
    """`/openapi.json` is OpenAPI 3.1 without loose ends: what changes anything takes JSON, refusals have one form."""
    status, told = process.ask("/openapi.json")
    assert (status, told["openapi"]) == (200, "3.1.0")
    shapes = told["components"]["schemas"]
    assert set(re.findall(r'"#/components/schemas/(\w+)"', json.dumps(told))) == set(shapes)
    assert shapes["Refused"]["required"] == ["error", "field"]
    for path, methods in told["paths"].items():
        for method, operation in methods.items():
            assert operation["summary"], (method, path)
            assert set(operation["responses"]) >= {"200", "401", "403", "503"}
            assert all(
                answer["content"]["application/json"]["schema"] is not None
                for answer in operation["responses"].values()
            )
            assert (method == "post") == ("415" in operation["responses"]), "state changes take application/json"
            named = {each["name"] for each in operation.get("parameters", [])}
            assert named == set(re.findall(r"{(\w+)}", path))
    assert process.request("/openapi.json", headers={"Host": "evil.example"})[0] == 403


def ports(process: Process, service: Path) -> list[int]:
    """Every port that it serves HTTP on."""
    found = [process.port()]
    if service.name == "web-gui":
        process.until("the page is at ")
        found.append(int(process.log().partition("the page is at ")[2].split()[0].rpartition(":")[2]))
    return found


def withstands_strangers(process: Process, port: int) -> None:
    """No form or page of the web changes anything; malformed and hostile requests get a 4xx; slow ones block nobody."""
    before = answers(port)
    foreign = list(http_fuzz.foreign_posts(http_fuzz.described(port)))
    for what, request in foreign:
        assert http_fuzz.status_of(http_fuzz.exchange(port, request)) in (401, 403, 415), what
    after = answers(port)
    assert not foreign or before.keys() & after.keys(), "nothing stood still for a comparison"
    assert [path for path in before.keys() & after.keys() if before[path] != after[path]] == []
    statuses = http_fuzz.assail(port, REQUESTS, seed=1, alive=lambda: process.child.poll() is None)
    assert max(statuses) < 500, statuses
    assert statuses[0] < REQUESTS * MOST_UNANSWERED, statuses
    with http_fuzz.slow_connections(port, 100):
        assert http_fuzz.told(port, "/openapi.json")[0] == 200
    assert process.get("/healthz")[0] == 200


def answers(port: int) -> dict[str, bytes]:
    """What it tells of itself on every path beside which something can be posted, where it tells the same twice."""
    described = http_fuzz.described(port)["paths"]
    if not any("post" in methods for methods in described.values()):
        return {}
    paths = [path for path, methods in described.items() if "get" in methods and "{" not in path]
    first, second = ({path: served(port, path) for path in paths} for _ in range(2))
    return {path: body for path, body in first.items() if second[path] == body}


def served(port: int, path: str) -> bytes:
    """What it answers once it has the time to: on a busy machine a main thread may keep a request waiting."""
    _, body = poll(lambda: (told := http_fuzz.told(port, path))[0] not in (0, 503) and told, f"{path} is served")
    return body


def overrides(service: Path, tmp_path: Path) -> dict[str, object]:
    """What must differ from the default so that the test touches nothing outside its own folder."""
    own = {
        "web-gui": {"port": 0},
        "recorder": {"directory": tmp_path / "recordings"},
        "metadata-registry": {"database": tmp_path / "registry.sqlite"},
        "session-coordinator": {"state_file": tmp_path / "session.json"},
        "sensor-bench": {"socket_path": tmp_path / "bus"},
        "driver-serial": {"board": service.parents[1] / "compose" / "studies" / "serial" / "board.yaml"},
    }
    return own.get(service.name, {})

"""`make check`: mistakes that are made in a copy of a ready study, each told with its line."""

import os
import re
from pathlib import Path

import check_study
import pytest
from checks import surroundings
from checks.finding import Finding

ROOT = Path(__file__).resolve().parents[3]
READY = ROOT / "compose" / "studies"
ANY = "  clock-sync:\n"
RECORDER, REGISTRY = "service: recorder}", "  metadata-registry:\n"


def in_any(keys: str) -> tuple[str, str]:
    return ANY, f"{ANY}    {keys}\n"


MISTAKES = [
    ("vernier", *in_any("depends_on: [recordr]"), "there is no service 'recordr' in the study; did you mean recorder?"),
    ("vernier", *in_any("depends_on: {nobody: {}}"), "there is no service 'nobody' in the study"),
    ("vernier", *in_any("depends_on: {recorder: {condition: healthy}}"), "condition 'healthy' must be one of service_"),
    ("vernier", *in_any("environment: {METRIC_PORT: 1}"), "nobody reads METRIC_PORT; did you mean METRICS_PORT?"),
    ("demo", "service: recorder}", "service: recorder}\n    environment: {METRICS_PORT: 9500}",
     "METRICS_PORT is 9500: Prometheus asks at 9464 alone"),
    ("vernier", *in_any("environment: [ROS_DOMAINID=5]"), "nobody reads ROS_DOMAINID; did you mean ROS_DOMAIN_ID?"),
    ("vernier", *in_any("environment: {SENSE4HRI_TOKN: x}"), "nobody reads SENSE4HRI_TOKN"),
    ("vernier", *in_any("networks: [lab]"), "'lab' is not declared under `networks`"),
    ("vernier", *in_any("secrets: [nobody]"), "'nobody' is not declared under `secrets`"),
    ("vernier", *in_any("restart: alway"), "is 'alway', must be one of \"no\", always"),
    ("vernier", *in_any("profiles: demo"), "is 'demo', must be a list"),
    ("vernier", *in_any("x-proces: [-p, a:=1]"), "nobody reads it; did you mean x-process?"),
    ("vernier", *in_any("x-hosts: a"), "nobody reads it; did you mean x-host?"),
    ("vernier", *in_any("ports: ['eighty:80']"), "'eighty:80' must be like 8080:80"),
    ("vernier", *in_any("ports: ['8080:99999']"), "port 99999: must be 1 to 65535"),
    ("vernier", *in_any("image: sense4hri/clok-sync"), "there is no image sense4hri/clok-sync; did you"),
    ("vernier", *in_any("command: echo ${GUI_PROT:-8080}"), "${GUI_PROT} is set by nobody; did you mean GUI_PORT?"),
    ("vernier", *in_any("mem_limit: lots"), "'lots' must be a size, like 512m or 2g"),
    ("vernier", *in_any("cpus: all"), "'all' must be a number"),
    ("vernier", *in_any("stop_grace_period: 10 seconds"), "'10 seconds' must be a duration, like 10s"),
    ("vernier", *in_any("build: ./nowhere"), "there is no folder './nowhere'"),
    ("vernier", *in_any("command: echo ${OUR_LAB}"), "${OUR_LAB} is set by nobody, and has no default"),
    ("vernier", "services:\n", "services:\n  bad name: {image: x}\n", "a service's name is letters, digits"),
    ("vernier", ANY, f"  clock-2:\n    extends: {{file: {READY.parent}/compose.yaml, service: clock-sync}}\n{ANY}",
     "runs clock_sync as clock-2 does already"),
    ("vernier", REGISTRY,
     f"  disk-2:\n    extends: {{file: {READY.parent}/compose.yaml, service: recorder}}\n{REGISTRY}",
     "records as recorder does: each writes every session, a recording of its own, and a stop waits for one of them"),
    ("vernier", "service: driver-vernier}", "service: driver-polar}", "sense4hri/driver-polar has no driver_vernier"),
    ("vernier", "GDX-RB 0K1002A1\"", "GDX-RB 0K1002A2\"", "name 'GDX-RB 0K1002A2' is that of no device of sensor-be"),
    ("vernier", "physiological/p1", "physiologcal/p1", "comes from nobody; did you mean /humans/physiological/p1/res"),
    ("vernier", "/humans/physiological/p1/respiration/belt_1/raw", "/humans/physiological/p1/respiration/belt_1/raw, "
     "/humans/physiological/p1/respiration/belt_1/raw", "/belt_1/raw is there 2 times"),
    ("eight-participants", "sensor: h10_1,", "sensor: h10_11,", "sensor 'h10_11' is no sensor; did you mean h10_1?"),
    ("lsl", "name='Bench EEG'", "name='Bench EGG'", "outlet 'Bench EGG' is that of no device of sensor-bench"),
    ("lsl", "source_id='bench-ecg_1'", "source_id='bench-ecg'", "outlet 'bench-ecg' is that of no device of sensor-be"),
    ("vernier", RECORDER, f"{RECORDER}\n    command: python -m recorder --ros-args -p directory:=/data",
     "directory '/data' is in no volume of recorder"),
    ("demo", "name: sense4hri-demo", "name: Sense4HRI Demo", "'Sense4HRI Demo' must be small letters"),
    ("demo", "  name: demo", "  name: a/b", "'a/b' is 'a_b' in the path of its recordings"),
    ("brainflow", "mac_address:=00:55:DA:B0:00:01", "mac_address:=00:55:DA:B0:00:02",
     "mac_address '00:55:DA:B0:00:02' is that of no device of sensor-bench; did you mean 00:55:da:b0:00:01?"),
    ("shimmer", "port:=/run/dbus/shimmer_1", "port:=/run/dbus/shimer_1", "is made by no device of sensor-bench"),
    ("serial", "/boards/board.yaml", "/boards/bord.yaml", "serial/bord.yaml' is not there"),
    ("file", "/signals/body.hea", "/signals/bdy.hea", "nine-modalities/bdy.hea' is not there"),
    ("lsl", "session:=lsl-{domain}", "session:=lsl_{domain}", "session 'lsl_{domain}' is that of no device"),
    ("lsl", "known_peers:=[sensor-bench]", "known_peers:=[sensorbench]", "known_peers 'sensorbench' is no service of"),
    ("pupil-labs", "address:=sensor-bench", "address:=sensor-bnch", "address 'sensor-bnch' is no service of the study"),
    ("pupil-labs", "-p port:=50020", "-p port:=50021", "port 50021 is that of no device of sensor-bench"),
]  # fmt: skip
"""Study, what stands there, what stands in its place, what is said."""


def findings(folder: Path, study: str, right: str, wrong: str) -> tuple[str, list[Finding]]:
    """A copy with the mistake in it, and what is found in it."""
    text = (READY / f"{study}.yaml").read_text().replace("../compose.yaml", str(READY.parent / "compose.yaml"))
    text = text.replace("[./", f"[{READY}/").replace(", ./", f", {READY}/")
    assert right in text
    file = folder / "trial.yaml"
    file.write_text(text.replace(right, wrong, 1))
    environment = {name: value for name, value in os.environ.items() if name != "GUI_PROT"}
    return file.read_text(), check_study.findings(file, "processes", 1e-3, folder / "recordings", environment)


@pytest.mark.parametrize(("study", "right", "wrong", "said"), MISTAKES, ids=[each[2][-40:] for each in MISTAKES])
def test_a_mistake_in_a_ready_study_stands_at_its_line(tmp_path, study, right, wrong, said):
    """Said once where it was made; the study has nothing of it before."""
    text, found = findings(tmp_path, study, right, wrong)
    matching = [each for each in found if said in each.text]
    assert len(matching) == 1, found
    begin = text.index(wrong)
    first, last = text.count("\n", 0, begin) + 1, text.count("\n", 0, begin + len(wrong)) + 1
    assert first <= matching[0].line <= last, matching


GONE = [
    ("name: sense4hri-demo\n", "name: is missing: Compose takes the folder's"),
    (f"{ANY}    extends: {{file: {READY.parent}/compose.yaml, service: clock-sync}}\n", "there is no clock-sync"),
]


@pytest.mark.parametrize(("gone", "said"), GONE)
def test_what_is_not_there_is_told(tmp_path, gone, said):
    """A study without a name, or without the service that maps clocks, is told of it as a warning."""
    _, found = findings(tmp_path, "demo", gone, "")
    assert [each.severity for each in found if said in each.text] == ["warning"], found


def test_every_variable_that_a_service_reads_may_be_given():
    """What the code asks its environment for is what `make check` knows."""
    sources = [*ROOT.glob("services/*/src/**/*.py"), *ROOT.glob("interfaces/sense4hri/src/**/*.py")]
    asked = re.compile(r'(?:environ|environment)(?:\.get\(|\.setdefault\(|\[)"([A-Z0-9_]+)"')
    read = {name for file in sources for name in asked.findall(file.read_text())}
    assert {"METRICS_PORT", "SENSE4HRI_HOST"} <= read
    assert read - {"OPENBLAS_NUM_THREADS"} <= surroundings.READ | surroundings.OF_ROS


def test_variables_of_somebody_elses_program_are_its_own(tmp_path):
    """What is near no known name and begins as none of ours is not judged."""
    _, found = findings(tmp_path, "vernier", *in_any("environment: {THEIR_PORT: 5, ROS_LOG_DIR: /tmp, TZ: UTC}"))
    assert found == []


@pytest.mark.parametrize(
    ("outlet", "wrong"), [("name='Acme'", []), ("name='Acme Skin'", []), ("name='Acne'", ["did you mean Acme?"])]
)
def test_outlets_of_a_driver_s_own_emulator_are_known_by_how_they_begin(tmp_path, outlet, wrong):
    """The first is called as the study says; how the others go on only the emulator's file tells."""
    device = '{sensor: ecg_1, model: LslEcg, participant: p1, session: "lsl-{domain}"}'
    emulated = device.replace("LslEcg", "EmulatedLsl, name: Acme, emulator: /emulated/emulator.py")
    text, _ = findings(tmp_path, "lsl", device, emulated)
    (tmp_path / "trial.yaml").write_text(text.replace("source_id='bench-ecg_1'", outlet))
    found = check_study.findings(tmp_path / "trial.yaml", "processes", 1e-3, tmp_path / "recordings", dict(os.environ))
    told = [each.text for each in found if "is that of no device" in each.text]
    assert [sentence.rpartition("; ")[2] for sentence in told] == wrong

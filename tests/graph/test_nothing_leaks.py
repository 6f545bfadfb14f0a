"""No token, and nothing that names a person, is where it must not be: every byte of recordings, logs, metrics is read.

Planted: tokens, right and wrong, in every place where a program or a careless hand puts them; a name, an e-mail and a
telephone number typed in place of a pseudonym; a pseudonym, which metrics must not have.
"""

import json
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import pytest
import zstandard
from ears import Ears
from mcap.exceptions import EndOfFile
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from processes import Process, poll
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri_msgs.msg import PhysioRaw, SensorInfoArray
from sense4hri_msgs.srv import AssignSensor

OPERATE, VIEW, WRONG = "tok-operate-7f31c0", "tok-view-c2b7aa", "tok-of-nobody-55e1"
PSEUDONYM = "zqkow77"
PEOPLE = ("Annabell Musterfrau", "annabell@musterfrau.example", "+49 151 23456789")
OPERATED, JSON = {"Authorization": f"Bearer {OPERATE}"}, {"Content-Type": "application/json"}
JUNK = "Content-Type", "text/plain"


class Study:
    """Registry, coordinator, recorder and page with tokens from files, and a driver nobody here has written."""

    def __init__(self, folder: Path, run: Callable[..., Process]) -> None:
        env = {}
        for role, token in (("OPERATE", OPERATE), ("VIEW", VIEW)):
            (folder / role).write_text(token)
            env[f"SENSE4HRI_{role}_TOKEN_FILE"] = str(folder / role)
        self.recorder = run("recorder", env=env, directory=folder / "recordings")
        self.registry = run("metadata_registry", env=env, database=folder / "registry.sqlite")
        self.coordinator = run("session_coordinator", env=env, state_file=folder / "session.json")
        self.page = run("web_gui", env=env, port=0)
        self.all = (self.recorder, self.registry, self.coordinator, self.page)

    def page_port(self) -> int:
        self.page.until("the page is at ")
        return int(self.page.log().partition("the page is at http://127.0.0.1:")[2].split()[0].rstrip("/"))


@pytest.fixture
def study(tmp_path: Path, start: Callable[..., Process]) -> Study:
    return Study(tmp_path, start)


def post(process: Process, path: str, fields: object, headers: Mapping[str, str] = OPERATED) -> int:
    return process.request(path, json.dumps(fields).encode(), headers={**JSON, **headers})[0]


def plant(study: Study, ears: Ears) -> None:
    """Put tokens and people where they do not belong; all of it is refused."""
    for process in study.all:
        cookie = f"sense4hri_token_{process.port()}"
        assert process.request(f"/openapi.json?token={OPERATE}")[0] == 401
        assert process.request("/openapi.json", headers={"Authorization": f"Bearer {WRONG}"})[0] == 401
        assert process.request(f"/{WRONG}", headers=OPERATED)[0] == 404
        assert process.request(f"/{PEOPLE[1]}", headers=OPERATED)[0] == 404
        assert process.request("/openapi.json", headers={"Cookie": f"{cookie}={WRONG}"})[0] == 401
    for person in PEOPLE:
        for fields in ({"human_id": person}, {"human_id": PSEUDONYM, "person_id": person}):
            assert post(study.registry, "/assign", {"sensor_id": "eda_1"} | fields) == 400
            asked = AssignSensor.Request(**({"sensor_id": "eda_1"} | fields))
            assert not ears.ask(AssignSensor, "/study/assign_sensor", asked).success
        assert post(study.coordinator, "/start", {"study": "s", "human_ids": [person]}) == 400
        assert post(study.registry, "/assign", {person: person}) == 400
        assert post(study.registry, "/assign", person, dict([JUNK]) | OPERATED) == 415
    assert [exchanged(study.page_port(), token) for token in (WRONG, OPERATE)] == [401, 200]


def exchanged(port: int, token: str) -> int:
    """The status with which the page answers a token."""
    body = json.dumps({"token": token}).encode()
    try:
        with urllib.request.urlopen(urllib.request.Request(f"http://127.0.0.1:{port}/token", body, JSON)) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as err:
        with err:
            return err.code


def unpacked(root: Path) -> Iterator[tuple[Path, bytes]]:
    """Every file below a folder, its name, and what MCAP chunks unpack to."""
    for path in (path for path in root.rglob("*") if path.is_file()):
        yield path, str(path.relative_to(root)).encode() + path.read_bytes()
        if path.suffix == ".mcap":
            with path.open("rb") as source, suppress(EndOfFile):  # it is still being written
                for record in StreamReader(source, emit_chunks=True).records:
                    if isinstance(record, Chunk):
                        yield path, zstandard.decompress(record.data) if record.compression == "zstd" else record.data


def found(where: Iterator[tuple[Path, bytes]], secrets: tuple[str, ...]) -> list[tuple[str, str]]:
    return [(path.name, secret) for path, data in where for secret in secrets if secret.encode() in data]


def test_no_token_and_no_person_is_in_recordings_logs_or_metrics(
    study: Study, tmp_path: Path, opened: Callable[[Ears], Ears]
) -> None:
    """After everything was planted: tokens and people nowhere, the pseudonym in the recording and in no metric."""
    ears = opened(Ears("leak_test", {"human_id": PSEUDONYM, "sensor_id": "eda_1"}))
    raw = StreamName(PSEUDONYM, "eda", "eda_1").topic("raw")
    publisher = ears.node.create_publisher(PhysioRaw, raw, qos.RAW)
    sensors = ears.hear(SensorInfoArray, "/study/sensors", qos.SENSORS)
    ears.until(lambda: sensors and sensors[-1].sensors, "the sensor is known")
    for process in study.all:
        poll(lambda process=process: process.get("/readyz")[0] == 200, "it is ready")
    plant(study, ears)
    recordings = tmp_path / "recordings"

    def recorded() -> bool:
        publisher.publish(PhysioRaw())
        return any(raw.encode() in data for _, data in unpacked(recordings))

    ears.until(recorded, "the recording has the stream")
    metrics = [process.request("/metrics")[1] for process in study.all]
    for process in study.all:
        assert process.stop() == 0
    secrets = (OPERATE, VIEW, WRONG, *PEOPLE)
    assert found(unpacked(recordings), secrets) == []
    logged = [(process.log_file, process.log_file.read_bytes()) for process in study.all]
    assert found(iter(logged), secrets) == []
    assert not [secret for secret in (*secrets, PSEUDONYM) for text in metrics if secret in text]
    assert found(unpacked(recordings), (PSEUDONYM,)), "what is looked for would be found"

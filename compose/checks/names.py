"""What belongs together in a study: participants, sensors, the streams a session waits for, who computes what."""

import os
from collections import Counter
from collections.abc import Iterator

from compose_yaml import load, near
from sense4hri.errors import Refusal
from sense4hri.names import ROOT, UNASSIGNED, StreamName
from sense4hri.patterns import Patterns
from session_coordinator.request import StartWish, request
from study_file import Service, Study

from checks.finding import Finding, Places
from checks.parameters import PLACEHOLDER, schema_known, streams_of

INTERPRETER = "interpreter_"
ALIKE = 0.9  # from which a topic that is not the house's is taken for a wrong spelling of one that is
WRITTEN = (("recorder", "directory"), ("metadata_registry", "database"), ("session_coordinator", "state_file"))
"""Parameters that say where a service writes what is to outlive its container."""
ONLY_ONE = ("clock_sync", "metadata_registry", "recorder", "session_coordinator", "web_gui")
SAID_IN_RECORDINGS = {"session_coordinator": "/study/session", "metadata_registry": "/study/sensors"}
"""What a recording says itself, and who else would."""
WISHED = {"study": "name", "human_ids": "participants"}
"""Keys of x-study by the fields of a wish for a session, where they differ."""
DEVICE = ("address", "name", "port")
"""Parameters that say which device a driver takes; two drivers of one device get in each other's way."""


def findings(study: Study, places: Places) -> Iterator[Finding]:
    """Yield what does not fit together."""
    yield from _participants(study, places)
    yield from _devices(study, places)
    yield from _volumes(study, places)
    yield from _sockets(study, places)
    yield from _kept(study, places)
    if "replay" in study.packages:
        yield from _replayed(study, places)
    else:
        yield from _required(study, places)
        yield from _missing(study, places)


def session(study: Study, places: Places) -> Iterator[Finding]:
    """Yield where nobody conducts the session that `make demo` records."""
    if study.of("session_coordinator") is None and "replay" not in study.packages:
        yield places.error("services", "session-coordinator is missing; make demo records a session through it")


def refused(study: Study, places: Places) -> Iterator[Finding]:
    """Yield why the session that `make demo` asks for, once everything runs, would be refused."""
    try:
        request(
            StartWish(study.name, "", study.task, human_ids=study.participants, required_streams=study.required_streams)
        )
    except Refusal as error:
        near_words = (topic for topic in study.required_streams if repr(topic) in str(error))
        yield places.error(f"x-study.{WISHED.get(error.field, error.field)}", str(error), *near_words)


def _participants(study: Study, places: Places) -> Iterator[Finding]:
    worn = {sensor.human_id: sensor for sensor in study.sensors}
    for human_id, sensor in worn.items():
        if human_id not in study.participants and human_id != UNASSIGNED:
            yield places.warning(
                f"services.{sensor.name}.command",
                f"{human_id!r} is not among the participants of x-study{near(human_id, study.participants)}",
                "human_id:=",
            )
    for human_id in study.participants:
        if study.sensors and human_id not in worn:
            yield places.warning("x-study.participants", f"{human_id!r} wears none of the study's sensors", human_id)


def _volumes(study: Study, places: Places) -> Iterator[Finding]:
    """Yield volumes of services that the file does not declare: Compose starts no study with one."""
    declared = load(study.file, os.environ).get("volumes")
    known = {str(name) for name in declared} if isinstance(declared, dict) else set()
    for service in study.services:
        for volume in service.mounts.values():
            if not volume.startswith("/") and volume not in known:
                text = f"volume {volume!r} is not declared under `volumes`{near(volume, known)}"
                yield places.error(f"services.{service.name}.volumes", text, volume)


def _sockets(study: Study, places: Places) -> Iterator[Finding]:
    """Yield a volume in which virtual sensors could make no socket: Docker gives a new one to root."""
    if (bench := study.of("sensor_bench")) is None:
        return
    declared = load(study.file, os.environ).get("volumes")
    for volume in bench.mounts.values():
        if isinstance(declared, dict) and volume in declared and not declared[volume]:
            opts = '{type: tmpfs, device: tmpfs, o: "uid=10001,mode=755,size=1m"}'
            text = f"is root's in a container, where {bench.name} runs as 10001; give it driver_opts: {opts}"
            yield places.error(f"volumes.{volume}", text)


def _kept(study: Study, places: Places) -> Iterator[Finding]:
    """Yield what a service would write into its container, where it is lost with it."""
    for service in study.processes:
        for package, name in WRITTEN:
            path = str(service.parameters.get(name, ""))
            inside = any(f"{path}/".startswith(f"{target}/") for target in service.mounts)
            if service.package == package and path and service.image and not inside:
                text = f"{name} {path!r} is in no volume of {service.name}: what is written is lost with its container"
                yield places.error(f"services.{service.name}.command", text, f"{name}:=")


def _replayed(study: Study, places: Places) -> Iterator[Finding]:
    """Yield services beside which a part of a recording cannot be played."""
    for package, topic in SAID_IN_RECORDINGS.items():
        if (service := study.of(package)) is not None:
            text = (
                f"says {topic} itself, so that of the recording is not played and features are not those of its session"
            )
            yield places.warning(f"services.{service.name}", text)


def _devices(study: Study, places: Places) -> Iterator[Finding]:
    """Yield devices that two drivers would have; on the network a device is an address and a port of it."""
    seen: dict[tuple[str, str, str, str], str] = {}
    for sensor in study.sensors:
        port = str(sensor.parameters.get("port", ""))
        for name in DEVICE:
            value = str(sensor.parameters.get(name, ""))
            if name == "port" and "address" in sensor.parameters:
                continue
            device = sensor.package, name, value, port
            if PLACEHOLDER.fullmatch(value):  # told as one
                continue
            if value and device in seen:
                keys = f"services.{sensor.name}.command"
                yield places.error(keys, f"{name} {value!r} is that of {seen[device]} already", f"{name}:=")
            if value:
                seen[device] = sensor.name


def _required(study: Study, places: Places) -> Iterator[Finding]:
    """Yield streams that a session would wait for in vain; topics that are not ours, the robot's, are not looked at."""
    topics, others = _topics(study)
    for topic, times in Counter(study.required_streams).items():
        if times > 1:
            yield places.warning("x-study.required_streams", f"{topic} is there {times} times", topic)
        ours = StreamName.loosely(topic)
        if not topic.startswith(f"{ROOT}/") and (meant := near(topic, topics, ALIKE)):
            yield places.error("x-study.required_streams", f"{topic} comes from nobody{meant}", topic)
        if not topic.startswith(f"{ROOT}/") or any(map(Patterns([topic]).match, topics)):
            continue
        if ours and ours[0].sensor_id in others:
            continue
        yield places.error(
            "x-study.required_streams", f"{topic} comes from no sensor of the study{near(topic, topics)}", topic
        )


def _topics(study: Study) -> tuple[list[str], set[str]]:
    """Return the topics of sensors whose streams are known before they run, and the sensor_ids of the others."""
    topics, others = [], set()
    fields = ("raw", "device", "health", "features", "clock")
    for sensor in study.sensors:
        streams = streams_of(sensor)
        if streams is None:
            others.add(sensor.sensor_id)
        for sensor_type in streams or ():
            name = StreamName(sensor.human_id, sensor_type, sensor.sensor_id)
            topics += [name.topic(field) for field in fields]
    return topics, others


def _missing(study: Study, places: Places) -> Iterator[Finding]:
    """Yield services without which something that a study is for does not happen."""
    if study.of("recorder") is None:
        yield places.warning("services", "there is no recorder: nothing is kept")
    if study.of("session_coordinator") is None:
        yield places.warning("services", "there is no session-coordinator: no session can be started")
    if study.of("clock_sync") is None:
        yield places.warning("services", "there is no clock-sync: nobody maps the sensors' clocks to this machine's")
    for service, first in _again(study):
        text = f"runs {service.package} as {first.name} does already: both do the same"
        if service.package == "recorder":  # of the same node name, so that the coordinator cannot tell them apart
            each = "each writes every session, a recording of its own, and a stop waits for one of them"
            text = f"records as {first.name} does: {each}"
        yield places.warning(f"services.{service.name}", text)
    for sensor in study.sensors:
        yield from _uninterpreted(study, sensor, places)


def _again(study: Study) -> Iterator[tuple[Service, Service]]:
    """Yield each further service of a package that a study has once, with the first one of it."""
    for service in study.processes:
        first = study.of(service.package)
        if service.package in ONLY_ONE and first is not None and first is not service:
            yield service, first


def _uninterpreted(study: Study, sensor: Service, places: Places) -> Iterator[Finding]:
    interpreters = {package for package in study.packages if package.startswith(INTERPRETER)}
    if not interpreters:  # a study that only records
        return
    for sensor_type in streams_of(sensor) or ():
        wanted = INTERPRETER + sensor_type
        if wanted in study.packages or schema_known(wanted) is None:
            continue
        text = (
            f"{sensor_type} of {sensor.sensor_id} gets no features: there is no {wanted.replace('_', '-')} in the study"
        )
        yield places.warning(f"services.{sensor.name}", text)

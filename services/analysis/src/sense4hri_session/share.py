"""A copy of a recording that does not tell of the lab it comes from; reports and exports are made of the copy."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path

from mcap.records import Channel, Message
from sense4hri.host_clocks import PROBES
from sense4hri_recording import recorder_json, repair, rosbag2
from sense4hri_recording.errors import SessionError
from sense4hri_recording.parts import find
from sense4hri_recording.reader import Reader, Record
from sense4hri_recording.strange import why_strange
from tqdm import tqdm

from sense4hri_session.identities import Identities
from sense4hri_session.rewrite import Named, write_anew

RECORDING = "recording"  # folder of the copy, beside what is exported of it
SENSORS = "/study/sensors"
TELLING = (SENSORS, "/study/host_clocks", PROBES, "/study/session", "/study/ack")


def copy(path: Path, target: Path, only_this_part: bool = False, progress: bool = False) -> list[Path]:
    """Write every folder of a recording into `target`, a folder that is there, without what identifies the lab.

    Returns the new folders in order. progress: show a bar.

    Left out are messages that cannot be decoded and may hold it, those that hold it in numbers or bytes, and what is no
    ROS 2 topic. Raises SessionError where what names the sensors cannot be decoded, and where the copy's other files,
    read back, still hold it.
    """
    folders = find(path, only_this_part)
    readers = [Reader(folder) for folder in folders]
    known = Identities()
    for reader, folder in zip(readers, folders, strict=True):
        _learn(known, reader, folder)
    total = sum(topic.messages for reader in readers for topic in reader.topics.values())
    with tqdm(total=total, unit=" messages", desc="copying", disable=not progress) as bar:
        return [
            _folder(known, reader, folder, target, bar.update) for reader, folder in zip(readers, folders, strict=True)
        ]


def _learn(known: Identities, reader: Reader, folder: Path) -> None:
    known.host(socket.gethostname())
    about = recorder_json.read(folder)
    known.host(about.host)
    known.path(str(folder.resolve().parent))
    for node in about.nodes:
        known.node(str(node.get("node", "")))
        known.parameters(node.get("parameters"))
    strange = {topic.name: why for topic in reader.topics.values() if (why := why_strange(topic))}
    if SENSORS in strange:
        raise SessionError(f"{SENSORS}: {strange[SENSORS]}; what it names could not be taken out")
    health = [topic.name for topic in reader.topics.values() if topic.type_name.endswith("/StreamHealth")]
    for record in reader.messages([topic for topic in (*TELLING, *health) if topic in reader.topics.keys() - strange]):
        message = reader.decode(record) if record.topic == SENSORS else reader.decoded(record)
        for name in ("host", "from_host", "to_host"):
            known.host(str(getattr(message, name, "")))
        for service in (getattr(message, "service", ""), *getattr(message, "expected_services", ())):
            known.node(str(service))
        known.path(str(getattr(message, "directory", "")))
        for clock in getattr(message, "clocks", ()):
            known.host(clock.host)
            known.host(clock.reference)
        for sensor in getattr(message, "sensors", ()):
            known.host(sensor.host)
            known.device(sensor.serial_number)
            known.parameters_json(sensor.parameters_json)


def _folder(known: Identities, reader: Reader, folder: Path, target: Path, step: Callable[[], object]) -> Path:
    made = target / (known.without(folder.resolve().stem) or "recording")
    made.mkdir()
    files = [made / f"{made.name}_{number}.mcap" for number in range(len(reader.files))]
    for file, copied in zip(reader.files, files, strict=True):
        _file(known, reader, file, copied, step)
    if folder.is_dir():
        about = recorder_json.read(folder)
        recorder_json.write(made, recorder_json.from_json(known.without(about.as_json())))
    rosbag2.describe(made, [repair.contents(file) for file in files], rosbag2.distro(folder))
    left = [file.name for file in made.iterdir() if file.suffix != ".mcap" and known.are_in(file.read_bytes())]
    if left:
        raise SessionError(f"{', '.join(left)} of the copy still tell of the lab: nothing was shared")
    return made


def _file(known: Identities, reader: Reader, file: Path, target: Path, step: Callable[[], object]) -> None:
    summary = reader.summaries[file]

    def named(channel: Channel) -> Named | None:
        if channel.topic not in reader.topics or channel.schema_id not in summary.schemas:
            return None
        names = {known.without(key): known.without(value) for key, value in channel.metadata.items()}
        return Named(known.without(channel.topic), names)

    def data(channel: Channel, message: Message) -> bytes | None:
        if channel.topic not in reader.topics:
            return None
        step()
        return _data(known, reader, channel, message)

    write_anew(file, target, summary, "sense4hri-share", named, data)


def _data(known: Identities, reader: Reader, channel: Channel, message: Message) -> bytes | None:
    """The bytes of a message without what identifies; None where that cannot be done."""
    if not known.are_in(message.data):
        return message.data
    decoded = reader.decoded(Record(channel.topic, message.log_time, message.publish_time, message.data))
    if decoded is None:
        return None
    data = reader.encode(channel.topic, known.without(decoded))
    return None if known.are_surely_in(data) else data

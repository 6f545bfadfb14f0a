"""The `metadata.yaml` of a rosbag2 folder, version 9, every field written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from sense4hri.files import open_file, replace_file

from sense4hri_recording.errors import LATEST_NS

NAME = "metadata.yaml"
METADATA_VERSION = 9
LARGEST_BYTES, DEEPEST = 8 << 20, 16
MOST_DEPTH = 100_000  # of a queue
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's is there or not


@dataclass(eq=False)
class Channel:
    """One topic of one type.

    qos: as rosbag2 spells it, one entry per publisher. definition: text of the type and all nested ones (`ros2msg`).
    state: the topic's newest message holds until the next one (transient local), so every file must begin with it.
    publishers: how many there are now; 0 where that is not known. gone: the last of them has left.
    """

    topic: str
    type_name: str
    type_hash: str
    qos: list[dict[str, Any]]
    definition: str = ""
    state: bool = False
    publishers: int = 0
    gone: bool = False


class File(NamedTuple):
    """One file of a bag. first_ns, last_ns: log times, 0 where it is empty."""

    name: str
    first_ns: int
    last_ns: int
    messages: int


class Contents(NamedTuple):
    """What is in a file: the entry of metadata.yaml, and how many messages by channel."""

    file: File
    messages: dict[Channel, int]


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]  # libyaml's is there or not
    """YAML without anchors: equal values are written out; what is no UTF-8, as a file's name may be, in escapes."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_str(self, data: str) -> Any:
        return super().represent_str(data.encode("utf-8", "backslashreplace").decode())


_Dumper.add_representer(str, _Dumper.represent_str)


def qos_text(qos: list[dict[str, Any]]) -> str:
    """QoS as a channel's metadata carries it."""
    return yaml.dump(qos, Dumper=_Dumper, sort_keys=False).strip()


def metadata(files: Sequence[File], messages: Mapping[Channel, int], ros_distro: str) -> dict[str, Any]:
    """The content of metadata.yaml. files: in their order. messages: in all of them, by channel."""
    filled = [file for file in files if file.messages]
    first_ns = min((file.first_ns for file in filled), default=0)
    last_ns = max((file.last_ns for file in filled), default=0)
    topics = [
        {
            "topic_metadata": {
                "name": channel.topic,
                "type": channel.type_name,
                "serialization_format": "cdr",
                "offered_qos_profiles": channel.qos,
                "type_description_hash": channel.type_hash,
            },
            "message_count": count,
        }
        for channel, count in messages.items()
    ]
    return {
        "rosbag2_bagfile_information": {
            "version": METADATA_VERSION,
            "storage_identifier": "mcap",
            **_times(first_ns, last_ns),
            "message_count": sum(file.messages for file in files),
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.name for file in files],
            "files": [
                {"path": file.name, **_times(file.first_ns, file.last_ns), "message_count": file.messages}
                for file in files
            ],
            "custom_data": None,
            "ros_distro": ros_distro,
        }
    }


def describe(folder: Path, found: Sequence[Contents], ros_distro: str) -> None:
    """Make a folder's metadata.yaml describe these files, in this order."""
    channels: dict[tuple[str, str], Channel] = {}
    messages: Counter[Channel] = Counter()
    for each in found:
        for channel, count in each.messages.items():
            messages[channels.setdefault((channel.topic, channel.type_name), channel)] += count
    write_metadata(folder, metadata([each.file for each in found], messages, ros_distro))


def write_metadata(folder: Path, content: dict[str, Any]) -> None:
    """Replace a folder's metadata.yaml, whole or not at all."""
    replace_file(folder / NAME, yaml.dump(content, Dumper=_Dumper, sort_keys=False))


def distro(folder: Path) -> str:
    """The ROS distribution that a folder's metadata.yaml names, `jazzy` where it is absent or damaged."""
    return str(_about(folder).get("ros_distro") or "jazzy")


def named_files(folder: Path) -> list[Path]:
    """The files that a folder's metadata.yaml names; none where it is absent or damaged."""
    named = _about(folder).get("relative_file_paths")
    texts = [name for name in named if isinstance(name, str)] if isinstance(named, list) else []
    # older versions of rosbag2 write the folder's name in front
    return list(dict.fromkeys(folder / name for text in texts if (name := Path(text).name)))


def is_of_another_storage(folder: Path) -> bool:
    """True where metadata.yaml says that the files are no plain MCAP: sqlite3, or compressed as a whole."""
    about = _about(folder)
    return bool(about) and (about.get("storage_identifier") != "mcap" or bool(about.get("compression_mode")))


def _about(folder: Path) -> dict[str, Any]:
    try:
        with open_file(folder / NAME, LARGEST_BYTES) as file:
            content = parse(file.read().decode())
        found = content["rosbag2_bagfile_information"]
    except (OSError, ValueError, LookupError, TypeError):
        return {}
    return found if isinstance(found, dict) else {}


def offers(text: str) -> list[dict[str, Any]]:
    """Publishers' QoS as a channel carries it; what is damaged is left out."""
    try:
        found = parse(text)
    except ValueError:
        return []
    return [_agreed(entry) for entry in found if isinstance(entry, dict)] if isinstance(found, list) else []


def _agreed(entry: dict[Any, Any]) -> dict[str, Any]:
    """What of one publisher's QoS is of the kind that rosbag2 writes: words, numbers, durations."""
    return {str(name): value for name, value in entry.items() if _is_word(value) or _is_duration(value)}


def _is_word(value: object) -> bool:
    return isinstance(value, str) or (isinstance(value, int) and 0 <= value <= MOST_DEPTH)


def _is_duration(value: object) -> bool:
    return isinstance(value, dict) and all(isinstance(part, int) and abs(part) <= LATEST_NS for part in value.values())


def _checked(text: str) -> None:
    """Raise ValueError for YAML that stands for more than is written, or is nested too deeply."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError(f"it has aliases, or is nested deeper than {DEEPEST} levels")


def parse(text: str) -> Any:
    """YAML that somebody else wrote. Raises ValueError where it is none, has aliases or is nested too deeply."""
    try:
        _checked(text)
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, OverflowError, LookupError, TypeError, AttributeError) as err:
        raise ValueError(f"no YAML: {err}") from err


def _times(first_ns: int, last_ns: int) -> dict[str, Any]:
    return {
        "starting_time": {"nanoseconds_since_epoch": first_ns},
        "duration": {"nanoseconds": max(last_ns - first_ns, 0)},
    }

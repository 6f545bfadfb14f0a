"""Opens recordings: sessions of the recorder with all their parts, `.mcap` files, rosbag2 folders of older storages."""

from __future__ import annotations

from pathlib import Path

from sense4hri_recording import rosbag2
from sense4hri_recording.parts import find

from replay.mcap_recording import McapRecording
from replay.older import OlderRecording
from replay.recorded import BagError, Recording, one_sentence


def open_recording(path: Path, only_this_part: bool = False) -> Recording:
    """Open a session by any of its folders or its id, or any other recording. Raises BagError that says why not.

    only_this_part: leave out the other folders of a session whose recorder was killed.
    """
    with one_sentence(path):
        folders = find(path, only_this_part)
        recording = _opened(folders)
    if not any(topic.messages for topic in recording.topics):
        recording.close()
        raise BagError(f"{path} holds no message")
    return recording


def _opened(folders: list[Path]) -> Recording:
    first = folders[0]
    if first.is_file() and first.suffix != ".mcap":
        raise BagError(f"{first} is neither a .mcap file nor a rosbag2 folder")
    if len(folders) == 1 and rosbag2.is_of_another_storage(first):
        return OlderRecording(first)
    return McapRecording(folders)

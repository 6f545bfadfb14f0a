"""Reading recordings, whole, foreign and damaged."""

import random
from pathlib import Path

import pytest
import yaml
from mcap.writer import CompressionType, Writer
from replay.bag import open_recording
from replay.recorded import BagError
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore

STRING = b"string data\n"
ONE = b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00"
NEVER = QosTime(0, 0)
LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    NEVER,
    NEVER,
    QosLiveliness.AUTOMATIC,
    NEVER,
    False,
)


def write_mcap(path: Path, stamps, topic="/a", encoding="cdr", finish=True, compression=CompressionType.ZSTD) -> None:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=200, compression=compression)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", STRING)
        channel = writer.register_channel(topic, encoding, schema, {"offered_qos_profiles": "- reliability: reliable"})
        for stamp in stamps:
            writer.add_message(channel, stamp, ONE, stamp)
        if finish:
            writer.finish()


def played(path: Path, from_ns: int = 0) -> list[int]:
    recording = open_recording(path)
    try:
        assert recording.start_ns <= recording.end_ns
        return [m.log_ns for m in recording.messages([t.name for t in recording.topics], from_ns)]
    finally:
        recording.close()


def test_a_lone_file_is_read_in_order_of_log_time(tmp_path):
    """Messages come in order of receipt, from wherever is asked, with bytes, type and QoS."""
    write_mcap(tmp_path / "a.mcap", [5, 3, 9, 7])
    assert played(tmp_path / "a.mcap") == [3, 5, 7, 9]
    assert played(tmp_path / "a.mcap", 6) == [7, 9]
    recording = open_recording(tmp_path / "a.mcap")
    (topic,) = recording.topics
    assert (topic.type_name, topic.messages, topic.offers) == ("std_msgs/msg/String", 4, [{"reliability": "reliable"}])
    assert {message.cdr for message in recording.messages(["/a"], 0)} == {ONE}
    recording.close()


def test_a_folder_of_splits_is_one_recording(tmp_path):
    """All files of a folder are played as one, whether metadata.yaml names them or is missing."""
    write_mcap(tmp_path / "r_0.mcap", [1, 2])
    write_mcap(tmp_path / "r_1.mcap", [3, 4])
    assert played(tmp_path) == [1, 2, 3, 4]
    about = {"storage_identifier": "mcap", "compression_mode": "", "relative_file_paths": ["r_1.mcap"]}
    (tmp_path / "metadata.yaml").write_text(yaml.dump({"rosbag2_bagfile_information": about}))
    assert played(tmp_path) == [3, 4]


@pytest.mark.parametrize("files", [1, 2])
def test_a_clock_that_was_set_back_while_recording_is_noticed(tmp_path, files):
    """By how much, in one file and between two; a message that waited is no such clock."""
    seconds = [s / 10 for s in (*range(100), 95, *range(100, 200))]
    for name, back_s in (("steady", 0.0), ("set", 5.0)):
        stamps = [round((1e9 + s - (back_s if s >= 15 else 0)) * 1e9) for s in seconds]
        (tmp_path / name).mkdir()
        for number, part in enumerate([stamps] if files == 1 else [stamps[:151], stamps[151:]]):
            write_mcap(tmp_path / name / f"r_{number}.mcap", part)
        recording = open_recording(tmp_path / name)
        assert recording.set_back_s == pytest.approx(back_s, abs=0.2)
        recording.close()


def test_an_older_sqlite3_recording_is_read(tmp_path):
    """rosbag2's sqlite3 folders are played with their QoS."""
    with Rosbag2Writer(tmp_path / "old", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        store = get_typestore(Stores.ROS2_HUMBLE)
        connection = writer.add_connection("/a", "std_msgs/msg/String", typestore=store, offered_qos_profiles=[LATCHED])
        for stamp in (10, 20, 30):
            writer.write(connection, stamp, ONE)
    assert played(tmp_path / "old") == [10, 20, 30]
    assert played(tmp_path / "old", 20) == [20, 30]
    recording = open_recording(tmp_path / "old")
    assert recording.topics[0].offers[0]["durability"] == "transient_local"
    assert (recording.start_ns, recording.end_ns) == (10, 30)
    recording.close()


def test_a_topic_that_is_not_of_ros_2_is_marked(tmp_path):
    """A channel in another encoding is not played as cdr; the reason names the encoding."""
    write_mcap(tmp_path / "a.mcap", [1], encoding="json")
    recording = open_recording(tmp_path / "a.mcap")
    assert "json" in recording.topics[0].refused
    recording.close()


def test_what_is_no_recording_is_refused_with_a_sentence(tmp_path):
    """Nothing there, a foreign file, an empty folder, an empty or unfinished recording: each says what is wrong."""
    (tmp_path / "text.mcap").write_text("not a recording at all, and long enough to hold a footer" * 3)
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "a.db3").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "wrong").mkdir()
    (tmp_path / "wrong" / "metadata.yaml").write_text("{}")
    write_mcap(tmp_path / "silent.mcap", [])
    write_mcap(tmp_path / "cut.mcap", range(100), finish=False)
    sentences = {
        "missing": "no such file",
        "text.mcap": "no MCAP file",
        "empty.mcap": "no MCAP file",
        "a.db3": "neither a .mcap file nor",
        "folder": "no recording here",
        "wrong": "no recording here",
        "silent.mcap": "holds no message",
        "cut.mcap": "sense4hri-repair",
    }
    for name, sentence in sentences.items():
        with pytest.raises(BagError, match=sentence):
            open_recording(tmp_path / name)


def test_a_file_that_metadata_names_and_is_gone_is_named(tmp_path):
    """A split that was not copied is an error, not a shorter recording."""
    about = {"storage_identifier": "mcap", "compression_mode": "", "relative_file_paths": ["r_0.mcap"]}
    (tmp_path / "metadata.yaml").write_text(yaml.dump({"rosbag2_bagfile_information": about}))
    with pytest.raises(BagError, match=r"r_0\.mcap"):
        open_recording(tmp_path)


def test_damage_never_raises_anything_else(tmp_path):
    """Bits flipped or the end cut off anywhere: it plays, or one sentence says that it cannot."""
    write_mcap(tmp_path / "a.mcap", range(0, 600, 3))
    whole, chance = (tmp_path / "a.mcap").read_bytes(), random.Random(4)
    sentences = []
    for number in range(400):
        data = bytearray(whole)
        if number % 2:
            for _ in range(chance.randint(1, 4)):
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        else:
            del data[chance.randrange(len(data)) :]
        (tmp_path / "b.mcap").write_bytes(data)
        try:
            played(tmp_path / "b.mcap")
        except BagError as err:
            sentences.append(str(err))
    assert len(sentences) > 300
    assert all("b.mcap" in sentence for sentence in sentences)

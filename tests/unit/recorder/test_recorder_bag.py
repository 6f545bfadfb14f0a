"""What the recorder writes, read back by other people's readers."""

import os
import shutil
import struct
import time
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from recorder import bag as bag_module
from recorder.bag import Bag, Channel, new_directory
from recorder.repair import main as repair_main
from recorder.repair import repair
from rosbags.highlevel import AnyReader

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
QOS = {
    "history": "unknown",
    "depth": 0,
    "reliability": "reliable",
    "durability": "transient_local",
    "deadline": {"sec": 9223372036, "nsec": 854775807},
    "lifespan": {"sec": 9223372036, "nsec": 854775807},
    "liveliness": "automatic",
    "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
    "avoid_ros_namespace_conventions": False,
}


def cdr_string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


def string_channel(bag: Bag, topic: str = "/study/x", qos: dict | None = None) -> Channel:
    return bag.channel(topic, "std_msgs/msg/String", "string data\n", STRING_HASH, [qos or QOS])


def wait_for(condition, what: str, seconds: float = 10.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        time.sleep(0.01)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A finished recording of 500 messages on one topic and one on another."""
    bag = Bag(new_directory(tmp_path, 0.0), 0.02)
    first, second = string_channel(bag), string_channel(bag, "/study/y", QOS | {"durability": "volatile"})
    for i in range(500):
        bag.write(first, cdr_string(f"number {i}"), START_NS + i * 1_000_000, START_NS + i, i)
        if i % 100 == 0:
            time.sleep(0.03)
    bag.write(second, cdr_string("once"), START_NS, START_NS)
    bag.close()
    return bag.directory


def test_rosbags_reads_it(recording):
    """AnyReader finds every message of every topic, with its type, in order."""
    with AnyReader([recording]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == {"/study/x": 500, "/study/y": 1}
        texts = [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages() if c.topic == "/study/x"]
    assert texts == [f"number {i}" for i in range(500)]


def test_mcap_ros2_reads_it(recording):
    """mcap-ros2-support decodes by the schema in the file; log time is receipt, publish time the header's stamp."""
    with next(recording.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = [(message, ros) for _, _, message, ros in reader.iter_decoded_messages(["/study/x"])]
    assert [ros.data for _, ros in found] == [f"number {i}" for i in range(500)]
    assert found[7][0].log_time == START_NS + 7_000_000
    assert found[7][0].publish_time == START_NS + 7


def test_the_metadata_is_rosbag2s_and_agrees_with_the_channels(recording):
    """Version 9 with every field; each topic's QoS and hash are the same in the yaml and in the file."""
    text = (recording / "metadata.yaml").read_text()
    assert "&id" not in text
    about = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert (about["version"], about["storage_identifier"], about["message_count"]) == (9, "mcap", 501)
    assert about["relative_file_paths"] == [path.name for path in recording.glob("*.mcap")]
    assert about["starting_time"]["nanoseconds_since_epoch"] == START_NS
    assert about["duration"]["nanoseconds"] == 499_000_000
    with next(recording.glob("*.mcap")).open("rb") as file:
        channels = {c.topic: c for c in make_reader(file).get_summary().channels.values()}
    for topic in about["topics_with_message_count"]:
        metadata = topic["topic_metadata"]
        channel = channels[metadata["name"]]
        assert yaml.safe_load(channel.metadata["offered_qos_profiles"]) == metadata["offered_qos_profiles"]
        assert channel.metadata["topic_type_hash"] == metadata["type_description_hash"] == STRING_HASH


def test_nothing_is_ever_overwritten(tmp_path):
    """Two recordings of the same second get folders of their own."""
    names = [new_directory(tmp_path, 1_700_000_000.0).name for _ in range(3)]
    assert names == ["20231114T221320Z", "20231114T221320Z_1", "20231114T221320Z_2"]


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_an_unfinished_file_is_repaired_to_the_last_flush(tmp_path, compression):
    """Without its end, as after a SIGKILL, the file gives every flushed message, and the folder reads again."""
    bag = Bag(new_directory(tmp_path, 0.0), 0.02, compression)
    channel = string_channel(bag)
    for i in range(100):
        bag.write(channel, cdr_string(str(i)), START_NS + i, START_NS + i)
    wait_for(lambda: bag.counts.on_disk == 100, "flushed")
    copy = tmp_path / "killed"
    copy.mkdir()
    for path in (bag.file, bag.directory / "metadata.yaml"):
        (copy / path.name).write_bytes(path.read_bytes())
    bag.close()
    assert repair_main([str(copy)]) == 0
    with AnyReader([copy]) as reader:
        assert [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages()] == [*map(str, range(100))]


def test_a_damaged_chunk_costs_only_itself(recording):
    """A flipped byte in the middle loses the messages of that chunk; those before and behind are saved."""
    file = next(recording.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    with file.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert len(chunks) >= 4
    victim = chunks[len(chunks) // 2]
    data[victim.chunk_start_offset + victim.chunk_length - 10] ^= 0xFF
    damaged = file.with_name("damaged.mcap")
    damaged.write_bytes(data)
    done = repair(damaged)
    assert (done.damaged_chunks, done.chunks) == (1, len(chunks) - 1)
    assert 501 - 130 <= done.messages < 501


@pytest.mark.parametrize("size", [0, 3, 100])
def test_a_file_with_nothing_in_it_is_not_called_repaired(recording, size):
    """Where no message can be saved the tool says so, exits 1 and leaves no file behind."""
    stub = recording / "stub.mcap"
    stub.write_bytes(next(recording.glob("*_0.mcap")).read_bytes()[:size])
    assert repair_main([str(stub)]) == 1
    assert not (recording / "stub_repaired.mcap").exists()


def test_a_full_disk_keeps_what_is_there_and_counts_the_rest(tmp_path, monkeypatch):
    """A write the disk refuses half-way leaves no torn chunk; when there is room again recording goes on."""
    room = [10_000]
    real = os.pwrite

    def pwrite(fd: int, data: bytes, offset: int) -> int:
        if offset + len(data) <= room[0]:
            return real(fd, data, offset)
        if offset < room[0]:
            return real(fd, data[: room[0] - offset], offset)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "pwrite", pwrite)
    monkeypatch.setattr(bag_module, "RETRY_S", 0.05)
    bag = Bag(new_directory(tmp_path, 0.0), 0.01, "none")
    channel = string_channel(bag)
    written = 0

    def write_some() -> None:
        nonlocal written
        for _ in range(10):
            bag.write(channel, cdr_string(f"{written:04d}" * 20), START_NS + written, START_NS)
            written += 1
        time.sleep(0.02)

    def failed() -> bool:
        write_some()
        return bool(bag.counts.failure)

    wait_for(failed, "the disk is full")
    assert "No space left on device" in bag.counts.failure
    size = bag.file.stat().st_size
    assert size <= 10_000
    assert repair(bag.file).stopped_at == size  # whole records up to the last byte
    wait_for(lambda: (write_some(), bag.counts.lost > 20)[1], "messages are lost")
    room[0] = 10_000_000
    wait_for(lambda: (write_some(), not bag.counts.failure)[1], "there is room again")
    bag.close()
    assert bag.counts.messages + bag.counts.lost == written
    with AnyReader([bag.file]) as reader:
        assert sum(1 for _ in reader.messages()) == bag.counts.messages


def test_writing_never_waits_for_the_disk(tmp_path, monkeypatch):
    """While the disk hangs, `write` returns at once; beyond the queue's limit messages are counted as lost."""
    monkeypatch.setattr(bag_module, "QUEUE_BYTES", 10_000)
    bag = Bag(new_directory(tmp_path, 0.0), 5.0)
    channel = string_channel(bag)
    message = cdr_string("x" * 985)
    for _ in range(30):
        bag.write(channel, message, START_NS, START_NS)
    assert bag.counts.lost == 20
    bag.close()
    assert bag.counts.messages == 10


def test_a_folder_that_is_taken_away_is_said(tmp_path, monkeypatch):
    """A recording whose folder was deleted does not pretend to be one; nothing crashes."""
    monkeypatch.setattr(bag_module, "METADATA_INTERVAL_S", 0.0)
    bag = Bag(new_directory(tmp_path, 0.0), 0.01)
    channel = string_channel(bag)
    shutil.rmtree(bag.directory)

    def failed() -> bool:
        bag.write(channel, cdr_string("x"), START_NS, START_NS)
        return bool(bag.counts.failure)

    wait_for(failed, "the failure is known")
    assert bag.free_bytes() > 0
    assert bag.counts.lost == 0
    bag.close()
    assert bag.counts.failure


def test_it_says_up_to_when_everything_is_on_the_disk(tmp_path):
    """What was written before a moment is safe once synced_ns has passed it; without news it passes all the same."""
    bag = Bag(new_directory(tmp_path, 0.0), 0.01)
    channel = string_channel(bag)
    for _ in range(2):
        bag.write(channel, cdr_string("x"), START_NS, START_NS)
        written_ns = time.time_ns()
        wait_for(lambda until=written_ns: bag.synced_ns > until, "it is safe")
        assert bag.counts.on_disk == bag.counts.messages
        later_ns = time.time_ns()
        wait_for(lambda until=later_ns: bag.synced_ns > until, "nothing new is safe too")
    bag.close()

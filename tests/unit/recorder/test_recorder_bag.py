"""What the recorder writes, read back by other people's readers."""

import errno
import json
import os
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from processes import poll
from recorder import bag as bag_module
from recorder.about import session, software
from recorder.account import QUEUE, Hole
from recorder.bag import Bag
from recorder.heads import Heads
from recorder.split import Entry, Output
from recorder.told import Limits
from rosbags.highlevel import AnyReader
from sense4hri_msgs.msg import SessionState
from sense4hri_recording import repair as repair_module
from sense4hri_recording.layout import new_directory, utc
from sense4hri_recording.lock import Lock
from sense4hri_recording.repair import contents, repair
from sense4hri_recording.repair import main as repair_main
from sense4hri_session.identities import FIXED
from string_messages import QOS, START_NS, STRING_HASH, cdr_string, string_channel


def new_bag(parent: Path, limits: Limits | None = None, **more) -> Bag:
    return Bag(new_directory(parent, "20231114T221320Z"), limits, **more)


def sidecar(bag: Bag) -> dict:
    return json.loads((bag.directory / "recorder.json").read_text())


def file_of(bag: Bag) -> Path:
    return bag.directory / f"{bag.directory.name}_0.mcap"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A finished recording of 500 messages on one topic and one on another."""
    return recorded(tmp_path)


def recorded(parent: Path, compression: str = "zstd") -> Path:
    bag = new_bag(parent, Limits(compression))
    first, second = string_channel(), string_channel("/study/y", QOS | {"durability": "volatile"})
    for i in range(500):
        bag.write(first, cdr_string(f"number {i}"), START_NS + i * 1_000_000, START_NS + i, i)
        if i % 100 == 0:
            bag.flush()
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


def test_no_host_that_is_called_as_a_key_takes_it_out_of_what_is_shared(recording):
    """`--share` leaves alone what keys of metadata.yaml and recorder.json consist of, whoever's host is called so."""
    about = json.loads((recording / "recorder.json").read_text())
    about |= {"session": session(SessionState()), "software": software(), "losses": Hole(0, 1, 1, QUEUE).as_json()}
    told = [about, yaml.safe_load((recording / "metadata.yaml").read_text())]
    keys = {key for one in told for key in keys_of(one)}
    assert {word for key in keys for word in key.split("_")} <= FIXED


def keys_of(value):
    """The keys of all objects in it."""
    for item in value.values() if isinstance(value, dict) else value if isinstance(value, list) else []:
        yield from keys_of(item)
    yield from value if isinstance(value, dict) else []


def test_nothing_is_ever_overwritten(tmp_path):
    """Two recordings of the same second get folders of their own."""
    names = [new_directory(tmp_path, utc(1_700_000_000.0)).name for _ in range(3)]
    assert names == ["20231114T221320Z", "20231114T221320Z_1", "20231114T221320Z_2"]


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_an_unfinished_file_is_repaired_to_the_last_flush(tmp_path, compression):
    """Without its end, as after a SIGKILL, the file gives every flushed message, and the folder reads again."""
    bag = new_bag(tmp_path, Limits(compression))
    channel = string_channel()
    for i in range(100):
        bag.write(channel, cdr_string(str(i)), START_NS + i, START_NS + i)
        if i % 30 == 0:
            bag.flush()
    bag.flush()
    copy = tmp_path / "killed"
    copy.mkdir()
    for path in (file_of(bag), bag.directory / "metadata.yaml"):
        (copy / path.name).write_bytes(path.read_bytes())
    bag.close()
    assert repair_main([str(copy)]) == 0
    with AnyReader([copy]) as reader:
        assert [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages()] == [*map(str, range(100))]


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_a_damaged_chunk_costs_only_itself(tmp_path, compression):
    """A flipped byte in the middle loses the messages of that chunk; those before and behind are saved."""
    file = next(recorded(tmp_path, compression).glob("*.mcap"))
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


@pytest.mark.parametrize(
    ("done_to_it", "said"),
    [("a bit flips", ""), ("a message is missing", "500 could be read back"), ("full", "No space")],
)
def test_a_repair_that_cannot_be_read_back_leaves_nothing(recording, monkeypatch, capsys, done_to_it, said):
    """What the disk made of the repaired file is checked before it counts: metadata.yaml never points at a bad one."""
    file = next(recording.glob("*_0.mcap"))
    file.write_bytes(file.read_bytes()[:-100])
    metadata = (recording / "metadata.yaml").read_bytes()
    target = file.with_name(f"{file.stem}_repaired.mcap")

    def fsync(fd: int) -> None:
        if done_to_it == "full":
            raise OSError(28, "No space left on device")
        data = bytearray(target.read_bytes())
        data[200] ^= 1  # in the first chunk
        target.write_bytes(data)

    if done_to_it == "a message is missing":
        monkeypatch.setattr(repair_module, "_readable", lambda path: 500)
    else:
        monkeypatch.setattr(os, "fsync", fsync)
    assert repair_main([str(recording)]) == 1
    assert f"{file}: not repaired: " in (told := capsys.readouterr().err)
    assert said in told
    assert not target.exists()
    assert (recording / "metadata.yaml").read_bytes() == metadata


@pytest.mark.parametrize("name", ["metadata.yaml", ".metadata.yaml", "repaired"])
def test_a_folder_in_a_files_place_is_said_and_nothing_is_left_beside_it(recording, capsys, name):
    """Where metadata.yaml, its half or the repaired file is a folder the tool says so and exits 1."""
    file = next(recording.glob("*_0.mcap"))
    file.write_bytes(file.read_bytes()[:-100])
    folder = recording / name if name != "repaired" else file.with_name(f"{file.stem}_repaired.mcap")
    if folder.exists():
        folder.unlink()
    folder.mkdir()
    assert repair_main([str(recording)]) == 1
    told = capsys.readouterr().err
    assert "not repaired: " in told
    assert f"Is a directory: '{folder.parent}" in told
    assert folder.is_dir()
    assert [path.name for path in recording.glob(".metadata*") if path != folder] == []


def test_a_folder_named_as_the_repaired_file_of_a_whole_one_changes_nothing(recording):
    """The file itself stays what metadata.yaml names."""
    file = next(recording.glob("*_0.mcap"))
    file.with_name(f"{file.stem}_repaired.mcap").mkdir()
    assert repair_main([str(recording)]) == 0
    assert file.name in (recording / "metadata.yaml").read_text()


class SmallDisk:
    """os.pwrite on a disk with so much room left."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, room: int) -> None:
        self.room, self._real = room, os.pwrite
        monkeypatch.setattr(os, "pwrite", self.pwrite)
        monkeypatch.setattr(bag_module, "RETRY_S", 0.0)

    def pwrite(self, fd: int, data: bytes, offset: int) -> int:
        if offset + len(data) <= self.room:
            return self._real(fd, data, offset)
        if offset < self.room:
            return self._real(fd, data[: self.room - offset], offset)
        raise OSError(28, "No space left on device")


def test_a_full_disk_keeps_what_is_there_and_counts_the_rest(tmp_path, monkeypatch):
    """A write the disk refuses half-way leaves no torn chunk; with room again it goes on; the hole is exact."""
    disk = SmallDisk(monkeypatch, 10_000)
    bag, channel = new_bag(tmp_path, Limits("none")), string_channel()
    written = 0

    def write_some() -> None:
        nonlocal written
        for _ in range(10):
            bag.write(channel, cdr_string(f"{written:04d}" * 20), START_NS + written, START_NS)
            written += 1
        bag.flush()

    while not bag.failure:
        write_some()
    assert "No space left on device" in bag.failure
    kept = written
    size = file_of(bag).stat().st_size
    assert size <= 10_000
    assert repair(file_of(bag)).stopped_at == size  # whole records up to the last byte
    write_some()
    write_some()
    disk.room = 10_000_000
    write_some()
    lost = written - kept
    assert not bag.failure
    write_some()
    bag.close()
    (topic,) = sidecar(bag)["topics"]
    assert (topic["messages"], topic["lost"]) == (written - lost, lost)
    hole = {"after_ns": START_NS + kept - 1, "before_ns": START_NS + kept + lost, "count": lost, "cause": "disk"}
    assert topic["losses"] == [hole]
    with AnyReader([file_of(bag)]) as reader:
        assert sum(1 for _ in reader.messages()) == topic["messages"]


def test_what_could_not_be_synced_once_stays_in_doubt(tmp_path, monkeypatch):
    """The kernel tells a failed fsync once; a later one that succeeds, and the metadata, do not make the bag good."""
    bag = new_bag(tmp_path)
    bag.write(string_channel(), cdr_string("x"), START_NS, START_NS)
    with monkeypatch.context() as patched:
        patched.setattr(Output, "sync", refused)
        bag.close()
    assert "Input/output error" in bag.failure


def test_after_a_failed_sync_nothing_is_said_to_be_on_the_disk(tmp_path, monkeypatch):
    """The last good sync stays the last, also when a later one succeeds: what lies between may be gone."""
    bag = new_bag(tmp_path)

    def flushed() -> int:
        bag.write(string_channel(), cdr_string("x"), START_NS, START_NS)
        bag.flush()
        return bag.last_synced_ns

    good_ns = flushed()
    assert good_ns > 0
    with monkeypatch.context() as patched:
        patched.setattr(Output, "sync", refused)
        assert flushed() == good_ns
    assert flushed() == good_ns


def refused(output: Output) -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def test_a_disk_that_stays_full_costs_what_was_not_flushed(tmp_path, monkeypatch):
    """Closed on a full disk, the recording says it is interrupted and counts the messages that are not in the file."""
    SmallDisk(monkeypatch, 3_000)
    bag, channel = new_bag(tmp_path, Limits("none")), string_channel()
    for i in range(10):
        bag.write(channel, cdr_string("x" * 500), START_NS + i, START_NS)
        bag.flush()
    bag.close()
    about = sidecar(bag)
    assert (about["state"], "No space left" in about["why"]) == ("interrupted", True)
    found = repair(file_of(bag)).messages
    assert about["topics"][0]["messages"] == found > 0
    assert about["topics"][0]["lost"] == 10 - found


def test_a_recording_that_cannot_be_begun_leaves_nothing(tmp_path, monkeypatch):
    """Where the disk refuses the first byte no folder stays behind."""
    SmallDisk(monkeypatch, 0)
    with pytest.raises(OSError, match="No space"):
        new_bag(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_files_are_split_and_read_as_one(tmp_path):
    """A bag of many files holds every message once, in order; metadata.yaml lists the files with their counts."""
    bag, channel = new_bag(tmp_path, Limits("none", split_bytes=5_000)), string_channel()
    for i in range(200):
        bag.write(channel, cdr_string(f"{i:04d}" * 20), START_NS + i, START_NS)
        bag.flush()
    bag.close()
    about = yaml.safe_load((bag.directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    names = about["relative_file_paths"]
    assert names == [f"{bag.directory.name}_{i}.mcap" for i in range(len(names))]
    assert len(names) > 3
    assert sum(file["message_count"] for file in about["files"]) == about["message_count"] == 200
    with AnyReader([bag.directory]) as reader:
        texts = [reader.deserialize(raw, c.msgtype).data[:4] for c, _, raw in reader.messages()]
    assert texts == [f"{i:04d}" for i in range(200)]


def test_files_are_split_by_time(tmp_path):
    """After split_s a further file is begun, whether or not anything comes."""
    bag, channel = new_bag(tmp_path, Limits(split_s=0.05)), string_channel()
    bag.write(channel, cdr_string("x"), START_NS, START_NS)
    poll(lambda: (bag.flush(), len(list(bag.directory.glob("*.mcap"))) == 3)[1], "three files")
    bag.close()
    with AnyReader([bag.directory]) as reader:
        assert sum(1 for _ in reader.messages()) == 1


def test_every_file_begins_with_what_still_holds(tmp_path):
    """The newest message of a transient-local topic stands at the head of each file, numbered 0; older ones do not."""
    heads, latched, plain = Heads(), string_channel("/study/sensors"), string_channel("/study/x")
    latched.state = True
    bag = new_bag(tmp_path, Limits("none", split_bytes=2_000), heads=heads)
    for entry in [
        Entry(latched, cdr_string("old"), START_NS, START_NS, 1),
        Entry(latched, cdr_string("new"), START_NS + 1, START_NS + 1, 2),
        *(Entry(plain, cdr_string("x" * 300), START_NS + i, START_NS, i) for i in range(2, 20)),
    ]:
        heads.keep(entry)
        bag.add(entry)
        bag.flush()
    bag.close()
    files = sorted(bag.directory.glob("*.mcap"))
    assert len(files) > 2
    for file in files[1:]:
        with file.open("rb") as stream:
            _, channel, first = next(make_reader(stream).iter_messages())
        assert (channel.topic, first.data, first.sequence) == ("/study/sensors", cdr_string("new"), 0)
        assert (first.log_time, first.publish_time) == (START_NS + 1, START_NS + 1)
    assert {t["topic"]: t["messages"] for t in sidecar(bag)["topics"]} == {"/study/sensors": 2, "/study/x": 18}


@pytest.mark.parametrize("received_s", [-60.0, 3600.0])
def test_what_holds_is_read_before_what_was_received_as_the_file_began(tmp_path, received_s):
    """Of messages in different queues the one that was received first is not written first; a clock may step back."""
    heads, latched = Heads(), string_channel("/study/session")
    latched.state = True
    heads.keep(Entry(latched, cdr_string("before"), START_NS + round(received_s * 1e9), START_NS, 1))
    bag = new_bag(tmp_path, heads=heads, at_ns=START_NS)
    bag.write(latched, cdr_string("after"), START_NS - 100_000_000, START_NS, 2)
    bag.close()
    with AnyReader([bag.directory]) as reader:
        assert [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages()] == ["before", "after"]


@pytest.mark.parametrize("received_s", [-0.03, 0.03])
def test_what_holds_stands_at_its_own_receipt(received_s):
    """Nobody reads it before it was said, though the message with which the file began was received before it."""
    heads, latched = Heads(), string_channel("/study/session")
    latched.state = True
    received_ns = START_NS + round(received_s * 1e9)
    heads.keep(Entry(latched, cdr_string("x"), received_ns, START_NS, 1))
    assert [entry.log_ns for entry in heads.at(START_NS)] == [received_ns]


def test_of_several_publishers_the_newest_different_messages_hold():
    """Two publishers of one topic hold 16 different ones, in the order they came last; one publisher holds one."""
    heads, latched = Heads(), string_channel("/tf_static")
    latched.state, latched.publishers = True, 2
    for text in [*map(str, range(20)), "7"]:
        heads.keep(Entry(latched, cdr_string(text), START_NS, START_NS, 1))
    texts = [*map(str, range(4, 7)), *map(str, range(8, 20)), "7"]
    assert [entry.data for entry in heads.at(START_NS)] == [*map(cdr_string, texts)]
    latched.publishers = 1
    heads.keep(Entry(latched, cdr_string("last"), START_NS, START_NS, 1))
    assert [entry.data for entry in heads.at(START_NS)] == [cdr_string("last")]


def test_what_the_middleware_lost_is_placed_and_what_came_too_early_is_not_lost(tmp_path):
    """Numbers that were skipped are a hole before the message that told them; those missed at the start are apart."""
    bag, channel = new_bag(tmp_path), string_channel()
    bag.add(Entry(channel, cdr_string("a"), START_NS, START_NS, 4, missed=3))
    bag.add(Entry(channel, cdr_string("b"), START_NS + 5, START_NS, 7, lost=2))
    bag.close()
    (topic,) = sidecar(bag)["topics"]
    hole = {"after_ns": START_NS, "before_ns": START_NS + 5, "count": 2, "cause": "middleware"}
    assert (topic["missed_at_start"], topic["lost"], topic["losses"], bag.accounts.lost) == (3, 2, [hole], 2)


def test_a_file_deleted_under_the_recorder_is_said_and_counted(tmp_path):
    """What was in it counts as lost; the recording goes on in the next file and says so."""
    bag, channel = new_bag(tmp_path), string_channel()
    for i in range(5):
        bag.write(channel, cdr_string("x"), START_NS + i, START_NS)
    bag.flush()
    file_of(bag).unlink()
    bag.flush()
    bag.write(channel, cdr_string("after"), START_NS + 9, START_NS)
    bag.close()
    about = sidecar(bag)
    assert any("was deleted under the recorder with 5 messages" in event["what"] for event in about["events"])
    assert (about["topics"][0]["messages"], about["topics"][0]["lost"]) == (1, 5)
    with AnyReader([bag.directory]) as reader:
        assert [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages()] == ["after"]


def test_a_deleted_file_with_a_head_counts_no_message_that_never_came(tmp_path):
    """What was only repeated at its head is no loss, and nobody says that what was deleted is safe."""
    heads, latched = Heads(), string_channel("/study/sensors")
    latched.state = True
    heads.keep(Entry(latched, cdr_string("x"), START_NS, START_NS, 1))
    bag = new_bag(tmp_path, heads=heads)
    file_of(bag).unlink()
    bag.flush()
    assert (bag.accounts.messages, bag.accounts.lost) == (0, 0)
    bag.close()
    said = [event["what"] for event in sidecar(bag)["events"]]
    assert any("was deleted under the recorder with 0 messages; what was written to it is lost" in one for one in said)
    assert not any("is safe" in one for one in said)


def test_a_bag_is_written_by_one_recorder_only(tmp_path):
    """A folder that is being written cannot be opened for writing again; once closed its lock is free."""
    bag = new_bag(tmp_path)
    with pytest.raises(BlockingIOError):
        Lock(bag.directory)
    bag.close()
    Lock(bag.directory).release()


def test_a_stop_for_want_of_space_leaves_a_whole_file(tmp_path):
    """Paused, the file has its index and what comes is counted; afterwards a further file goes on."""
    bag, channel = new_bag(tmp_path), string_channel()
    for i, step in enumerate([None, bag.pause, None, None, bag.resume, None]):
        if step is not None:
            step(*(["12 MB left"] if step == bag.pause else []))
        bag.write(channel, cdr_string(str(i)), START_NS + i, START_NS)
        if i == 2:
            assert contents(file_of(bag)).file.messages == 1
        bag.flush()
    bag.close()
    with AnyReader([bag.directory]) as reader:
        texts = [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages()]
    assert texts == ["0", "4", "5"]
    about = sidecar(bag)
    assert about["topics"][0]["losses"][0]["count"] == about["topics"][0]["lost"] == 3
    assert "12 MB left" in about["events"][0]["what"]

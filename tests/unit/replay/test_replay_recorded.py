"""Playing what our recorder and the tools of others write, whole and broken."""

import random
import shutil
import struct
from itertools import product
from pathlib import Path

import pytest
from recorder.bag import Bag
from recorder.heads import Heads
from recorder.split import Entry
from recorder.told import About, Limits
from replay.bag import open_recording
from replay.recorded import LATCHED_DEPTH, BagError, Topic
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore
from sense4hri_recording import rosbag2
from sense4hri_recording.layout import new_directory
from sense4hri_recording.repair import main as repair
from sense4hri_recording.rosbag2 import Channel

SECOND = 10**9
START_NS = 1_700_000_000 * SECOND
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
SENSORS, STATE, PLAIN = "/study/sensors", "/humans/persons/known", "/study/x"


def cdr(text: str) -> bytes:
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


def said(message) -> str:
    return message.cdr[8:-1].decode(errors="replace")


def channel(topic: str, publishers: int = 1) -> Channel:
    latched = topic != PLAIN
    qos = {"reliability": "reliable", "durability": "transient_local" if latched else "volatile", "depth": 0}
    offers = [qos] * publishers
    return Channel(topic, "std_msgs/msg/String", STRING_HASH, offers, "string data\n", latched, publishers)


def played(path: Path, from_ns: int = 0) -> dict[str, list[str]]:
    """Texts by topic."""
    recording = open_recording(path)
    try:
        found: dict[str, list[str]] = {topic.name: [] for topic in recording.topics}
        for message in recording.messages(list(found), from_ns):
            found[message.topic.name].append(said(message))
        return found
    finally:
        recording.close()


def record(bag: Bag, heads: Heads, *, texts: dict[str, list[str]], count: int = 30, step_ns: int = 1) -> None:
    """The texts of the state topics first, again in the middle where there are more, and 300 bytes 30 times."""
    channels = {topic: channel(topic, 2 if topic == STATE else 1) for topic in (*texts, PLAIN)}
    entries = [
        Entry(channels[topic], cdr(text), 0, 0, 1 + i) for topic, all_ in texts.items() for i, text in enumerate(all_)
    ]
    plain = [Entry(channels[PLAIN], cdr(f"{i:0300}"), 0, 0, 1 + i) for i in range(count)]
    half = len(entries) // 2
    for i, entry in enumerate([*entries[:half], *plain[: count // 2], *entries[half:], *plain[count // 2 :]]):
        stamped = entry._replace(log_ns=START_NS + i * step_ns)
        heads.keep(stamped)
        bag.add(stamped)
        bag.flush()


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """A session's folder of our recorder, in several files; /humans/persons/known has two publishers."""
    heads = Heads()
    bag = Bag(new_directory(tmp_path / "study" / "p1", "s1_20231114T221320Z"), Limits(split_bytes=2000), heads=heads)
    record(bag, heads, texts={STATE: ["anna", "ben"], SENSORS: ["none", "one", "both"]})
    bag.close()
    assert len(list(bag.directory.glob("*.mcap"))) > 3
    return bag.directory


def test_what_stands_at_the_head_of_every_file_is_said_once(session):
    """Of a session in several files every message is played once, state topics of two publishers too."""
    found = played(session)
    assert found[STATE] == ["anna", "ben"]
    assert found[SENSORS] == ["none", "one", "both"]
    assert [int(text) for text in found[PLAIN]] == list(range(30))


@pytest.mark.parametrize("place", range(30))
def test_what_was_said_before_a_place_is_not_said_by_the_heads_after_it(tmp_path, place):
    """Played from the middle, the heads of further files repeat nothing, and a change is played."""
    heads = Heads()
    bag = Bag(new_directory(tmp_path, "s1_20231114T221320Z"), Limits(split_bytes=2000), heads=heads)
    record(bag, heads, texts={STATE: ["anna", "ben"], SENSORS: ["none", "one", "both"]}, step_ns=60 * SECOND)
    bag.close()
    recording, from_ns = open_recording(bag.directory), START_NS + place * 60 * SECOND
    held: dict[str, list[bytes]] = {STATE: [], SENSORS: []}
    for message in recording.messages(held.keys(), START_NS, from_ns):
        held[message.topic.name].append(message.cdr)
    found: dict[str, list[str]] = {STATE: [], SENSORS: []}
    for message in recording.messages(found.keys(), from_ns, held=held):
        found[message.topic.name].append(said(message))
    recording.close()
    assert found[STATE] == ["anna", "ben"][place:]
    assert found[SENSORS] == ["none", "one", "both"][max(0, place - 17) :]


def test_the_files_are_in_order_without_metadata(session):
    """File 10 comes after file 2; a folder whose metadata.yaml is gone plays the same."""
    whole = played(session)
    (session / "metadata.yaml").unlink()
    assert played(session) == whole


def test_a_state_said_again_is_said_again(tmp_path):
    """A publisher that repeats itself in a later file is heard twice: only what bears no number is a head."""
    heads = Heads()
    bag = Bag(new_directory(tmp_path, "20231114T221320Z"), Limits(split_bytes=2000), heads=heads)
    record(bag, heads, texts={SENSORS: ["same"] * 4})
    bag.close()
    assert played(bag.directory)[SENSORS] == ["same"] * 4


def test_a_continuation_says_what_held_before_it(tmp_path):
    """The further folder of a session whose recorder was started again begins with what held, and that is played."""
    heads = Heads()
    first = Bag(new_directory(tmp_path, "s1_20231114T221320Z"), Limits(), heads=heads)
    record(first, heads, texts={SENSORS: ["none", "one"]})
    first.close()
    second = Bag(new_directory(tmp_path, "s1_20231114T221320Z"), Limits(), heads=heads, at_ns=START_NS + 100)
    second.add(Entry(channel(PLAIN), cdr("on"), START_NS + 101, 0, 31))
    second.close()
    assert second.directory.name == "s1_20231114T221320Z_1"
    assert played(second.directory) == {SENSORS: ["one"], PLAIN: ["on"]}


def test_a_session_that_was_cut_off_is_played_after_its_repair(session, capsys):
    """Refused with the sentence that names the repair; after it, up to where it was cut, also without metadata.yaml."""
    last = max(session.glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns)
    whole = played(session)
    last.write_bytes(last.read_bytes()[:-200])
    with pytest.raises(BagError, match=rf"{last.name} was cut off.* `sense4hri-repair`"):
        open_recording(session)
    assert repair([str(session)]) == 0
    capsys.readouterr()
    found = played(session)
    assert found[STATE] == whole[STATE]
    assert found[PLAIN] == whole[PLAIN][: len(found[PLAIN])]
    (session / "metadata.yaml").unlink()
    assert played(session) == found


def write_with_rosbags(path: Path, version: int, plugin: StoragePlugin, mode: CompressionMode | None) -> None:
    writer = Rosbag2Writer(path, version=version, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        connection = writer.add_connection(PLAIN, "std_msgs/msg/String", typestore=store)
        for i in range(20):
            writer.write(connection, START_NS + i, cdr(str(i)))


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        *product(StoragePlugin, [None, CompressionMode.FILE, CompressionMode.MESSAGE]),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
    ],
)
def test_folders_of_others_are_played(tmp_path, plugin, version, mode):
    """rosbag2 folders in either storage, plain or compressed as a whole, by message or in the storage."""
    write_with_rosbags(tmp_path / "bag", version, plugin, mode)
    assert played(tmp_path / "bag") == {PLAIN: [str(i) for i in range(20)]}
    assert played(tmp_path / "bag", START_NS + 15) == {PLAIN: [str(i) for i in range(15, 20)]}


def test_what_ros2_bag_recorded_is_played(shared_data):
    """The file that rosbag2's own tests play: ten messages of a talker, in order."""
    recording = open_recording(shared_data / "rosbag/rosbag2_upstream/talker.mcap")
    found = [message.cdr for message in recording.messages(["/topic"], 0)]
    recording.close()
    assert len(found) == 10
    assert all(data.startswith(b"\0\1\0\0") for data in found)


def test_a_foreign_recording_is_refused_with_a_sentence(tmp_path):
    """ROS 1 bags, lone sqlite3 files and storages nobody here knows: named, with what is wrong."""
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    write_with_rosbags(tmp_path / "bag", 9, StoragePlugin.SQLITE3, None)
    (db3,) = (tmp_path / "bag").glob("*.db3")
    shutil.copytree(tmp_path / "bag", tmp_path / "unknown")
    listed = tmp_path / "unknown" / "metadata.yaml"
    listed.write_text(listed.read_text().replace("sqlite3", "parchment"))
    for path, words in (
        (tmp_path / "old.bag", "neither a .mcap file nor a rosbag2 folder"),
        (db3, "neither a .mcap file nor a rosbag2 folder"),
        (tmp_path / "unknown", "no rosbag2 recording.*parchment"),
    ):
        with pytest.raises(BagError, match=words) as refused:
            open_recording(path)
        assert str(path) in str(refused.value)


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_damage_anywhere_in_a_folder_is_one_sentence(tmp_path, plugin):
    """Data or metadata.yaml cut off or with flipped bits: played, or refused with one line that names it."""
    write_with_rosbags(tmp_path / "bag", 9, plugin, None)
    chance, sentences = random.Random(8), []
    for number in range(150):
        broken = tmp_path / f"broken_{number}"
        shutil.copytree(tmp_path / "bag", broken)
        file = chance.choice(sorted(broken.iterdir()))
        data = bytearray(file.read_bytes())
        if number % 2:
            for _ in range(chance.randint(1, 6)):
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        else:
            del data[chance.randrange(len(data)) :]
        file.write_bytes(data)
        try:
            played(broken)
        except BagError as err:
            sentences.append(str(err))
    assert len(sentences) > 50
    assert all("broken_" in sentence and "\n" not in sentence for sentence in sentences)


def test_a_session_in_two_folders_is_played_as_one(tmp_path):
    """Any folder, or the id, plays all parts with their pause and what holds once; only_this_part plays one alone."""
    folders = []
    for part, begins_ns in enumerate((START_NS, START_NS + 60 * SECOND)):
        about = About({"session_id": "s1", "start_at_ns": START_NS})
        bag = Bag(new_directory(tmp_path, "s1_20231114T221320Z"), Limits("none"), about=about)
        bag.add(Entry(channel(SENSORS), cdr("holds"), begins_ns, START_NS, 1))
        bag.add(Entry(channel(PLAIN), cdr(f"part {part}"), begins_ns + SECOND, 0, 1))
        bag.close()
        folders.append(bag.directory)
    for path in (*folders, tmp_path / "s1"):
        assert played(path) == {SENSORS: ["holds"], PLAIN: ["part 0", "part 1"]}
    recording = open_recording(folders[1])
    assert (recording.end_ns - recording.start_ns) == 61 * SECOND
    recording.close()
    alone = open_recording(folders[1], only_this_part=True)
    assert [said(message) for message in alone.messages([PLAIN, SENSORS], 0)] == ["holds", "part 1"]
    alone.close()


@pytest.mark.parametrize(
    "text", ["- depth: x", "- depth: -5", "- {depth: [1], durability: {}}", "- {deadline: {sec: x}}", "5"]
)
def test_a_quality_of_service_that_makes_no_sense_is_left_out(text):
    """What a channel says of its publishers' QoS in words of another kind costs no more than itself."""
    topic = Topic("/x", "x/msg/Y", offers=rosbag2.offers(text))
    assert topic.latched_depth == LATCHED_DEPTH
    assert not topic.latched

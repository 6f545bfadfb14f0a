"""What a damaged disk or a stranger may have made of a recording: every function harms one folder in one way.

`MUTATIONS[name](folder, dice)`; a name and a seed are one recording, always the same.
"""

from __future__ import annotations

import json
import os
import random
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from hostile import mcap_bytes
from hostile.mcap_bytes import HEAD, Told

Mutation = Callable[[Path, random.Random], None]
MUTATIONS: dict[str, Mutation] = {}

DAY_NS = 86_400 * 10**9
ENDS = (0, 1, 2**31 * 10**9, 2**63 - 1, 2**63, 2**64 - 1)
SECONDS = (0, -1, -(2**31), 2**31 - 1, 1, 946_684_800, 4_102_444_800 - 2**32)
LENGTHS = (0, 1, 0xFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
NUMBERS = (float("nan"), float("inf"), float("-inf"), 1e307, -1e307, 1e-300, 0.0, -5.0, 1e15)
VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    2**63,
    10**400,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "x" * 100_000,
    "\ud800",
    "../../x",
    "/" + "*" * 200 + "X/**",
    "a\nb\x00\x15",
    [],
    [[]],
    {},
    {"a": {}},
    [None],
    ["\ud800"],
    [1, "a", None],
    "p1",
)
JSONS: tuple[Any, ...] = (b"", b"[", b"{}", b"null", b"1e999", b"NaN", b"\xff\xfe", b"[" * 200_000, b'{"a":' * 50_000)
ALIASES = b"".join(
    b"%c: &%c [%s]\n" % (97 + i, 97 + i, b",".join([b"*%c" % (96 + i)] * 9) if i else b"x" + b",x" * 8)
    for i in range(9)
)


def mutation(harm: Mutation) -> Mutation:
    MUTATIONS[harm.__name__] = harm
    return harm


def bag(folder: Path) -> Path:
    return sorted(folder.glob("*.mcap"))[0]


# --- bytes, of any file


def _some(folder: Path, dice: random.Random) -> tuple[Path, bytearray, int]:
    file = dice.choice([*[bag(folder)] * 4, folder / "metadata.yaml", folder / "recorder.json", folder / "report.json"])
    content = bytearray(file.read_bytes())
    ends = (dice.randrange(min(64, len(content))), len(content) - 1 - dice.randrange(min(400, len(content))))
    return file, content, dice.choice([dice.randrange(len(content)), *ends])


@mutation
def bytes_flipped(folder: Path, dice: random.Random) -> None:
    file, content, at = _some(folder, dice)
    for _ in range(dice.choice([1, 1, 5, 50])):
        content[(at + dice.randrange(100)) % len(content)] ^= 1 << dice.randrange(8)
    file.write_bytes(content)


@mutation
def bytes_cut(folder: Path, dice: random.Random) -> None:
    file, content, at = _some(folder, dice)
    length = dice.choice([1, 8, 100, len(content)])
    del content[at : at + length]
    file.write_bytes(content)


@mutation
def bytes_blank(folder: Path, dice: random.Random) -> None:
    file, content, at = _some(folder, dice)
    length = min(dice.choice([1, 8, 64, 1024]), len(content) - at)
    content[at : at + length] = dice.choice([b"\0", b"\xff"]) * length
    file.write_bytes(content)


@mutation
def bytes_twice(folder: Path, dice: random.Random) -> None:
    file, content, at = _some(folder, dice)
    content[at:at] = content[at : at + dice.choice([1, 9, 1000, len(content)])]
    file.write_bytes(content)


# --- the file's structure


def _chunks(content: bytes) -> list[tuple[int, int]]:
    return [(start, length) for opcode, start, length in mcap_bytes.records(content) if opcode == mcap_bytes.CHUNK]


def _patch(folder: Path, at: Callable[[bytes], int], value: bytes) -> None:
    content = bytearray(bag(folder).read_bytes())
    where = at(bytes(content))
    content[where : where + len(value)] = value
    bag(folder).write_bytes(content)


@mutation
def chunk_lies(folder: Path, dice: random.Random) -> None:
    """Times, unpacked size, checksum, name of the compression, packed size."""
    at, form = dice.choice([(0, "Q"), (8, "Q"), (16, "Q"), (24, "I"), (28, "I"), (36, "Q")])
    value = dice.choice(
        [0, 1, 2**31, 2**32 - 1] if form == "I" else [0, 1, 2**20, 2**30, 2**40, 2**63 - 1, 2**63, 2**64 - 1]
    )
    _patch(folder, lambda content: dice.choice(_chunks(content))[0] + at, struct.pack(f"<{form}", value))


@mutation
def record_length_lies(folder: Path, dice: random.Random) -> None:
    value = dice.choice([0, 1, 2**20, 2**31, 2**40, 2**63 - 1, 2**63, 2**64 - 1])
    _patch(folder, lambda content: dice.choice(mcap_bytes.records(content))[1] - 8, struct.pack("<Q", value))


@mutation
def index_lies(folder: Path, dice: random.Random) -> None:
    """A number in the summary or the footer, with the checksum of the summary taken away."""
    content = bytearray(bag(folder).read_bytes())
    found = mcap_bytes.records(bytes(content))
    _, start, length = dice.choice([each for each in found if each[0] in (0x02, 0x08, 0x0B, 0x0B, 0x0E)])
    at = start + dice.randrange(max(length - 8, 1)) // 2 * 2
    content[at : at + 8] = struct.pack("<Q", dice.choice([0, 1, 2**31, 2**40, 2**63, 2**64 - 1]))
    footer = next(start for opcode, start, _ in found if opcode == 0x02)
    if at < footer + 16:
        content[footer + 16 : footer + 20] = bytes(4)
    bag(folder).write_bytes(content)


@mutation
def statistics_lie(folder: Path, dice: random.Random) -> None:
    """Counts and times of the statistics; a believable checksum."""
    content = bytearray(bag(folder).read_bytes())
    found = mcap_bytes.records(bytes(content))
    start = next(start for opcode, start, _ in found if opcode == 0x0B)
    at = dice.choice([0, 8 + 2 + 4 * 4, 8 + 2 + 4 * 4 + 8])
    content[start + at : start + at + 8] = struct.pack("<Q", dice.choice([0, *ENDS, dice.randrange(2**64)]))
    footer = next(start for opcode, start, _ in found if opcode == 0x02)
    content[footer + 16 : footer + 20] = bytes(4)
    bag(folder).write_bytes(content)


@mutation
def zstd_bomb(folder: Path, dice: random.Random) -> None:
    size = dice.choice([1 << 28, 1 << 30, (1 << 30) + (1 << 20), 3 << 30])
    mcap_bytes.insert_before_end(bag(folder), mcap_bytes.bomb(size, dice.random() < 0.5) * dice.choice([1, 4]))


@mutation
def zstd_bomb_of_records(folder: Path, dice: random.Random) -> None:
    """Records of eleven bytes and less, by the million: a message of nothing, or an opcode of no meaning."""
    record = dice.choice([HEAD.pack(0x80, 0), HEAD.pack(0x05, 22) + bytes(22), HEAD.pack(0x03, 14) + bytes(14)])
    size = dice.choice([1 << 26, 1 << 28, 1 << 30])
    mcap_bytes.insert_before_end(bag(folder), mcap_bytes.bomb(size, dice.random() < 0.5, record))


@mutation
def whole_bomb(folder: Path, dice: random.Random) -> None:
    """A whole, indexed file of a few kilobytes with very much in it."""
    messages = mcap_bytes.read(bag(folder))
    big = dice.choice([m for m in messages if m.topic.endswith(("/raw", "/session", "/state"))])
    count = dice.choice([1, 40])
    data = [replace(big, data=big.data + bytes(dice.choice([1 << 24, 1 << 28]) // count)) for _ in range(count)]
    mcap_bytes.write(bag(folder), messages + data)


@mutation
def chunk_indexed_often(folder: Path, dice: random.Random) -> None:
    """One chunk named by many entries of the index."""
    content = bag(folder).read_bytes()
    found = mcap_bytes.records(content)
    start, length = next((start, length) for opcode, start, length in found if opcode == 0x08)
    entry = content[start - HEAD.size : start + length]
    footer = next(start for opcode, start, _ in found if opcode == 0x02)
    out = bytearray(content[: footer - HEAD.size] + entry * dice.choice([10, 3000]) + content[footer - HEAD.size :])
    place = len(out) - len(mcap_bytes.MAGIC) - 20
    out[place + 8 : place + 20] = bytes(12)
    bag(folder).write_bytes(out)


# --- messages


def _edit(
    folder: Path, dice: random.Random, change: Callable[[Told], Told], where: Callable[[Told], bool] | None = None
) -> None:
    """Change one, some or all messages of one topic, or of all."""
    messages = mcap_bytes.read(bag(folder))
    suits = [each for each in messages if where is None or where(each)]
    topic = dice.choice(sorted({each.topic for each in suits}))
    share = dice.choice([0.0, 0.3, 1.0])
    own = [i for i, each in enumerate(messages) if each.topic == topic]
    one = dice.choice(own)
    for i in own:
        if i == one or dice.random() < share:
            messages[i] = change(messages[i])
    mcap_bytes.write(bag(folder), messages)


def _away(dice: random.Random) -> int:
    return dice.choice([1, -1]) * dice.choice([DAY_NS, 400 * DAY_NS, 20 * 365 * DAY_NS])


@mutation
def receipts(folder: Path, dice: random.Random) -> None:
    """Times of receipt: ends of what can be written, days and years away."""
    end, away = dice.choice([*ENDS, None, None, None, None]), _away(dice)
    _edit(
        folder,
        dice,
        lambda m: replace(m, log_ns=max(m.log_ns + away, 0) if end is None else end, publish_ns=end or m.publish_ns),
    )


def _has_header(each: Told) -> bool:
    return len(each.data) >= 24 and each.topic.endswith(
        ("/raw", "/health", "/clock", "/features", "/markers", "/session")
    )


@mutation
def header_stamps(folder: Path, dice: random.Random) -> None:
    seconds, nanoseconds = dice.choice(SECONDS), dice.choice([0, 999_999_999, 2**32 - 1])
    away = dice.choice([None, None, _away(dice)])

    def change(m: Told) -> Told:
        if away is None:
            stamp = struct.pack("<iI", seconds, nanoseconds)
        else:
            then = struct.unpack_from("<i", m.data, 4)[0] + away // 10**9
            stamp = struct.pack("<iI", max(min(then, 2**31 - 1), -(2**31)), 0)
        return replace(m, data=m.data[:4] + stamp + m.data[12:])

    _edit(folder, dice, change, _has_header)


@mutation
def device_stamps(folder: Path, dice: random.Random) -> None:
    seconds, nanoseconds = dice.choice(SECONDS), dice.choice([0, 999_999_999, 2**32 - 1])

    def change(m: Told) -> Told:
        at = 4 + 12 + (struct.unpack_from("<I", m.data, 12)[0] + 3) // 4 * 4
        return replace(m, data=m.data[:at] + struct.pack("<iI", seconds, nanoseconds) + m.data[at + 8 :])

    _edit(folder, dice, change, lambda m: m.topic.endswith(("/raw", "/features")))


@mutation
def cdr_cut(folder: Path, dice: random.Random) -> None:
    _edit(
        folder,
        dice,
        lambda m: replace(m, data=m.data[: dice.choice([0, 1, 3, 4, 5, 11, 12, 20, len(m.data) // 2, -1])]),
    )


@mutation
def cdr_numbers(folder: Path, dice: random.Random) -> None:
    def change(m: Told) -> Told:
        at = 4 + dice.randrange(max((len(m.data) - 4) // 8, 1)) * 8
        return replace(m, data=m.data[:at] + struct.pack("<d", dice.choice(NUMBERS)) + m.data[at + 8 :])

    _edit(folder, dice, change)


@mutation
def cdr_lengths(folder: Path, dice: random.Random) -> None:
    def change(m: Told) -> Told:
        at = 4 + dice.randrange(max((len(m.data) - 4) // 4, 1)) * 4
        return replace(m, data=m.data[:at] + struct.pack("<I", dice.choice(LENGTHS)) + m.data[at + 4 :])

    _edit(folder, dice, change)


@mutation
def cdr_bytes(folder: Path, dice: random.Random) -> None:
    def change(m: Told) -> Told:
        data = bytearray(m.data)
        for _ in range(dice.choice([1, 4, 20])):
            data[dice.randrange(len(data))] = dice.choice([0, 1, 0x15, 0x80, 0xFF, dice.randrange(256)])
        return replace(m, data=bytes(data))

    _edit(folder, dice, change)


@mutation
def json_in_messages(folder: Path, dice: random.Random) -> None:
    """The session's metadata as text that is hostile JSON; the length is kept."""
    texts = [b'{"room": 3}', b"[[[[[[[[[[[", b'{"a": NaN }', b'{"a":1e999}', b'"\\ud800"    ', b"[1e400, 1] "]

    def change(m: Told) -> Told:
        return replace(m, data=m.data.replace(texts[0], dice.choice(texts[1:])[:11]))

    _edit(folder, dice, change, lambda m: m.topic == "/study/session")


# --- types and channels


@mutation
def type_names(folder: Path, dice: random.Random) -> None:
    names = [
        "",
        "x",
        "std_msgs/msg/String",
        "os/msg/system",
        "hostile/msg/Evil",
        "sense4hri_msgs/msg/ECG",
        "a" * 70_000,
        "../../x/msg/Y",
        "sense4hri_msgs/msg/PhysioRaw",
        "sense4hri_msgs/msg/SessionState",
        "a/msg/B\n",
        "\x00",
    ]
    _edit(folder, dice, lambda m: replace(m, type_name=name)) if (name := dice.choice(names)) else _edit(
        folder, dice, lambda m: replace(m, type_name="", definition=b"")
    )


@mutation
def definitions(folder: Path, dice: random.Random) -> None:
    own = dice.choice(
        ["x", "sense4hri_msgs/msg/PhysioRaw", "sense4hri_msgs/msg/SessionState", "sense4hri_msgs/msg/UserState"]
    )
    texts = [
        b"",
        b"\xff\xfe",
        b"garbage ][ {",
        b"float64[4000000000] x\n",
        b"float64[100000000] x\n",
        b"string<=5 x\n" * 20_000,
        f"{own} a\n{'=' * 80}\nMSG: {own}\n{own} a\n".encode(),
        f"{own}[<=3] a\n{'=' * 80}\nMSG: {own}\n{own}[] a\n".encode(),
        b"".join(b"a/L%d x\na/L%d y\n" % (i + 1, i + 1) + b"=" * 80 + b"\nMSG: a/L%d\n" % (i + 1) for i in range(40))
        + b"bool x\n",
        b"int32 " + b"x" * 200_000 + b"\n",
        b"# " + b"(" * 100_000 + b"\n",
        b"int32 X=" + b"(" * 3000 + b"\n",
        b"uint8[] class\nuint8 __class__\nuint8 def\n",
        b"string a 'x\n",
    ]
    text = dice.choice(texts)
    _edit(folder, dice, lambda m: replace(m, definition=text, type_name=own if own.encode() in text else m.type_name))


@mutation
def definitions_damaged(folder: Path, dice: random.Random) -> None:
    def change(m: Told) -> Told:
        text = bytearray(m.definition)
        for _ in range(dice.choice([1, 3])):
            at = dice.randrange(max(len(text), 1))
            text[at : at + dice.choice([0, 1, 10])] = dice.choice([b"", b"\n", b"[", b"x", b"\0", b"float64 ", b"="])
        return replace(m, definition=bytes(text))

    one: dict[str, bytes] = {}
    _edit(folder, dice, lambda m: replace(m, definition=one.setdefault(m.topic, change(m).definition)))


@mutation
def topics(folder: Path, dice: random.Random) -> None:
    names = [
        "",
        "/",
        "/" + "x" * 60_000,
        "/a\nb",
        "/\x00",
        "/humans/physiological/../../raw",
        "/humans/physiological/p1/ecg/x/raw",
        "/humans/physiological/p1/ecg/h10_1/health",
        "/humans/physiological/p 1/ecg/=cmd()/raw",
        "/study/session",
        "/study/sensors",
        "/study/markers",
        "/tf_static",
        "/humans/physiological//ecg//raw",
        "p1/ecg/h10_1/raw",
        "/" + "/a" * 5000,
        "/humans/physiological/p1/ecg/" + "x" * 300 + "/raw",
    ]
    name = dice.choice(names)
    _edit(folder, dice, lambda m: replace(m, topic=name))


@mutation
def many_topics(folder: Path, dice: random.Random) -> None:
    messages = mcap_bytes.read(bag(folder))
    like = dice.choice([m for m in messages if m.topic.endswith("/raw")])
    more = [replace(like, topic=f"/humans/physiological/q{i}/ecg/s{i}/raw") for i in range(dice.choice([300, 3000]))]
    mcap_bytes.write(bag(folder), messages + more)


@mutation
def channel_metadata(folder: Path, dice: random.Random) -> None:
    texts = [
        "5",
        "x",
        "- 5",
        "{a: b}",
        "- depth: x",
        "- depth: 1000000000000000000",
        "- depth: -5",
        "- {depth: [1], durability: {}}",
        "- {deadline: {sec: x}}",
        "- {deadline: {sec: .nan, nsec: .inf}}",
        "- {deadline: {sec: 1.0e+300}}",
        "- {deadline: [1]}",
        "!!python/object/apply:os.system ['touch /tmp/x']",
        "[" * 100_000,
        ALIASES.decode() + "- *i",
        "- {durability: 1, depth: .inf}",
        "\x00",
        "- {reliability: [1], durability: transient_local, depth: true}",
        "2026-99-99",
        "- {depth: 10, ? [1] : 2}",
    ]
    metadata = {"offered_qos_profiles": dice.choice(texts), "topic_type_hash": dice.choice(["", "RIHS01_", "x" * 1000])}
    _edit(folder, dice, lambda m: replace(m, metadata=metadata))


@mutation
def encodings(folder: Path, dice: random.Random) -> None:
    one = dice.choice([{"encoding": "json"}, {"encoding": ""}, {"schema_encoding": "ros2idl"}, {"schema_encoding": ""}])
    _edit(folder, dice, lambda m: replace(m, **one))


# --- what stands beside


def _values(value: Any, dice: random.Random) -> Any:
    """A value of JSON with one of its parts put in place of something else."""
    if isinstance(value, dict) and value and dice.random() < 0.8:
        key = dice.choice(sorted(value))
        return {**value, key: _values(value[key], dice)}
    if isinstance(value, list) and value and dice.random() < 0.7:
        return [_values(value[0], dice), *value[1:]]
    return dice.choice(VALUES)


@mutation
def recorder_json(folder: Path, dice: random.Random) -> None:
    path = folder / "recorder.json"
    content = json.loads(path.read_text())
    text = json.dumps(_values(_values(content, dice), dice)).encode()
    path.write_bytes(dice.choice([*JSONS, *[text] * 20]))


@mutation
def report_json(folder: Path, dice: random.Random) -> None:
    (folder / "report.json").write_bytes(dice.choice(JSONS))
    (folder / "report.html").write_bytes(b"\xff")


@mutation
def metadata_yaml(folder: Path, dice: random.Random) -> None:
    path, name = folder / "metadata.yaml", bag(folder).name
    head = "rosbag2_bagfile_information:\n  "
    texts = [
        ALIASES + head.encode() + b"relative_file_paths: *i\n",
        ALIASES + head.encode() + b"ros_distro: *i\n",
        b"[" * 100_000,
        b"a: " * 20_000,
        b"!!python/object/apply:os.system ['touch /tmp/x']",
        b"\xff",
        b"5",
        b"- 5",
        head.encode(),
        b"? [1]\n: 2",
        (head + "relative_file_paths: [/etc/passwd]\n").encode(),
        (head + "relative_file_paths: ['..']\n").encode(),
        (head + "relative_file_paths: ['']\n").encode(),
        (head + f'relative_file_paths: ["{name}\\0"]\n').encode(),
        (head + f"relative_file_paths: [{', '.join([name] * 20_000)}]\n").encode(),
        (head + f"relative_file_paths: {name}").encode(),
        (head + f"relative_file_paths: [{name}, {name}]\n").encode(),
        (head + "relative_file_paths: [[], {}, 5, null]\n").encode(),
        (head + "storage_identifier: sqlite3\n  relative_file_paths: [x.db3]\n").encode(),
        (head + "compression_mode: [1]\n").encode(),
        (head + "compression_mode: file\n  version: x\n").encode(),
        (head + "ros_distro: 2026-99-99\n").encode(),
        (head + "ros_distro: " + "9" * 5000 + "\n").encode(),
        (head + f"relative_file_paths: ['{'x' * 5000}']\n").encode(),
    ]
    path.write_bytes(dice.choice(texts))


@mutation
def journal(folder: Path, dice: random.Random) -> None:
    target = dice.choice(
        [str(folder.parent.parent / "stolen"), "/tmp/hostile/stolen", "../../stolen", "x", "\x00", "", 5, None]
    )
    content = {"human_id": "p1", "ids": [], "also": [], "target": target, "report": False}
    text = json.dumps(dice.choice([content, _values(content, dice)])).encode()
    (folder / ".withdrawal.json").write_bytes(dice.choice([*[text] * 12, *JSONS]))


@mutation
def file_names(folder: Path, dice: random.Random) -> None:
    names = [
        b"\xff\xfe.mcap",
        b"a\nb_0.mcap",
        b"-rf.mcap",
        b"x_" + b"9" * 200 + b".mcap",
        b"x_\xd9\xa3.mcap",
        b".mcap",
        b"x\x1b[2J.mcap",
        b"_.mcap",
    ]
    os.rename(os.fsencode(bag(folder)), os.path.join(os.fsencode(folder), dice.choice(names)))
    if dice.random() < 0.7:
        (folder / "metadata.yaml").unlink()


@mutation
def odd_files(folder: Path, dice: random.Random) -> None:
    """Links, pipes and folders where files are expected."""
    names = [
        "metadata.yaml",
        "recorder.json",
        "report.json",
        "report.html",
        bag(folder).name,
        ".lock",
        ".withdrawal.json",
        "z_1.mcap",
        ".recorder.json",
        ".report.json",
        ".metadata.yaml",
        f".{bag(folder).name}.new",
        f"{bag(folder).stem}_repaired.mcap",
    ]
    path = folder / dice.choice(names)
    moved = folder.parent / "outside"
    moved.mkdir(exist_ok=True)
    if path.exists():
        path = path.rename(moved / path.name) and path
    else:
        (moved / path.name).write_bytes(b"precious")
    kind = dice.choice(["link", "link", "fifo", "folder", "loop", "nowhere", "device"])
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
        (path / "x").write_text("x")
    else:
        targets = {"link": moved / path.name, "loop": path, "nowhere": moved / "nothing", "device": Path("/dev/zero")}
        path.symlink_to(targets[kind])

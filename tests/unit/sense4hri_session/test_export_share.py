"""What is shared does not tell of the lab, and is the recording all the same."""

import gzip
import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet
import pytest
import sense4hri_session
from hostile import mcap_bytes
from mcap.reader import make_reader
from sense4hri_session import share
from sense4hri_session.__main__ import main
from sense4hri_session.identities import Identities

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
TELLING = ("labpc-17", "labpc_17", "C4509D2B", "A0:9E:1A:11:22:33", "a0_9e_1a_11_22_33", "/home/eva", "/srv/lab")
KEY = "p1/ecg/s_a0_9e_1a_11_22_33"


def header(at_ns, frame_id=""):
    return {"stamp": {"sec": at_ns // SECOND, "nanosec": at_ns % SECOND}, "frame_id": frame_id}


@pytest.fixture
def telling(study):
    """The folder of a recording in which host, serial number, address and paths stand wherever they can."""
    for i in range(100):
        study.raw(KEY, START_NS + i * SECOND // 10, (i + 10) * SECOND // 10, {"ecg": np.sin(np.arange(13) + i)})
    sensor = study.sensor(KEY, 130.0, "uV", ["ecg"], 14, host="labpc-17", serial_number="C4509D2B")
    sensor |= {"parameters_json": json.dumps({"address": "A0:9E:1A:11:22:33", "rate": 130}), "node": "driver_c4509d2b"}
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[sensor])
    base = f"/humans/physiological/{KEY}"
    about = {"host": "labpc-17", "reasons": ["no A0:9E:1A:11:22:33 on labpc-17"]}
    study.add(f"{base}/health", "StreamHealth", START_NS, header=header(START_NS), **about)
    note = {"name": "note", "value": "log in /home/eva/x.log", "source": "clock_sync_labpc_17"}
    study.add("/study/markers", "Marker", START_NS, header=header(START_NS), **note)
    session = {"session_id": "s1", "directory": "/srv/lab/s1", "phase": 2}
    study.add("/study/session", "SessionState", START_NS, header=header(START_NS), **session)
    folder = study.write()
    parameters = {"serial_number": "C4509D2B", "log": "/home/eva/log"}
    told = {"format": 1, "state": "interrupted", "host": "labpc-17", "nodes": [{"node": "d", "parameters": parameters}]}
    (folder / "recorder.json").write_text(json.dumps(told | {"session": {"session_id": "s1"}}))
    return folder


def everything(folder):
    """All bytes of all files, what is packed in them unpacked, and their names."""
    for path in folder.rglob("*"):
        yield path.name.encode()
        if path.suffix == ".mcap":
            with path.open("rb") as file:
                yield from (c.topic.encode() + m.data for _, c, m in make_reader(file).iter_messages())
        elif path.suffix == ".gz":
            yield gzip.decompress(path.read_bytes())
        elif path.suffix == ".parquet":
            yield str(pyarrow.parquet.read_table(path).to_pydict()).encode()
        elif path.is_file():
            yield path.read_bytes()


def test_nothing_that_is_shared_tells_of_the_lab(telling, tmp_path, capsys):
    """Copy, report and every format hold no host, serial number, address or path; the samples are the same."""
    before = {path.name: path.read_bytes() for path in telling.iterdir()}
    assert main([str(telling), "--share", "--out", str(tmp_path / "out")]) == 0
    assert {path.name: path.read_bytes() for path in telling.iterdir()} == before
    found = b"\n".join(everything(tmp_path / "out"))
    assert [text for text in (*TELLING, str(tmp_path)) if text.lower().encode() in found.lower()] == []
    (copied,) = (tmp_path / "out" / "recording").iterdir()
    assert {"report.json", "report.html", "recorder.json", "metadata.yaml"} <= {path.name for path in copied.iterdir()}
    ours, theirs = sense4hri_session.open(telling)[KEY], list(sense4hri_session.open(copied).streams.values())
    assert len(theirs) == 1
    assert theirs[0].arrays()[1].tolist() == ours.arrays()[1].tolist()
    assert theirs[0].name.sensor_id.startswith("device_")


def test_a_copy_shows_how_far_it_is(telling, tmp_path, capsys):
    """It reads and writes the whole recording, as long as an export takes; the bar ends with the last message."""
    for name in ("shown", "silent"):
        (tmp_path / name).mkdir()
    share.copy(telling, tmp_path / "shown", progress=True)
    total = sum(topic.messages for topic in sense4hri_session.open(telling).reader.topics.values())
    assert f"{total}/{total}" in capsys.readouterr().err
    share.copy(telling, tmp_path / "silent")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("topic", "status"), [("/study/sensors", 1), ("/study/host_clocks", 0)])
def test_what_names_the_lab_is_believed_in_its_own_type_alone(study, tmp_path, capsys, topic, status):
    """Sensors of another type cannot be taken out: nothing is shared. Clocks of another type end nothing."""
    study.raw(KEY, START_NS, SECOND, {"ecg": np.zeros(13)})
    study.definitions["lab_msgs/msg/Thing"] = "string[] clocks\nstring[] sensors\n"
    study.add(topic, "lab_msgs/msg/Thing", START_NS, clocks=["noon"], sensors=["h10_1"])
    assert main([str(study.write()), "--share", "--quiet", "--out", str(tmp_path / "out")]) == status
    assert (f"{topic}: it is recorded as lab_msgs/msg/Thing" in capsys.readouterr().err) == bool(status)
    assert (tmp_path / "out").exists() == (not status)


def test_a_message_that_holds_an_identity_in_bytes_is_left_out(study, telling, tmp_path):
    """What numbers hold cannot be taken out of them: of two messages the one with the serial number is not shared."""
    for at_s, data in ((1, b"12 C4509D2B 34"), (2, b"nothing of the lab")):
        values = np.frombuffer(data, np.uint8)
        study.add("/lab/dump", "std_msgs/msg/UInt8MultiArray", START_NS + at_s * SECOND, data=values)
    folder = study.write()
    assert main([str(folder), "--share", "--only-this-part", "--out", str(tmp_path / "out")]) == 0
    (copied,) = (tmp_path / "out" / "recording").iterdir()
    dumps = [bytes(row) for row in sense4hri_session.open(copied).table("/lab/dump")["data"]]
    assert dumps == [b"nothing of the lab"]


def test_sensors_that_cannot_be_read_end_the_sharing(telling, tmp_path, capsys):
    """Nobody knows then what identifies them: one sentence, and nothing is written."""
    (file,) = telling.glob("*.mcap")
    mcap_bytes.edit(file, lambda told: replace(told, data=told.data[:9]) if told.topic == "/study/sensors" else told)
    assert main([str(telling), "--share", "--out", str(tmp_path / "out")]) == 1
    assert "a message on /study/sensors is no sense4hri_msgs/msg/SensorInfoArray" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_host_is_found_in_small_and_capital_letters():
    """Windows calls itself LABPC-17 and is called labpc-17 in links and logs: both are the one host."""
    known = Identities()
    known.host("LabPC-17")
    assert known.without("LabPC-17 labpc-17 LABPC-17 labpc_17") == " ".join(["host_1"] * 4)


@pytest.mark.parametrize("told", ["labpc-17.lab.example", "labpc_17_lab_example", "LabPC-17"])
def test_a_host_that_is_told_in_one_spelling_is_found_in_all(told):
    """As the network writes it, as the kit does, short, in any letters: one host. Other words and domains stay."""
    known = Identities()
    known.host("labpc-17.lab.example")
    known.host(told)
    text = "labpc-17.lab.example LABPC-17 Labpc_17 clock_sync_labpc_17 labpc-17:80 labpc_17_lab_example labpc-170 lab"
    shown = "host_1 host_1 host_1 clock_sync_host_1 host_1:80 host_1 labpc-170 lab"
    assert known.without(text) == shown
    assert known.without(shown) == shown


def test_a_host_called_as_a_part_of_topics_leaves_the_topics():
    """Of `study.lab.example` the short name is a word of the contract: the copy is a recording all the same."""
    known = Identities()
    for host in ("study.lab.example", "raw", "ecg.lab.example", "10.0.0.5"):
        known.host(host)
    text = "/study/markers /humans/physiological/p1/ecg/h10_1/raw 10"
    assert known.without(text) == text
    assert known.without("at study.lab.example") == "at host_1"


@pytest.mark.parametrize("host", ["jazzy.lab.example", "nodes", "data.lab.example", "ns.lab.example", "what"])
def test_a_host_called_as_a_word_of_the_files_hinders_no_sharing(study, tmp_path, host):
    """What metadata.yaml and recorder.json say in every recording tells of no lab; the whole name is taken out."""
    study.raw("p1/ecg/h10_1", START_NS, SECOND, {"ecg": np.zeros(13)})
    sensor = study.sensor("p1/ecg/h10_1", 130.0, "uV", ["ecg"], 14, host=host)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[sensor])
    folder = study.write()
    nodes, events = [{"node": "a", "parameters": {f"on_{host}": host}}], [{"at_ns": 7, "what": f"on {host}"}]
    session = {"session_id": "s1", "metadata": {host: "left"}}
    told = {"format": 1, "host": host, "nodes": nodes, "events": events, "session": session}
    (folder / "recorder.json").write_text(json.dumps(told))
    assert main([str(folder), "--share", "--out", str(tmp_path / "out")]) == 0
    (copied,) = (tmp_path / "out" / "recording").iterdir()
    about = sense4hri_session.open(copied).recorders[0]
    assert [node["node"] for node in about.nodes] == ["a"]
    assert [event["at_ns"] for event in about.events if "what" in event] == [7]
    assert b"lab.example" not in b"".join(everything(tmp_path / "out"))


def test_samples_that_read_like_a_short_host_name_are_shared(study, tmp_path):
    """Two letters among numbers come by chance; nothing is left out for them."""
    letters = np.frombuffer(b".pc.PC..", np.float64)
    study.raw("p1/ecg/h10_1", START_NS, SECOND, {"ecg": letters})
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[study.sensor("p1/ecg/h10_1", 1.0, "uV", [], 0)])
    about = {"host": "pc", "reasons": ["no sensor on pc"]}
    study.add("/humans/physiological/p1/ecg/h10_1/health", "StreamHealth", START_NS, header=header(START_NS), **about)
    assert main([str(study.write()), "--share", "--out", str(tmp_path / "out")]) == 0
    (copied,) = (tmp_path / "out" / "recording").iterdir()
    session = sense4hri_session.open(copied)
    assert session["p1/ecg/h10_1"].arrays()[1].tolist() == [letters.tolist()]
    (health,) = session.health("p1/ecg/h10_1").to_dict("records")
    assert health["reasons"] == f"no sensor on {health['host']}" != "no sensor on pc"


def test_a_host_that_only_services_and_probes_name_is_taken_out(study, tmp_path):
    """The clock-sync of a host whose clock nobody measured yet, a reference, a peer asked for streams."""
    study.raw("p1/ecg/h10_1", START_NS, SECOND, {"ecg": np.zeros(13)})
    sensor = study.sensor("p1/ecg/h10_1", 130.0, "uV", ["ecg"], 14)
    sensor["parameters_json"] = json.dumps({"known_peers": ["peer-pc"], "lsl.hostname": "lsl-pc"})
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[sensor])
    study.add("/study/session", "SessionState", START_NS, session_id="s1", expected_services=["clock_sync_lone_pc"])
    study.add("/study/ack", "SessionAck", START_NS, session_id="s1", service="clock_sync_ack_pc")
    study.add("/study/host_clocks", "HostClockArray", START_NS, clocks=[{"host": "one_pc", "reference": "ref_pc"}])
    study.add("/study/clock_probes", "ClockProbe", START_NS, from_host="from_pc", to_host="to_pc")
    words = "peer-pc lsl-pc lone-pc lone_pc ack-pc one-pc ref-pc from-pc to-pc node-pc"
    study.add("/study/markers", "Marker", START_NS, header=header(START_NS), name="note", value=words)
    folder = study.write()
    (folder / "recorder.json").write_text(json.dumps({"format": 1, "nodes": [{"node": "clock_sync_node_pc"}]}))
    assert main([str(folder), "--share", "--out", str(tmp_path / "out")]) == 0
    found = b"\n".join(everything(tmp_path / "out"))
    assert [word for word in words.split() if word.encode() in found or word.replace("-", "_").encode() in found] == []


def test_a_name_is_the_same_wherever_it_stands():
    """The spellings of one address become one name, whole words alone are changed, and twice is as once."""
    known = Identities()
    known.device("A0:9E:1A:11:22:33")
    known.host("lab")
    text = "A0:9E:1A:11:22:33 s_a0_9e_1a_11_22_33 a09e1a112233 lab label /humans/physiological/p1 DE:AD:BE:EF:00:01"
    shown = known.without(text)
    assert shown == "device_1 device_1 device_1 host_1 label /humans/physiological/p1 address_1"
    assert known.without(shown) == shown


def test_json_stays_json():
    """A path of Windows has two backslashes there, the same name, and no quote goes with it."""
    known = Identities()
    texts = ["C:\\Users\\eva", 'C:\\Users\\eva "x"', "C:\\Users\\eva\\", "D:\\", "\\\\pc\\a"]
    shown = json.loads(known.without(json.dumps({"a": texts})))["a"]
    assert [known.without(text) for text in texts] == shown
    assert shown == ["path_1", 'path_1 "x"', "path_1\\", "D:\\", "path_2"]


def test_one_address_has_one_name_with_separators_and_without():
    """Nobody has named it: what is written in three ways is one device all the same."""
    assert Identities().without("A0:9E:1A:11:22:33 a09e1a112233 A0-9E-1A-11-22-33") == " ".join(["address_1"] * 3)


@pytest.mark.parametrize("root", ["home", "data", "storage", "nfs", "mnt"])
def test_a_path_is_told_by_the_root_that_labs_use(root):
    """In the middle of a sentence too; what begins like a topic stays."""
    assert Identities().without(f"see /{root}/lab7/eva/p1.csv; /humans/p1/x") == "see path_1; /humans/p1/x"


def test_numbers_that_look_like_a_path_are_shared(study, telling, tmp_path):
    """In samples `E:\\x` comes by chance; nothing is left out for it."""
    data = np.frombuffer(b"....E:\\xy, \\\\z\\z....", np.uint8)
    study.add("/lab/dump", "std_msgs/msg/UInt8MultiArray", START_NS, data=data)
    folder = study.write()
    assert main([str(folder), "--share", "--only-this-part", "--out", str(tmp_path / "out")]) == 0
    (copied,) = (tmp_path / "out" / "recording").iterdir()
    assert [bytes(row) for row in sense4hri_session.open(copied).table("/lab/dump")["data"]] == [data.tobytes()]


@pytest.mark.parametrize(
    "text",
    [
        '{"serial": "C4509D2B", "serial": "x"}',
        '{"devices": [{"serial": "C4509D2B"}]}',
        '{"a": {"serial": "C4509D2B"}, "b": NaN, cut',
    ],
    ids=["twice", "in_a_list", "cut"],
)
def test_a_serial_number_is_found_anywhere_in_parameters(text):
    """A name given twice, a list, and what is cut short hide none."""
    known = Identities()
    known.parameters_json(text)
    assert known.without("of C4509D2B") == "of device_1"


LAB = {
    "advertised": ({"name": "Polar H10 1234ABCD"}, "Polar H10 1234ABCD, 1234ABCD, h10_1234abcd"),
    "served": ({"port": "socket://bench-pc:7000", "reference_host": "clock-pc"}, "bench-pc at bench-pc:7000, clock_pc"),
    "listed": ({"devices": [{"address": "C4509D2B"}], "serial_numbers": ["SN778899"]}, "C4509D2B SN778899"),
    "mounted": ({"file": "/data/eva/rest.edf", "recordings": ["/data/adam"]}, "/data/eva/rest.edf /data/adam/1"),
    "bare": ({"address": "bench-pc:7000", "server": "clock-pc:80"}, "bench-pc at bench-pc:7000, no bench-pc, clock_pc"),
    "linked": ({"url": "http://[fd12:3456::abcd]:80/x"}, "fd12:3456::abcd, http://[fd12:3456::abcd]:80/x"),
    "network 6": ({}, "[2001:db8::8a2e:370]:80, fe80::1ff:fe23%eth0: no answer, 2001:db8:1:2:3:4:5:6."),
    "address as one word": ({}, "a09e1a112233, A09E1A112233, h10_a09e1a112233"),
    "windows": (
        {"file": "C:\\Lab PC\\eva\\a.edf"},
        'at C:\\Lab PC\\eva\\a.edf, D:/eva/x, \\\\clock-pc\\adam\\x: "E:\\eva"',
    ),
    "network": ({}, "http://192.168.1.23:8080 and 10.0.0.5."),
}


@pytest.mark.parametrize("which", LAB)
def test_what_a_parameter_names_is_taken_out(which):
    """Sensors by the name they advertise, hosts of links, lists, folders of a container, addresses of a network."""
    parameters, text = LAB[which]
    telling = ["1234abcd", "bench", "clock-pc", "clock_pc", "c4509d2b", "sn778899", "eva", "adam", "192.168", "10.0"]
    telling += ["2001", "db8", "fe80", "fe23", "fd12", "a09e1a", "lab pc", "e:"]
    for learn in (Identities.parameters, lambda known, found: known.parameters_json(json.dumps(found))):
        known = Identities()
        learn(known, parameters)
        shown = known.without(text)
        assert [word for word in telling if word in shown.lower()] == [], shown
        assert known.without(shown) == shown


def test_what_tells_nothing_of_the_lab_stays():
    """The machine itself, versions, a chosen name, topics."""
    known = Identities()
    known.parameters({"host": "127.0.0.1", "name": "wristband", "input": "/study/markers", "port": "auto"})
    text = "127.0.0.1 0.0.0.0 localhost firmware 3.1.1 of 300.1.1.1 and 1.2.3.4.5, wristband, auto, [::1]:80, std::a"
    text += " at 12:30:45, 231114123045, 0000180d-0000-1000-8000-00805f9b34fb, C:, a:b, /study/ecg, 12:30::"
    assert known.without(text) == text

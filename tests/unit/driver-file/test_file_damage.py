"""driver-file: files that are damaged, or made to do harm, end in one sentence."""

import asyncio
import gzip
import os
import shutil
import threading
import time
import zipfile
from contextlib import suppress

import fastavro
import numpy as np
import pytest
import signal_file_makers as make
from driver_file import embrace_plus as embrace_plus_file
from driver_file import packed, transport
from driver_file.config import FileConfig
from driver_file.device import FilePlayer, Tape
from processes import DEADLINE_S
from sense4hri.errors import ConfigError, DeviceLost

STEPS = np.arange(20)


def config(file, **more):
    return FileConfig(sensor_id="file_1", file=str(file), **more)


def play(file, **more):
    """Read a file and play its first second."""
    settings = config(file, **more)
    recorded, content = transport.read(settings)
    tape = Tape(recorded, content.events, settings)
    return [item for frame in range(10) for item in tape.items(frame, 10**18)]


def edf(folder):
    return make.edf(folder / "a.edf", {"ECG": (10, "uV", STEPS)}, [(0.5, "cue")])


def edf_d(folder):
    records = [(f"+{at}.5||~", [range(10), range(5)]) for at in range(5)]
    return make.edf_d(folder / "a.edf", {"ECG": ("uV", 1.0), "EDA": ("uS", 0.001)}, records)


def wfdb(folder):
    return make.wfdb(folder / "a", {"I": (10, "mV", STEPS), "RESP": (1, "NU", STEPS[:2])})


def wfdb_segments(folder):
    for name in ("r_1", "r_2"):
        make.segment(folder, name, {"II": (10, "mV", STEPS), "RESP": (1, "NU", STEPS)})
    (folder / "a.hea").write_text("a/3 2 4 43 07:08:09 06/05/2024\nr_1 20\n~ 3\nr_2 20\n")
    return folder / "a.hea"


def brainvision(folder):
    return make.brainvision(folder / "a", ("Fp1", "Cz"), np.arange(40).reshape(20, 2))


def xdf(folder):
    return make.xdf(folder / "a.xdf", 100.0, ("Cz", "Oz"), np.arange(40.0).reshape(20, 2), [(10.05, "cue")])


def empatica(folder, **files):
    """Make a zip; files by name without .csv, as text."""
    session = folder / "session"
    session.mkdir(exist_ok=True)
    texts = {"EDA": "1560279825.0\n4.0\n0.0\n0.5\n1.0\n", "tags": "1560279825.5\n"} | files
    for name, text in texts.items():
        (session / f"{name}.csv").write_text(text)
    return shutil.make_archive(str(folder / "a"), "zip", session)


def embrace_plus(folder):
    factor = {"conversionFactor": 0.5}
    return make.embrace_plus(
        folder / "a.avro", (6, 5, 0), factor, eda=(4.0, [0.5, 1.0, 1.5]), tags=[1_714_979_289_000_000]
    )


def polar(folder):
    rows = "".join(f"2023;{10**17 + at * 10**7};5\n" for at in range(20))
    (folder / "a.txt").write_text(f"Phone timestamp;sensor timestamp [ns];ecg [uV]\n{rows}")
    return folder / "a.txt"


def eyelink(folder):
    rows = "".join(f"{1000 + at}\t 1.0\t 2.0\t 3.0\t...\n" for at in range(20))
    (folder / "a.asc").write_text(f"MSG\t1000 TRIAL 7\nSAMPLES\tGAZE\tLEFT\tRATE\t1000.00\n{rows}")
    return folder / "a.asc"


@pytest.mark.parametrize(
    "maker", [edf, edf_d, wfdb, wfdb_segments, brainvision, xdf, empatica, embrace_plus, polar, eyelink]
)
def test_a_damaged_file_is_played_or_told_in_one_line(tmp_path, maker):
    """Bytes changed or cut off anywhere in any of its files: never another error, never more than a line."""
    opened, rng, said = maker(tmp_path), np.random.default_rng(5), ""
    whole = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    assert play(opened)
    for round_ in range(60):
        path = sorted(whole)[round_ % len(whole)]
        damaged = np.frombuffer(whole[path], np.uint8).copy()
        damaged[rng.integers(0, len(damaged), 3)] ^= rng.integers(1, 256, 3).astype(np.uint8)
        path.write_bytes(damaged[: rng.integers(0, len(damaged)) if round_ % 4 == 3 else None].tobytes())
        try:
            play(opened)
        except (ConfigError, DeviceLost) as err:
            said += str(err)
        path.write_bytes(whole[path])
    assert "\n" not in said


def test_what_was_seen_to_end_in_a_traceback(tmp_path):
    """Rates of 0, times that are no number or too far, a NUL in a name: each names its file."""
    (tmp_path / "c.csv").write_text("t,ECG\n0,1\n1e300,2\n2,3\n")
    said = {tmp_path / "c.csv": {"time_column": "t"}, empatica(tmp_path, EDA="inf\n4\n0\n1\n"): {}}
    for old, new in (("SamplingInterval=2000", "SamplingInterval=0"), ("DataFile=a", "DataFile=\0")):
        name = f"{len(said)}.vhdr"
        (tmp_path / name).write_text(brainvision(tmp_path).read_text().replace(old, new))
        said[tmp_path / name] = {}
    for old, new in (("a 2 1 2", "a 2 0 2"), ("16x10", "16x0"), ("16x10", "16x10:-1")):
        name = f"{len(said)}.hea"
        (tmp_path / name).write_text(wfdb(tmp_path).read_text().replace(old, new))
        said[tmp_path / name] = {}
    for file, more in said.items():
        with pytest.raises(ConfigError, match=str(file)):
            play(file, **more)


def test_a_quote_that_never_ends_is_told(tmp_path):
    """A cell longer than any reader of columns takes ends the driver in a sentence, not a traceback."""
    (tmp_path / "a.csv").write_text('t,ECG\n0,1\n"' + "1" * 200_000 + ",1\n2,1\n")
    with pytest.raises(ConfigError, match="damaged"):
        transport.read(FileConfig(sensor_id="file_1", file=str(tmp_path / "a.csv"), time_column="t"))


def test_an_encrypted_zip_is_told(tmp_path):
    """Its names are open, what they hold is not."""
    archive = bytearray((tmp_path / empatica(tmp_path)).read_bytes())
    for mark, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = archive.find(mark)
        while at >= 0:
            archive[at + flags] |= 1
            at = archive.find(mark, at + 4)
    (tmp_path / "b.zip").write_bytes(archive)
    with pytest.raises(ConfigError, match=r"b\.zip.*encrypted"):
        play(tmp_path / "b.zip")


def test_one_time_for_all_samples_is_refused(tmp_path):
    """Such a file has no length to play."""
    (tmp_path / "a.csv").write_text("t,ECG\n" + "5,1\n" * 20)
    with pytest.raises(ConfigError, match=r"time_column: .*a\.csv has one time for all samples of ecg"):
        play(tmp_path / "a.csv", time_column="t")


def test_a_file_shorter_than_a_frame_is_played_once_in_a_frame(tmp_path):
    """Times in a wrong unit make rounds of nanoseconds; they do not fill a frame with millions of them."""
    (tmp_path / "a.csv").write_text("t,ECG\n" + "".join(f"{at},1\n" for at in range(20)))
    assert sum(len(item.chunk.samples) for item in play(tmp_path / "a.csv", time_column="t", time_unit="ns")) == 200


def test_what_is_no_file_is_not_opened(tmp_path):
    """A pipe would be waited for until somebody writes into it."""
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(ConfigError, match=r"a\.csv is neither a file nor a folder"):
        play(tmp_path / "a.csv")


def test_a_driver_that_reads_can_be_stopped(tmp_path, monkeypatch):
    """The end does not wait for the file."""
    held, entered = threading.Event(), threading.Event()

    def slow(_):
        entered.set()
        held.wait(20)
        raise DeviceLost("late")

    async def begin_and_stop():
        player = FilePlayer(config(tmp_path / "a.csv"), {})
        task = asyncio.ensure_future(anext(player.stream()))
        assert await asyncio.to_thread(entered.wait, DEADLINE_S)
        task.cancel()

    monkeypatch.setattr(transport, "read", slow)
    begun_s = time.monotonic()
    asyncio.run(begin_and_stop())
    assert time.monotonic() - begun_s < 10
    held.set()


def test_a_recording_without_tags_is_read(tmp_path):
    """The usual E4 session: the button was never pressed, tags.csv is empty."""
    assert play(empatica(tmp_path, tags=""))


def test_only_what_is_read_is_unpacked_and_within_a_bound(tmp_path, monkeypatch):
    """Something large beside an E4's files does not matter; one of them that is too large is refused."""
    monkeypatch.setattr(packed, "MOST_BYTES", 1000)
    archive = empatica(tmp_path)
    with zipfile.ZipFile(archive, "a", zipfile.ZIP_DEFLATED) as file:
        file.writestr("IBI.csv", "0\n" * 10_000)
    assert play(archive)
    with pytest.raises(ConfigError, match=r"a\.zip: unpacks to more than 1000 bytes"):
        play(empatica(tmp_path, EDA="1560279825.0\n4.0\n" + "0.0\n" * 1000))


def test_a_packed_xdf_has_the_same_bound(tmp_path, monkeypatch):
    """It is unpacked to nowhere first."""
    (tmp_path / "a.xdfz").write_bytes(gzip.compress(xdf(tmp_path).read_bytes()))
    assert play(tmp_path / "a.xdfz")
    monkeypatch.setattr(packed, "MOST_BYTES", 1000)
    with pytest.raises(ConfigError, match=r"a\.xdfz: unpacks to more than 1000 bytes"):
        play(tmp_path / "a.xdfz")


def test_an_xdf_cut_off_anywhere_is_played_or_told(tmp_path):
    """Wherever its recorder was killed."""
    path = xdf(tmp_path)
    octets = path.read_bytes()
    for length in range(len(octets)):
        path.write_bytes(octets[:length])
        with suppress(ConfigError):
            play(path)


def test_a_damaged_xdf_is_told_in_one_sentence_and_writes_no_traceback(tmp_path, caplog, capsys):
    """What can be read is played; that it is not all stands once in the driver's log, through the kit."""
    path = xdf(tmp_path)
    assert transport.read(config(path))[1].notes == ()
    octets = path.read_bytes()
    path.write_bytes(octets + b"\x07")

    async def first():
        return await anext(FilePlayer(config(path), {}).stream())

    note = asyncio.run(first())
    assert note.text.startswith(f"{path}: damaged, what could be read is played: ")
    assert "\n" not in note.text
    assert caplog.text == capsys.readouterr().err == ""


def test_an_avro_file_is_unpacked_within_a_bound(tmp_path, monkeypatch):
    """A block that unpacks to more than half an hour has, is refused before it is in memory."""
    half_a_mb = make.embrace_plus(tmp_path / "a.avro", (6, 5, 0), {"conversionFactor": 0.5}, eda=(4.0, [0.0] * 125_000))
    monkeypatch.setattr(embrace_plus_file, "MOST_BYTES", 100_000)
    with pytest.raises(ConfigError, match=r"a\.avro: .* unpacks to more than 100000 bytes"):
        play(half_a_mb)


NULLS = {"type": "record", "name": "Nulls", "fields": [{"name": "a", "type": "null"}]}
NOTHINGS = {
    "null": ["long", "null"],
    "no fields": ["long", {"type": "record", "name": "Nothing", "fields": []}],
    "fixed": ["long", {"type": "fixed", "name": "None", "size": 0}],
    "nulls": ["long", NULLS],
    "by its name": [["long", NULLS], "Nulls"],
}


@pytest.mark.parametrize("nothing", NOTHINGS)
def test_an_avro_array_of_nothing_is_refused_before_its_items_are_made(tmp_path, monkeypatch, nothing):
    """A hundred thousand million items would take no bytes: no bound on the bytes holds them."""
    one, items = NOTHINGS[nothing]
    fields = [{"name": "one", "type": one}, {"name": "rawData", "type": {"type": "array", "items": items}}]
    schema = {"type": "record", "name": "Session", "fields": fields}
    with (tmp_path / "a.avro").open("wb") as file:
        fastavro.writer(file, schema, [{"one": 1, "rawData": []}])

    def never(file, schema, reader_schema):
        assert schema in ("long", "bytes"), "the record is being read"
        return schemaless(file, schema, reader_schema)

    schemaless = fastavro.schemaless_reader
    monkeypatch.setattr(fastavro, "schemaless_reader", never)
    with pytest.raises(ConfigError, match=r"a\.avro: .* an array of items that take no bytes"):
        play(tmp_path / "a.avro")


def test_a_damaged_bzip2_in_avro_is_told_and_not_tried_again(tmp_path):
    """bz2 calls it an OSError, as if the disk had failed; another look would find the same."""
    path = make.embrace_plus(tmp_path / "a.avro", (6, 5, 0), {"conversionFactor": 0.5}, eda=(4.0, [0.5, 1.0]))
    with path.open("rb") as file:
        reader = fastavro.reader(file)
        schema, records = reader.writer_schema, list(reader)
    with path.open("wb") as file:
        fastavro.writer(file, schema, records, codec="bzip2")
    octets = bytearray(path.read_bytes())
    octets[octets.index(b"BZh") + 12] ^= 0xFF
    path.write_bytes(octets)
    with pytest.raises(ConfigError, match=r"a\.avro: .* bzip2 is damaged"):
        play(path)


@pytest.mark.parametrize("elsewhere", ["../secret.dat", "{folder}/secret.dat", ".."])
def test_a_header_names_no_file_outside_its_folder(tmp_path, elsewhere):
    """Neither as its data nor as its markers."""
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.dat").write_bytes(bytes(800))
    name = elsewhere.format(folder=tmp_path)
    for header, its_names in ((brainvision(inside), ("a.eeg", "a.vmrk")), (wfdb(inside), ("a.dat",))):
        text = header.read_text()
        for its in its_names:
            header.write_text(text.replace(its, name))
            with pytest.raises(ConfigError, match="not in its folder"):
                play(header)


def test_a_header_may_name_a_file_below_its_folder(tmp_path):
    """Records are kept so."""
    header = wfdb(tmp_path)
    (tmp_path / "data").mkdir()
    shutil.move(tmp_path / "a.dat", tmp_path / "data" / "a.dat")
    header.write_text(header.read_text().replace("a.dat", "data/a.dat"))
    assert play(header)

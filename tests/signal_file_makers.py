"""Small files of recorded signals in the formats of driver-file, made here, where no real one is at hand."""

import struct
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path

import fastavro
import numpy as np
import pyedflib

START = datetime(2024, 5, 6, 7, 8, 9)
START_NS = 1_714_979_289_000_000_000
"""The same, taken for UTC."""


def edf(
    path: Path,
    signals: Mapping[str, tuple[float, str, np.ndarray]],
    events: Sequence[tuple[float, str]] = (),
    kind: int = pyedflib.FILETYPE_EDFPLUS,
) -> Path:
    """Write signals by label, each as rate in Hz, unit and whole values, and events as onset in s and text."""
    with pyedflib.EdfWriter(str(path), len(signals), file_type=kind) as file:
        file.setStartdatetime(START)
        for number, (label, (rate_hz, unit, _)) in enumerate(signals.items()):
            header = {"label": label, "dimension": unit, "sample_frequency": rate_hz}
            limits = {"physical_min": -1000, "physical_max": 1000, "digital_min": -1000, "digital_max": 1000}
            file.setSignalHeader(number, header | limits | {"transducer": "", "prefilter": ""})
        if signals:
            file.writeSamples([np.asarray(values, np.float64) for _, _, values in signals.values()])
        for onset_s, text in events:
            file.writeAnnotation(onset_s, 0, text)
    return path


def edf_d(
    path: Path,
    channels: Mapping[str, tuple[str, float]],
    records: Sequence[tuple[str, Sequence[Sequence[int]]]],
    record_s: str = "1",
) -> Path:
    """Write an EDF+D, or a BDF+D by its suffix: channels by label, each as unit and what one count is.

    records: the annotations of each, `|` for 0x14 and `~` for 0, and the counts of every channel.
    """
    kind, octets = ("BDF", 3) if path.suffix == ".bdf" else ("EDF", 2)
    lengths = [len(counts) for counts in records[0][1]]
    rows: list[tuple[object, ...]] = [
        (label, "", unit, -1000 * scale, 1000 * scale, -1000, 1000, "", length, "")
        for (label, (unit, scale)), length in zip(channels.items(), lengths, strict=True)
    ]
    most = (1 << (8 * octets - 1)) - 1
    rows.append((f"{kind} Annotations", "", "", -1, 1, -most - 1, most, "", 60 // octets, ""))
    version = b"0       " if kind == "EDF" else b"\xffBIOSEMI"
    head = [("X X X X", 80), ("Startdate 06-MAY-2024 X X X", 80), (f"{START:%d.%m.%y%H.%M.%S}", 16)]
    head += [(256 * (len(rows) + 1), 8), (f"{kind}+D", 44), (len(records), 8), (record_s, 8), (len(rows), 4)]
    head += [(row[at], size) for at, size in enumerate((16, 80, 8, 8, 8, 8, 8, 80, 8, 32)) for row in rows]
    data = b""
    for told, values in records:
        data += b"".join(count.to_bytes(octets, "little", signed=True) for counts in values for count in counts)
        data += told.replace("|", "\x14").replace("~", "\0").encode().ljust(60, b"\0")
    path.write_bytes(version + "".join(f"{text:<{size}}" for text, size in head).encode() + data)
    return path


def wfdb(path: Path, signals: Mapping[str, tuple[int, str, np.ndarray]], frames_hz: int = 1) -> Path:
    """Write a record of format 16, gain 10, no date: signals by name, as samples a frame, unit and whole values."""
    frames = len(next(iter(signals.values()))[2]) // next(iter(signals.values()))[0]
    counts = np.hstack(
        [np.asarray(values).reshape(frames, per_frame) * 10 for per_frame, _, values in signals.values()]
    )
    path.with_suffix(".dat").write_bytes(counts.astype("<i2").tobytes())
    lines = [f"{path.stem} {len(signals)} {frames_hz} {frames}"]
    for name, (per_frame, unit, _) in signals.items():
        lines.append(f"{path.stem}.dat 16x{per_frame} 10/{unit} 16 0 0 0 0 {name}")
    path.with_suffix(".hea").write_text("\n".join(lines) + "\n")
    return path.with_suffix(".hea")


def segment(folder: Path, name: str, signals: Mapping[str, tuple[float, str, Sequence[int]]]) -> None:
    """Write a record of format 16 and 4 Hz that is to be a segment: signals by name, as gain, unit and counts."""
    rows = np.array([counts for _, _, counts in signals.values()]).T
    lines = [f"{name}.dat 16 {gain}/{unit} 16 0 0 0 0 {label}" for label, (gain, unit, _) in signals.items()]
    (folder / f"{name}.hea").write_text("\n".join([f"{name} {len(lines)} 4 {len(rows)}", *lines, ""]))
    (folder / f"{name}.dat").write_bytes(b"".join(int(one).to_bytes(2, "little", signed=True) for one in rows.ravel()))


def brainvision(
    path: Path, names: Sequence[str], values: np.ndarray, kind: str = "INT_16", by_sample: bool = True
) -> Path:
    """Write channels of 0.5 uV a step at 500 Hz, values of shape (n, channels), and a marker at the third sample."""
    stored = values if by_sample else values.T
    path.with_suffix(".eeg").write_bytes(stored.astype({"INT_16": "<i2", "IEEE_FLOAT_32": "<f4"}[kind]).tobytes())
    lines = ["Brain Vision Data Exchange Header File Version 1.0", "; a comment", "[Common Infos]", "Codepage=UTF-8"]
    lines += [f"DataFile={path.stem}.eeg", f"MarkerFile={path.stem}.vmrk", "DataFormat=BINARY", "SamplingInterval=2000"]
    lines += [f"DataOrientation={'MULTIPLEXED' if by_sample else 'VECTORIZED'}", f"NumberOfChannels={len(names)}"]
    lines += ["[Binary Infos]", f"BinaryFormat={kind}", "[Channel Infos]"]
    lines += [f"Ch{number}={name},,0.5,\u00b5V" for number, name in enumerate(names, 1)]
    path.with_suffix(".vhdr").write_text(
        "\n".join([*lines, "[Comment]", "anything = [at all"]) + "\n", encoding="utf-8"
    )
    marks = ["Brain Vision Data Exchange Marker File, Version 1.0", "[Common Infos]", "Codepage=UTF-8"]
    marks += [f"DataFile={path.stem}.eeg", "[Marker Infos]", f"Mk1=New Segment,,1,1,0,{START:%Y%m%d%H%M%S}000000"]
    path.with_suffix(".vmrk").write_text("\n".join([*marks, "Mk2=Stimulus,S  7,3,1,0"]) + "\n", encoding="utf-8")
    return path.with_suffix(".vhdr")


def xdf(
    path: Path, rate_hz: float, names: Sequence[str], values: np.ndarray, words: Sequence[tuple[float, str]]
) -> Path:
    """Write a stream of doubles from 10 s on, values of shape (n, channels), and one of words at their times in s."""
    channels = "".join(f"<channel><label>{name}</label><unit>microvolts</unit></channel>" for name in names)
    samples = [(10 + i / rate_hz, row.astype("<f8").tobytes()) for i, row in enumerate(values)]
    texts = [(at, b"\x01" + bytes([len(word)]) + word.encode()) for at, word in words]
    body = b"XDF:" + _chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")
    described = f"<desc><channels>{channels}</channels></desc>"
    body += xdf_stream(1, "EEG", len(names), rate_hz, "double64", described, samples)
    body += xdf_stream(2, "Markers", 1, 0, "string", "<desc></desc>", texts)
    path.write_bytes(body)
    return path


def xdf_stream(
    number: int, kind: str, count: int, rate_hz: float, form: str, desc: str, samples: list[tuple[float, bytes]]
) -> bytes:
    """Return the chunks of one stream, each sample as its time in s and its bytes."""
    head = f"<name>{kind}</name><type>{kind}</type><channel_count>{count}</channel_count>"
    head += f"<nominal_srate>{rate_hz}</nominal_srate><channel_format>{form}</channel_format>{desc}"
    which = struct.pack("<I", number)
    data = b"".join(b"\x08" + struct.pack("<d", at) + content for at, content in samples)
    footer = f"<?xml version='1.0'?><info><sample_count>{len(samples)}</sample_count></info>"
    return (
        _chunk(2, which + f"<?xml version='1.0'?><info>{head}</info>".encode())
        + _chunk(3, which + b"\x04" + struct.pack("<I", len(samples)) + data)
        + _chunk(6, which + footer.encode())
    )


def _chunk(tag: int, content: bytes) -> bytes:
    return b"\x04" + struct.pack("<IH", len(content) + 2, tag) + content


def embrace_plus(path: Path, version: tuple[int, int, int], imu: Mapping[str, float], **sensors: object) -> Path:
    """Write an Avro file as Empatica's cloud does: acceleration with these parameters, and what is given by field.

    sensors: rate in Hz and values, or those of x, y and z; all begin at START, tags are in us.
    """
    start_us = START_NS // 1000
    tags = {"tagsTimeMicros": sensors.pop("tags", [])}
    raw: dict[str, object] = {
        "tags": tags,
        "accelerometer": {"imuParams": imu},
        "bvp": {},
        "eda": {},
        "temperature": {},
    }
    for name in raw.keys() - {"tags"}:
        rate_hz, values = sensors.get(name, (0.0, []))
        columns = dict(zip("xyz", values or [[]] * 3, strict=True)) if name == "accelerometer" else {"values": values}
        raw[name] |= {"timestampStart": start_us, "samplingFrequency": rate_hz} | columns
    record = {"schemaVersion": dict(zip(("major", "minor", "patch"), version, strict=True)), "rawData": raw}
    with path.open("wb") as file:
        fastavro.writer(file, _schema_of("Session", record), [record], codec="deflate")
    return path


def _schema_of(name: str, value: object) -> object:
    """Return the Avro schema of a value; names of records are made of where they stand."""
    if isinstance(value, dict):
        fields = [{"name": key, "type": _schema_of(f"{name}_{key}", each)} for key, each in value.items()]
        return {"type": "record", "name": name, "fields": fields}
    if isinstance(value, list):
        return {"type": "array", "items": "float" if not value else _schema_of(name, value[0])}
    return "long" if isinstance(value, int) else "float"

"""What the services compute from recordings, replayed fast, against what they computed when it was looked at.

A simulated person is always there; four real recordings are where ../shared/data is. To write references/ anew:

    PYTHONPATH=tests .venv/bin/python tests/graph/replay_references.py

Look at the difference (`git diff --stat`, then the numbers) before committing it: it is the change of the algorithms.
"""

from __future__ import annotations

import csv
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import wfdb
from hri_msgs.msg import Expression, IdsList
from mcap.writer import Writer
from numpy.typing import NDArray
from processes import claimed_domain
from rclpy.serialization import serialize_message
from recorder.schemas import definition
from replay_law import Messages, recompute, stamp_ns
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel, SensorInfo, SensorInfoArray, SessionState
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.sources import EcgSource, PpgSource, Wearing
from sensor_bench.signals.waveforms import stored as stored_waveforms
from std_msgs.msg import String

ROOT = Path(__file__).resolve().parents[2]
REFERENCES = Path(__file__).with_name("references")
RATE = 20.0
TOLERANCE = 1e-6
"""Relative above 1, in s for times. Another CPU rounds differently, which is less than 1e-9 after all steps; a change
of the algorithms shows at the third or fourth digit, and a clock model is uncertain by a thousand times as much."""
SECOND_NS = 10**9
T0_NS = 1_750_000_000 * SECOND_NS
START_NS = T0_NS + 2 * SECOND_NS
LENGTH_S = 45.0
PPG_CHANNELS = ("ppg_0", "ppg_1", "ppg_2", "ambient")
EXPRESSIONS = ("neutral", "happy", "angry")
LATCHED = "- {reliability: reliable, durability: transient_local, history: keep_last, depth: 1}"
VOLATILE = "- {reliability: reliable, durability: volatile, history: keep_last, depth: 200}"
FIELDS = {
    "features": (
        "heart_rate_bpm peak_count rr_interval_ms signal_quality device_timestamp.sec device_timestamp.nanosec "
        "hrv.nn_count hrv.corrected_count hrv.mean_nn_ms hrv.rmssd_ms"
    ),
    "clock": "offset_ns skew_ppm uncertainty_s latency_s segment state",
    "state": "state confidence heart_rate_bpm expression person_id",
}


class Source(NamedTuple):
    """One stream. samples: shape (n, channels). device_ns: of every sample, None where the device has no time."""

    topic: str
    fs_hz: float
    unit: str
    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    device_ns: NDArray[np.int64] | None
    received_ns: NDArray[np.int64]
    frame: int


def simulated() -> list[Source]:
    """ECG and PPG of one heart as the sensor bench makes them, on one device's clock."""
    heart, worn, waveforms, count = Heart(5), Wearing(), stored_waveforms(), round(LENGTH_S * 130)
    ecg = EcgSource(heart, worn, waveforms, 6).read(0, count, 130.0)
    ppg = PpgSource(heart, worn, waveforms, 7).read(0, count, 130.0)
    return [
        _regular("p1/ecg/bench_1", 130.0, "uV", ("ecg",), ecg.astype(np.float64), 13, 1.0e15),
        _regular("p1/ppg/bench_1", 130.0, "counts", PPG_CHANNELS, ppg.astype(np.float64), 10, 1.0e15),
    ]


def real(data: Path) -> list[Source]:
    """An ECG and a PPG of one rest (NeuroKit), a Verity Sense with its own stamps (BIOBSS), MIT-BIH record 100."""
    with (data / "multimodal/neurokit/bio_resting_5min_100hz.csv").open() as file:
        rest = np.array([[float(row["ECG"]), float(row["PPG"])] for row in csv.DictReader(file)])
    record = wfdb.rdrecord(str(data / "ecg/mitdb/100"), sampto=round(LENGTH_S * 360), channels=[0])
    return [
        _regular("p2/ecg/rest_1", 100.0, "uV", ("ecg",), 1000.0 * rest[:, :1], 10, 4.0e15),
        _regular("p2/ppg/rest_2", 100.0, "counts", ("ppg_0",), 10_000.0 * rest[:, 1:], 7, None),
        _verity(data / "polar/verity_sense/Polar_Sense_PPG.txt"),
        _regular("p4/ecg/mitdb_100", 360.0, "uV", ("MLII",), 1000.0 * record.p_signal, 36, 9.0e15),
    ]


def _regular(
    name: str,
    fs_hz: float,
    unit: str,
    channels: tuple[str, ...],
    samples: NDArray[np.float64],
    frame: int,
    epoch_ns: float | None,
) -> Source:
    """A recording that has lost its stamps: a clock 20 ppm fast, receipt 20 to 60 ms late, the same at every call."""
    samples = samples[: round(LENGTH_S * fs_hz)]
    passed_ns = np.rint(np.arange(1, len(samples) + 1) / fs_hz * SECOND_NS).astype(np.int64)
    late_ns = np.random.default_rng(len(samples)).integers(20_000_000, 60_000_000, len(samples))
    device_ns = None if epoch_ns is None else int(epoch_ns) + passed_ns + passed_ns // 50_000
    topic = f"/humans/physiological/{name}/raw"
    return Source(topic, fs_hz, unit, channels, samples, device_ns, T0_NS + passed_ns + late_ns, frame)


def _verity(path: Path) -> Source:
    rows = path.read_text().splitlines()[1 : 1 + round(LENGTH_S * 55)]
    cells = [row.rstrip(";").split(";") for row in rows]
    phone_ns = [round(datetime.fromisoformat(c[0]).replace(tzinfo=UTC).timestamp() * 1000) * 1_000_000 for c in cells]
    received_ns = np.array(phone_ns, np.int64) - phone_ns[0] + T0_NS
    samples = np.array([[float(value) for value in c[2:6]] for c in cells])
    device_ns = np.array([int(c[1]) for c in cells], np.int64)
    topic = "/humans/physiological/p3/ppg/verity_1/raw"
    return Source(topic, 55.0, "counts", PPG_CHANNELS, samples, device_ns, received_ns, 11)


def write(found: list[Source], path: Path) -> None:
    """Write the session that never was: all sources beside each other, one face, and a common start."""
    said = [*_study(found), *(entry for source in found for entry in _raw(source)), *_face()]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for at_ns, topic, message in sorted(said, key=lambda entry: entry[0]):
            if topic not in channels:
                kind = f"{type(message).__module__.partition('.')[0]}/msg/{type(message).__name__}"
                schema = writer.register_schema(kind, "ros2msg", definition(kind).encode())
                latched = topic.startswith(("/study/", "/humans/persons/"))
                qos = {"offered_qos_profiles": LATCHED if latched else VOLATILE}
                channels[topic] = writer.register_channel(topic, "cdr", schema, qos)
            writer.add_message(channels[topic], at_ns, serialize_message(message), at_ns)
        writer.finish()


def _raw(source: Source) -> Iterator[tuple[int, str, Any]]:
    for end in range(source.frame, len(source.samples) + 1, source.frame):
        part, last = source.samples[end - source.frame : end], end - 1
        columns = zip(source.channels, part.T, strict=True)
        message = PhysioRaw(channels=[PhysioRawChannel(channel_name=c, samples=v.tolist()) for c, v in columns])
        message.header.stamp = from_ns(int(source.received_ns[last]))
        message.header.frame_id = source.topic.split("/")[-2]
        if source.device_ns is not None:
            message.device_timestamp = from_ns(int(source.device_ns[last]))
        yield int(source.received_ns[last]), source.topic, message


def _study(found: list[Source]) -> Iterator[tuple[int, str, Any]]:
    sensors = []
    for source in found:
        _, _, _, human_id, sensor_type, sensor_id, _ = source.topic.split("/")
        info = SensorInfo(sensor_id=sensor_id, sensor_type=sensor_type, human_id=human_id, unit=source.unit)
        info.sampling_frequency_hz, info.channel_names, info.online = source.fs_hz, list(source.channels), True
        info.range_min = info.range_max = math.nan
        sensors.append(info)
    yield T0_NS, "/study/sensors", SensorInfoArray(sensors=sensors)
    for at_ns, phase in ((T0_NS, SessionState.PREPARING), (T0_NS + SECOND_NS, SessionState.RECORDING)):
        state = SessionState(session_id="references", study="references", phase=phase)
        if phase == SessionState.RECORDING:
            state.start_at = from_ns(START_NS)
        yield at_ns, "/study/session", state
    yield T0_NS, "/humans/persons/tracked", IdsList(ids=["p1"])
    yield T0_NS, "/humans/persons/p1/face_id", String(data="f1")


def _face() -> Iterator[tuple[int, str, Any]]:
    """One face; its expressions come without a stamp."""
    for step in range(round(LENGTH_S * 5)):
        at_ns = T0_NS + step * SECOND_NS // 5 + 1_000_000
        faces = IdsList(ids=["f1"])
        faces.header.stamp = from_ns(at_ns)
        yield at_ns, "/humans/faces/tracked", faces
        if step % 2 == 0:
            word = EXPRESSIONS[step // 50 % 3]
            yield at_ns, "/humans/faces/f1/expression", Expression(expression=word, confidence=0.9)


def results(data: Path | None, work: Path, domain: int) -> dict[str, dict[str, Any]]:
    """Replay the recordings through the services; return what came out from the common start on, by file name."""
    write(simulated() + (real(data) if data else []), work / "references.mcap")
    return tables(recompute(work / "references.mcap", RATE, work / "recomputed", domain))


def tables(messages: Messages) -> dict[str, dict[str, Any]]:
    """What is compared: of each topic the numbers in FIELDS by stamp (ns after T0), and all events after the first."""
    found = {}
    for topic, said in sorted(messages.items()):
        field = topic.rpartition("/")[2]
        names = FIELDS[field].split()
        rows = {str(stamp_ns(m) - T0_NS): [_value(m, n) for n in names] for m in said if stamp_ns(m) >= START_NS}
        table: dict[str, Any] = {"topic": topic, "fields": names, "rows": rows}
        if field == "features":
            peaks = [t.sec * SECOND_NS + t.nanosec for m in said if stamp_ns(m) >= START_NS for t in m.peak_timestamps]
            table |= {"first_peak_ns": peaks[0], "peaks_s": [round((p - peaks[0]) / SECOND_NS, 9) for p in peaks]}
        found["_".join(topic.split("/")[3:])] = table
    return found


def _value(message: Any, name: str) -> Any:
    value = message
    for part in name.split("."):
        value = getattr(value, part)
    if isinstance(value, str):
        return value
    if isinstance(value, float | np.floating):
        return None if math.isnan(value) else float(f"{value:.12g}")
    return int(value)


def changes(stored: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Where now differs from what was stored, a line each; a clock model is kept last 1 and may be missed."""
    lines = []
    rows, other = stored["rows"], now["rows"]
    both = [stamp for stamp in rows if stamp in other]
    missed = len(rows) - len(both)
    allowed = len(rows) // 5 if stored["topic"].endswith("/clock") else 0
    if missed > allowed or len(other) > len(both):
        lines.append(f"{stored['topic']}: {len(rows)} stored, {len(other)} now, {len(both)} with the same stamps")
    for stamp in both:
        named = zip(stored["fields"], rows[stamp], other[stamp], strict=True)
        lines += [f"{stored['topic']} {stamp} {name}: {a} is {b} now" for name, a, b in named if not _same(a, b, name)]
    peaks, new = stored.get("peaks_s", []), now.get("peaks_s", [])
    if len(peaks) != len(new):
        lines.append(f"{stored['topic']}: {len(peaks)} peaks stored, {len(new)} now")
    elif not all(_same(a, b) for a, b in zip(peaks, new, strict=True)):
        lines.append(f"{stored['topic']}: peaks at other times")
    if abs(stored.get("first_peak_ns", 0) - now.get("first_peak_ns", 0)) > TOLERANCE * SECOND_NS:
        lines.append(f"{stored['topic']}: the first peak is elsewhere")
    return lines


def _same(a: Any, b: Any, name: str = "") -> bool:
    if name.endswith(("_ns", ".nanosec")):
        return abs(a - b) <= TOLERANCE * SECOND_NS
    if isinstance(a, float) or isinstance(b, float):
        return a is not None and b is not None and abs(a - b) <= TOLERANCE * max(1.0, abs(a))
    return bool(a == b)


def stored() -> dict[str, dict[str, Any]]:
    """What is in references/."""
    return {path.stem: json.loads(path.read_text()) for path in sorted(REFERENCES.glob("*.json"))}


def main() -> int:
    """Write references/ anew."""
    data = ROOT.parent / "shared" / "data"
    with tempfile.TemporaryDirectory() as work, claimed_domain() as domain:
        found = results(data, Path(work), domain)
    REFERENCES.mkdir(exist_ok=True)
    for name, table in found.items():
        rows = ",\n".join(f"  {json.dumps(stamp)}: {json.dumps(row)}" for stamp, row in table["rows"].items())
        head = {name: value for name, value in table.items() if name != "rows"}
        text = json.dumps(head, indent=None)[:-1] + f', "rows": {{\n{rows}\n}}}}\n'
        (REFERENCES / f"{name}.json").write_text(text)
        print(f"{name}: {len(table['rows'])} messages, {len(table.get('peaks_s', []))} peaks")
    return 0


if __name__ == "__main__":
    sys.exit(main())

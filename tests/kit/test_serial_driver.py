"""A device nobody here has heard of, on a serial port: what a driver of two files of code gets from the kit."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import poll
from rcl_interfaces.srv import GetParameters
from sense4hri import qos, stamps
from sense4hri.names import StreamName
from sense4hri_msgs.msg import ClockMeasurement, PhysioDeviceFeature, PhysioRaw, SessionAck, SessionState, StreamHealth
from virtual_skinbox import VirtualSkinBox

EDA = StreamName("p1", "eda", "box_1")
DRIVER = "skinbox/driver.py"


@pytest.fixture
def port(tmp_path: Path) -> Path:
    """Where the box is plugged in."""
    return tmp_path / "ttySkinBox"


@pytest.fixture
def plug(port: Path) -> Iterator[Callable[..., VirtualSkinBox]]:
    """plug(rate_hz=50, powered_ms=0, missing=()) plugs a box in, until the end of the test."""
    boxes: list[VirtualSkinBox] = []

    def new(**how: Any) -> VirtualSkinBox:
        boxes.append(VirtualSkinBox(port, **how))
        return boxes[-1]

    yield new
    for box in boxes:
        box.unplug()


@pytest.fixture
def drive(start, port):
    """Start the driver with further parameters."""
    return lambda **parameters: start(DRIVER, human_id="p1", sensor_id="box_1", port=port, **parameters)


def parameters(ears, *names: str) -> list[Any]:
    """Values of the driver's parameters; None where it has none of that name."""
    asked = GetParameters.Request(names=list(names))
    values = ears.ask(GetParameters, "/driver_skinbox_box_1/get_parameters", asked).values
    fields = {1: "bool_value", 2: "integer_value", 3: "double_value", 4: "string_value", 9: "string_array_value"}
    return [getattr(value, fields[value.type]) if value.type else None for value in values] or [None] * len(names)


def numbers_of(message: PhysioRaw) -> list[int]:
    return [round(value * 100) for value in message.channels[0].samples]


def device_ns(message: Any) -> int:
    return stamps.to_ns(message.device_timestamp)


def prepare(ears) -> list[SessionAck]:
    """Announce a session of everybody; the acknowledgements of it."""
    acks = ears.hear(SessionAck, "/study/ack", qos.ACK)
    announce = ears.node.create_publisher(SessionState, "/study/session", qos.SESSION)
    announce.publish(SessionState(session_id="s1", phase=SessionState.PREPARING, human_ids=["p1"]))
    return acks


def test_streams_are_known_once_the_box_is_there(drive, plug, ears) -> None:
    """Before, there is no stream and no session can begin; then parameters, names and samples are those declared."""
    raw = ears.hear(PhysioRaw, EDA.topic("raw"), qos.deep(qos.RAW))
    drive(eda__channel_names=["left hand"])
    acks = prepare(ears)
    refusal = ears.until(lambda: [ack for ack in acks if "no such port" in ack.detail], "the driver says why not")[0]
    assert not refusal.ok
    assert "ttySkinBox" in refusal.detail
    assert ears.node.count_publishers(EDA.topic("raw")) == 0
    plug()
    ears.until(lambda: len(raw) >= 3, "samples")
    wanted = ("eda.sampling_frequency_hz", "eda.unit", "eda.channel_names", "serial_number")
    assert parameters(ears, *wanted) == [50.0, "uS", ["left hand"], "SB-7"]
    assert raw[0].channels[0].channel_name == "left hand"
    assert numbers_of(raw[1]) == list(range(numbers_of(raw[1])[0], numbers_of(raw[1])[0] + 10))
    ears.until(lambda: acks[-1].ok, "the session may begin")


def test_a_counter_that_wraps_goes_on(drive, plug, ears) -> None:
    """16 bits of milliseconds go round: the device time goes on as if they had not, and nothing is lost or late."""
    raw = ears.hear(PhysioRaw, EDA.topic("raw"), qos.deep(qos.RAW))
    health = ears.hear(StreamHealth, EDA.topic("health"), qos.HEALTH)
    plug(powered_ms=64_500)
    drive()
    ears.until(lambda: len(raw) > 3 and device_ns(raw[-1]) > 67 * 10**9, "device times no 16 bits can hold")
    last = ears.until(lambda: [m for m in health if m.samples_total >= 100], "health")[-1]
    assert (last.gaps_total, last.lost_samples_total, last.duplicates_total) == (0, 0, 0)
    steps_ms = np.diff([device_ns(message) // 10**6 for message in raw])
    assert set(steps_ms.tolist()) == {200}


def test_a_restart_is_passed_on(drive, plug, ears) -> None:
    """A box that is powered off and on shows its new, small time at once, not the old one and a round more."""
    raw = ears.hear(PhysioRaw, EDA.topic("raw"), qos.deep(qos.RAW))
    box = plug(powered_ms=40_000)
    drive()
    ears.until(lambda: len(raw) >= 3, "samples")
    assert device_ns(raw[-1]) > 40 * 10**9
    box.restart()
    ears.until(lambda: any(device_ns(each) < 10 * 10**9 for each in raw), "the time of a box just powered on")


def test_a_hole_inside_a_frame_is_no_part_of_any_message(drive, plug, ears) -> None:
    """Samples 113, 114 and 126 never left the box: three are lost in two gaps, and every other one has its own time."""
    raw = ears.hear(PhysioRaw, EDA.topic("raw"), qos.deep(qos.RAW))
    health = ears.hear(StreamHealth, EDA.topic("health"), qos.HEALTH)
    drive()
    ears.until(lambda: ears.node.count_publishers("/study/ack") > 0, "the driver waits")
    plug(missing=(113, 114, 126))
    last = ears.until(lambda: [m for m in health if m.samples_total >= 140], "health")[-1]
    assert (last.gaps_total, last.lost_samples_total) == (2, 3)
    numbers = [numbers_of(message) for message in raw]
    assert all(part == list(range(part[0], part[-1] + 1)) for part in numbers)
    first_ns = {device_ns(message) - part[-1] * 20_000_000 for message, part in zip(raw, numbers, strict=True)}
    assert len(first_ns) == 1


def test_the_clock_is_measured_beside_the_stream(drive, plug, ears) -> None:
    """What the driver measures is the truth within what it says it may be off."""
    measured = ears.hear(ClockMeasurement, EDA.topic("clock_measurement"), qos.CLOCK_MEASUREMENT)
    box = plug(powered_ms=5_000)
    drive()
    for message in ears.until(lambda: len(measured) >= 2 and measured, "measurements"):
        assert abs(message.offset_ns - box.powered_ns) <= message.uncertainty_s * 1e9
        assert stamps.to_ns(message.header.stamp) >= device_ns(message) + message.offset_ns
        assert message.method == "ping over the serial port"


def test_a_box_that_only_reports_streams_all_the_same(drive, plug, ears) -> None:
    """Nothing sampled: no raw topic, but reports, health that streams, a service that is ready and a session too."""
    device = ears.hear(PhysioDeviceFeature, EDA.topic("device"), qos.DEVICE)
    health = ears.hear(StreamHealth, EDA.topic("health"), qos.HEALTH)
    plug(rate_hz=0)
    process = drive()
    report = ears.until(lambda: device, "a report")[0]
    assert (report.features[0].name, report.features[0].values[0]) == ("conductance_level", pytest.approx(12.34))
    last = ears.until(lambda: [m for m in health if m.state == m.STREAMING], "health")[-1]
    assert (last.nominal_rate_hz, last.samples_total) == (0.0, 0)
    poll(lambda: process.get("/readyz")[0] == 200, "ready")
    acks = prepare(ears)
    assert ears.until(lambda: acks, "the driver answers")[0].ok
    assert ears.node.count_publishers(EDA.topic("raw")) == 0


def test_another_box_on_the_same_port(drive, plug, ears) -> None:
    """After a loss the box says anew what it measures: another rate is taken over, no stream at all as well."""
    raw = ears.hear(PhysioRaw, EDA.topic("raw"), qos.deep(qos.RAW))
    health = ears.hear(StreamHealth, EDA.topic("health"), qos.HEALTH)
    first = plug()
    drive()
    ears.until(lambda: len(raw) >= 2, "samples of the first box")
    first.unplug()
    ears.until(lambda: health and health[-1].state == StreamHealth.LOST, "the loss")
    second = plug(rate_hz=25)
    ears.until(lambda: health[-1].nominal_rate_hz == 25.0 and health[-1].state == StreamHealth.STREAMING, "the second")
    assert parameters(ears, "eda.sampling_frequency_hz") == [25.0]
    assert health[-1].reconnects_total == 1
    second.unplug()
    plug(rate_hz=0)
    ears.until(lambda: ears.node.count_publishers(EDA.topic("raw")) == 0, "no raw stream any more")
    assert parameters(ears, "eda.sampling_frequency_hz") == [None]


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"eda__unit": "nS"}, "parameter 'eda.unit' is 'nS', the driver sends uS"),
        ({"eda__sampling_frequency_hz": 100}, "parameter 'eda.sampling_frequency_hz' is 100, the device has 50"),
        ({"eda__channel_names": ["a", "b"]}, "parameter 'eda.channel_names' must name 1 channels"),
    ],
)
def test_a_study_that_contradicts_the_box(drive, plug, given: dict[str, Any], named: str) -> None:
    """What cannot be true of the box that is there ends the driver with status 78 and the parameter's name."""
    plug()
    process = drive(**given)
    assert process.wait() == 78
    assert named in process.log()
    assert "Traceback" not in process.log()


def test_a_stopped_driver_closes_its_port_in_time(drive, plug) -> None:
    """The thread that reads ends with the driver, also between two bytes."""
    plug()
    process = drive()
    process.until("streaming")
    assert process.stop_within(8.0) == 0, process.log()

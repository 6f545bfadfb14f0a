"""A stranger on the graph: sends messages, answers and requests that nobody can use, and says how many.

    stranger.py COUNT SEED HEALTHY     HEALTHY: the raw topic of a stream that must not suffer

It publishes on streams of its own, of which it says nonsense, on every topic of the study and on the healthy stream's.
What it sends is made from good messages: fields at their ends, texts without end, bytes cut short, turned or of
another type. Of one stream for each of the newer interpreters it says what a driver says, so that it is taken, and then
sends values and stamps that no body and no clock has. On topics where a good message of a stranger's would rightly be
believed (the session, the assignments, the healthy stream) all of them are unfit.
"""

import math
import random
import struct
import sys
from array import array
from collections import Counter
from collections.abc import Iterator
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sense4hri import qos
from sense4hri.modalities import modality
from sense4hri.names import StreamName
from sense4hri.stamps import set_time
from sense4hri_msgs import msg
from sense4hri_msgs.srv import AssignSensor, StartSession

OWN = [StreamName("p9", "ecg", "bad_1"), StreamName("p9", "ecg", "bad_2"), StreamName("p9", "ppg", "bad_3")]
TOLD: dict[str, tuple[float, str, tuple[str, ...]]] = {
    "eda": (10.0, "uS", ("eda",)),
    "respiration": (25.0, "N", ("respiration",)),
    "emg": (500.0, "uV", ("emg_0", "emg_1")),
    "eeg": (250.0, "uV", ("Fz", "F3", "F4", "O1")),
    "eog": (100.0, "uV", ("heog", "veog")),
    "eye_tracking": (60.0, "px", ("gaze_x", "gaze_y")),
    "pupillometry": (60.0, "mm", ("diameter_left", "diameter_right")),
    "accelerometer": (52.0, "m/s^2", ("x", "y", "z")),
}
"""What it says of its streams of these types, as a driver does: rate in Hz, unit, channels."""
OWN += [StreamName("p9", sensor_type, "bad_4") for sensor_type in TOLD]
SIZES = (1e-300, 1e-9, 1.0, 1e3, 1e12, 1e29)
STEPS_NS = (10**9, 10**9, 10**9, 10**9, 0, -(10**9), 10**6, 4 * 10**12)
NUMBERS = (math.inf, -math.inf, math.nan, 1e307, -1e307, 1e-320, 0.0, -1.0)
INTEGERS = (2**63 - 1, -(2**63), 2**31 - 1, -(2**31), 255, -1, 0, 2**32 - 1)
TEXTS = (
    "",
    "\x00\x15\n\t",
    "x" * 70_000,
    "../../etc",
    "{" * 5000,
    '{"a":' * 5000,
    "\ufffd" * 300,
    "=1+1",
    "nan",
    "1e999",
)
BAD_VALUES = [
    ParameterValue(type=77),
    ParameterValue(type=4, string_value="much"),
    ParameterValue(type=4, string_value="x" * 100_000),
    ParameterValue(type=1, bool_value=True),
    ParameterValue(type=3, double_value=-250.0),
    ParameterValue(type=3, double_value=math.inf),
    ParameterValue(type=8, double_array_value=[1.0] * 20_000),
    ParameterValue(type=9, string_array_value=["x" * 1000] * 100),
]
WAIT_S = 0.001


class Stranger:
    """One node; `rounds` sends one thing at a time."""

    def __init__(self, seed: int, healthy: str) -> None:
        self._random = random.Random(seed)
        self.node: Node = rclpy.create_node("stranger", start_parameter_services=False)
        for kind, name, answer in ((GetParameters, "get", self._get), (ListParameters, "list", self._list)):
            self.node.create_service(kind, f"stranger/{name}_parameters", answer, qos_profile=QoSProfile(depth=1000))
        self.sent: Counter[str] = Counter()
        """How many of what, by topic, and `answers`."""
        self._any = [(kind, self._publisher(kind, topic, profile)) for kind, topic, profile in _topics()]
        base = healthy.rpartition("/")[0]
        self._unfit = [
            (msg.PhysioRaw, self._publisher(msg.PhysioRaw, healthy, qos.RAW)),
            (msg.StreamHealth, self._publisher(msg.StreamHealth, f"{base}/health", qos.HEALTH)),
            (msg.SessionState, self._publisher(msg.SessionState, "/study/session", qos.SESSION)),
            (msg.SensorAssignmentArray, self._publisher(msg.SensorAssignmentArray, "/study/assignments", qos.SESSION)),
        ]
        by_topic = {publisher.topic_name: publisher for _, publisher in self._any}
        self._taken = [(stream, by_topic[stream.topic("raw")]) for stream in OWN if stream.sensor_type in TOLD]
        self._now_ns = 10**18
        self._setters = [self.node.create_client(SetParameters, f"/{name}/set_parameters") for name in SERVICES]
        self._starter = self.node.create_client(StartSession, "/study/start_session")
        self._assigner = self.node.create_client(AssignSensor, "/study/assign_sensor")

    def one(self) -> None:
        """Send one thing, and answer whoever asks meanwhile."""
        pick = self._random.random()
        if pick < 0.02:
            self._ask()
        elif pick < 0.2:
            stream, publisher = self._random.choice(self._taken)
            publisher.publish(self._second(*TOLD[stream.sensor_type]))
            self.sent[publisher.topic_name] += 1
        elif pick < 0.5:
            kind, publisher = self._random.choice(self._unfit)
            publisher.publish(self._cut(kind))
            self.sent[publisher.topic_name] += 1
        else:
            kind, publisher = self._random.choice(self._any)
            publisher.publish(self._random.choice((self._ends, self._cut, self._turned, self._other))(kind))
            self.sent[publisher.topic_name] += 1
        self._answer()

    def _answer(self) -> None:
        """Answer all who ask by now."""
        answered = -1
        while answered != (answered := self.sent["answers"]):
            rclpy.spin_once(self.node, timeout_sec=WAIT_S)

    def _publisher(self, kind: type, topic: str, profile: Any) -> Any:
        return self.node.create_publisher(kind, topic, profile)

    def _ask(self) -> None:
        if self._random.random() < 0.7:
            client: Any = self._random.choice(self._setters)
            value = self._random.choice([ParameterValue(type=self._random.randrange(10, 256)), *BAD_VALUES])
            name = self._random.choice(("human_id", "use_sim_time", "nobody", "x" * 10_000, ""))
            client.call_async(SetParameters.Request(parameters=[Parameter(name=name, value=value)] * 3))
        elif self._random.random() < 0.5:
            self._starter.call_async(self._fill(StartSession.Request(study="s", session_id="../x")))
        else:
            self._assigner.call_async(self._fill(AssignSensor.Request(sensor_id="h10_1", human_id="p/1")))

    def _fill(self, request: Any) -> Any:
        """Put a text without end into a field that is still empty; all the rest stays as it is."""
        for field, kind in request.get_fields_and_field_types().items():
            if kind == "string" and not getattr(request, field):
                setattr(request, field, self._random.choice(TEXTS))
        return request

    def _second(self, fs_hz: float, unit: str, channels: tuple[str, ...]) -> msg.PhysioRaw:
        """A second of a stream in good form: noise of a size that no body makes, with holes, at any time."""
        size, holes = self._random.choice(SIZES), self._random.choice((0.0, 0.0, 0.5, 1.0))
        message = msg.PhysioRaw()
        for name in channels:
            noise = (
                self._random.gauss(0, size) if self._random.random() >= holes else math.nan for _ in range(int(fs_hz))
            )
            message.channels.append(msg.PhysioRawChannel(channel_name=name, samples=array("d", noise)))
        for stamp in (message.header.stamp, message.device_timestamp):
            self._now_ns = max(1, min(2 * 10**18, self._now_ns + self._random.choice(STEPS_NS)))
            set_time(stamp, self._now_ns)
        return message

    def _ends(self, kind: type) -> bytes:
        """A message whose fields are at the ends of what their type holds."""
        return bytes(serialize_message(self._filled(kind())))

    def _filled(self, message: Any, depth: int = 0) -> Any:
        for field, type_name in message.get_fields_and_field_types().items():
            if self._random.random() < 0.3:
                continue
            value = getattr(message, field)
            if isinstance(value, float):
                setattr(message, field, self._random.choice(NUMBERS))
            elif isinstance(value, int) and not isinstance(value, bool):
                setattr(message, field, _fitting(self._random.choice(INTEGERS), type_name))
            elif isinstance(value, str):
                setattr(message, field, self._random.choice(TEXTS))
            elif type_name == "sequence<double>":
                setattr(message, field, [self._random.choice(NUMBERS) for _ in range(self._random.choice((0, 1, 50)))])
            elif type_name == "sequence<string>":
                setattr(message, field, [self._random.choice(TEXTS) for _ in range(3)])
            elif hasattr(value, "get_fields_and_field_types"):
                self._filled(value, depth + 1)
            elif item := ITEMS.get(type_name):
                setattr(message, field, [self._filled(item(), depth + 1) for _ in range(self._random.choice((1, 3)))])
        return message

    def _cut(self, kind: type) -> bytes:
        """Fewer bytes than any message of the type has, or a stamp that is none."""
        whole = bytes(serialize_message(kind()))
        if self._random.random() < 0.5:
            return whole[: self._random.randrange(4, 16)]
        return whole[:4] + struct.pack("<iI", -self._random.randrange(1, 2**31), 2**32 - 1) + whole[12:]

    def _turned(self, kind: type) -> bytes:
        """Some bytes are others."""
        whole = bytearray(serialize_message(self._filled(kind())))
        for _ in range(self._random.choice((1, 3, 20))):
            whole[self._random.randrange(4, len(whole))] = self._random.randrange(256)
        return bytes(whole)

    def _other(self, kind: type) -> bytes:
        """A message of another type."""
        other = self._random.choice([each for each, _, _ in _topics() if each is not kind])
        return self._ends(other)

    def _list(self, request: Any, response: Any) -> Any:
        self.sent["answers"] += 1
        response.result.names = ["sensor_id", "human_id", "ecg.unit", "x" * 5000, "a"]
        return response

    def _get(self, request: Any, response: Any) -> Any:
        """What a driver says of the streams in TOLD; else nonsense, sometimes of fewer or more than were asked for."""
        self.sent["answers"] += 1
        if any(name.partition(".")[0] in TOLD for name in request.names):
            response.values = [_said(*name.partition(".")[::2]) for name in request.names]
            return response
        count = len(request.names) + self._random.choice((0, 0, 0, 1, -1))
        response.values = [self._random.choice(BAD_VALUES) for _ in range(max(0, count))]
        return response


SERVICES = (
    "recorder",
    "metadata_registry",
    "clock_sync",
    "interpreter_ecg",
    "interpreter_ppg",
    *(f"interpreter_{each}" for each in ("eda", "respiration", "emg", "eeg", "eog")),
    *(f"interpreter_{each}" for each in ("eye_tracking", "pupillometry", "motion")),
    "bridge_lsl",
    "fusion_affect",
    "session_coordinator",
    "web_gui",
)
ITEMS = {
    "sequence<sense4hri_msgs/PhysioRawChannel>": msg.PhysioRawChannel,
    "sequence<sense4hri_msgs/PhysioFeature>": msg.PhysioFeature,
    "sequence<sense4hri_msgs/SensorInfo>": msg.SensorInfo,
    "sequence<sense4hri_msgs/Indicator>": msg.Indicator,
    "sequence<diagnostic_msgs/DiagnosticStatus>": DiagnosticStatus,
    "sequence<diagnostic_msgs/KeyValue>": KeyValue,
    "sequence<rcl_interfaces/Parameter>": Parameter,
}
_BITS = {"int64": 63, "int32": 31, "int8": 7, "uint64": 64, "uint32": 32, "uint16": 16, "uint8": 8, "byte": 8}


def _said(sensor_type: str, parameter: str) -> ParameterValue:
    """A driver's answer of a stream; `not set` of what is no parameter of a stream."""
    fs_hz, unit, channels = TOLD.get(sensor_type, (0.0, "", ()))
    values = {
        "sampling_frequency_hz": ParameterValue(type=3, double_value=fs_hz),
        "unit": ParameterValue(type=4, string_value=unit),
        "channel_names": ParameterValue(type=9, string_array_value=list(channels)),
        "px_per_deg": ParameterValue(type=3, double_value=40.0),
    }
    return values.get(parameter, ParameterValue())


def _fitting(value: int, type_name: str) -> int:
    """The nearest number that the field's type holds."""
    bits = _BITS.get(type_name, 7)
    low = 0 if type_name.startswith("u") or type_name == "byte" else -(2**bits)
    return max(low, min(2**bits - 1, value))


def _topics() -> Iterator[tuple[type, str, Any]]:
    for stream in OWN:
        features = getattr(msg, modality(stream.sensor_type).message)
        yield msg.PhysioRaw, stream.topic("raw"), qos.RAW
        yield features, stream.topic("features"), qos.FEATURES
        if stream.sensor_type in TOLD:
            continue
        yield msg.StreamHealth, stream.topic("health"), qos.HEALTH
        yield msg.ClockModel, stream.topic("clock"), qos.CLOCK
        yield msg.ClockMeasurement, stream.topic("clock_measurement"), qos.CLOCK_MEASUREMENT
        yield msg.PhysioDeviceFeature, stream.topic("device"), qos.DEVICE
    yield msg.UserState, "/humans/physiological/p9/state", qos.STATE
    yield msg.SessionAck, "/study/ack", qos.ACK
    yield msg.Marker, "/study/markers", qos.MARKERS
    yield msg.SensorInfoArray, "/study/sensors", qos.SENSORS
    yield DiagnosticArray, "/diagnostics", qos.HEALTH
    yield ParameterEvent, "/parameter_events", qos.deep(qos.MARKERS)


def main() -> None:
    """Send COUNT things; print how many of what, then how it ended."""
    count, seed, healthy = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    rclpy.init()
    stranger = Stranger(seed, healthy)
    print("here", flush=True)
    for _ in range(count):
        stranger.one()
    for topic, number in sorted(stranger.sent.items()):
        print(f"sent {number} to {topic}", flush=True)
    print("done", flush=True)
    while True:  # it goes on lying until it is ended
        rclpy.spin_once(stranger.node, timeout_sec=0.1)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(0)

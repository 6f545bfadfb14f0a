"""The configuration is strict and names what is wrong."""

from pathlib import Path

import pytest
import yaml
from sensor_bench.config import DEFAULT_DEVICES, BenchConfig, parse
from sensor_bench.scene import RECOGNISED, Scene

DEFAULT_FILE = Path(__file__).resolve().parents[3] / "services" / "sensor-bench" / "config" / "default.yaml"
ONE = """
participants: {{p1: {{}}}}
devices:
  - {{sensor: h10_1, model: H10, participant: p1, address: "F1:00:00:00:00:01", device_id: 1A2B3C01{extra}}}
"""


def test_the_default_file_says_what_the_defaults_are():
    """config/default.yaml gives every parameter with the value it has without the file."""
    given = yaml.safe_load(DEFAULT_FILE.read_text())["/**"]["ros__parameters"]
    assert parse(given.pop("devices")) == parse(DEFAULT_DEVICES)
    defaults = BenchConfig().__dict__.copy()
    del defaults["devices"]
    assert given == defaults


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[", "not YAML"),
        ("a: 1", "participants and devices"),
        ("participants: []\ndevices: []", "table"),
        ("participants: {1p: {}}\ndevices: []", "'1p' is no identifier"),
        ("participants: {p1: {heart: 1}}\ndevices: []", "participants.p1: unknown key 'heart'"),
        ("participants: {p1: {heart_rate_bpm: fast}}\ndevices: []", "heart_rate_bpm: expected float"),
        (ONE.format(extra=", skew: 1"), "devices[0]: unknown key 'skew'"),
        (ONE.format(extra=", contact: 1"), "devices[0].contact: expected bool"),
        (ONE.format(extra=", link: {latency: 1}"), "devices[0].link: unknown key 'latency'"),
        (ONE.format(extra=", battery_percent: 120"), "battery_percent: 120 is not within 0..100"),
        (ONE.format(extra=", clock_start: noon"), "devices[0].clock_start"),
        (ONE.format(extra=", play: {ppg: x.csv}"), "plays ecg, accelerometer, not 'ppg'"),
        (ONE.format(extra=", play: {ecg: /nowhere.csv}"), "no such file: /nowhere.csv"),
        (ONE.format(extra="").replace("H10,", "H11,"), "'H11' is not one of H10, VeritySense, OH1"),
        (ONE.format(extra="").replace("participant: p1", "participant: p9"), "'p9' is not among the participants"),
        (ONE.format(extra="").replace("F1:00", "f1:00"), "no upper-case Bluetooth address"),
        (ONE.format(extra="").replace("1A2B3C01", "polar"), "'polar' is not 7 or 8"),
        (ONE.format(extra="") + ONE.format(extra="").splitlines()[-1], "sensor 'h10_1' is used twice"),
    ],
)
def test_what_is_wrong_is_named(text, reason):
    """Every mistake in the devices text is a ValueError that says where and what."""
    with pytest.raises(ValueError, match="devices: ") as caught:
        BenchConfig(devices=text)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"socket_path": "bus"}, "socket_path"),
        ({"socket_path": "/" + 120 * "x"}, "socket_path"),
        ({"adapter": "eth0"}, "adapter"),
        ({"expression_interval_s": 0.0}, "expression_interval_s"),
        ({"input": "/nowhere/100.hea"}, "input: no such file"),
    ],
)
def test_wrong_parameters_are_named(values, reason):
    """A parameter out of its range is a ValueError with its name."""
    with pytest.raises(ValueError, match=reason):
        BenchConfig(**values)


def test_whole_numbers_are_taken_where_fractions_are_meant():
    """`skew_ppm: 40` is 40.0."""
    (device,) = parse(ONE.format(extra=", skew_ppm: 40")).devices
    assert isinstance(device.skew_ppm, float)


def test_input_is_played_by_the_first_participants_devices(shared_data):
    """An ECG goes to p1's strap alone; a file with ECG and PPG to strap and arm band."""
    record = str(shared_data / "ecg" / "mitdb" / "100.hea")
    plays = {device.sensor: dict(device.play) for device in BenchConfig(input=record).cast().devices}
    assert plays["h10_1"]["ecg"].file == record
    assert plays["verity_1"] == plays["h10_2"] == plays["verity_2"] == {}
    both = str(shared_data / "multimodal" / "neurokit" / "bio_resting_5min_100hz.csv")
    plays = {device.sensor: dict(device.play) for device in BenchConfig(input=both).cast().devices}
    assert (plays["h10_1"]["ecg"].column, plays["verity_1"]["ppg"].column) == ("ECG", "PPG")


class TestScene:
    """Faces and persons."""

    @pytest.fixture
    def scene(self):
        return Scene(BenchConfig().cast().participants)

    def test_faces_belong_to_their_participants(self, scene):
        """Each visible face is its person's; a hidden one leaves the person with none."""
        assert scene.face_of_person() == {"p1": "face_a", "p2": "face_b"}
        scene.show(1)
        assert list(scene.visible()) == ["face_a"]
        assert scene.face_of_person() == {"p1": "face_a", "p2": ""}

    def test_strangers_fill_up(self, scene):
        """More faces than are known are strangers without a person."""
        scene.show(4)
        assert len(scene.visible()) == 4
        assert scene.face_of_person() == {"p1": "face_a", "p2": "face_b"}

    def test_a_refused_change_changes_nothing(self, scene):
        """One bad face in a request leaves the others as they were."""
        before = scene.faces.copy()
        with pytest.raises(ValueError, match=r"face_b\.expression: 'fear'"):
            scene.update({"face_a": {"expression": "happy"}, "face_b": {"expression": "fear"}})
        assert scene.faces == before

    @pytest.mark.parametrize("expression", RECOGNISED)
    def test_everything_the_recogniser_says_can_be_set(self, scene, expression):
        """The seven expressions of hri_emotion_recognizer are accepted."""
        scene.update({"face_a": {"expression": expression}})
        assert scene.faces["face_a"].expression == expression

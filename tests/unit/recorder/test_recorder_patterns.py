"""Which topics are meant, and how a type is described."""

import pytest
from recorder import schemas
from recorder.config import IDENTIFYING, PATTERNS, Config
from sense4hri.patterns import Patterns


@pytest.mark.parametrize(
    ("glob", "topic", "expected"),
    [
        ("/humans/**", "/humans/physiological/p1/ecg/h10/raw", True),
        ("/humans/**", "/humans", True),
        ("/humans/**", "/humanses/x", False),
        ("/tf*", "/tf", True),
        ("/tf*", "/tf_static", True),
        ("/tf*", "/tf/x", False),
        ("/rosout", "/rosout", True),
        ("/rosout", "/rosout_agg", False),
        ("/robot/*/joint_states", "/robot/left/joint_states", True),
        ("/robot/*/joint_states", "/robot/left/arm/joint_states", False),
        ("/**/raw", "/humans/physiological/p1/ecg/h10/raw", True),
        ("/**", "/anything/at/all", True),
        ("/cam?", "/cam1", True),
        ("/cam?", "/cam12", False),
        ("/a.b", "/axb", False),
    ],
)
def test_globs(glob, topic, expected):
    """`*` stays between two slashes, `**` is any number of parts, everything else is itself."""
    assert Patterns([glob]).match(topic) is expected


@pytest.mark.parametrize(
    "topic",
    [
        "/humans/faces/f1/cropped",
        "/humans/faces/f1/aligned",
        "/humans/faces/f1/frontalized",
        "/humans/faces/f1/cropped/compressed",
        "/humans/bodies/b1/cropped",
        "/humans/voices/v1/audio",
        "/humans/persons/p1/name",
    ],
)
def test_what_identifies_people(topic):
    """Images of faces and bodies, voices and names are matched by the default patterns and withheld by default."""
    assert Patterns(PATTERNS).match(topic)
    assert Patterns(IDENTIFYING).match(topic)


@pytest.mark.parametrize(
    "topic", ["/humans/faces/tracked", "/humans/faces/f1/expression", "/humans/persons/p1/face_id"]
)
def test_what_does_not_identify_people(topic):
    """Ids and expressions are recorded."""
    assert not Patterns(IDENTIFYING).match(topic)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"directory": ""}, "directory"),
        ({"patterns": ()}, "patterns"),
        ({"patterns": ("humans/**",)}, "humans"),
        ({"exclude": ("x",)}, "exclude"),
        ({"flush_interval_s": 0.0}, "flush_interval_s"),
        ({"compression": "gzip"}, "compression"),
        ({"record_when": "sometimes"}, "record_when"),
        ({"free_floor_mb": -1}, "free_floor_mb"),
        ({"split_s": -1.0}, "split_s"),
    ],
)
def test_a_wrong_parameter_is_named(change, named):
    """What cannot be meant is refused, and the message names it."""
    with pytest.raises(ValueError, match=named):
        Config(**change)


@pytest.fixture
def share(tmp_path, monkeypatch):
    """A folder with the definitions of three small packages."""
    texts = {
        "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
        "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
        "lab_msgs/msg/Arm": "# an arm\nstd_msgs/Header header\nJoint[] joints  # all\nstring<=10 name\nuint8 OK=1\n",
        "lab_msgs/msg/Joint": "float64[3] position\nJointKind kind\nbuiltin_interfaces/Time[<=4] at\n",
        "lab_msgs/msg/JointKind": "uint8 kind\n",
        "lab_msgs/msg/Odd": "other_msgs/Gone gone\n",
    }
    for name, text in texts.items():
        path = tmp_path / "share" / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    schemas.definition.cache_clear()
    schemas.begins_with_header.cache_clear()
    yield tmp_path
    schemas.definition.cache_clear()
    schemas.begins_with_header.cache_clear()


def test_a_definition_holds_every_nested_type_once(share):
    """The text is followed by that of each nested type, also of those nested deeper, each once."""
    text = schemas.definition("lab_msgs/msg/Arm")
    parts = text.split("=" * 80 + "\n")
    assert parts[0].startswith("# an arm\nstd_msgs/Header header")
    names = [part.splitlines()[0] for part in parts[1:]]
    assert sorted(names) == [
        "MSG: builtin_interfaces/Time",
        "MSG: lab_msgs/Joint",
        "MSG: lab_msgs/JointKind",
        "MSG: std_msgs/Header",
    ]


def test_a_header_in_front_is_seen(share):
    """Only a type that begins with a Header carries its publish time in its first bytes."""
    assert schemas.begins_with_header("lab_msgs/msg/Arm")
    assert not schemas.begins_with_header("lab_msgs/msg/Joint")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("lab_msgs/msg/Nothing", "Nothing"),
        ("gone_msgs/msg/X", "gone_msgs"),
        ("lab_msgs/msg/Odd", "other_msgs"),
        ("x", "x"),
    ],
)
def test_a_type_that_is_not_installed_is_named(share, name, said):
    """So is one that is missing inside another."""
    with pytest.raises(schemas.UnknownType, match=said):
        schemas.definition(name)

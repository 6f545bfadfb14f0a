"""The command line as ROS parameters."""

import pytest
from replay.cli import ros_arguments


def test_words_become_parameters():
    """Every option is a parameter; strings are quoted, so that a path of digits stays a string."""
    out = ros_arguments(
        [
            "20261121",
            "--rate",
            "20",
            "--what",
            "raw",
            "--topics",
            "/a/*",
            "/b",
            "--loop",
            "--start",
            "3",
            "--wait-for",
            "clock_sync",
            "lab/fusion",
        ]
    )
    given = dict(word.split(":=", 1) for word in out[2::2])
    assert out[0] == "--ros-args"
    assert set(out[1::2]) == {"-p"}
    assert given == {
        "progress": "true",
        "bag": '"20261121"',
        "rate": "20.0",
        "what": '"raw"',
        "topics": '["/a/*", "/b"]',
        "wait_for": '["clock_sync", "lab/fusion"]',
        "loop": "true",
        "start_s": "3.0",
    }


def test_a_ros_command_line_is_left_alone():
    """What begins with --ros-args, or is empty, goes to ROS as it is; after the options more may follow."""
    assert ros_arguments([]) == []
    assert ros_arguments(["--ros-args", "-p", "bag:=x"]) == ["--ros-args", "-p", "bag:=x"]
    assert ros_arguments(["x", "--ros-args", "-r", "__ns:=/a"])[-2:] == ["-r", "__ns:=/a"]


def test_nonsense_is_refused(capsys):
    """An unknown word ends with status 2 and the usage."""
    with pytest.raises(SystemExit) as ended:
        ros_arguments(["x", "--speed", "3"])
    assert ended.value.code == 2
    assert "usage: sense4hri-replay" in capsys.readouterr().err

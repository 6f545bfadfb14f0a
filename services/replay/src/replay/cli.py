"""The command line: words a researcher types, turned into ROS parameters."""

import argparse
import json
from collections.abc import Sequence


def ros_arguments(words: Sequence[str]) -> list[str]:
    """Return the command line as `--ros-args -p ...`; one that begins with `--ros-args` is returned as it is.

    Exits with status 2 where it makes no sense.
    """
    if not words or words[0] == "--ros-args":
        return list(words)
    split = words.index("--ros-args") if "--ros-args" in words else len(words)
    given = {name: value for name, value in vars(_parser().parse_args(words[:split])).items() if value is not None}
    out = ["--ros-args", "-p", "progress:=true"]
    for name, value in given.items():
        out += ["-p", f"{name}:={json.dumps(value)}"]  # JSON strings and lists are YAML
    return out + list(words[split + 1 :])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="sense4hri-replay", description="Plays a recording back onto the graph.")
    parser.add_argument(
        "bag", metavar="BAG", help="a session (any of its folders, or FOLDER/ID), rosbag2 folder or .mcap file"
    )
    parser.add_argument("--only-this-part", action="store_true", default=None, help="leave out the other folders")
    parser.add_argument("--rate", type=float, help="speed (1); 0 = as fast as subscribers keep up")
    parser.add_argument("--what", choices=("all", "raw"), help="raw: leave out what services compute from the rest")
    parser.add_argument("--topics", nargs="+", metavar="GLOB", help="topics to play (/**)")
    parser.add_argument("--exclude", nargs="+", metavar="GLOB", help="topics to leave out all the same")
    parser.add_argument("--remap", nargs="+", metavar="/FROM:=/TO", help="other names")
    parser.add_argument("--start", dest="start_s", type=float, metavar="S", help="begin at so many seconds")
    parser.add_argument("--loop", action="store_true", default=None, help="begin again at the end")
    parser.add_argument("--wait-for", nargs="+", metavar="NODE", help="play nothing until these nodes are there")
    parser.add_argument("--clock", action="store_true", default=None, help="publish /clock")
    return parser

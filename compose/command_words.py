"""What the words of a command say: the ROS parameters in them, and where their paths are without a container."""

import itertools
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import ros_yaml
import yaml
from compose_yaml import StudyError


def parameters_of(where: str, command: Sequence[str], here: Callable[[str], str] = str) -> dict[str, Any]:
    """Return the ROS parameters that a command sets with -p and --params-file, the last one of a name.

    where: the key, begins what is said of one that is wrong. here: the path on this machine for one in the command.
    """
    words = command[command.index("--ros-args") + 1 :] if "--ros-args" in command else []
    found: dict[str, Any] = {}
    for option, value in itertools.pairwise(words):
        if option in ("-p", "--param"):
            name, given, text = value.partition(":=")
            if not given:
                raise StudyError(f"{where}: {shlex.quote(value)} after -p must be name:=value")
            found[name.rpartition(":")[2]] = _value(f"{where}: {name}", text)
        elif option == "--params-file":
            found |= _file(f"{where}: --params-file", Path(here(value)))
    return found


def _file(where: str, path: Path) -> dict[str, Any]:
    """Return the parameters of a ROS parameter file, whatever node it names; nested ones with dots."""
    try:
        text = path.read_text("utf-8")
    except OSError as error:
        raise StudyError(f"{where}: {path} cannot be read: {error.strerror}") from error
    nodes = _value(f"{where}: {path}", text)
    blocks = [node.get("ros__parameters") or {} for node in nodes.values()] if isinstance(nodes, dict) else []
    return {name: value for block in blocks for name, value in _flat(block).items()}


def _flat(block: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in block.items():
        found |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return found


def _value(where: str, text: str) -> Any:
    try:
        return ros_yaml.load(text)
    except yaml.constructor.ConstructorError as error:
        raise StudyError(f"{where}: {text!r}: {error.problem}") from error
    except yaml.YAMLError as error:
        raise StudyError(f"{where}: {text!r} is no YAML: {' '.join(str(error).split())}") from error


def mapping(mounts: Mapping[str, str], volumes: Path) -> Callable[[str], str]:
    """Return what turns every path inside a mount, wherever in a text, into the path on this machine."""
    sources = {target: source if source.startswith("/") else str(volumes / source) for target, source in mounts.items()}
    if not sources:
        return lambda text: text
    longest_first = sorted(map(re.escape, sources), key=len, reverse=True)
    inside = re.compile(rf"(?<![\w./-])({'|'.join(longest_first)})(?![\w.-])")
    return lambda text: inside.sub(lambda found: sources[found[1]], text)

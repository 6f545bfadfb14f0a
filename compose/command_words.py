"""What the words of a command say: the ROS parameters in them, and where their paths are without a container."""

import itertools
import os
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import ros_yaml
import yaml
from compose_yaml import StudyError, said, text_of

SERVICES = Path(__file__).parents[1] / "services"
NAMED_LATER = ("driver_", "clock_sync")
"""How packages begin whose node is called by its sensor or machine, and reads its parameters under another name too."""


def parameters_of(where: str, command: Sequence[str], here: Callable[[str], str] = str) -> dict[str, Any]:
    """Return the ROS parameters that a command sets with -p and --params-file, the last one of a name.

    where: the key, begins what is said of one that is wrong. here: the path on this machine for one in the command.
    """
    words = command[command.index("--ros-args") + 1 :] if "--ros-args" in command else []
    package = command[command.index("-m") + 1] if "-m" in command[:-1] else ""
    found: dict[str, Any] = {}
    for option, value in itertools.pairwise(words):
        if option in ("-p", "--param"):
            name, given, text = value.partition(":=")
            if not given:
                raise StudyError(f"{where}: {shlex.quote(value)} after -p must be name:=value")
            found[name.rpartition(":")[2]] = _value(f"{where}: {name}: {text!r}", text)
        elif option == "--params-file":
            found |= _file(f"{where}: --params-file", Path(here(value)), package)
    return found


def _file(where: str, path: Path, package: str) -> dict[str, Any]:
    """Return the parameters that a ROS parameter file has for a node; nested ones with dots."""
    content = _value(f"{where}: {path}", text_of(f"{where}: {path}", path))
    nodes = content if isinstance(content, dict) else {}
    own = [node for name, node in nodes.items() if _is_for(str(name), package)]
    if nodes and not own:
        raise StudyError(
            f"{where}: {path} is for {', '.join(map(str, nodes))}: ROS gives {package} nothing of it; write /**"
        )
    blocks = [node.get("ros__parameters") or {} for node in own if isinstance(node, dict)]
    for block in blocks:
        if not isinstance(block, dict):
            raise StudyError(f"{where}: {path}: ros__parameters is {block!r}, must be a table")
    return {name: value for block in blocks for name, value in _flat(block).items()}


def _is_for(name: str, package: str) -> bool:
    """Return whether ROS gives a block of this name to a node; of somebody else's the node's name is not known."""
    if not os.path.isdir(SERVICES / package.replace("_", "-")) or not package:
        return True
    return name.strip("/") in ("*", "**") or (name.strip("/") == package and not package.startswith(NAMED_LATER))


def _flat(block: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in block.items():
        found |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return found


def _value(where: str, text: str) -> Any:
    try:
        return ros_yaml.load(text)
    except yaml.constructor.ConstructorError as error:
        raise StudyError(f"{where}: {error.problem}") from error
    except yaml.YAMLError as error:
        raise StudyError(f"{where} is no YAML: {said(error)}") from error


def mapping(mounts: Mapping[str, str], volumes: Path) -> Callable[[str], str]:
    """Return what turns every path inside a mount, wherever in a text, into the path on this machine."""
    sources = {target: source if source.startswith("/") else str(volumes / source) for target, source in mounts.items()}
    if not sources:
        return lambda text: text
    longest_first = sorted(map(re.escape, sources), key=len, reverse=True)
    inside = re.compile(rf"(?<![\w./-])({'|'.join(longest_first)})(?![\w.-])")
    return lambda text: inside.sub(lambda found: sources[found[1]], text)

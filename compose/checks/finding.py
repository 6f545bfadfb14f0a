"""What a check finds, and at which line of which file it stands."""

import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import yaml
from compose_yaml import StudyError
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

MERGE = "<<"
SENTENCE = re.compile(r"(?P<file>.+?\.ya?ml): (?P<keys>\S+): (?P<what>.+)", re.S)
OF_A_FILE = re.compile(r"(?P<file>.+?\.ya?ml) (?:is|has|cannot) .+", re.S)
IN_A_LINE = re.compile(r"line (\d+)")


class Finding(NamedTuple):
    """One thing that is wrong (`error`: the study does not do what it says) or looks so (`warning`).

    line: from 1; 0 where it is about the machine and not about a line.
    """

    file: Path
    line: int
    severity: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line or ''}{':' if self.line else ''} {self.severity}: {self.text}"


class Places:
    """Where things stand in a study file: `error` and `warning` make a finding of a dotted key and a sentence."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def error(self, keys: str, text: str, *near: str) -> Finding:
        """Return what keeps the study from running. keys: as in `services.h10-1.command`. near: words of the line."""
        return self._finding(keys, "error", text, *near)

    def warning(self, keys: str, text: str, *near: str) -> Finding:
        """Return what the study runs with, but perhaps not as it was meant."""
        return self._finding(keys, "warning", text, *near)

    def of(self, error: StudyError) -> Finding:
        """Return the finding of a sentence that begins with file and keys, or that names a line."""
        sentence = str(error)
        if (found := SENTENCE.fullmatch(sentence)) is None:
            lines = IN_A_LINE.findall(sentence)
            whole = OF_A_FILE.fullmatch(sentence)
            file = Path(whole["file"]) if whole else self.file
            return Finding(file, int(lines[-1]) if lines else 1, "error", sentence)
        file, line_number = place(Path(found["file"]), found["keys"], *_words(found["what"]))
        return Finding(file, line_number, "error", _in_one_line(f"{found['keys']}: {found['what']}"))

    def _finding(self, keys: str, severity: str, text: str, *near: str) -> Finding:
        file, line = place(self.file, keys, *near)
        return Finding(file, line, severity, _in_one_line(f"{keys}: {text}"))


def _in_one_line(text: str) -> str:
    return " ".join(text.split())


def _words(sentence: str) -> Iterator[str]:
    """Yield what may stand in the line that a sentence is about: parameters that it names, and what it quotes."""
    yield from (f"{word}:=" for word in re.findall(r"[A-Za-z_][\w.]*", sentence))
    yield from re.findall(r"'([^']+)'", sentence)


def place(file: Path, keys: str, *near: str) -> tuple[Path, int]:
    """Return file and line of a dotted key, of the first of these texts inside it, or of the nearest key above it.

    A key that the service only has from what it `extends` is found there.
    """
    found, node_file = _root(file), file
    line, rest = 1, keys
    while rest and isinstance(found, MappingNode | SequenceNode):
        entry = _entry(found, rest)
        if entry is None and (base := _base(found, node_file)):
            node_file, found = base
            entry = _entry(found, rest)
        if entry is None:
            break
        key, found, rest = entry
        line = key.start_mark.line + 1
    return node_file, _line_of(node_file, line, found, near)


def _line_of(file: Path, line: int, node: Node | None, near: tuple[str, ...]) -> int:
    """Return the line in a node's text in which one of these words stands, else the given one."""
    if node is None:
        return line
    lines = file.read_text("utf-8").splitlines()
    last = max(node.end_mark.line + bool(node.end_mark.column), line)
    for text in near:
        inside = re.compile(rf"(?<![\w.]){re.escape(text)}")
        for number in range(line, min(last, len(lines)) + 1):
            if inside.search(lines[number - 1]):
                return number
    return line


def _root(file: Path) -> Node | None:
    try:
        return _composed(file.read_text("utf-8"))
    except (OSError, yaml.YAMLError):
        return None


@lru_cache(maxsize=8)
def _composed(text: str) -> Node | None:
    return yaml.compose(text, yaml.SafeLoader)


def _entry(node: Node, keys: str) -> tuple[Node, Node, str] | None:
    """Return (key's node, value's node, remaining keys) of the longest key of a mapping that begins these keys."""
    if not isinstance(node, MappingNode):
        return None
    best: tuple[Node, Node, str] | None = None
    for key, value in node.value:
        name = str(key.value)
        if (keys == name or keys.startswith(f"{name}.")) and (best is None or len(best[2]) > len(keys) - len(name)):
            best = key, value, keys[len(name) + 1 :]
    return best or _merged(node, keys)


def _merged(node: MappingNode, keys: str) -> tuple[Node, Node, str] | None:
    for key, value in node.value:
        if key.value == MERGE:
            below = value.value if isinstance(value, SequenceNode) else [value]
            return next((found for each in below if (found := _entry(each, keys))), None)
    return None


def _base(node: Node, file: Path) -> tuple[Path, Node] | None:
    """Return file and node of the service that this one extends."""
    entry = _entry(node, "extends")
    if entry is None:
        return None
    given = {key.value: value.value for key, value in entry[1].value} if isinstance(entry[1], MappingNode) else {}
    service = given.get("service") or (entry[1].value if isinstance(entry[1], ScalarNode) else "")
    of = (file.parent / str(given["file"])).resolve() if "file" in given else file
    root = _root(of)
    services = _entry(root, "services") if root else None
    found = _entry(services[1], str(service)) if services else None
    return (of, found[1]) if found else None

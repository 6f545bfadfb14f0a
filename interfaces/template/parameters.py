"""`config/default.yaml` and the README's table of parameters, from a service's Config.

What is left as it is: everything in the README's section "Parameters" that is no table.
"""

import importlib
import json
import re
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import MISSING, asdict
from pathlib import Path
from typing import Any

from sense4hri.device import DriverConfig
from sense4hri.schema import Parameter, Schema, parameters_of, schema_of

WIDTH = 120
HEAD = """\
# Every parameter with its default; a study's file says what it changes. Written from config.py: make generate.
/**:
  ros__parameters:
"""


def default_yaml(package: str) -> str:
    """Return the text of config/default.yaml; what has no default that works stands there with its example."""
    schema = schema_of(package)
    entries = "".join(_entry(each) for each in parameters_of(schema))
    return HEAD + (entries or "    {}\n") + _stream_comments(package, schema)


def readme(package: str, text: str) -> str:
    """Return the README with the table of its section `## Parameters` written anew."""
    before, heading, rest = text.partition("\n## Parameters\n")
    if not heading:
        raise ValueError(f"{package}: the README has no section '## Parameters'")
    section, following, after = rest.partition("\n## ")
    words = re.sub(r"^\|.*\n", "", section, flags=re.M).strip("\n")
    section = f"\n{_table(schema_of(package))}" + (f"\n{words}\n" if words else "")
    return before + heading + section + following + after


def _entry(entry: Parameter) -> str:
    allowed = f"; {entry.rule.allowed}" if entry.rule.allowed else f" [{entry.rule.unit}]" if entry.rule.unit else ""
    required = "required: " if entry.default is MISSING else ""
    lines = textwrap.wrap(f"{required}{entry.rule.help}{allowed}", WIDTH - 6) + entry.rule.notes.splitlines()
    value = _example(entry)
    return "".join(f"    # {line}\n" for line in lines) + f"    {entry.name}:{_yaml(value, len(entry.name))}\n"


def _example(entry: Parameter) -> Any:
    return entry.default if entry.rule.example is None else entry.rule.example


def _yaml(value: Any, used: int = 0) -> str:
    if isinstance(value, str) and "\n" in value:
        return " |\n" + textwrap.indent(value.strip("\n"), " " * 6)
    if isinstance(value, tuple):
        flow = f" [{', '.join(json.dumps(each, ensure_ascii=False) for each in value)}]"
        return flow if used + len(flow) < WIDTH - 5 else "".join(f"\n      - {json.dumps(each)}" for each in value)
    return f" {json.dumps(value, ensure_ascii=False)}"


def _stream_comments(package: str, schema: type[Schema]) -> str:
    """Say what a driver's streams have as parameters, where it knows them before it has met its device."""
    streams_of: Callable[..., Any] | None = getattr(importlib.import_module(f"{package}.config"), "streams_of", None)
    if streams_of is None or not issubclass(schema, DriverConfig):
        return ""
    examples = {each.name: _example(each) for each in parameters_of(schema)}
    lines = ["", "    # Of each stream, with what holds where nothing is given:"]
    for sensor_type, stream in streams_of(schema(**examples)).items():
        lines += [f"    # {sensor_type}.{name}:{_yaml(value)}" for name, value in asdict(stream).items()]
    return "\n".join(lines) + "\n"


def _table(schema: type[Schema]) -> str:
    rows = [("name", "default", "allowed", "meaning"), ("---",) * 4]
    rows += [(f"`{each.name}`", _cell(each), _allowed(each), each.rule.help) for each in parameters_of(schema)]
    return "".join(f"|{'|'.join(_padded(row))}|\n" for row in rows)


def _padded(row: Iterable[str]) -> list[str]:
    return [text if text == "---" else f" {text.replace('|', chr(92) + '|')} " for text in row]


def _allowed(entry: Parameter) -> str:
    return entry.rule.allowed or entry.rule.unit


def _cell(entry: Parameter) -> str:
    value = entry.default
    if value is MISSING:
        return "required"
    if value in ("", ()):
        return "empty"
    if isinstance(value, str) and "\n" in value:
        return "see `config/default.yaml`"
    if isinstance(value, tuple):
        return " ".join(f"`{each}`" for each in value)
    return f"`{value}`" if isinstance(value, str) else json.dumps(value)


def files(service: Path) -> dict[Path, str]:
    """Return what `default.yaml` and `README.md` of a service's folder must hold."""
    package = service.name.replace("-", "_")
    page = service / "README.md"
    return {service / "config" / "default.yaml": default_yaml(package), page: readme(package, page.read_text())}

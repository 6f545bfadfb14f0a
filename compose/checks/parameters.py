"""Parameters that a study gives its services, against what each of them declares: names, types, ranges, the whole."""

import difflib
import importlib
import importlib.util
import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, replace
from pathlib import Path
from typing import Any, get_type_hints

from compose_yaml import near
from sense4hri.device import DriverConfig, Stream, check_rate, check_stream
from sense4hri.errors import ConfigError
from sense4hri.modalities import modality
from sense4hri.schema import Parameter, Rule, Schema, check, parameters_of, schema_of
from study_file import Service, Study

from checks.finding import Finding, Places

OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")
OVERRIDES = "qos_overrides."
HOUSE = Path(__file__).resolve().parents[2] / "services"
ALIKE = 0.85  # from which a package is taken for a wrong spelling of one of the house
PLACEHOLDER = re.compile(r".*\b0{8}|00(:00){5}")
"""An id that is nobody's, as a ready study has it before one's own is put in."""


def findings(study: Study, places: Places) -> Iterator[Finding]:
    """Yield what is wrong with the parameters of all services that are the house's own."""
    for service in study.processes:
        keys = f"services.{service.name}.command"
        yield from _words(service, places, keys)
        schema = schema_known(service.package)
        if schema is not None:
            found = list(_parameters(service, schema, places, keys))
            yield from found or _added(service, schema, places)
        elif misspelt := _misspelt(service.package):
            yield places.error(keys, f"there is no service {service.package!r}{misspelt}", service.package)


def schema_known(package: str) -> type[Schema] | None:
    """Return the schema of one of the house's services; None for somebody else's program."""
    try:
        found = importlib.util.find_spec(f"{package}.config") if package.isidentifier() else None
    except ModuleNotFoundError:
        return None
    return schema_of(package) if found else None


def streams_of(service: Service) -> Mapping[str, Stream] | None:
    """Return the raw streams of a sensor with the study's parameters in them; None where only its driver knows."""
    schema = schema_known(service.package)
    known = getattr(importlib.import_module(f"{service.package}.config"), "streams_of", None) if schema else None
    if schema is None or known is None:
        return None
    own = [entry.name for entry in parameters_of(schema)]
    try:
        streams = known(schema(**_typed(schema, {n: v for n, v in service.parameters.items() if n in own})))
        return {kind: _given(service, kind, stream) for kind, stream in streams.items()}
    except (ValueError, TypeError):
        return None


def _given(service: Service, kind: str, own: Stream) -> Stream:
    """Return a driver's stream with what the study says of it."""
    hints = get_type_hints(Stream)
    given = {
        name: check(f"{kind}.{name}", hints[name], Rule(nan=True), service.parameters[f"{kind}.{name}"])
        for name in hints
        if f"{kind}.{name}" in service.parameters
    }
    return replace(own, **given)


def _words(service: Service, places: Places, keys: str) -> Iterator[Finding]:
    """Yield words that look like ROS parameters and are none: no `--ros-args`, or no `-p`, before them."""
    words = list(service.command)
    begins = words.index("--ros-args") if "--ros-args" in words else len(words)
    for number, word in enumerate(words):
        if not re.match(r"[A-Za-z_][\w.]*:=", word):
            continue
        if number < begins:
            yield places.error(keys, f"{word!r} stands before --ros-args, so nobody reads it", word)
        elif words[number - 1] not in ("-p", "--param", "-r", "--remap"):
            yield places.error(keys, f"{word!r} has no -p before it, so nobody reads it", word)


def _parameters(service: Service, schema: type[Schema], places: Places, keys: str) -> Iterator[Finding]:
    declared = {entry.name: entry for entry in parameters_of(schema)}
    given = service.parameters
    own = {name: value for name, value in given.items() if name in declared}
    wrong = list(_unknown(service, schema, declared)) + list(_values(declared, own))
    wrong += [
        (entry.name, f"parameter {entry.name!r} is required: {entry.rule.help}")
        for entry in declared.values()
        if entry.default is MISSING and entry.name not in given
    ]
    yield from (places.error(keys, sentence, f"{name}:=") for name, sentence in wrong)
    if not wrong:
        yield from _whole(service, schema, own, places, keys)
    for name, value in own.items():
        if isinstance(value, str) and PLACEHOLDER.fullmatch(value):
            yield places.warning(
                keys, f"{name} {value!r} is only an example: put in what is printed on yours", f"{name}:="
            )


def _added(service: Service, schema: type[Schema], places: Places) -> Iterator[Finding]:
    """Yield what is wrong with the parameters of a plain process, where those of its container are right."""
    if service.added_parameters:
        process = replace(service, parameters={**service.parameters, **service.added_parameters})
        yield from _parameters(process, schema, places, f"services.{service.name}.x-process")


def _unknown(service: Service, schema: type[Schema], declared: Mapping[str, Parameter]) -> Iterator[tuple[str, str]]:
    """Yield names that the service does not declare, with the nearest one that it does."""
    known = {*declared, *_stream_names(service, schema)}
    for name in service.parameters:
        if name in known or name in OF_EVERY_NODE or name.startswith(OVERRIDES):
            continue
        yield name, f"{service.package} has no parameter {name!r}{near(name, known)}"


def _stream_names(service: Service, schema: type[Schema]) -> Iterator[str]:
    """Yield the parameters of a driver's streams; of one whose streams are not known, those of any that are given."""
    if not issubclass(schema, DriverConfig):
        return
    known = streams_of(service)
    for kind in known if known is not None else {name.partition(".")[0] for name in service.parameters if "." in name}:
        yield from (f"{kind}.{name}" for name in (*get_type_hints(Stream), *modality(kind).parameters))


def _values(declared: Mapping[str, Parameter], given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the values that are of another type or out of range."""
    for name, value in given.items():
        try:
            check(name, declared[name].kind, declared[name].rule, value)
        except ValueError as error:
            yield name, str(error)


def _whole(
    service: Service, schema: type[Schema], own: Mapping[str, Any], places: Places, keys: str
) -> Iterator[Finding]:
    """Yield what is wrong with parameters that are each right, and with those of the streams."""
    try:
        config = schema(**_typed(schema, own))
        known = getattr(importlib.import_module(f"{service.package}.config"), "streams_of", None)
        for kind, stream in (known(config) if known else {}).items():
            given = _given(service, kind, stream)
            check_stream(kind, stream, given)
            if isinstance(config, DriverConfig) and not config.asks_rates:
                check_rate(kind, stream, given)
    except (ValueError, ConfigError) as error:
        yield places.error(keys, str(error), *(f"{word}:=" for word in re.findall(r"[A-Za-z_][\w.]*", str(error))))


def _typed(schema: type[Schema], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as the schema's types: a whole number as float, a list as tuple. Raises ValueError."""
    declared = {entry.name: entry for entry in parameters_of(schema)}
    return {name: check(name, declared[name].kind, declared[name].rule, value) for name, value in given.items()}


def _misspelt(package: str) -> str:
    """Return `; did you mean X?` where a service's package is meant, "" for somebody else's program."""
    found = difflib.get_close_matches(package, [path.parent.name for path in HOUSE.glob("*/src/*/config.py")], 1, ALIKE)
    return f"; did you mean {found[0]}?" if found else ""

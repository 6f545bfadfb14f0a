"""What a driver's node answers about itself (contract, section 6), against what came."""

import math
from typing import Any

from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters
from sense4hri.line import Line
from sense4hri.modalities import check_unit, modality
from sense4hri.names import StreamName

from check_driver.findings import Findings
from check_driver.heard import Heard

TRIES = 2  # on a busy machine one answer may be lost, or come late
TEXT, NUMBER, WHOLE, TEXTS = (
    ParameterType.PARAMETER_STRING,
    ParameterType.PARAMETER_DOUBLE,
    ParameterType.PARAMETER_INTEGER,
    ParameterType.PARAMETER_STRING_ARRAY,
)
KINDS = {TEXT: "a text", NUMBER: "a double", WHOLE: "an integer", TEXTS: "a list of texts"}
OF_SENSOR = {
    "human_id": TEXT,
    "sensor_id": TEXT,
    "vendor": TEXT,
    "model": TEXT,
    "serial_number": TEXT,
    "firmware_version": TEXT,
    "body_location": TEXT,
    "transport_delay_s": NUMBER,
}
OF_STREAM = {
    "sampling_frequency_hz": NUMBER,
    "unit": TEXT,
    "range_min": NUMBER,
    "range_max": NUMBER,
    "resolution_bits": WHOLE,
    "channel_names": TEXTS,
}
FIELDS = {TEXT: "string_value", NUMBER: "double_value", WHOLE: "integer_value", TEXTS: "string_array_value"}


def ask(line: Line, kind: Any, node: str, service: str, request: Any) -> Any:
    """Return what a node answers, None where it does not answer in time."""
    try:
        return line.answer(kind, f"{node}/{service}", request, tries=TRIES)
    except TimeoutError:
        return None


def check(line: Line, node: str, sampled: list[StreamName], findings: Findings) -> dict[str, Any]:
    """Return the parameters that are there and of the right type, by name; find what is not.

    sampled: the streams that have `raw`; each has six parameters of its own.
    """
    wanted = OF_SENSOR | {f"{name.sensor_type}.{key}": kind for name in sampled for key, kind in OF_STREAM.items()}
    values: dict[str, Any] = {}
    for name, kind in wanted.items():
        answer = ask(line, GetParameters, node, "get_parameters", GetParameters.Request(names=[name]))
        if answer is None:
            findings.wrong(6, node, "does not answer get_parameters")
            return values
        given = answer.values[0] if answer.values else ParameterValue()
        if given.type == kind:
            values[name] = getattr(given, FIELDS[kind])
        elif given.type == ParameterType.PARAMETER_NOT_SET:
            findings.wrong(6, node, f"parameter {name} is not there")
        else:
            findings.wrong(6, node, f"parameter {name} must be {KINDS[kind]}")
    _described(line, node, list(values), findings)
    return values


def _described(line: Line, node: str, names: list[str], findings: Findings) -> None:
    request = DescribeParameters.Request(names=names)
    answer = ask(line, DescribeParameters, node, "describe_parameters", request)
    if answer is None or len(answer.descriptors) != len(names):
        findings.wrong(6, node, "does not answer describe_parameters")
        return
    if bare := [each.name for each in answer.descriptors if not each.description]:
        findings.remark(node, f"parameters without a description: {', '.join(bare)}")
    if any(each.name == "human_id" and each.read_only for each in answer.descriptors):
        findings.wrong(6, node, "parameter human_id is read-only, must be settable at run time")


def agree(values: dict[str, Any], heard: Heard, node: str, findings: Findings) -> None:
    """Find where a stream is not what the parameters say of it."""
    name = heard.name
    for key, true in (("human_id", name.human_id), ("sensor_id", name.sensor_id)):
        if values.get(key, true) != true:
            findings.wrong(6, node, f"parameter {key} is {values[key]!r}, the topics say {true}")
    if not 0 <= (delay_s := values.get("transport_delay_s", 0.0)) < math.inf:
        findings.wrong(6, node, f"parameter transport_delay_s is {delay_s:g}, must be 0 or above")
    of = {key: values[f"{name.sensor_type}.{key}"] for key in OF_STREAM if f"{name.sensor_type}.{key}" in values}
    if "unit" in of:
        try:
            check_unit(name.sensor_type, of["unit"])
        except ValueError as err:
            findings.wrong(5, node, f"parameter {name.sensor_type}.unit: {err}")
    _channels(of, heard, node, findings)
    _range(of, heard, node, findings)


def _channels(of: dict[str, Any], heard: Heard, node: str, findings: Findings) -> None:
    sensor_type = heard.name.sensor_type
    if heard.channels and "channel_names" in of and tuple(of["channel_names"]) != heard.channels:
        declared = list(of["channel_names"])
        findings.wrong(6, node, f"{sensor_type}.channel_names is {declared}, messages have {list(heard.channels)}")
    usual = modality(sensor_type).channels
    if usual and set(heard.channels) - set(usual):
        findings.remark(node, f"channels of {sensor_type} are {list(heard.channels)}, usually of {list(usual)}")


def _range(of: dict[str, Any], heard: Heard, node: str, findings: Findings) -> None:
    sensor_type = heard.name.sensor_type
    rate_hz = of.get("sampling_frequency_hz", 0.0)
    if not (math.isfinite(rate_hz) and rate_hz >= 0):
        findings.wrong(6, node, f"{sensor_type}.sampling_frequency_hz is {rate_hz:g}, must be 0 (irregular) or above")
    if of.get("resolution_bits", 0) < 0:
        findings.wrong(6, node, f"{sensor_type}.resolution_bits is {of['resolution_bits']}, must be 0 or above")
    low, high = of.get("range_min", math.nan), of.get("range_max", math.nan)
    if low >= high:
        findings.wrong(6, node, f"{sensor_type}.range_min is {low:g}, must be below range_max, which is {high:g}")
    elif heard.lowest < low or heard.highest > high:
        found = f"{heard.lowest:g} to {heard.highest:g}"
        findings.wrong(
            5, node, f"samples of {sensor_type} are {found}, declared {low:g} to {high:g}: is the unit right?"
        )

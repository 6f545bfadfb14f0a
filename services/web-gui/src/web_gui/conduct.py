"""What a publisher under the streams' names does wrong, in one sentence that says what to do. Pure."""

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from sense4hri.crowd import MOST
from sense4hri.errors import Refusal
from sense4hri.names import ROOT, StreamName, is_human_id
from sense4hri.refusals import LeftOut
from sense4hri.strict_json import parse
from sense4hri.topics import BEST_EFFORT, UNKNOWN_NODE, Topic

from web_gui.intake import shown

STATE = "sense4hri_msgs/msg/UserState"
LATCHED = ("/study/session", "/study/sensors", "/study/assignments")
LATCHED_FIELD = "clock"


def fault(topic: Topic, types: Mapping[str, Collection[str]]) -> str:
    """Return what is wrong with a topic below /humans/physiological, or of LATCHED; empty where it can be used.

    types: of each field of a stream, the names of the types that it may have. What is too much of a process is one
    sentence for all of it.
    """
    if topic.excess:
        field = topic.name.rpartition("/")[2]
        return f"{_who(topic.publishers)} publishes more than {MOST} {field} topics, of which only {MOST} are read"
    why = "" if topic.name in LATCHED else _fault(topic.name.split("/"), topic, types)
    if why:
        return f"{_who(topic.publishers)} publishes {shown(topic.name)}, {why}"
    return _volatile(topic)


def _volatile(topic: Topic) -> str:
    """Return who publishes a state in a way that none of those who keep to the contract hears."""
    if topic.name not in LATCHED and not topic.name.endswith(f"/{LATCHED_FIELD}"):
        return ""
    wrong = [one for one in topic.publishers if one.qos_profile.durability.name == "VOLATILE"]
    why = "volatile, which nobody hears: it is a state; publish it transient local"
    return f"{_who(wrong)} publishes {shown(topic.name)}, {why}" if wrong else ""


def left_out(place: str, what: LeftOut) -> str:
    """Return what is told of messages that the kit refused."""
    who = " or ".join(name.removeprefix("/") for name in what.nodes) or "somebody"
    return f"{shown(place)}: {what.count} messages of {shown(who)} are left out: {shown(what.why)}"


def notes(parameters_json: str) -> list[str]:
    """Return what the registry says of a sensor in entries that begin with `!`, but for what is said here anyhow.

    Nothing where they cannot be read.
    """
    try:
        told = parse(parameters_json, "parameters_json")
    except Refusal:
        return []
    found = told if isinstance(told, dict) else {}
    told_here = {"!duplicate_sensor_id", "!quality_of_service"}
    news = {name: text for name, text in found.items() if name.startswith("!") and name not in told_here}
    return [shown(text) for text in news.values() if text and isinstance(text, str)]


def _fault(parts: list[str], topic: Topic, types: Mapping[str, Collection[str]]) -> str:
    if len(parts) == 5 and parts[-1] == "state":
        return _of_state(parts[3], topic)
    if len(parts) != 7:
        return f"which nobody reads: streams are {ROOT}/<human_id>/<sensor_type>/<sensor_id>/<field>"
    if parts[-1] not in types:
        return ""  # a field of somebody's own
    try:
        StreamName(*parts[3:6]).checked()
    except ValueError as err:
        return f"which nobody reads: {shown(str(err))}"
    return _of_field(parts[-1], topic, types[parts[-1]])


def _of_field(field: str, topic: Topic, types: Collection[str]) -> str:
    if topic.type_name not in types:
        known = min(types) if len(types) == 1 else "a features message of sense4hri_msgs"
        return f"whose type {shown(topic.type_name)} nobody reads: {field} is {known}"
    return BEST_EFFORT if field == "raw" and topic.best_effort else ""


def _of_state(human_id: str, topic: Topic) -> str:
    if topic.type_name != STATE:
        return f"whose type {shown(topic.type_name)} nobody reads: state is {STATE}"
    return "" if is_human_id(human_id) else f"which nobody reads: {shown(human_id)!r} is no human_id"


def _who(publishers: Iterable[Any]) -> str:
    names = sorted({shown(one.node_name, 100) for one in publishers if one.node_name != UNKNOWN_NODE})
    return " and ".join(names[:3]) or "somebody"

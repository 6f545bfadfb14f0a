"""What in a recording tells of the lab and not of the study: hosts, serial numbers, radio addresses, paths.

Each becomes a name of its own (`host_1`, `device_2`), the same wherever it stands, so that all still fits together.
"""

from __future__ import annotations

import dataclasses
import json
import re
from contextlib import suppress
from typing import Any

from sense4hri.host_clocks import sanitised
from sense4hri.modalities import MODALITIES
from sense4hri.names import sanitise_sensor_id

LEAST = 4  # characters; a shorter serial number is in every other word, and numbers are like it by chance
_OF_TOPICS = (
    "ack assignments clock clocks device expression faces features health host humans markers measurement "
    "physiological probes raw sensors session state study"
)
_OF_FILES = (
    "after at automatic avoid bagfile before cause cdr closed complete compression conventions count custom data "
    "deadline depth description distro durability duration epoch events false file files format hash history "
    "human id identifier ids information interrupted jazzy last lease lifespan liveliness local losses lost mcap "
    "message messages metadata missed mode msg msgs name namespace nanoseconds node nodes ns nsec null offered "
    "opened parameters path paths profiles python qos recorder refused relative reliability reliable required rmw "
    "ros rosbag2 sec seen serialization since software start starting stop storage streams task time topic topics "
    "transient type unknown version volatile what why with withheld written"
)
FIXED = {*MODALITIES, *_OF_TOPICS.split(), *_OF_FILES.split()}
"""Words of topics' names, metadata.yaml and recorder.json, without which a copy is none; they are not taken out."""
_DEVICES = re.compile(r"serial(?!_port)|address|mac$|uuid", re.IGNORECASE)
_HOSTS = re.compile(r"(^|[_.])(hosts?|hostname|peers)$", re.IGNORECASE)
_CLOCK_SYNC = re.compile(r"/?clock_sync_(\w+)")
"""The node of a clock-sync is named after its host (contract, section 9)."""
_PATHS = re.compile(r"file|folder|director|path|database|recordings|(^|_)(bag|board|input|log|port)$", re.IGNORECASE)
_NAMES = re.compile(r"(^|_)name$", re.IGNORECASE)
_PRINTED = re.compile(r"(?=[A-Za-z]*\d)[A-Za-z0-9]+$")
"""The id at the end of an advertised name (`Polar H10 1234ABCD`), as it is printed on the sensor."""
_LINK = re.compile(r"\w+://(?:[^/@]*@)?(?P<host>\[[^\]]*\]|[^/:]+)")
_SERVES = re.compile(r"host$|address|server|port$|url$|endpoint", re.IGNORECASE)
_SERVED = re.compile(r"(?P<host>\[[^\]\s]*\]|[^\s:/\\]+):\d{1,5}")
_THIS_MACHINE = ("localhost", "127.0.0.1", "0.0.0.0", "::1", "::")
_ADDRESS = r"(?:[0-9A-Fa-f]{2}([:_-]))(?:[0-9A-Fa-f]{2}\1){4}[0-9A-Fa-f]{2}"
_ROOTS = (
    "home|Users|root|mnt|media|nfs|data|storage|scratch|var|tmp|opt|srv|usr|etc|work|recordings|private|Volumes|run|dev"
)
_PATH = rf"/(?:{_ROOTS})(?:/[^\s\"',;:/]+)+"
_OCTET = r"(?:25[0-5]|2[0-4]\d|1?\d?\d)"
_IP = rf"(?<!\d\.)(?!127\.|0\.0\.0\.0){_OCTET}(?:\.{_OCTET}){{3}}(?!\.\d)"
_IP6_PART = r"[0-9A-Fa-f]{1,4}"
_IP6_FIRST = r"(?:[23][0-9A-Fa-f]{3}|[Ff][C-Fc-f][0-9A-Fa-f]{2})"
"""Of an address in a network: global, of a site, of a link, of a group; `a::b` and `::1` are none."""
_IP6_SHORT = rf"{_IP6_FIRST}(?::{_IP6_PART}){{0,6}}::(?:{_IP6_PART}(?::{_IP6_PART}){{0,5}})?"
_IP6 = rf"(?<!:)(?:{_IP6_FIRST}(?::{_IP6_PART}){{7}}|{_IP6_SHORT})(?:%\w+)?"
_TWELVE = r"(?<![0-9A-Fa-f]{4}-)(?=[0-9]*[A-Fa-f])(?=[A-Fa-f]*[0-9])(?:[0-9A-F]{12}|[0-9a-f]{12})"
"""An address without separators. Twelve digits are rather a time; the end of a UUID is none."""
_PART = r"[^\\/:*?\"<>|\r\n\t]+"
_BACK = r'\\{1,2}(?!")'  # as it is, or as JSON writes it; not the one that keeps a quote
_LAST = r"[^\s\\/:*?\"'<>|,;]+"
_WINDOWS = (
    rf"[A-Za-z]:{_BACK}(?:{_PART}{_BACK})*{_LAST}",
    r"[A-Za-z]:(?:/[^\s\"',;:/]+)+",
    rf"\\{{2,4}}[\w.-]+{_BACK}(?:{_PART}{_BACK})*{_LAST}",
)
"""Paths on a drive and on a server. So short that numbers are like them by chance: only texts are judged by them."""
_GENERAL = (_ADDRESS, _PATH, _IP, _IP6, _TWELVE)


class Identities:
    """Learns what identifies, then takes it out of texts, messages and JSON."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}
        self._hosts: dict[str, str] = {}  # by the name that the kit makes of them
        self._numbers = {"host": 0, "device": 0, "address": 0, "path": 0}
        self._compile()

    def host(self, text: str) -> None:
        """A host's name with its domain and without, in small and capital letters, with `-`, `_` or `.` in it."""
        short = text.partition(".")[0]
        spellings = {text, *([] if short.isdigit() else [short])}  # 10.0.0.5 has no name
        keys = {sanitised(one) for one in spellings if len(one) > 1 and one.lower() not in FIXED}
        if text in (*_THIS_MACHINE, *self._hosts.values()) or keys <= self._hosts.keys():
            return
        name = next((self._hosts[key] for key in keys if key in self._hosts), "") or self._next("host")
        self._hosts = dict.fromkeys(keys, name) | self._hosts
        self._names.setdefault(text, name)  # it may have letters that the kit leaves out
        self._compile()

    def node(self, name: str) -> None:
        """A node's name, which may tell its host."""
        if found := _CLOCK_SYNC.fullmatch(name):
            self.host(found[1])

    def device(self, text: str) -> None:
        """A serial number or address, and the sensor_id that the kit makes of it."""
        words = re.sub(r"[^A-Za-z0-9]+", "", text)
        if len(words) >= LEAST:
            self._learn("device", text, LEAST, words.lower(), words.upper(), sanitise_sensor_id(text))

    def path(self, text: str) -> None:
        """A folder's whole path."""
        if text.count("/") > 1:
            self._learn("path", text, LEAST)

    def parameters(self, found: Any) -> None:
        """Everything in a node's parameters whose name says that it identifies a device, a host or a folder."""
        for key, value in found.items() if isinstance(found, dict) else ():
            self._parameter(str(key), value)

    def parameters_json(self, text: str) -> None:
        """The same of a text that should be JSON, also of the part before it is none, and of a name given twice."""
        with suppress(ValueError, RecursionError):
            json.loads(text or "{}", object_pairs_hook=self._pairs)

    def _pairs(self, found: list[tuple[str, Any]]) -> None:
        for key, value in found:
            self._parameter(key, value)

    def _parameter(self, key: str, value: Any) -> None:
        if isinstance(value, dict):
            self.parameters(value)
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, dict):
                self.parameters(item)
            elif isinstance(item, str):
                self._told(key, item)

    def _told(self, key: str, text: str) -> None:
        """Learn one parameter by its name."""
        link = _LINK.match(text) or (_SERVED.fullmatch(text) if _SERVES.search(key) else None)
        if link or _HOSTS.search(key):
            self.host(link["host"].strip("[]") if link else text)
        elif _DEVICES.search(key):
            self.device(text)
        elif _NAMES.search(key) and (printed := _PRINTED.search(text)) and len(printed[0]) >= LEAST:
            self.device(text)
            self.device(printed[0])
        elif _PATHS.search(key) and text.startswith("/"):
            self.path(text)

    def are_in(self, data: bytes) -> bool:
        """True where bytes may hold something that identifies."""
        return self._maybe.search(data) is not None

    def are_surely_in(self, data: bytes) -> bool:
        """True where bytes hold what no numbers are like by chance."""
        return self._surely.search(data) is not None

    def without(self, value: Any) -> Any:
        """A text, a decoded message or a value of JSON without them."""
        if isinstance(value, str):
            return self._text.sub(lambda found: self._name(found[0]), value)
        if isinstance(value, dict):
            return {self.without(key): self.without(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.without(item) for item in value]
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            names = [field.name for field in dataclasses.fields(value) if field.default is dataclasses.MISSING]
            return dataclasses.replace(value, **{name: self.without(getattr(value, name)) for name in names})
        return value

    def _learn(self, kind: str, text: str, least: int, *spellings: str) -> None:
        if len(text) < least or text in FIXED or text in self._names or text in self._names.values():
            return
        name = self._next(kind)
        for spelling in (text, *spellings):
            if len(spelling) >= least and spelling not in FIXED:
                self._names.setdefault(spelling, name)
        self._compile()

    def _name(self, found: str) -> str:
        if name := self._names.get(found) or self._hosts.get(sanitised(found)):
            return name
        one = _spelling(found)
        if one not in self._names:
            self._names[one] = self._next("path" if "/" in one or "\\" in one else "address")
        return self._names[one]

    def _next(self, kind: str) -> str:
        self._numbers[kind] += 1
        return f"{kind}_{self._numbers[kind]}"

    def _compile(self) -> None:
        known = {spelling: re.escape(spelling) for spelling in self._names}
        known |= {host: f"(?i:{host.replace('_', '[-_.]+')})" for host in self._hosts}
        longest_first = sorted(known, key=len, reverse=True)
        self._text = _any_of(*_GENERAL, *_WINDOWS, *(known[one] for one in longest_first))
        self._maybe = re.compile(self._text.pattern.encode())
        sure = [known[one] for one in longest_first if len(one) >= LEAST]
        self._surely = re.compile(_any_of(*_GENERAL, *sure).pattern.encode())


def _any_of(*patterns: str) -> re.Pattern[str]:
    """Return what finds any of the patterns where it is a whole word."""
    return re.compile(rf"(?<![A-Za-z0-9])(?:{'|'.join(patterns)})(?![A-Za-z0-9])")


def _spelling(found: str) -> str:
    """One of the spellings of an address or path, for all of them."""
    if re.fullmatch(rf"{_ADDRESS}|{_TWELVE}", found):
        return re.sub(r"[:_-]", "", found).lower()
    return re.sub(r"\\+", r"\\", found)

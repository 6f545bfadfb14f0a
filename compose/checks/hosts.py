"""The machines of a study on several: whether they can be told apart, and this machine's address is its own."""

import socket
from collections.abc import Iterator
from contextlib import closing

from sense4hri.host_clocks import sanitised
from study_file import Study

from checks.finding import Finding, Places

LOOPBACK = "127."


def findings(study: Study, host: str, listens: bool, places: Places) -> Iterator[Finding]:
    """Yield addresses with which no machine finds the others, and names that are one on the graph.

    host: which machine this is, "" = none of them, where a name need not be known. listens: services answer HTTP at it.
    """
    seen: dict[str, str] = {}
    called: dict[str, str] = {}
    for name, address in study.hosts.items():
        keys, found = f"x-study.hosts.{name}", _found(address)
        if (other := called.setdefault(sanitised(name), name)) != name:
            yield places.error(keys, f"{name!r} and {other!r} are both {sanitised(name)} on the graph: rename one")
        if not found:
            text = f"{address!r} is no address that is known here: no ROS node would start"
            yield (places.error if host else places.warning)(keys, text, address)
        elif other := seen.get(found):
            yield places.warning(keys, f"{address!r} is the address of {other} already", address)
        elif name == host and listens and not _own(found):
            yield places.error(keys, f"{address!r} is no address of this machine: no service listens there", address)
        elif name == host and found.startswith(LOOPBACK):
            yield places.warning(keys, f"{address!r} is reached by this machine alone: {found}", address)
        seen.setdefault(found, name)


def _found(address: str) -> str:
    """Return the numbers of a name or address, "" where nobody knows it."""
    try:
        return socket.gethostbyname(address)
    except (OSError, UnicodeError):
        return ""


def _own(address: str) -> bool:
    with closing(socket.socket()) as probe:
        try:
            probe.bind((address, 0))
        except OSError:
            return False
    return True

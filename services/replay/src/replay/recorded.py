"""What a recording offers to be played, however it is stored, and the one error it raises."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import apsw
import yaml
from rosbags.rosbag2 import ReaderError
from sense4hri_recording.errors import DAMAGE, SessionError

LATCHED_DEPTH = 100
_LATCHED = ("transient_local", 1)
_KNOWN_LATCHED = {"/tf_static": LATCHED_DEPTH, "/robot_description": 1}
_UNREADABLE = (*DAMAGE, ReaderError, yaml.YAMLError, apsw.Error, AttributeError, TypeError, AssertionError)
"""What damaged bytes make the readers of every storage raise."""


class BagError(ValueError):
    """A recording that cannot be played; the text is the sentence that says why."""


@dataclass
class Topic:
    """One recorded topic. offers: the publishers' QoS as rosbag2 spells it. type_hash: empty where not recorded."""

    name: str
    type_name: str
    type_hash: str = ""
    offers: list[dict[str, Any]] = field(default_factory=list)
    messages: int = 0
    refused: str = ""

    @property
    def latched(self) -> bool:
        """True where a late subscriber was given what had been said before."""
        if not self.offers:
            return self.name in _KNOWN_LATCHED
        return any(entry.get("durability") in _LATCHED for entry in self.offers)

    @property
    def latched_depth(self) -> int:
        """How many messages a late subscriber is given: as recorded, else 1 of the contract's topics, 100 of others."""
        depths = [depth for entry in self.offers if isinstance(depth := entry.get("depth"), int) and depth > 0]
        if depths:
            return max(depths)
        return 1 if self.name.startswith(("/humans/", "/study/")) else _KNOWN_LATCHED.get(self.name, LATCHED_DEPTH)

    @property
    def repeated(self) -> int:
        """How many messages may stand again at the head of a further file; the recorder keeps 8 of each publisher."""
        return self.latched_depth if len(self.offers) < 2 else max(self.latched_depth, 8 * len(self.offers))


class Recorded(NamedTuple):
    """One message as it was received: log_ns is the receipt in ROS time."""

    topic: Topic
    log_ns: int
    cdr: bytes


class Recording(Protocol):
    """An open recording. start_ns, end_ns: log time of its first and last message.

    set_back_s: by how much the clock of log times was set back in it at most, 0 where it was not or nobody can tell.
    """

    path: Path
    set_back_s: float
    topics: list[Topic]
    start_ns: int
    end_ns: int

    def messages(
        self,
        names: Collection[str],
        from_ns: int,
        until_ns: int | None = None,
        held: Mapping[str, Iterable[bytes]] | None = None,
    ) -> Iterator[Recorded]:
        """Yield the messages of topics with these names, from_ns <= log time < until_ns, in order of log time.

        held: what latched topics said before from_ns, the newest last; heads of further files do not say it again.
        Raises BagError where the bytes make no sense.
        """

    def close(self) -> None:
        """Close the files."""


@contextmanager
def one_sentence(path: Path) -> Iterator[None]:
    """Make whatever damaged bytes or a failing disk raise one sentence that names the recording."""
    try:
        yield
    except BagError:
        raise
    except SessionError as err:
        raise BagError(str(err)) from err
    except OSError as err:
        raise BagError(f"{path} cannot be read: {err.strerror or err}") from err
    except _UNREADABLE as err:
        why = " ".join(str(err).split()) or type(err).__name__  # parsers of YAML speak in several lines
        raise BagError(f"{path} is damaged or no rosbag2 recording: {why}") from err

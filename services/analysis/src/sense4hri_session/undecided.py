"""What in a recording may be a pseudonym's and cannot be told: each a sentence, with the option that removes it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping

from sense4hri.names import ROOT, UNASSIGNED
from sense4hri_recording.reader import Topic

from sense4hri_session.traces import Node, Traces

MAY_SHOW = ("Image", "CompressedImage", "AudioData", "AudioDataStamped", "PointCloud2")
NODES = ("faces", "bodies", "voices", "persons")


def while_unassigned(topics: Collection[Topic], traces: Traces, sensors: Iterable[str]) -> Iterator[str]:
    """Messages of the pseudonym's sensors from while nobody wore them."""
    for sensor_id in sorted(sensors):
        own = [t for t in topics if t.name.startswith(f"{ROOT}/{UNASSIGNED}/") and f"/{sensor_id}/" in t.name]
        count = sum(topic.messages for topic in own)
        if count and not all(traces.owns_topic(topic.name) for topic in own):
            glob = f"'{ROOT}/{UNASSIGNED}/*/{sensor_id}/**'"
            yield f"{count} messages of {sensor_id} while nobody wore it; --also {glob} removes them"


def of_several(topics: Collection[Topic], shared: Iterable[Node]) -> Iterator[str]:
    """Faces, bodies, voices and persons that are tied to another pseudonym as well."""
    for kind, name in sorted(shared):
        glob = f"/humans/{kind}/{name}/**"
        if any(topic.name.startswith(glob[:-2]) for topic in topics):
            yield f"/humans/{kind}/{name} is tied to another pseudonym as well; --also '{glob}' removes it"


def of_nobody(topics: Collection[Topic], traces: Traces, tied: Collection[Node]) -> Iterator[str]:
    """Faces, bodies, voices and persons that are tied to no pseudonym, as far as recorded."""
    loose: Counter[str] = Counter()
    for topic in topics:
        parts = topic.name.split("/")
        is_node = len(parts) > 4 and parts[1] == "humans" and parts[2] in NODES
        if is_node and (parts[2], parts[3]) not in tied and not traces.owns_topic(topic.name):
            loose[f"/humans/{parts[2]}/{parts[3]}/**"] += topic.messages
    for glob, count in sorted(loose.items()):
        yield f"{count} messages of {glob}: nobody's, as far as recorded; --also '{glob}' removes them"


def of_unread(unread: Mapping[str, str], traces: Traces) -> Iterator[str]:
    """Topics that tell who belongs to whom, with messages that cannot be read. unread: topic -> why."""
    for topic, why in sorted(unread.items()):
        if not traces.owns_topic(topic):
            told = f"{topic} would tell whose persons and faces are the pseudonym's, and was not read whole: {why}"
            yield f"{told}; what of it holds the name is removed, --also '{topic}' removes all of it"


def of_anyone(topics: Collection[Topic], traces: Traces) -> Iterator[str]:
    """Topics of pictures and sound."""
    for topic in topics:
        if topic.type_name.rpartition("/")[2] in MAY_SHOW and topic.messages and not traces.owns_topic(topic.name):
            yield (
                f"{topic.messages} messages of {topic.name} may show or let hear anyone; --also '{topic.name}' "
                "removes them"
            )

"""Names of streams as people say them: `p1/ecg/h10_1` in place of a whole topic."""

import re

from sense4hri.names import StreamName

TOPIC = re.compile(r"/humans/physiological/[^\s,;:]+")


def short(sentence: str) -> str:
    """Return a sentence with the stream in place of each of its topics; what names no stream stays."""
    return TOPIC.sub(lambda found: _stream(found[0]), sentence)


def _stream(topic: str) -> str:
    parsed = StreamName.parse(topic)
    return "/".join(parsed[0]) if parsed else topic

"""What Prometheus sees of the recorder."""

from __future__ import annotations

import math

from sense4hri.metrics import Metrics

from recorder.accounts import Accounts
from recorder.bag import Bag
from recorder.topics import Topics
from recorder.writing import Writing


def show(metrics: Metrics, bag: Bag | None, topics: Topics, writing: Writing, minutes_left: float | None) -> None:
    """Show how things stand now. bag: the newest recording. minutes_left: until the disk is full, where it is known."""
    synced_s = bag.last_synced_ns * 1e-9 if bag is not None and bag.last_synced_ns else math.nan
    accounts = bag.accounts if bag is not None else Accounts(0)
    for name, text, value in (
        ("written_messages", "Messages in the file.", accounts.messages),
        ("written_bytes", "Payload in the file.", accounts.payload_bytes),
        ("lost_messages", "Messages sent during this recording that are not in its file.", accounts.lost),
        ("last_sync_timestamp_seconds", "When all that was written had last reached the disk.", synced_s),
        ("refused_topics", "Topics that match and cannot be recorded, 1000 at most.", len(topics.refused)),
        ("topics", "Topics in the file.", len(accounts.by_channel)),
        ("queue_messages", "Messages that wait for the disk.", len(writing.queue)),
        ("behind_seconds", "How long the study's own messages waited to be taken in.", topics.hearing.behind_s),
        ("disk_free_bytes", "Free space of the disk.", writing.space.free_bytes),
        ("left_seconds", "Until the disk is full.", math.nan if minutes_left is None else 60.0 * minutes_left),
    ):
        metrics.gauge(f"recorder_{name}", text).set(value)

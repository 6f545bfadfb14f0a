"""What a long recording costs while it is opened and exported."""

import tracemalloc

import numpy as np
import pytest
import sense4hri_session
from sense4hri.cdr import RawMessage, write_raw
from sense4hri_session.seen import Seen

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
MESSAGES = 12_000
MB = 1e6
CHANNELS = ("TP9", "AF7", "AF8", "TP10", "AUX")


def messages():
    """A headband's, a hundred a second."""
    for number in range(MESSAGES):
        at_ns = number * SECOND // 100
        yield RawMessage(START_NS + at_ns, SECOND + at_ns, CHANNELS, np.full((12, 5), float(number)))


@pytest.fixture
def session(study):
    for raw in messages():
        study.add_bytes("/humans/physiological/p1/eeg/muse_1/raw", "PhysioRaw", raw.received_ns, write_raw("", raw))
    return sense4hri_session.open(study.write(flush_every=500))


def test_few_messages_wait_to_be_placed(session, tmp_path):
    """Of messages that take 18 MB in memory less than 12 MB are there at a time."""
    tracemalloc.start()
    with session.kept(tmp_path / "kept", lambda samples: None) as placed:
        most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert placed == {"p1/eeg/muse_1": 12 * MESSAGES}
    assert most < 12 * MB


def test_a_message_that_was_seen_costs_little():
    """Its two stamps and its count are numbers of 8 bytes: less than 32 bytes for as long as the session is open."""
    seen = Seen()
    tracemalloc.start()
    for raw in messages():
        seen.add(raw, raw.received_ns)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(seen.counts) == MESSAGES
    assert held / MESSAGES < 32

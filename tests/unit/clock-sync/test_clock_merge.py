"""Packets of several streams in one order."""

from clock_sync.merge import LONGEST_NS, MOST_WAITING, Merge
from hypothesis import given
from hypothesis import strategies as st

STREAMS = ("accelerometer", "ecg")


def released(merge: Merge, packets) -> list[tuple[int, str]]:
    return [(p.received_ns, p.stream) for stream, ns in packets for p in merge.push(stream, ns, ns, STREAMS)]


@given(st.data())
def test_the_order_between_streams_does_not_matter(data):
    """However two streams are interleaved on arrival, what comes out is sorted by receipt stamp, nothing twice."""
    times = {s: sorted(data.draw(st.sets(st.integers(1, 1_000_000), min_size=1, max_size=30))) for s in STREAMS}
    shuffled = data.draw(st.permutations([s for s in STREAMS for _ in times[s]]))
    queues = {s: iter(times[s]) for s in STREAMS}
    out = released(Merge(), [(s, next(queues[s])) for s in shuffled])
    expected = sorted((ns, s) for s in STREAMS for ns in times[s])
    complete_ns = min(times[s][-1] for s in STREAMS)
    assert out == [entry for entry in expected if entry[0] <= complete_ns]


def test_a_single_stream_does_not_wait():
    """Where a device has one stream every packet is released at once."""
    merge = Merge()
    assert [len(merge.push("ecg", ns, ns, {"ecg"})) for ns in (5, 6, 7)] == [1, 1, 1]


def test_a_silent_stream_is_not_waited_for_longer_than_two_seconds():
    """The other stream's packets come out once they are older than the limit."""
    out = released(Merge(), [("ecg", 1), ("ecg", 2 + LONGEST_NS), ("ecg", 10 + 2 * LONGEST_NS)])
    assert [ns for ns, _ in out] == [1, 2 + LONGEST_NS]


def test_stamps_that_go_back_are_handed_on_at_once():
    """After the host's clock was stepped back nothing is held, and what came before it comes out before it."""
    out = released(Merge(), [("ecg", 100), ("ecg", 50)])
    assert [ns for ns, _ in out] == [100, 50]


def test_a_driver_that_does_not_stamp_is_not_waited_for_either():
    """Where all stamps are alike and the other stream is silent no packet ever is the latest: the oldest come out."""
    out = released(Merge(), [("ecg", 0)] * (MOST_WAITING + 3))
    assert len(out) == 3

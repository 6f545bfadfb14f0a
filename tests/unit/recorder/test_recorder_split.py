"""One file: what it costs while it is open, and its index when it is closed."""

import tracemalloc

from mcap.reader import make_reader
from recorder.split import Entry, Split
from string_messages import START_NS, cdr_string, string_channel

CHANNELS = [string_channel(f"/study/x{number}") for number in range(20)]
FLUSHES = 400


def test_an_open_file_grows_by_little_and_its_index_finds_every_message(tmp_path):
    """A flush of 20 topics costs less than 500 bytes until the file is closed; then topics are found by its index."""
    split = Split(tmp_path / "s_0.mcap", "zstd")

    def flushes(first: int, last: int) -> None:
        for number in range(first, last):
            for channel in CHANNELS:
                split.write(Entry(channel, cdr_string("x"), START_NS + number, START_NS + number))
            split.flush()
            split.output.flush()

    flushes(0, 10)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    flushes(10, FLUSHES)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (after - before) / (FLUSHES - 10) < 500
    split.finish()
    split.output.close()
    with (tmp_path / "s_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert len(summary.chunk_indexes) == FLUSHES
        assert all(len(index.message_index_offsets) == len(CHANNELS) for index in summary.chunk_indexes)
        found = [message.log_time - START_NS for _, _, message in reader.iter_messages(topics=["/study/x7"])]
    assert found == list(range(FLUSHES))

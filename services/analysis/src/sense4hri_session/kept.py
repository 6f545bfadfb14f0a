"""Placed samples on the disk while several formats are written: the recording is read and placed once for all of them.

Each stream has a file with its blocks, one after the other: HEAD numbers, then the arrays as they are in memory. To
read NumPy's own format costs more than all else, where a block is one message.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from io import BufferedReader, BufferedWriter
from pathlib import Path

import numpy as np
from sense4hri.cdr import RawMessage, read_raw
from sense4hri_recording.reader import Reader

from sense4hri_session.blocks import Block, Ints
from sense4hri_session.stream import Stream

HEAD = 6
MOST_VALUES, MESSAGE = 500_000, 64  # that wait to be placed, of all streams together; a message counts as so many


def keep(
    reader: Reader, streams: Mapping[str, Stream], folder: Path, advance: Callable[[int], object]
) -> tuple[dict[str, Stream], dict[str, int]]:
    """Return the streams as they are read from files in `folder`, which is made and filled by this.

    Also how many samples each has there, those of repeated messages left out.

    advance(samples): called while the recording is read. Raises OSError, SessionError.
    """
    folder.mkdir()
    files = {key: _File(folder / f"{i}", stream) for i, (key, stream) in enumerate(streams.items())}
    for key, raws in _batches(reader, streams):
        files[key].write(raws)
        advance(sum(len(raw.samples) for raw in raws))
    placed = {key: replace(stream, placed=files[key].blocks) for key, stream in streams.items()}
    return placed, {key: file.placed for key, file in files.items()}


def count(reader: Reader, streams: Mapping[str, Stream]) -> dict[str, int]:
    """Return how many samples each stream has, those of repeated messages left out. Raises SessionError."""
    timelines = {key: stream.timeline() for key, stream in streams.items()}
    counts = dict.fromkeys(streams, 0)
    for key, raws in _batches(reader, streams):
        counts[key] += sum(len(block.time_ns) for block in timelines[key].blocks(raws))
    return counts


def _batches(reader: Reader, streams: Mapping[str, Stream]) -> Iterator[tuple[str, list[RawMessage]]]:
    """Yield all messages, some of one stream at a time, each stream's in order of receipt. Memory: MOST_VALUES."""
    keys = {stream.name.topic("raw"): key for key, stream in streams.items()}
    waiting: dict[str, list[RawMessage]] = {}
    values = 0
    for record in reader.messages(list(keys)):
        try:
            raw = read_raw(record.data)
        except ValueError:  # counted in `Stream.seen`
            continue
        waiting.setdefault(keys[record.topic], []).append(raw)
        values += raw.samples.size + MESSAGE
        if values >= MOST_VALUES:
            yield from waiting.items()
            waiting, values = {}, 0
    yield from waiting.items()


class _File:
    """The file of one stream. placed: samples that are in it."""

    def __init__(self, path: Path, stream: Stream) -> None:
        self._path, self._channel_sets = path, list(stream.seen.channel_sets)
        self._timeline = stream.timeline()
        self.placed = 0

    def write(self, raws: Iterable[RawMessage]) -> None:
        """Place the messages that follow those placed before, and write them."""
        with self._path.open("ab") as file:
            for block in self._timeline.blocks(raws):
                self._write(file, block)
                self.placed += len(block.time_ns)

    def blocks(self) -> Iterator[Block]:
        """Read it. Memory: one block."""
        if not self._path.exists():
            return
        with self._path.open("rb") as file:
            while file.peek(1):
                yield self._read(file)

    def _write(self, file: BufferedWriter, block: Block) -> None:
        timed = block.device_time_ns is not None
        sizes = *block.samples.shape, len(block.counts)
        head = np.array([self._channel_sets.index(block.channels), block.segment, timed, *sizes])
        whole = (head, block.time_ns, block.device_time_ns, block.received_ns, block.counts)
        for array in whole:
            if array is not None:
                file.write(np.ascontiguousarray(array, np.int64).data)
        file.write(np.ascontiguousarray(block.samples, np.float64).data)

    def _read(self, file: BufferedReader) -> Block:
        channels, segment, timed, rows, columns, messages = _taken(file, HEAD).tolist()
        time_ns, device_time_ns = _taken(file, rows), _taken(file, rows) if timed else None
        received_ns, counts = _taken(file, messages), _taken(file, messages)
        samples = _taken(file, rows * columns).view(np.float64).reshape(rows, columns)
        return Block(time_ns, device_time_ns, received_ns, self._channel_sets[channels], samples, segment, counts)


def _taken(file: BufferedReader, count: int) -> Ints:
    """Return the next so many numbers of 8 bytes. Raises OSError where the file ends before."""
    numbers = np.empty(count, np.int64)
    if file.readinto(numbers.data) != numbers.nbytes:
        raise OSError(f"{file.name}: ends in the middle of a block")
    return numbers

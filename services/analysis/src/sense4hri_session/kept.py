"""Placed samples on the disk while several formats are written: the recording is read and placed once for all of them.

Each stream has a file with its blocks, one after the other, each as arrays in NumPy's format.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from sense4hri.cdr import RawMessage, read_raw
from sense4hri_recording.reader import Reader

from sense4hri_session.blocks import Block
from sense4hri_session.stream import Stream

MOST_VALUES, MESSAGE = 4_000_000, 64  # that wait to be placed, of all streams together; a message counts as so many


def keep(
    reader: Reader, streams: Mapping[str, Stream], folder: Path, advance: Callable[[int], object]
) -> dict[str, Stream]:
    """Return the streams as they are read from files in `folder`, which is made and filled by this.

    advance(samples): called while the recording is read. Raises OSError, SessionError.
    """
    folder.mkdir()
    files = {stream.name.topic("raw"): _File(folder / f"{i}", stream) for i, stream in enumerate(streams.values())}
    values = 0
    for record in reader.messages(list(files)):
        try:
            raw = read_raw(record.data)
        except ValueError:  # counted in `Stream.seen`
            continue
        files[record.topic].waiting.append(raw)
        values += raw.samples.size + MESSAGE
        if values >= MOST_VALUES:
            values = _write_all(files.values(), advance)
    _write_all(files.values(), advance)
    return {key: replace(stream, placed=files[stream.name.topic("raw")].blocks) for key, stream in streams.items()}


def _write_all(files: Iterable[_File], advance: Callable[[int], object]) -> int:
    for file in files:
        advance(file.write())
    return 0


class _File:
    """The file of one stream. waiting: messages that are not in it yet."""

    def __init__(self, path: Path, stream: Stream) -> None:
        self._path, self._channel_sets = path, list(stream.seen.channel_sets)
        self._timeline = stream.timeline()
        self.waiting: list[RawMessage] = []

    def write(self) -> int:
        """Place what waits and write it; returns how many samples that were."""
        if not self.waiting:
            return 0
        with self._path.open("ab") as file:
            for block in self._timeline.blocks(self.waiting):
                self._write(file, block)
        samples = sum(len(raw.samples) for raw in self.waiting)
        self.waiting.clear()
        return samples

    def blocks(self) -> Iterator[Block]:
        """Read it. Memory: one block."""
        if not self._path.exists():
            return
        with self._path.open("rb") as file:
            while file.peek(1):
                yield self._read(file)

    def _write(self, file: BinaryIO, block: Block) -> None:
        timed = block.device_time_ns is not None
        head = np.array([self._channel_sets.index(block.channels), block.segment, timed], np.int64)
        arrays = (head, block.time_ns, block.device_time_ns, block.received_ns, block.samples, block.counts)
        for array in arrays:
            if array is not None:
                np.save(file, array, allow_pickle=False)

    def _read(self, file: BinaryIO) -> Block:
        channels, segment, timed = np.load(file).tolist()
        time_ns, device_time_ns = np.load(file), np.load(file) if timed else None
        received_ns, samples, counts = (np.load(file) for _ in range(3))
        return Block(time_ns, device_time_ns, received_ns, self._channel_sets[channels], samples, segment, counts)

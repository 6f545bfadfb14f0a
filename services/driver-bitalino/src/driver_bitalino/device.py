"""One BITalino: connect, ask, start, hand over everything it sends, always stop it again."""

import time
from collections.abc import AsyncGenerator, Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from sense4hri.arrivals import Arrival, Silence
from sense4hri.chunk import Chunk
from sense4hri.device import MESSAGE_S, Identity, Item, Marked, Samples, Status, Stream
from sense4hri.errors import FrameError
from sense4hri.serial_port import decoded
from sense4hri.stamps import SECOND_NS

from driver_bitalino import protocol
from driver_bitalino.config import BitalinoConfig
from driver_bitalino.losses import Rounds
from driver_bitalino.protocol import Frames, Run
from driver_bitalino.transport import Board, connected

GATHER_S = 2 * MESSAGE_S  # that the samples of a message are waited for at most
SILENCE_S = 3.0
EMPTY_V, FULL_V = 3.4, 4.2  # of its lithium cell
INPUTS = {"I1": 0, "I2": 1}


class Bitalino:
    """A Device of the kit."""

    def __init__(self, config: BitalinoConfig, streams: Mapping[str, Stream]) -> None:
        self._config, self._streams = config, streams

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, ask, start, and yield until the link is lost (DeviceLost); stop the board whatever happens."""
        async with connected(self._config.port) as board:
            version = await board.version()
            yield Identity(firmware_version=version)
            if protocol.tells_state(version):
                yield _status(await board.state())
            self._start(board)
            rate_hz = self._config.sampling_frequency_hz
            decoder = Decoder(self._config, self._streams)
            silence = Silence(["frame"], SILENCE_S + 2 * protocol.CONFIRM / rate_hz)
            board.port.gather_s = GATHER_S
            async for item in decoded(board.port, board.arrivals, decoder, silence):
                yield item

    def _start(self, board: Board) -> None:
        board.port.write(protocol.set_threshold(self._config.battery_threshold))
        board.port.write(protocol.set_rate(self._config.sampling_frequency_hz))
        board.port.write(protocol.start(tuple(channel.port for channel in self._config.acquired)))


class Decoder:
    """From what arrives of one acquisition to what the kit publishes.

    clock_ns: a clock of the host that nobody sets.
    """

    def __init__(
        self,
        config: BitalinoConfig,
        streams: Mapping[str, Stream],
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._clock_ns = clock_ns
        self._streams, self._channels = streams, config.acquired
        self._inputs = config.digital_inputs
        self._rate_hz = config.sampling_frequency_hz
        self._frames, self._rounds = Frames(len(self._channels)), Rounds(self._rate_hz)
        self._buffer, self._received_ns = bytearray(), 0
        self._least = max(1, round(MESSAGE_S * self._rate_hz)) * self._frames.size
        self._levels: NDArray[np.int64] | None = None

    @property
    def missing(self) -> int:
        """Bytes until there are enough for a message."""
        return max(1, self._least - len(self._buffer))

    def items(self, arrival: Arrival[bytes]) -> Iterator[Item]:
        """Yield the samples, markers and errors of all frames that are complete, once there are enough for a message.

        Bytes that have come are never stamped by a later arrival than that of the last of them.
        """
        self._buffer += arrival.value
        self._received_ns = arrival.received_ns
        if len(self._buffer) >= self._least:
            yield from self.rest()

    def rest(self) -> Iterator[Item]:
        """Yield what the frames hold that wait for more."""
        runs = []
        for taken in self._frames.take(self._buffer):
            if isinstance(taken, FrameError):
                yield taken
            else:
                runs.append(taken)
        if runs:
            yield from self._samples(runs, self._received_ns)

    def _samples(self, runs: list[Run], received_ns: int) -> Iterator[Item]:
        counts = np.concatenate([run.counts for run in runs])
        lost = sum(run.lost for run in runs)
        lost += self._rounds.missed(len(counts), lost, self._clock_ns())
        columns = [
            channel.values(counts[:, position] / 2**channel.bits) for position, channel in enumerate(self._channels)
        ]
        for sensor_type, stream in self._streams.items():
            own = [
                column for column, each in zip(columns, self._channels, strict=True) if each.sensor_type == sensor_type
            ]
            chunk = Chunk(stream.channel_names, np.stack(own, axis=1), None, received_ns)
            yield Samples(sensor_type, chunk, lost=lost)
        if self._inputs:
            yield from self._markers(np.concatenate([run.digital for run in runs]), received_ns)

    def _markers(self, digital: NDArray[np.int64], received_ns: int) -> Iterator[Marked]:
        """Yield each change of the inputs that are asked for; the first frame shows how they stand."""
        before = digital[:1] if self._levels is None else self._levels
        self._levels = digital[-1:]
        levels = np.concatenate([before, digital])[:, [INPUTS[name] for name in self._inputs]]
        for row, column in np.argwhere(np.diff(levels, axis=0)).tolist():
            age_s = (len(digital) - 1 - row) / self._rate_hz
            value = str(levels[row + 1, column])
            yield Marked(received_ns - round(age_s * SECOND_NS), None, self._inputs[column], value)


def _status(state: protocol.State | FrameError) -> Item:
    """Return the battery in percent: a straight line between an empty and a full lithium cell, no more than a guess."""
    if isinstance(state, FrameError):
        return state
    share = (state.battery_v - EMPTY_V) / (FULL_V - EMPTY_V)
    return Status(battery_percent=100.0 * min(1.0, max(0.0, share)))

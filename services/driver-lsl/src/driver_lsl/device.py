"""The device as the kit sees it: connects, and yields until it is gone."""

from collections.abc import AsyncGenerator, Mapping
from contextlib import closing

from sense4hri.arrivals import Arrival, from_thread
from sense4hri.chunk import Chunk
from sense4hri.device import Item, Samples, Stream
from sense4hri.errors import FrameError

from driver_lsl.config import Config
from driver_lsl.protocol import decode
from driver_lsl.transport import connect


class Device:
    """One physical sensor."""

    def __init__(self, config: Config, streams: Mapping[str, Stream]) -> None:
        self._config, self._streams = config, streams

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, then yield what comes until the link is lost: DeviceLost."""
        with closing(connect(self._config.address)) as link:
            async with from_thread(link.read) as arrivals:
                while True:
                    yield self._item(await arrivals.get())

    def _item(self, arrival: Arrival[bytes]) -> Item:
        frame = decode(arrival.value)
        if isinstance(frame, FrameError):
            return frame
        names = self._streams["eda"].channel_names
        return Samples("eda", Chunk(names, frame.samples, frame.device_ns, arrival.received_ns))

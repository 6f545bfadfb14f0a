"""A virtual Shimmer3 on a link of made-up time, and the driver's device on its other end."""

import asyncio
from collections.abc import Callable
from contextlib import aclosing
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from driver_shimmer.config import ShimmerConfig, streams_of
from driver_shimmer.device import Shimmer
from pure_link import PureLink
from sense4hri.device import Item, Samples
from sense4hri.errors import DeviceLost
from sensor_bench.shimmer.body import Body
from sensor_bench.shimmer.firmware import Memory, VirtualShimmer
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.skin import Skin
from sensor_bench.signals.sources import Wearing
from sensor_bench.signals.waveforms import stored


@dataclass
class Loss:
    """Throws away packets by number, and counts."""

    lost: Callable[[int], bool] = lambda number: False
    sent: int = 0
    lost_total: int = 0

    def carry(self, packet: bytes, **samples: int) -> bytes:
        self.sent += 1
        gone = self.lost(self.sent)
        self.lost_total += gone
        return b"" if gone else packet


@dataclass
class Run:
    """What a driver's device yielded."""

    items: list[Item] = field(default_factory=list)
    error: Exception | None = None

    def of(self, kind: type) -> list[Any]:
        return [item for item in self.items if isinstance(item, kind)]

    def samples(self, sensor_type: str) -> tuple[np.ndarray, np.ndarray]:
        """Times in ns and values of all samples of one sensor."""
        mine = [each for each in self.of(Samples) if each.sensor_type == sensor_type]
        return np.concatenate([each.times_ns for each in mine]), np.concatenate([e.chunk.samples for e in mine])


@pytest.fixture
def body() -> Body:
    """A participant at rest."""
    return Body(Heart(1), Skin(1), stored(), Wearing())


@pytest.fixture
def virtual(body) -> Callable[..., VirtualShimmer]:
    """Makes a Shimmer3 that the participant wears."""

    def make(loss: Loss | None = None, memory: Memory | None = None, **keywords: Any) -> VirtualShimmer:
        return VirtualShimmer(body, memory or Memory(), (loss or Loss()).carry, **keywords)

    return make


async def _until(device: Shimmer, link: PureLink, end_s: float, run: Run) -> None:
    try:
        async with aclosing(device.stream()) as items:
            async for item in items:
                run.items.append(item)
                if link.now_s >= end_s:
                    return
    except DeviceLost as err:
        run.error = err


@pytest.fixture
def made() -> Callable[..., Shimmer]:
    """Makes the driver's device on a link."""
    return shimmer


@pytest.fixture
def ran() -> Callable[..., Run]:
    """Streams from a link for so many seconds of its time; a device may be used again."""

    def run(link: PureLink, seconds: float, device: Shimmer | None = None, **parameters: Any) -> Run:
        found = Run()
        asyncio.run(_until(device or shimmer(link, **parameters), link, link.now_s + seconds, found))
        return found

    return run


def shimmer(link: PureLink, **parameters: Any) -> Shimmer:
    """The driver's device on this link."""
    config = ShimmerConfig(sensor_id="shimmer_1", port="/dev/rfcomm0", **parameters)
    return Shimmer(config, streams_of(config), link.connect, link.clock_ns)

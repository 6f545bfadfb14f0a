"""A driver of a wristband over Bluetooth LE, in two files and nothing else (docs/adding-a-sensor.md)."""

import sys
from collections.abc import AsyncGenerator, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from protocol import BITS, COMMAND, LAYOUTS, SERVICE, START, TICKS_HZ, decode
from sense4hri import gatt
from sense4hri.arrivals import Arrival, Arrivals, Silence
from sense4hri.bluetooth_le import BleakRadio
from sense4hri.chunk import Chunk
from sense4hri.device import Item, Samples, Status, Stream
from sense4hri.driver import run_driver
from sense4hri.errors import ConfigError, DeviceLost, FrameError
from sense4hri.unwrap import Unwrap, ticks_ns

SILENCE_S = 5.0


@dataclass(frozen=True, kw_only=True)
class Config(gatt.BluetoothConfig):
    """Which band: `name` or `address`."""


def streams_of(config: Config) -> dict[str, Stream]:
    """Return both streams, whose ranges are those of the numbers that are sent."""
    return {
        each.sensor_type: Stream(
            each.rate_hz,
            each.unit,
            np.iinfo(each.form).min * each.scale,
            np.iinfo(each.form).max * each.scale,
            np.iinfo(each.form).bits,
            each.channels,
        )
        for each in LAYOUTS.values()
    }


class Wristband:
    """One band."""

    def __init__(self, config: Config, streams: Mapping[str, Stream]) -> None:
        self._streams = streams
        self._radio = BleakRadio(config, (SERVICE,), tuple(LAYOUTS))
        self._unwrap = Unwrap(BITS, TICKS_HZ)

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, subscribe, have it start, and yield until the link is lost (DeviceLost)."""
        inbox = Arrivals[tuple[str, bytes]]()
        async with self._radio.connect(lambda reason: inbox.fail(DeviceLost(reason))) as link:
            yield Status(rssi_dbm=link.rssi_dbm)
            yield await gatt.identity_of(link)
            yield await gatt.battery_of(link)
            await gatt.subscribe_to_battery(link, partial(_receive, inbox, gatt.BATTERY))
            for each in LAYOUTS:
                if not await link.subscribe(each, partial(_receive, inbox, each)):
                    raise ConfigError(f"name or address: {link.name} does not notify {each}")
            await link.write(COMMAND, START)
            silence = Silence(self._streams, SILENCE_S)
            while True:
                arrival = await silence.watch(inbox.get())
                for item in self._items(arrival):
                    if isinstance(item, Samples):
                        silence.broken_by(item.sensor_type)
                    yield item

    def _items(self, arrival: Arrival[tuple[str, bytes]]) -> Iterator[Item]:
        characteristic, value = arrival.value
        try:
            if characteristic == gatt.BATTERY:
                yield gatt.battery_status(value)
                return
            sensor_type = LAYOUTS[characteristic].sensor_type
            frame = decode(LAYOUTS[characteristic], value)
        except FrameError as err:
            yield err
            return
        names = self._streams[sensor_type].channel_names
        device_ns = ticks_ns(self._unwrap(frame.ticks), TICKS_HZ)
        yield Samples(sensor_type, Chunk(names, frame.samples, device_ns, arrival.received_ns))


def _receive(inbox: Arrivals[tuple[str, bytes]], characteristic: str, value: bytes) -> None:
    inbox.receive((characteristic, value))


if __name__ == "__main__":
    sys.exit(run_driver("wristband", Config, streams_of, Wristband))

"""The device as the kit sees it: connects, and yields what it reports until it is gone."""

from collections.abc import AsyncGenerator, Callable, Iterator

from sense4hri import gatt
from sense4hri.arrivals import Arrival, Arrivals, Silence
from sense4hri.device import Item, Noted, Reported, Status
from sense4hri.errors import ConfigError, DeviceLost, FrameError

from driver_ble_heart_rate.config import KINDS, Config
from driver_ble_heart_rate.protocol import Oximetry, decode_continuous, decode_spot_check

CONTINUOUS, SPOT_CHECK = gatt.standard("2a5f"), gatt.standard("2a5e")
REPORTS = {"180d": (gatt.HEART_RATE,), "1822": (CONTINUOUS, SPOT_CHECK)}
"""Characteristics that report, by the service; a device has at least one of them."""
SILENCE_S = 30.0
"""Every strap reports each second or two; one that is silent for so long is stuck."""
Value = tuple[str, bytes]
"""Characteristic and its value."""


class Device:
    """One strap, watch or oximeter over any Radio."""

    def __init__(self, config: Config, radio: gatt.Radio) -> None:
        self._config, self._radio = config, radio
        kind = KINDS[config.kind]
        self._sensor_type, self._reports = kind.sensor_type, REPORTS[kind.service]

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, subscribe, and yield until the link is lost: DeviceLost."""
        inbox = Arrivals[Value]()
        async with self._radio.connect(lambda reason: inbox.fail(DeviceLost(reason))) as link:
            yield Status(rssi_dbm=link.rssi_dbm)
            said = await gatt.identity_of(link)
            yield said._replace(body_location=None) if self._config.body_location else said
            yield await gatt.battery_of(link)
            there, refused = await self._subscribe(link, inbox)
            for each in refused:
                yield Noted(str(each))
            silence = Silence([each for each in there if each != SPOT_CHECK], SILENCE_S)
            while True:
                arrival = await silence.watch(inbox.get())
                silence.broken_by(arrival.value[0])
                for item in self._items(arrival):
                    yield item

    async def _subscribe(self, link: gatt.Link, inbox: Arrivals[Value]) -> tuple[list[str], list[gatt.Refused]]:
        """Have everything notified; return what reports, and what is refused where something else reports.

        Raises Refused where all that could report is refused, ConfigError where there is nothing.
        """

        def into_inbox(characteristic: str) -> Callable[[bytes], None]:
            return lambda value: inbox.receive((characteristic, value))

        await gatt.subscribe_to_battery(link, into_inbox(gatt.BATTERY))
        there, refused = list[str](), list[gatt.Refused]()
        for each in self._reports:
            try:
                if await link.subscribe(each, into_inbox(each)):
                    there.append(each)
            except gatt.Refused as err:
                refused.append(err)
        if there:
            return there, refused
        if refused:
            raise refused[0]
        raise ConfigError(f"kind {self._config.kind}: {link.name} has none of {', '.join(self._reports)}")

    def _items(self, arrival: Arrival[Value]) -> Iterator[Item]:
        """Decode one value; what cannot be decoded is handed on as the error that says why."""
        received_ns, (characteristic, value) = arrival
        try:
            if characteristic == gatt.BATTERY:
                yield gatt.battery_status(value)
            elif characteristic == gatt.HEART_RATE:
                yield from gatt.heart_rate_items(gatt.decode_heart_rate(value), self._sensor_type, received_ns)
            else:
                decode = decode_continuous if characteristic == CONTINUOUS else decode_spot_check
                yield from self._oximetry(decode(value), received_ns)
        except FrameError as err:
            yield err

    def _oximetry(self, measured: Oximetry, received_ns: int) -> Iterator[Item]:
        features = list(measured.features)
        if measured.contact is not None:
            features.append(gatt.feature("contact", "1", measured.contact))
            yield Status(contact=float(measured.contact))
        yield Reported(self._sensor_type, received_ns, measured.device_ns, tuple(features))

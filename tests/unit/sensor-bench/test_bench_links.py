"""Links of the stand-in over bumble's radio: an attempt that is given up leaves its device, and the others, free."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from bumble.device import Device
from bumble.link import LocalLink
from dbus_fast import Message, Variant
from processes import DEADLINE_S
from sensor_bench.ble.controller import radio_device
from sensor_bench.ble.gatt_calls import GattCalls
from sensor_bench.ble.links import Links
from sensor_bench.ble.listening import Listening
from sensor_bench.ble.names import DEVICE, BluezError, device_properties
from sensor_bench.ble.object_tree import ObjectTree
from sensor_bench.ble.remotes import Remote, Remotes

STRAP, OTHER = "C0:FF:EE:00:00:02", "C0:FF:EE:00:00:03"
CLIENT = ":1.7"


def path_of(address: object) -> str:
    return "/hci0/dev_" + str(address)[:17].replace(":", "_")


async def until(holds) -> None:
    async with asyncio.timeout(DEADLINE_S):
        while not holds():
            await asyncio.sleep(0.001)


class Stage:
    """Two straps that advertise, and the links of a stand-in that has seen both."""

    def __init__(self) -> None:
        medium = LocalLink()
        self.central = radio_device(medium, "central", "C0:FF:EE:00:00:01")
        self.straps = {address: radio_device(medium, address, address) for address in (STRAP, OTHER)}
        self.remotes, self.tree = Remotes(), ObjectTree(lambda _: None)
        gatt = GattCalls(self.tree, self.remotes, asyncio.ensure_future)
        listening = Listening(self.central)
        self.calls = Links(
            self.central, self.tree, self.remotes, gatt, listening, lambda: None, asyncio.ensure_future
        ).calls()

    async def start(self) -> None:
        await self.central.power_on()
        self.central.on("advertisement", lambda heard: self.remotes[path_of(heard.address)].advertised.set())
        for address, strap in self.straps.items():
            await strap.power_on()
            await advertise(strap)
            properties = device_properties("/hci0", address, "strap", [], -60, Variant("a{qv}", {}))
            self.tree.add(path_of(address), {DEVICE: properties})
            self.remotes[path_of(address)] = Remote(path_of(address), strap.random_address, 0.0)

    def call(self, member: str, address: str) -> asyncio.Task[Message]:
        message = Message(path=path_of(address), interface=DEVICE, member=member, sender=CLIENT, serial=1)
        return asyncio.ensure_future(self.calls[DEVICE, member](message))

    async def give_up_while_connecting(self, address: str, *, silent: bool = False) -> None:
        """Disconnect in the moment in which the radio waits for the next advertisement to answer it; silent: of none.

        A process that is kept from a core for that moment is connected, and tries again.
        """
        strap = self.straps[address]
        while True:
            connecting = self.call("Connect", address)
            await until(lambda attempt=connecting: self.central.is_le_connecting or attempt.done())
            if silent:
                await strap.stop_advertising()
            await self.call("Disconnect", address)
            try:
                await connecting
            except BluezError:
                return
            if silent:
                await advertise(strap)

    async def advertised(self, address: str, times: int) -> None:
        """Wait until the radio hears it so many times."""
        heard = []
        self.central.on("advertisement", lambda each: heard.append(path_of(each.address)))
        await self.central.start_scanning(filter_duplicates=False)
        await until(lambda: heard.count(path_of(address)) >= times)
        await self.central.stop_scanning()


async def advertise(strap: Device) -> None:
    await strap.start_advertising(advertising_interval_min=20, advertising_interval_max=20, auto_restart=True)


@asynccontextmanager
async def stage() -> AsyncIterator[Stage]:
    made = Stage()
    await made.start()
    try:
        yield made
    finally:
        for device in (made.central, *made.straps.values()):
            await device.power_off()


def test_a_connection_that_is_given_up_while_it_is_made_leaves_the_device_free():
    """It goes on advertising, nobody is connected to it, and the next attempt gets through."""

    async def use() -> None:
        async with stage() as it:
            for _ in range(3):
                await it.give_up_while_connecting(STRAP)
                await it.advertised(STRAP, times=3)
                assert not it.straps[STRAP].connections
            await it.call("Connect", STRAP)
            assert len(it.straps[STRAP].connections) == 1

    asyncio.run(use())


def test_a_device_that_falls_silent_while_it_is_connected_keeps_no_other_off():
    """Another device is connected at once after the attempt was given up."""

    async def use() -> None:
        async with stage() as it:
            await it.give_up_while_connecting(STRAP, silent=True)
            async with asyncio.timeout(DEADLINE_S):
                await it.call("Connect", OTHER)
            assert len(it.straps[OTHER].connections) == 1

    asyncio.run(use())

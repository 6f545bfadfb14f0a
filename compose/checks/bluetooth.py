"""Which Bluetooth adapters BlueZ has, asked over D-Bus."""

import asyncio

from dbus_fast import AuthError, DBusError, ErrorType, Message, MessageType
from dbus_fast.aio import MessageBus

ADAPTER = "org.bluez.Adapter1"
ANSWER_S = 3.0
DENIED = ErrorType.ACCESS_DENIED.value


def adapters(address: str) -> tuple[list[str], str]:
    """Return the names of the adapters at this bus that are switched on, and what is wrong ("": nothing)."""
    try:
        found = asyncio.run(_adapters(address))
    except DBusError as error:
        why = "D-Bus denies this user BlueZ" if error.type == DENIED else "bluetoothd does not run"
        return [], f"{why}, so no Bluetooth is reached: {error.text}"
    except (OSError, EOFError, AuthError, TimeoutError) as error:
        return [], f"no D-Bus answers at {address}, so no Bluetooth is reached: {error or 'no answer'}"
    on = [name for name, powered in found.items() if powered]
    if not found:
        return [], "BlueZ has no Bluetooth adapter: plug one in"
    return on, "" if on else f"Bluetooth is switched off on {', '.join(found)}: bluetoothctl power on"


async def _adapters(address: str) -> dict[str, bool]:
    """Raises TimeoutError after ANSWER_S."""
    async with asyncio.timeout(ANSWER_S):
        bus = await MessageBus(bus_address=address).connect()
        try:
            asked = Message("org.bluez", "/", "org.freedesktop.DBus.ObjectManager", member="GetManagedObjects")
            answer = await bus.call(asked)
        finally:
            bus.disconnect()
    if answer is None:
        raise EOFError
    if answer.message_type is not MessageType.METHOD_RETURN:
        raise DBusError(answer.error_name or "", " ".join(map(str, answer.body)))
    objects = answer.body[0]
    return {
        path.rpartition("/")[2]: bool(interfaces[ADAPTER]["Powered"].value)
        for path, interfaces in objects.items()
        if ADAPTER in interfaces
    }

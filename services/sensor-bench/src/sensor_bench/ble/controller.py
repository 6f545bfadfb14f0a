"""A Bluetooth controller, and its host, on the medium that all of a bench share."""

import asyncio

from bumble.controller import Controller
from bumble.device import Device
from bumble.hci import (
    Address,
    HCI_ErrorCode,
    HCI_LE_Connection_Complete_Event,
    HCI_LE_Create_Connection_Cancel_Command,
    HCI_StatusReturnParameters,
    Role,
)
from bumble.host import Host
from bumble.link import LocalLink
from bumble.transport.common import AsyncPipeSink


class RadioController(Controller):
    """A virtual controller that gives up a connection when it is told to.

    bumble's says yes, and connects all the same as soon as the device advertises; its host, which waits for no link any
    more, fails on the news of it, and the device is held for ever by a link that nobody knows.
    """

    def on_hci_le_create_connection_cancel_command(
        self, _command: HCI_LE_Create_Connection_Cancel_Command
    ) -> HCI_StatusReturnParameters:
        """Bluetooth Core 5.4, Vol 4, Part E, 7.8.13: the command is answered first, then the attempt ends as failed."""
        if (pending := self.pending_le_connection) is None:
            return HCI_StatusReturnParameters(HCI_ErrorCode.COMMAND_DISALLOWED_ERROR)
        self.pending_le_connection = None
        failed = HCI_LE_Connection_Complete_Event(
            status=HCI_ErrorCode.UNKNOWN_CONNECTION_IDENTIFIER_ERROR,
            connection_handle=0,
            role=Role.CENTRAL,
            peer_address_type=pending.peer_address_type,
            peer_address=pending.peer_address,
            connection_interval=0,
            peripheral_latency=0,
            supervision_timeout=0,
            central_clock_accuracy=0,
        )
        asyncio.get_running_loop().call_soon(self.send_hci_packet, failed)
        return HCI_StatusReturnParameters(HCI_ErrorCode.SUCCESS)


def radio_device(medium: LocalLink, name: str, address: str) -> Device:
    """A bumble host with a controller of its own on the shared medium."""
    controller = RadioController(name, link=medium, public_address=address)
    return Device(name=name, address=Address(address), host=Host(controller, AsyncPipeSink(controller)))

"""Parameters of driver-serial, and what it declares of its streams."""

import math
from dataclasses import dataclass

from sense4hri.device import DriverConfig
from sense4hri.devices import ANY, DeviceRow, Offered
from sense4hri.schema import parameter
from sense4hri.serial_port import ADDRESS, ADDRESS_FORM

DEVICES = (
    DeviceRow(
        device="any microcontroller that sends lines, JSON, COBS or struct frames",
        vendor="",
        streams={ANY: Offered("", math.nan)},
        clock="the board's own, where its frames have one (`time`); wraps and restarts told",
        loss="its time or its frame counter, where it has one",
        link="any serial port, Bluetooth Classic (RFCOMM), TCP",
        seen_on="virtual; lines of a recorded PhysioKit board",
    ),
)


@dataclass(frozen=True, kw_only=True)
class SerialConfig(DriverConfig):
    """Where the board is, and what it sends."""

    port: str = parameter("/dev/ttyUSB0", help="where the board is", matches=ADDRESS, form=ADDRESS_FORM)
    board: str = parameter(help="YAML file that describes its frames; see the README", example="/boards/board.yaml")

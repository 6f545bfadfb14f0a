"""Parameters of driver-vernier, and what it declares of its stream."""

import math
from dataclasses import dataclass

from sense4hri.device import Stream
from sense4hri.devices import NO_CLOCK, DeviceRow, Offered
from sense4hri.gatt import BluetoothConfig
from sense4hri.schema import parameter

RATES_HZ = (1.0, 100.0)
"""What is asked for at all (10 ms is the fastest the vendor's code knows); each belt says its own fastest period."""
DEVICES = (
    DeviceRow(
        device="Vernier Go Direct respiration belt (GDX-RB)",
        vendor="Vernier",
        streams={"respiration": Offered("N", *RATES_HZ)},
        reports=("respiration_rate",),
        clock=NO_CLOCK,
        loss="8-bit frame counter: exact to 127 frames in a row",
        link="Bluetooth LE, bluetoothd or a stand-in",
        seen_on="virtual; two captured frames; the fastest rate of a real belt is its own to say",
        chosen_by={"name": "GDX-RB 0K1002A1"},
    ),
)


@dataclass(frozen=True, kw_only=True)
class Config(BluetoothConfig):
    """Which belt. The rate is the parameter `respiration.sampling_frequency_hz`."""

    vendor: str = parameter("Vernier", help="who makes the device", settable=True)
    name: str = parameter(
        "", help="advertised name, or the id at its end as printed on the belt", example="GDX-RB 0K0000A0"
    )

    @property
    def asks_rates(self) -> bool:
        """True: the belt measures at any rate in its range."""
        return True


def streams_of(config: Config) -> dict[str, Stream]:
    """Return what the driver declares of the force on the belt: 32-bit floats, up to 50 N by its data sheet.

    That begins at 0 N; a belt that nobody has tared sends less, how much less is not known.
    """
    return {"respiration": Stream(10.0, "N", math.nan, 50.0, 24, ("respiration",))}

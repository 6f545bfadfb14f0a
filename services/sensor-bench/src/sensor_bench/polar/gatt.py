"""The GATT services of a Polar sensor."""

from collections.abc import Callable

from bumble.device import Connection
from bumble.gatt import Characteristic, CharacteristicValue, Service

from sensor_bench.ble.peripheral import NOTIFY, READ, READABLE, WRITEABLE, information
from sensor_bench.polar import pmd
from sensor_bench.polar.body import Identity

PMD_SERVICE = "FB005C80-02E7-F387-1CAD-8ACD2D8DF0C8"
PMD_CONTROL = "FB005C81-02E7-F387-1CAD-8ACD2D8DF0C8"
PMD_DATA = "FB005C82-02E7-F387-1CAD-8ACD2D8DF0C8"
WRITE, INDICATE = Characteristic.Properties.WRITE, Characteristic.Properties.INDICATE


class Gatt:
    """Heart rate, device information, and Polar's measurement service.

    on_command(connection, value) gets what is written to the control point.
    """

    def __init__(self, identity: Identity, on_command: Callable[[Connection, bytes], None]) -> None:
        model = identity.model
        self.heart_rate = Characteristic("2A37", NOTIFY, Characteristic.Permissions(0), b"")
        self.control: Characteristic[bytes] = Characteristic(
            PMD_CONTROL,
            READ | WRITE | INDICATE,
            READABLE | WRITEABLE,
            CharacteristicValue(read=lambda _: pmd.features(model.measurements), write=on_command),
        )
        self.data = Characteristic(PMD_DATA, NOTIFY, Characteristic.Permissions(0), b"")
        location = Characteristic("2A38", READ, READABLE, bytes([model.body_location]))
        self.services = [
            Service("180D", [self.heart_rate, location]),
            information(
                vendor="Polar Electro Oy",
                model_number=model.model_number,
                serial_number=identity.serial_number,
                hardware="00760690.03",
                firmware=model.firmware,
                software="3.1.1",
            ),
            Service(PMD_SERVICE, [self.control, self.data]),
        ]

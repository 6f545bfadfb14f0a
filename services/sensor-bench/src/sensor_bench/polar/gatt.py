"""The GATT services of a Polar sensor."""

from collections.abc import Callable

from bumble.device import Connection
from bumble.gatt import Characteristic, CharacteristicValue, Service

from sensor_bench.polar import pmd
from sensor_bench.polar.body import Identity

PMD_SERVICE = "FB005C80-02E7-F387-1CAD-8ACD2D8DF0C8"
PMD_CONTROL = "FB005C81-02E7-F387-1CAD-8ACD2D8DF0C8"
PMD_DATA = "FB005C82-02E7-F387-1CAD-8ACD2D8DF0C8"
READ, NOTIFY = Characteristic.Properties.READ, Characteristic.Properties.NOTIFY
WRITE, INDICATE = Characteristic.Properties.WRITE, Characteristic.Properties.INDICATE
READABLE, WRITEABLE = Characteristic.READABLE, Characteristic.WRITEABLE


class Gatt:
    """Heart rate, device information, battery, and Polar's measurement service.

    battery_percent() is asked at every read; on_command(connection, value) gets what is written to the control point.
    """

    def __init__(
        self,
        identity: Identity,
        battery_percent: Callable[[], int],
        on_command: Callable[[Connection, bytes], None],
    ) -> None:
        model = identity.model
        self.heart_rate = Characteristic("2A37", NOTIFY, Characteristic.Permissions(0), b"")
        self.battery: Characteristic[bytes] = Characteristic(
            "2A19", READ | NOTIFY, READABLE, CharacteristicValue(read=lambda _: bytes([battery_percent()]))
        )
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
            Service("180A", _information(identity)),
            Service("180F", [self.battery]),
            Service(PMD_SERVICE, [self.control, self.data]),
        ]


def _information(identity: Identity) -> list[Characteristic[bytes]]:
    texts = {
        "2A29": "Polar Electro Oy",
        "2A24": identity.model.model_number,
        "2A25": identity.serial_number,
        "2A27": "00760690.03",
        "2A26": identity.model.firmware,
        "2A28": "3.1.1",
    }
    return [Characteristic(uuid, READ, READABLE, text.encode()) for uuid, text in texts.items()]

"""Parameters of driver-bioharness, and what it declares of its streams."""

from dataclasses import dataclass

from sense4hri.device import DriverConfig, Stream
from sense4hri.devices import DeviceRow, Offered
from sense4hri.modalities import XYZ
from sense4hri.schema import parameter
from sense4hri.serial_port import ADDRESS, ADDRESS_FORM

from driver_bioharness.protocol import COUNTS_PER_G, MIDDLE, SHAPES, STANDARD_GRAVITY, Kind

STREAMS = {"ecg": Kind.ECG, "respiration": Kind.BREATHING, "accelerometer": Kind.ACCELEROMETER}
_SPAN_MS2 = MIDDLE / COUNTS_PER_G * STANDARD_GRAVITY
DEVICES = (
    DeviceRow(
        device="BioHarness 3, BioModule",
        vendor="Zephyr",
        streams={
            "ecg": Offered("counts", 250),
            "respiration": Offered("a.u.", SHAPES[Kind.BREATHING].rate_hz),
            "accelerometer": Offered("m/s^2", 50),
        },
        reports=("heart_rate", "rr_interval", "respiration_rate", "skin_temperature", "posture", "activity"),
        clock="calendar and ms of the day, of each packet's first sample; its own, set by Zephyr's software",
        loss="device time of each packet against its samples, exact; sequence number for what is sent twice",
        link="Bluetooth Classic or serial",
        seen_on="virtual",
        chosen_by={"port": "/dev/rfcomm0"},
    ),
)


@dataclass(frozen=True, kw_only=True)
class BioHarnessConfig(DriverConfig):
    """Which strap, and what of it."""

    vendor: str = parameter("Zephyr", help="who makes the device", settable=True)
    model: str = parameter("BioHarness 3", help="name of the model", settable=True)
    port: str = parameter(
        help="where it is; a BioHarness is paired with the PIN 1234",
        matches=ADDRESS,
        form=ADDRESS_FORM,
        example="/dev/rfcomm0",
    )
    streams: tuple[str, ...] = parameter(
        tuple(STREAMS), help="what is sampled; a second's summary comes in any case", choices=tuple(STREAMS)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.streams or len(set(self.streams)) < len(self.streams):
            raise ValueError(f"streams {list(self.streams)}: at least one, each at most once")

    @property
    def reported_types(self) -> tuple[str, ...]:
        """Return what a summary is told under, also where it is not sampled."""
        return tuple(STREAMS)


def streams_of(config: BioHarnessConfig) -> dict[str, Stream]:
    """Return what the driver declares of each raw stream."""
    shapes = {
        "ecg": ("counts", 0.0, 1023.0, 10, ("ecg",)),
        "respiration": ("a.u.", 0.0, 1023.0, 10, ("respiration",)),
        "accelerometer": ("m/s^2", -_SPAN_MS2, _SPAN_MS2, 10, XYZ),
    }
    return {each: Stream(SHAPES[STREAMS[each]].rate_hz, *shapes[each]) for each in config.streams}

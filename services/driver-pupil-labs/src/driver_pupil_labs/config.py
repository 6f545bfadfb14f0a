"""Parameters of driver-pupil-labs."""

from dataclasses import dataclass

from sense4hri.device import DriverConfig
from sense4hri.devices import DeviceRow, Offered
from sense4hri.schema import parameter

MODELS = ("Core",)
DEVICES = (
    DeviceRow(
        device="Pupil Core",
        vendor="Pupil Labs",
        streams={"eye_tracking": Offered("1", 0, 200), "pupillometry": Offered("mm", 30, 200)},
        reports=("blink_onset", "blink_offset", "fixation_duration", "fixation_dispersion", "fixation_x", "fixation_y"),
        clock="Pupil time: s of a monotonic clock, new with every start of Capture; measured both ways every 2 s",
        loss="sizes: gaps of the stamps, exact; NaN for one eye's picture; gaze of two eyes: nobody knows",
        link="network, ZeroMQ to Pupil Capture or Service",
        seen_on="virtual",
    ),
)


@dataclass(frozen=True, kw_only=True)
class PupilConfig(DriverConfig):
    """Which eye tracker, and where it is on the network."""

    vendor: str = parameter("Pupil Labs", help="who makes the device", settable=True)
    model: str = parameter("Core", help="of the eye tracker", choices=MODELS)
    address: str = parameter(
        help="machine on which Pupil Capture or Service runs",
        matches=r"[A-Za-z0-9_.:-]+",
        form="a host name or an IP address",
        example="127.0.0.1",
    )
    port: int = parameter(50020, help="of Capture's Network API plugin", low=1, high=65535)
    send_markers: bool = parameter(True, help="let Capture record the study's markers as annotations")

"""Parameters of driver-pupil-labs."""

from dataclasses import dataclass

from sense4hri.device import DriverConfig
from sense4hri.devices import DeviceRow, Offered
from sense4hri.schema import parameter

MODELS = ("Core", "Neon", "Invisible")
SCENES_PX = {"Neon": (1600.0, 1200.0), "Invisible": (1088.0, 1080.0)}
PORTS = {"Core": 50020, "Neon": 8080, "Invisible": 8080}
_EVENTS = ("blink_duration", "fixation_duration", "saccade_duration", "saccade_amplitude")
_IMU = {"accelerometer": Offered("m/s^2", 110), "gyroscope": Offered("rad/s", 110), "orientation": Offered("1", 110)}
_UNIX = "the phone's UNIX time, of each sample; measured both ways every 5 s by its time echo (whole ms)"
_NUMBERED = "gaps of the stamps, exact"
_REALTIME = "network, HTTP and RTSP to the Companion app"
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
    DeviceRow(
        device="Pupil Labs Neon",
        vendor="",
        streams={
            "eye_tracking": Offered("px", 30, 200),
            "pupillometry": Offered("mm", 30, 200),
            "eyelids": Offered("mm", 30, 200),
        }
        | _IMU,
        reports=_EVENTS,
        clock=_UNIX,
        loss=_NUMBERED,
        link=_REALTIME,
        seen_on="virtual",
    ),
    DeviceRow(
        device="Pupil Labs Invisible",
        vendor="",
        streams={"eye_tracking": Offered("px", 30, 200)},
        clock=_UNIX,
        loss=_NUMBERED,
        link=_REALTIME,
        seen_on="virtual",
    ),
)


@dataclass(frozen=True, kw_only=True)
class PupilConfig(DriverConfig):
    """Which eye tracker, and where it is on the network."""

    vendor: str = parameter("Pupil Labs", help="who makes the device", settable=True)
    model: str = parameter("Core", help="of the eye tracker", choices=MODELS)
    address: str = parameter(
        help="machine on which Pupil Capture or Service runs, or the phone of a Neon or Invisible",
        matches=r"[A-Za-z0-9_.:-]+",
        form="a host name or an IP address",
        example="127.0.0.1",
    )
    port: int = parameter(
        0, help="of Capture's Network API, or of the Companion app; 0 = the usual one, 50020 or 8080", low=0, high=65535
    )
    send_markers: bool = parameter(True, help="let the eye tracker's own recording have the study's markers")

    @property
    def usual_port(self) -> int:
        """The port, the model's usual one where none is given."""
        return self.port or PORTS[self.model]

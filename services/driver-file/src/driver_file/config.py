"""Parameters of driver-file."""

import math
from dataclasses import dataclass

from sense4hri.device import DriverConfig
from sense4hri.devices import ANY, DeviceRow, Offered
from sense4hri.schema import parameter
from sense4hri.signal_files.choice import Wanted, parse_all

_LOSS = "gaps of the file's stamps; what it marks as missing is NaN"
DEVICES = (
    DeviceRow(
        device="any recording: text columns, WFDB, EDF, BDF, BrainVision, XDF, Polar Sensor Logger",
        vendor="",
        streams={ANY: Offered("", math.nan)},
        clock="the file's own times; a date is taken for UTC",
        loss=_LOSS,
        link="file",
        seen_on="recordings (EDF, BDF, BrainVision: files made here)",
    ),
    DeviceRow(
        device="EyeLink (ASC of edf2asc)",
        vendor="SR Research",
        streams={"eye_tracking": Offered("px", 250, 2000), "pupillometry": Offered("a.u.", 250, 2000)},
        clock="the tracker's ms",
        loss=_LOSS,
        link="file",
        seen_on="recordings (EyeLink 1000)",
    ),
    DeviceRow(
        device="Empatica E4 (its zip or folder)",
        vendor="Empatica",
        streams={
            "ppg": Offered("a.u.", 64),
            "eda": Offered("uS", 4),
            "accelerometer": Offered("m/s^2", 32),
            "temperature": Offered("degC", 4),
        },
        clock="UTC at the beginning of each file, then counted",
        loss="not told by the device's files",
        link="file",
        seen_on="recordings",
    ),
    DeviceRow(
        device="Empatica EmbracePlus (an Avro file of its cloud)",
        vendor="Empatica",
        streams={
            "ppg": Offered("a.u.", 64),
            "eda": Offered("uS", 4),
            "accelerometer": Offered("m/s^2", 64),
            "temperature": Offered("degC", 1),
        },
        clock="UTC at the beginning of each sensor, then counted",
        loss="not told by the device's files",
        link="file",
        seen_on="files made here by the published field names; **no real one yet**",
    ),
)


@dataclass(frozen=True, kw_only=True)
class FileConfig(DriverConfig):
    """Which recording, what of it, and how it is played."""

    file: str = parameter(help="the recording: a file, or the folder of an Empatica E4", example="recording.edf")
    streams: tuple[str, ...] = parameter(
        (),
        help="what of it is which signal, each as `type: column, column [unit] * factor`; "
        "empty = what the names in the file tell",
    )
    sampling_frequency_hz: float = parameter(
        0.0, help="of plain columns; 0 = the file says it, or `time_column` does", unit="Hz", low=0, high=100_000
    )
    time_column: str = parameter("", help="column of plain columns that holds each row's time")
    time_unit: str = parameter("s", help="of `time_column`", choices=("s", "ms", "us", "ns"))
    start_s: float = parameter(0.0, help="what is left out at the file's beginning", unit="s", low=0)
    duration_s: float = parameter(0.0, help="how much is played from there; 0 = to the end", unit="s", low=0)
    speed: float = parameter(1.0, help="seconds of the recording in a second", low=0.01, high=1000)
    loop: bool = parameter(True, help="begin again at the end, the sensor's clock going on; else the sensor is lost")
    markers: bool = parameter(True, help="publish what the file says happened as markers of the study")
    frame_s: float = parameter(0.1, help="how much of a recording a message holds", unit="s", low=0.001, high=2)

    def __post_init__(self) -> None:
        super().__post_init__()
        parse_all(self.streams)

    @property
    def wanted(self) -> tuple[Wanted, ...]:
        """The streams as they are asked for. Raises ValueError."""
        return parse_all(self.streams)

"""What is said of BrainFlow's boards in docs/devices.md: a row per family."""

from collections.abc import Mapping

from sense4hri.devices import NO_CLOCK, DeviceRow, Offered

COUNTED, UNKNOWN = "its own count, {}", "cannot be known: what its number counts is not established"
LE = "Bluetooth LE (BlueZ)"
MOVES = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
FIELD = {"magnetometer": "uT"}


TABLES = "BrainFlow's tables and source alone"


def _row(
    board: str,
    device: str,
    vendor: str,
    loss: str,
    link: str,
    streams: Mapping[str, Offered],
    seen_on: str = TABLES,
) -> DeviceRow:
    """Return the row of a board; none has a clock that BrainFlow hands on."""
    return DeviceRow(
        device=device,
        vendor=vendor,
        streams=streams,
        clock=NO_CLOCK,
        loss=loss,
        link=link,
        seen_on=seen_on,
        chosen_by={"board": board},
    )


def _at(rate_hz: float, **units: str) -> dict[str, Offered]:
    return {sensor_type: Offered(unit, rate_hz) for sensor_type, unit in units.items()}


DEVICES = (
    _row(
        "CYTON",
        "OpenBCI Cyton",
        "OpenBCI",
        COUNTED.format("8 bits"),
        "serial port of its dongle",
        _at(250, eeg="uV", accelerometer="m/s^2"),
    ),
    _row(
        "CYTON_DAISY",
        "OpenBCI Cyton with Daisy",
        "OpenBCI",
        COUNTED.format("8 bits, every second number"),
        "serial port of its dongle",
        _at(125, eeg="uV", accelerometer="m/s^2"),
    ),
    _row("GANGLION_NATIVE", "OpenBCI Ganglion", "OpenBCI", UNKNOWN, LE, _at(200, eeg="uV", accelerometer="m/s^2")),
    _row(
        "MUSE_2",
        "Muse 2, Muse S (first two), Muse 2016",
        "InteraXon",
        COUNTED.format("16 bits of each packet"),
        LE,
        _at(256, eeg="uV") | _at(52, **MOVES),
        "virtual",
    ),
    _row(
        "UNICORN",
        "g.tec Unicorn Hybrid Black",
        "g.tec",
        COUNTED.format("24 bits"),
        "Bluetooth Classic, by g.tec's library",
        _at(250, eeg="uV", **MOVES),
    ),
    _row(
        "EMOTIBIT",
        "EmotiBit",
        "EmotiBit",
        UNKNOWN,
        "WiFi",
        _at(15, eda="uS", temperature="degC") | _at(25, ppg="counts", **MOVES, **FIELD),
    ),
    _row("CROWN", "Neurosity Crown", "Neurosity", UNKNOWN, "WiFi (OSC)", _at(256, eeg="uV")),
    _row("BRAINBIT", "BrainBit", "BrainBit", UNKNOWN, LE, _at(250, eeg="uV")),
    _row(
        "EXPLORE_8_CHAN",
        "Mentalab Explore",
        "Mentalab",
        UNKNOWN,
        "Bluetooth Classic",
        _at(250, eeg="uV") | _at(20, **MOVES, **FIELD) | _at(1, temperature="degC"),
    ),
    _row("FREEEEG32", "FreeEEG32", "", COUNTED.format("8 bits"), "serial port", _at(512, eeg="uV")),
    DeviceRow(
        device="BrainFlow's synthetic board; by name, any other of its sixty",
        vendor="",
        streams=_at(250, eeg="uV", ppg="counts", eda="counts", temperature="degC", **MOVES),
        clock=NO_CLOCK,
        loss=COUNTED.format("8 bits; most others: cannot be known"),
        link="as the board has",
        seen_on="virtual: SYNTHETIC, PLAYBACK",
        chosen_by={"board": "SYNTHETIC"},
    ),
)

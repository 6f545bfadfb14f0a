"""Units as files and LSL streams spell them become the canonical one of their sensor type, or none."""

import math

import pytest
from sense4hri.signal_files.units import canonical

MICROVOLTS = (
    "uV",
    "µV",
    "μV",
    "uv",
    "microvolts",
    "Microvolts",
    "microvolt",
    "micro-volts",
    "uVolts",
    " uV ",
    "micro volts",
    "[uV]",
)


@pytest.mark.parametrize("unit", MICROVOLTS)
def test_a_microvolt_is_one_however_it_is_spelt(unit):
    """Spellings in XML of LSL streams that mean the same."""
    assert canonical("eeg", unit) == ("uV", 1.0)


@pytest.mark.parametrize(
    ("sensor_type", "unit", "target", "factor"),
    [
        ("eeg", "V", "uV", 1e6),
        ("ecg", "millivolts", "uV", 1e3),
        ("eda", "µS", "uS", 1.0),
        ("eda", "microsiemens", "uS", 1.0),
        ("eda", "micro siemens", "uS", 1.0),
        ("eda", "milliSiemens", "uS", 1e3),
        ("accelerometer", "m/s²", "m/s^2", 1.0),
        ("accelerometer", "m·s⁻²", "m/s^2", 1.0),
        ("accelerometer", "m s^-2", "m/s^2", 1.0),
        ("accelerometer", "meters/second^2", "m/s^2", 1.0),
        ("accelerometer", "m/s**2", "m/s^2", 1.0),
        ("gyroscope", "rad·s⁻¹", "rad/s", 1.0),
        ("gyroscope", "DPS", "rad/s", math.pi / 180),
        ("gyroscope", "º/s", "rad/s", math.pi / 180),
        ("temperature", "℃", "degC", 1.0),
        ("accelerometer", "G", "m/s^2", 9.80665),
        ("magnetometer", "Gauss", "uT", 100.0),
        ("gyroscope", "°/s", "rad/s", math.pi / 180),
        ("gyroscope", "degrees/second", "rad/s", math.pi / 180),
        ("temperature", "°C", "degC", 1.0),
        ("temperature", "Degrees Celsius", "degC", 1.0),
        ("eye_tracking", "Pixels", "px", 1.0),
        ("eye_tracking", "normalized", "1", 1.0),
        ("pupillometry", "millimeters", "mm", 1.0),
    ],
)
def test_other_units_have_their_factor(sensor_type, unit, target, factor):
    """G is gravity of an accelerometer and gauss of a magnetometer: the type decides."""
    assert canonical(sensor_type, unit) == (target, pytest.approx(factor))


@pytest.mark.parametrize(
    ("sensor_type", "unit"), [("eda", "kOhm"), ("eda", "ms"), ("eeg", "raw"), ("eeg", "uV^2"), ("temperature", "K")]
)
def test_what_no_factor_reaches_becomes_none(sensor_type, unit):
    """Ohms would need a division, kelvins an offset: nobody guesses."""
    assert canonical(sensor_type, unit) is None


@pytest.mark.parametrize("unit", ["Gauss", "gauss", "milligauss"])
def test_gauss_is_no_gravity(unit):
    """Spelt out it is a magnetic field and nothing else: an accelerometer in gauss has no scale."""
    assert canonical("accelerometer", unit) is None

"""Units as files and LSL streams spell them become the canonical one of their sensor type, or none."""

import math

import numpy as np
import pytest
from sense4hri.signal_files.units import Scale, canonical, scaled

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
    assert canonical("eeg", unit) == ("uV", Scale(1.0))


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
    assert canonical(sensor_type, unit) == (target, (pytest.approx(factor), False))


@pytest.mark.parametrize(
    ("unit", "of_100k"),
    [
        *((unit, 1e5) for unit in ("ohm", "Ohms", "Ω", "\u2126")),
        *((unit, 100) for unit in ("kOhm", "KOHM", "kΩ", "k\u2126", "kohms", "kilo ohm")),
        *((unit, 0.1) for unit in ("MOhm", "MΩ", "megohm")),
    ],
)
def test_a_skins_resistance_becomes_its_conductance(unit, of_100k):
    """100 kOhm are 10 uS, however it is spelt; half of it is twice as much."""
    target, scale = canonical("eda", unit)
    found = scaled(np.array([[of_100k], [of_100k / 2]]), [scale])
    assert (target, found.ravel().tolist()) == ("uS", pytest.approx([10.0, 20.0]))


def test_what_no_resistance_can_be_is_no_number():
    """0 of a short circuit, below 0, and what is infinite or missing; channels beside it stay as they are."""
    _, scale = canonical("eda", "kOhm")
    values = np.array([[0.0], [-0.0], [-5.0], [np.inf], [-np.inf], [np.nan]])
    found = scaled(np.hstack([values, values]), [scale, Scale(2.0)])
    assert np.isnan(found[:, 0]).all()
    assert np.array_equal(found[:, 1], values.ravel() * 2, equal_nan=True)


def test_a_factor_comes_before_the_conversion():
    """A file that counts in 10 Ohm: 10 000 of them are 100 kOhm, 10 uS."""
    _, scale = canonical("eda", "ohm")
    assert scaled(np.array([[10_000]]), [scale.after(10)]).tolist() == [[pytest.approx(10.0)]]


@pytest.mark.parametrize(
    ("sensor_type", "unit"), [("eeg", "kOhm"), ("eda", "ms"), ("eeg", "raw"), ("eeg", "uV^2"), ("temperature", "K")]
)
def test_what_no_scale_reaches_becomes_none(sensor_type, unit):
    """An electrode's impedance is no signal, kelvins would need an offset: nobody guesses."""
    assert canonical(sensor_type, unit) is None


@pytest.mark.parametrize("unit", ["Gauss", "gauss", "milligauss"])
def test_gauss_is_no_gravity(unit):
    """Spelt out it is a magnetic field and nothing else: an accelerometer in gauss has no scale."""
    assert canonical("accelerometer", unit) is None

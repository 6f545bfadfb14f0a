"""Parameters of driver-polar: what is refused, and what is declared."""

import math

import pytest
from driver_polar.config import MODELS, PolarConfig, streams_of
from driver_polar.control import Setting
from driver_polar.device import Polar
from driver_polar.session import choose


def config_of(**values) -> PolarConfig:
    return PolarConfig(**{"sensor_id": "polar_1", "name": "B5E3A222"} | values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"name": ""}, "address or name"),
        ({"address": "A0:9E:1A:00:00:00"}, "address or name"),
        ({"name": "", "address": "A0-9E"}, "parameter 'address' is 'A0-9E'"),
        ({"model": "H9"}, "parameter 'model' is 'H9', must be one of H10, VeritySense, OH1"),
        ({"streams": ("ppg",)}, "streams 'ppg': model H10 has ecg, accelerometer, heart_rate"),
        ({"streams": ("ecg", "pp_interval")}, "streams 'pp_interval': model H10"),
        ({"model": "VeritySense", "streams": ("ecg",)}, "streams 'ecg': model VeritySense has ppg"),
        ({"model": "OH1", "streams": ("gyroscope",)}, "streams 'gyroscope': model OH1"),
        ({"streams": ("ecg", "ecg")}, "each at most once"),
        ({"sdk_mode": True}, "sdk_mode: model H10 has none"),
        ({"model": "VeritySense", "sdk_mode": True, "streams": ("ppg", "pp_interval")}, "sdk_mode: in it"),
        ({"scan_timeout_s": 0.0}, "'scan_timeout_s' is 0.0, must be 0.1 to 300 s"),
        ({"scan_timeout_s": math.nan}, "'scan_timeout_s' is nan, must be 0.1 to 300 s"),
        ({"sensor_id": "Polar"}, "'sensor_id' is 'Polar'"),
        ({"human_id": "p 1"}, "'human_id' is 'p 1'"),
    ],
)
def test_a_wrong_configuration_names_the_parameter(values: dict, message: str) -> None:
    """Everything that cannot work is refused before a device is looked for."""
    with pytest.raises(ValueError, match=message):
        config_of(**values)


def test_addresses() -> None:
    """Bluetooth addresses, and the UUIDs macOS gives instead, are taken."""
    assert config_of(name="", address="a0:9e:1A:00:00:00").address
    assert config_of(name="", address="12345678-1234-1234-1234-123456789ABC").address


def test_an_h10_declares_its_streams() -> None:
    """Rate, unit, range and channels of what is started; heart_rate adds no stream."""
    streams = streams_of(config_of())
    assert list(streams) == ["ecg", "accelerometer"]
    ecg, motion = streams.values()
    assert (ecg.sampling_frequency_hz, ecg.unit, ecg.resolution_bits, ecg.range_max) == (130.0, "uV", 14, 20000.0)
    assert (motion.sampling_frequency_hz, motion.unit, motion.channel_names) == (50.0, "m/s^2", ("x", "y", "z"))
    assert motion.range_max == pytest.approx(8 * 9.80665)


def test_a_heart_rate_without_its_signal_has_a_stream_of_rate_zero() -> None:
    """The topics that carry the device's heart rate exist though no raw sample comes."""
    streams = streams_of(config_of(streams=("accelerometer", "heart_rate")))
    assert streams["ecg"].sampling_frequency_hz == 0.0
    assert streams["accelerometer"].sampling_frequency_hz == 50.0


def test_sdk_mode_leaves_out_what_the_device_computes() -> None:
    """The default streams lose the pulse intervals in SDK mode."""
    assert config_of(model="VeritySense").started == ("ppg", "accelerometer", "pp_interval")
    assert config_of(model="VeritySense", sdk_mode=True).started == ("ppg", "accelerometer")


@pytest.mark.parametrize("model", MODELS)
def test_every_model_declares_every_stream(model: str) -> None:
    """Each stream of each model is declared with the unit its samples have."""
    streams = streams_of(config_of(model=model, streams=tuple(MODELS[model].rates_hz)))
    units = {"ecg": "uV", "ppg": "counts", "accelerometer": "m/s^2", "gyroscope": "rad/s", "magnetometer": "uT"}
    assert {kind: stream.unit for kind, stream in streams.items()} == {kind: units[kind] for kind in streams}


@pytest.mark.parametrize(
    ("model", "offered", "sent"), [("VeritySense", 55, 55), ("VeritySense", 135, 135), ("OH1", 130, 130)]
)
def test_rates_that_firmware_misreports(model: str, offered: float, sent: float) -> None:
    """A Verity Sense before 2.1.0 offers its 55 Hz as 135, an OH1 its 135 Hz as 130: what is offered is asked for."""
    config = config_of(model=model)
    wanted = Polar(config, streams_of(config), None)._wanted("ppg")
    offers = {Setting.SAMPLE_RATE: (offered,), Setting.RESOLUTION: (22,), Setting.CHANNELS: (4,)}
    assert choose("ppg", wanted, offers, "it") == {
        Setting.SAMPLE_RATE: (sent,),
        Setting.RESOLUTION: (22,),
        Setting.CHANNELS: (4,),
    }


def test_what_nobody_asked_for_is_the_largest_offer() -> None:
    """A setting without a parameter takes the largest offer; factor and security are not sent back."""
    offers = {Setting.CHANNELS: (1, 3), Setting.FACTOR: (0.5,), Setting.SECURITY: (7,), Setting.RANGE: ()}
    assert choose("ppg", {}, offers, "it") == {Setting.CHANNELS: (3,)}

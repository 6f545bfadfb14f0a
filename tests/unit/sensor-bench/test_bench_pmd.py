"""The bench's encoder against the published bytes, and against a decoder written here for nothing else."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_bench.ble.values import heart_rate_measurement
from sensor_bench.polar import pmd
from sensor_bench.polar.pmd import Block, Command, MalformedCommand, Measurement, PulseInterval, Setting, Status


@pytest.fixture(scope="module")
def vectors(shared_data):
    entries = json.loads((shared_data / "polar" / "vectors.json").read_text())["vectors"]
    return {entry["id"]: entry for entry in entries}


def unpacked(content: bytes, channels: int, reference_bytes: int) -> tuple[list[list[int]], list[Block]]:
    """Samples and blocks of delta content, bit by bit."""
    size = channels * reference_bytes
    sample = [
        int.from_bytes(content[i : i + reference_bytes], "little", signed=True) for i in range(0, size, reference_bytes)
    ]
    samples, blocks, at = [sample], [], size
    while at < len(content):
        width, length = content[at], content[at + 1]
        count = -(-width * length * channels // 8)
        bits = int.from_bytes(content[at + 2 : at + 2 + count], "little")
        for _ in range(length):
            sample = list(sample)
            for channel in range(channels):
                delta = bits & ((1 << width) - 1)
                bits >>= width
                sample[channel] += delta - (1 << width if width and delta >> (width - 1) else 0)
            samples.append(sample)
        blocks.append(Block(width, length))
        at += 2 + count
    return samples, blocks


@pytest.mark.parametrize(
    ("name", "measurement", "frame_type", "channels", "reference_bytes"),
    [
        ("acc_delta_type0_10bit_57", Measurement.ACC, 0, 3, 2),
        ("acc_delta_type1_6bit", Measurement.ACC, 1, 3, 2),
        ("ppg_delta_type0_10bit_42", Measurement.PPG, 0, 4, 3),
        ("ppg_delta_type7_24bit", Measurement.PPG, 7, 17, 3),
        ("mag_delta_type0_6bit", Measurement.MAG, 0, 3, 2),
        ("mag_delta_type1_3bit", Measurement.MAG, 1, 4, 2),
    ],
)
def test_compressed_frames_come_out_byte_for_byte(vectors, name, measurement, frame_type, channels, reference_bytes):
    """Encoding the samples of a published compressed frame, in its blocks, gives its bytes."""
    published = bytes.fromhex(vectors[name]["input_hex"])
    samples, blocks = unpacked(published[10:], channels, reference_bytes)
    content = pmd.delta_content(np.array(samples), reference_bytes, blocks)
    made = pmd.frame(measurement, int.from_bytes(published[1:9], "little"), frame_type, content, compressed=True)
    width, length = blocks[-1]
    used_bits = width * length * channels % 8 or 8  # what follows in the last byte is padding, random in some vectors
    assert made[:-1] == published[:-1]
    assert made[-1] == published[-1] & ((1 << used_bits) - 1)


@pytest.mark.parametrize(("name", "channels"), [("delta_multi_blocks_140", 3)])
def test_content_of_many_blocks_comes_out_byte_for_byte(vectors, name, channels):
    """Nine blocks of two widths, 140 samples, are encoded as published."""
    published = bytes.fromhex(vectors[name]["input_hex"])
    samples, blocks = unpacked(published, channels, 2)
    assert len(samples) == 140
    assert pmd.delta_content(np.array(samples), 2, blocks) == published


def test_raw_frames_come_out_byte_for_byte(vectors):
    """Raw ECG, acceleration and PPG frames are encoded as published."""
    ecg = np.array(vectors["ecg_type0"]["expected"]["uV"])
    assert (
        pmd.frame(Measurement.ECG, 2_000_000_000, 0, pmd.signed_content(ecg.reshape(-1, 1), 3)).hex()
        == vectors["ecg_type0"]["input_hex"]
    )
    ppg = np.array(vectors["ppg_raw_type0"]["expected"]["samples"])
    assert (
        pmd.frame(Measurement.PPG, 2_000_000_000, 0, pmd.signed_content(ppg, 3)).hex()
        == vectors["ppg_raw_type0"]["input_hex"]
    )
    acc = np.array([[-187, -28, 949], [-187, -28, 952]])
    frame = pmd.frame(Measurement.ACC, 599618164814402794, 1, pmd.signed_content(acc, 2))
    assert frame.hex() == vectors["spec_acc_raw_h10_truncated"]["input_hex"]


def test_real_ecg_frames_come_out_byte_for_byte(vectors):
    """Six consecutive frames of a real H10, decoded and encoded again, are the same bytes."""
    for entry in vectors["real_h10_ecg_6_consecutive"]["frames"]:
        real = bytes.fromhex(entry["hex"])
        values = [int.from_bytes(real[i : i + 3], "little", signed=True) for i in range(10, len(real), 3)]
        content = pmd.signed_content(np.array(values).reshape(-1, 1), 3)
        assert pmd.frame(Measurement.ECG, int.from_bytes(real[1:9], "little"), 0, content) == real


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("hr_u8_255", heart_rate_measurement(255)),
        ("hr_u16_32896", heart_rate_measurement(32896)),
        ("hr_contact_yes", heart_rate_measurement(0, contact=True)),
        ("hr_contact_no", heart_rate_measurement(0, contact=False)),
        ("hr_energy_u8hr", heart_rate_measurement(0, energy_kj=32895)),
        ("hr_rr_0", heart_rate_measurement(0, [65535])),
        ("hr_h10_example", heart_rate_measurement(72, [832])),
        ("cp_features_verity", pmd.features([Measurement(i) for i in (1, 2, 3, 5, 6)])),
        ("real_h10_features", pmd.features([Measurement.ECG, Measurement.ACC])),
        ("cp_unsolicited_online_stopped", pmd.stopped_by_device([Measurement.PPG, Measurement.ACC])),
        ("cp_resp_mag_invalid_resolution", pmd.response(1, 6, Status.INVALID_RESOLUTION)),
        (
            "settings_range",
            pmd.settings(
                {
                    Setting.RATE: (52,),
                    Setting.RESOLUTION: (16,),
                    Setting.RANGE: (245, 500, 1000, 2000),
                    Setting.CHANNELS: (3,),
                }
            ),
        ),
        (
            "settings_range_milliunit",
            pmd.settings({Setting.RANGE_MILLI: (0xFFFFFFFF, 0xFF), Setting.RESOLUTION: (14,)}),
        ),
        (
            "cp_start_acc_verity_resp",
            pmd.response(2, 2, Status.SUCCESS, pmd.settings({Setting.FACTOR: (2.44e-4,)})),
        ),
    ],
)
def test_small_messages_are_the_published_bytes(vectors, name, made):
    """Heart-rate measurements, features, settings and responses are encoded as published."""
    assert made.hex() == vectors[name]["input_hex"].lower()


def test_pulse_intervals_carry_rate_interval_error_and_flags():
    """Six bytes per interval, the three flags in bits 0 to 2."""
    content = pmd.ppi_content([PulseInterval(60, 1000, 10), PulseInterval(255, 65535, 5, blocked=True, contact=False)])
    assert content == bytes([60, 0xE8, 0x03, 10, 0, 0b110, 255, 255, 255, 5, 0, 0b101])


@given(
    st.integers(1, 4),
    st.integers(1, 60),
    st.integers(1, 22),
    st.integers(30, 219),
    st.integers(0, 2**32 - 1),
)
def test_fitted_frames_keep_to_the_budget_and_lose_nothing(channels, count, spread_bits, budget, seed):
    """Whatever the signal, content fits the budget, its samples are a prefix, and more would not have fitted."""
    rng = np.random.default_rng(seed)
    steps = rng.integers(-(1 << spread_bits) // 2, (1 << spread_bits) // 2 + 1, (count, channels))
    samples = np.clip(np.cumsum(steps, axis=0), -(1 << 23), (1 << 23) - 1)
    content, used = pmd.fit_delta(samples, 3, budget)
    found, blocks = unpacked(content, channels, 3)
    assert len(content) <= max(budget, 3 * channels)
    assert found == samples[:used].tolist()
    assert all(width != 1 for width, _ in blocks)
    assert used == count or len(content) + 2 + 24 * channels // 8 + channels > budget


def test_settings_are_cut_off_or_unknown_only_with_an_error():
    """A start command that ends in the middle of a setting, or has an unknown one, is refused by name."""
    with pytest.raises(MalformedCommand, match="RATE is cut off"):
        pmd.parse_settings(bytes([0, 1, 0x82]))
    with pytest.raises(MalformedCommand, match="begins no setting"):
        pmd.parse_settings(bytes([9, 1, 0]))
    assert pmd.parse_settings(bytes.fromhex("020108000001c800010110 00".replace(" ", ""))) == {
        Setting.RANGE: [8],
        Setting.RATE: [200],
        Setting.RESOLUTION: [16],
    }


def test_long_responses_are_paged():
    """All packets but the last say that more follows, and together they carry the parameters."""
    pages = pmd.paged_responses(Command.GET_SETTINGS, Measurement.ACC, bytes(range(25)), 10)
    assert [page[4] for page in pages] == [1, 1, 0]
    assert b"".join(page[5:] for page in pages) == bytes(range(25))

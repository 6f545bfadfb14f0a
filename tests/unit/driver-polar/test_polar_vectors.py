"""Every vector of ../shared/data/polar/vectors.json against the codec."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from driver_polar import control, protocol
from driver_polar.delta import decode_delta, signed_values
from driver_polar.protocol import Measurement
from sense4hri.errors import FrameError
from sense4hri.gatt import decode_heart_rate

G = 9.80665
NOT_OF_THIS_CODEC = {
    "timestamps": "sample times are computed in the kit; the clock's epoch is passed on as it is",
    "psftp_rfc76_header": "setting the device's clock is left out",
}
TESTED = {
    "hr_0x2A37",
    "pmd_frame",
    "pmd_frame_error",
    "pmd_frame_sequence",
    "delta_content",
    "delta_reference",
    "control_point",
    "settings_tlv",
    "measurement_status_byte",
}
ECG_MARKS = {
    "over_sampling": "oversampling",
    "skin_contact": "skin_contact",
    "contact_impedance": "contact_impedance",
    "ecg_data_tag": "ecg_data_tag",
    "pace_data_tag": "pace_data_tag",
    "status": "status",
}


@pytest.fixture(scope="session")
def vectors(shared_data: Path) -> list[dict]:
    return json.loads((shared_data / "polar" / "vectors.json").read_text())["vectors"]


def of(vectors: list[dict], *groups: str) -> list[dict]:
    return [vector for vector in vectors if vector["group"] in groups]


def decoded(vector: dict) -> protocol.Frame:
    data = bytes.fromhex(vector["input_hex"])
    if data[0] == 0xA5:  # two vectors hand the SDK's PPG decoder a frame whose first byte names no measurement
        data = bytes([Measurement.PPG]) + data[1:]
    return protocol.decode(protocol.parse(data), vector["params"].get("factor", 1.0))


def test_every_group_of_vectors_is_tested_or_belongs_elsewhere(vectors: list[dict]) -> None:
    """No vector is left out by accident."""
    assert {vector["group"] for vector in vectors} == TESTED | set(NOT_OF_THIS_CODEC)


def test_heart_rate(vectors: list[dict]) -> None:
    """Rate, contact, energy and every RR interval come out as the source asserts."""
    for vector in of(vectors, "hr_0x2A37"):
        measured, computed = decode_heart_rate(bytes.fromhex(vector["input_hex"])), vector["computed"]
        assert measured.bpm == computed["hr"], vector["id"]
        assert measured.contact == computed["contact"], vector["id"]
        assert measured.energy_kj == computed["energy"], vector["id"]
        assert measured.rr_ms == tuple(rr * 1000 / 1024 for rr in computed["rr_1024"]), vector["id"]


def test_every_frame_decodes_or_says_why(vectors: list[dict]) -> None:
    """All frames but the one a document cut off decode, with the stamp their header carries."""
    for vector in of(vectors, "pmd_frame"):
        if vector["id"] == "spec_acc_delta_verity_truncated":
            continue
        frame = decoded(vector)
        expected = vector["expected"]
        stamp = struct.unpack_from("<Q", bytes.fromhex(vector["input_hex"]), 1)[0]
        assert frame.device_ns == stamp, vector["id"]
        assert stamp == expected.get("last_timestamp", expected.get("timestamp", stamp)), vector["id"]
        assert len(frame.samples) == expected.get("n", len(frame.samples)), vector["id"]


def test_ecg_is_exact(vectors: list[dict]) -> None:
    """Microvolts in are microvolts out, bit for bit, in all four frame types."""
    for vector in of(vectors, "pmd_frame"):
        frame = decoded(vector) if vector["id"].startswith("ecg") else None
        if frame is None:
            continue
        expected = vector["expected"]
        if "uV" in expected:
            assert frame.samples[:, 0].tolist() == expected["uV"]
            continue
        for row, sample in enumerate(expected["samples"]):
            signal = [sample["uV"]] if "uV" in sample else [sample["data0"], sample["data1"]]
            assert frame.samples[row].tolist() == signal, vector["id"]
            marks = {status.name: status.values[row] for status in frame.status}
            assert marks == {ECG_MARKS[name]: int(value) for name, value in sample.items() if name in ECG_MARKS}


def test_acceleration_scales_once(vectors: list[dict]) -> None:
    """Raw counts times the factor are m/s^2 to the last digit float64 holds."""
    by_id = {vector["id"]: vector for vector in vectors}
    raw = by_id["acc_raw_type1_36"]
    assert decoded(raw).samples == pytest.approx(np.array(raw["computed"]["mG"]) * 1e-3 * G, rel=1e-15)
    large = by_id["acc_delta_type0_10bit_57"]
    counts = np.array(large["computed"]["raw"])
    assert decoded(large).samples == pytest.approx(counts * 0.000244 * G, rel=1e-15)
    assert np.abs(decoded(large).samples).max() <= large["expected"]["range_check_mG"] * 1e-3 * G
    small = by_id["acc_delta_type1_6bit"]
    assert decoded(small).samples == pytest.approx(np.array(small["expected"]["mG"]) * 1e-3 * G, rel=1e-15)
    document = by_id["spec_acc_raw_h10_truncated"]
    assert decoded(document).samples == pytest.approx(np.array(document["computed"]["mG"]) * 1e-3 * G, rel=1e-15)


def test_the_frame_a_document_cut_is_refused(vectors: list[dict]) -> None:
    """The printed half of a Verity Sense frame is an error; its whole part decodes to the printed samples."""
    vector = next(v for v in vectors if v["id"] == "spec_acc_delta_verity_truncated")
    with pytest.raises(FrameError, match="delta block 1 is cut"):
        decoded(vector)
    data = bytearray.fromhex(vector["input_hex"])
    content = data[protocol.HEADER.size :]
    assert (content[6], content[7]) == (vector["expected"]["delta_bits"], vector["expected"]["delta_count"])
    content[7] = 5
    samples = decode_delta(bytes(content[: 8 + 15]), 3, 2)
    assert samples.tolist() == vector["computed"]["raw_available"]


def test_ppg_counts(vectors: list[dict]) -> None:
    """All optical frame types give the counts the source asserts; status words stay unsigned."""
    for vector in of(vectors, "pmd_frame"):
        expected = vector["expected"]
        if not vector["id"].startswith("ppg"):
            continue
        frame = decoded(vector)
        status = {word.name: word.values.tolist() for word in frame.status}
        whole = np.column_stack([frame.samples, *(word.values for word in frame.status)]) if frame.channels else None
        assert frame.unit == "counts"
        if "samples" in expected:
            assert frame.samples.tolist() == expected["samples"]
            assert list(frame.channels) == ["ppg_0", "ppg_1", "ppg_2", "ambient"]
        if "first" in expected:
            assert frame.samples[:2].tolist() == expected["first"]
        if vector.get("computed") and whole is not None:
            assert ((whole - np.array(vector["computed"]["samples"])) % 2**24 == 0).all(), vector["id"]
        if "s0_red" in expected:
            assert frame.samples[0].tolist() == expected["s0_red"] + expected["s0_green"] + expected["s0_ir"]
        if "s0_status" in expected:
            assert status["status"][0] == expected["s0_status"]
        if "s0" in expected:
            assert whole[0].tolist() == expected["s0"]
        if "num_int" in expected:
            assert status["integrations"] == expected["num_int"]
        if "gain1_first2_last2" in expected:
            assert status["gain_1"][:2] + status["gain_1"][-2:] == expected["gain1_first2_last2"]
            assert status["gain_2"][:2] + status["gain_2"][-2:] == expected["gain2_first2_last2"]
        if "gain1" in expected:
            assert (status["gain_1"], status["gain_2"]) == (expected["gain1"], expected["gain2"])
        if "operation_mode" in expected:
            assert status["operation_mode"] == [expected["operation_mode"]]


def test_motion_and_temperature(vectors: list[dict]) -> None:
    """Gyroscope, magnetometer and skin temperature arrive in rad/s, uT and degC."""
    for vector in of(vectors, "pmd_frame"):
        expected = vector["expected"]
        if "dps" in expected:
            assert decoded(vector).samples == pytest.approx(np.radians(expected["dps"]), rel=1e-15)
        if "gauss_raw" in expected:
            assert decoded(vector).samples == pytest.approx(np.array(expected["gauss_raw"]) * 100, rel=1e-15)
        if "gauss" in expected:
            frame = decoded(vector)
            assert frame.samples == pytest.approx(np.array(expected["gauss"]) * 100, abs=100 * expected["tolerance"])
            assert frame.status[0].values.tolist() == expected["calibration"]
        if "celsius" in expected:
            assert decoded(vector).samples[:, 0] == pytest.approx(expected["celsius"], abs=1e-6)


def test_frames_no_device_should_send_are_refused(vectors: list[dict]) -> None:
    """The three error vectors raise FrameError that names the frame type."""
    for vector in of(vectors, "pmd_frame_error"):
        with pytest.raises(FrameError, match=r"frame type 1[034] is not supported"):
            decoded(vector)


def test_delta_contents(vectors: list[dict]) -> None:
    """Contents of up to nine blocks decode to the independent decoder's integers, 32-bit wrap included."""
    for vector in of(vectors, "delta_content"):
        samples = decode_delta(
            bytes.fromhex(vector["input_hex"]), vector["params"]["channels"], vector["params"]["ref_bytes"]
        )
        assert len(samples) == vector["expected"]["n"], vector["id"]
        computed = vector["computed"].get("raw", vector["computed"].get("int_bits"))
        assert samples.astype(np.int64).tolist() == [[wrap(value) for value in row] for row in computed], vector["id"]


def wrap(value: int) -> int:
    return (value + 2**31) % 2**32 - 2**31


def test_delta_references(vectors: list[dict]) -> None:
    """Reference samples are signed integers of their own width."""
    for vector in of(vectors, "delta_reference"):
        values = signed_values(bytes.fromhex(vector["input_hex"]), vector["params"]["ref_bytes"])
        expected = vector["expected"].get("ref", vector["expected"].get("ref_uint32"))
        assert values.tolist() == [wrap(value) if "ref_uint32" in vector["expected"] else value for value in expected]


def test_consecutive_frames_of_a_real_h10(vectors: list[dict]) -> None:
    """Six frames of a real strap decode to 438 exact samples, 560.8 ms apart."""
    (vector,) = of(vectors, "pmd_frame_sequence")
    stamps = []
    for recorded in vector["frames"]:
        frame = protocol.decode(protocol.parse(bytes.fromhex(recorded["hex"])))
        assert frame.samples[:, 0].tolist() == recorded["uV"]
        assert (frame.device_ns, frame.unit, frame.channels) == (recorded["timestamp"], "uV", ("ecg",))
        stamps.append(frame.device_ns)
    assert np.diff(stamps) == pytest.approx([560.8e6] * 5, rel=2e-4)


def test_control_point(vectors: list[dict]) -> None:
    """Features, responses, notices and commands match byte for byte."""
    for vector in of(vectors, "control_point"):
        data, expected = bytes.fromhex(vector["input_hex"]), vector["expected"]
        if data[0] == control.RESPONSE:
            response = control.parse_response(data)
            for name, field in (("op", "op"), ("type", "measurement"), ("status", "status"), ("more", "more")):
                assert getattr(response, field) == expected.get(name, getattr(response, field)), vector["id"]
            if "status_name" in expected:
                assert response.status_name == expected["status_name"].removeprefix("ERROR_")
            if "params" in expected:
                assert response.parameters.hex() == expected["params"]
            if "settings" in expected:
                assert plain(control.parse_settings(response.parameters)) == expected["settings"]
            if "factor" in expected:
                assert control.parse_settings(response.parameters)[control.Setting.FACTOR] == (expected["factor"],)
            if "reserved" in expected:
                assert control.parse_settings(response.parameters) == {}
        elif data[0] == control.FEATURES:
            short = {"ACCELERATION": "ACC", "PP_INTERVAL": "PPI", "GYROSCOPE": "GYRO", "MAGNETOMETER": "MAG"}
            names = {short.get(kind.name, kind.name) for kind in control.parse_features(data)}
            assert names == set(expected["types"])
        elif expected["command"] == "ONLINE_MEASUREMENT_STOPPED":
            assert list(control.parse_stopped(data)) == expected["types"]
        else:
            settings = {
                control.Setting(int(kind)): tuple(values) for kind, values in expected.get("settings", {}).items()
            }
            op = {2: control.Op.START, 3: control.Op.STOP, 4: control.Op.GET_SDK_SETTINGS}[data[0]]
            assert control.command(op, Measurement(data[1]), settings) == data, vector["id"]


def plain(settings: control.Settings) -> dict[str, list[float]]:
    return {str(int(kind)): list(values) for kind, values in settings.items()}


def test_settings(vectors: list[dict]) -> None:
    """Settings decode in any order; a cut one is refused."""
    for vector in of(vectors, "settings_tlv"):
        data = bytes.fromhex(vector["input_hex"])
        if "error" in vector["expected"]:
            with pytest.raises(FrameError, match="RESOLUTION with 1 values is cut"):
                control.parse_settings(data)
        else:
            assert plain(control.parse_settings(data)) == vector["expected"]["settings"]


def test_measurement_status_bytes(vectors: list[dict]) -> None:
    """Online, offline and both are told apart."""
    for vector in of(vectors, "measurement_status_byte"):
        activity = control.parse_activity(int(vector["input_hex"], 16))
        words = "+".join(word for word, on in (("online", activity.online), ("offline", activity.offline)) if on)
        assert (words or "none", activity.measurement) == (vector["expected"]["state"], vector["expected"]["type"])

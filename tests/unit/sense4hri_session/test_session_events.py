"""Events, whose times are in the clock of the samples, lie on the corrected timeline where those do."""

import numpy as np
import pytest
import sense4hri_session
from reported_session import EPOCH_NS, SECOND, START_NS, stamp
from sense4hri_report import make_report

LINK_NS = 20_000_000


def raw(study, key, second, device_ns):
    """One second of samples; device_ns: of the last one, 0 = the device gives no time."""
    study.raw(key, START_NS + second * SECOND + LINK_NS, device_ns, {"c": np.arange(100.0)})


def features(study, key, second, device_ns, breath_ns):
    """A breath, computed on the samples up to that second, told with the message that brought the last of them."""
    now = START_NS + second * SECOND + LINK_NS
    told = {"header": {"stamp": stamp(now), "frame_id": ""}, "device_timestamp": stamp(device_ns)}
    told["breath_timestamps"] = [stamp(breath_ns)]
    study.add(f"/humans/physiological/{key}/features", "Respiration", now + 3_000_000, **told)


def after_start_s(session, key):
    return (session.events(key)["time_ns"].to_numpy() - START_NS) / SECOND


def test_events_of_a_derived_stream_are_in_the_clock_of_the_same_persons_source(study):
    """A strap goes from p1 to p2 and restarts: each one's breaths lie in the second in which they were found."""
    for second in range(1, 121):
        human, begun = ("p1", EPOCH_NS) if second <= 60 else ("p2", EPOCH_NS - 1000 * SECOND)
        device_ns = begun + second * SECOND
        raw(study, f"{human}/ecg/h10_1", second, device_ns)
        key = f"{human}/respiration/h10_1_ecg"
        features(study, key, second, device_ns, device_ns - SECOND // 2)
    session = sense4hri_session.open(study.write())
    for human, first in (("p1", 1), ("p2", 61)):
        found_s = after_start_s(session, f"{human}/respiration/h10_1_ecg")
        assert np.abs(found_s - (np.arange(first, first + 60) - 0.5)).max() < 0.05


def test_without_device_time_a_known_delay_is_subtracted_from_events_as_from_samples(study):
    """A breath told at a sample's own time lies on that sample, and so do the features and the device's own values."""
    sensor = study.sensor("p1/respiration/belt_1", 100.0, "N", ["c"], 16, transport_delay_s=0.15)
    study.add(
        "/study/sensors",
        "SensorInfoArray",
        START_NS,
        header={"stamp": stamp(START_NS), "frame_id": ""},
        sensors=[sensor],
    )
    for second in range(1, 61):
        raw(study, "p1/respiration/belt_1", second, 0)
        at_ns = START_NS + second * SECOND + LINK_NS
        features(study, "p1/respiration/belt_1", second, 0, at_ns)
        own = {"name": "respiration_rate", "unit": "1/min", "values": [12.0]}
        head = {"stamp": stamp(at_ns), "frame_id": ""}
        topic = "/humans/physiological/p1/respiration/belt_1/device"
        study.add(topic, "PhysioDeviceFeature", at_ns, header=head, features=[own])
    session = sense4hri_session.open(study.write())
    samples_ns, _ = session["p1/respiration/belt_1"].arrays()
    for told in (session.events, session.features, session.device):
        found_ns = told("p1/respiration/belt_1")["time_ns"].to_numpy()
        assert np.abs(samples_ns[99::100] - found_ns).max() < 1_000_000


@pytest.mark.parametrize("apart_s", [-1.1e9, 3.0])
def test_events_of_a_time_without_device_time_are_in_ros_time(study, apart_s):
    """Device time from second 31 to 60 and a single message without: whether its clock is years or seconds away."""
    for second in range(1, 91):
        now_ns = START_NS + second * SECOND
        device_ns = now_ns + round(apart_s * SECOND) if 30 < second <= 60 and second != 45 else 0
        in_device_time = 30 < second < 70
        clock_ns = now_ns + round(apart_s * SECOND) if in_device_time else now_ns + LINK_NS
        raw(study, "p1/respiration/belt_1", second, device_ns)
        features(study, "p1/respiration/belt_1", second, device_ns, clock_ns - SECOND // 2)
    found_s = after_start_s(sense4hri_session.open(study.write()), "p1/respiration/belt_1")
    assert np.abs(found_s - (np.arange(1, 91) - 0.5)).max() < 0.05


def test_events_without_the_values_beside_them_are_events(study):
    """Somebody's interpreter that finds R peaks and tells no intervals: both peaks are there, the values empty."""
    raw(study, "p1/ecg/h10_1", 1, 0)
    raw(study, "p1/ecg/h10_1", 2, 0)
    told = {"header": {"stamp": stamp(START_NS + 2 * SECOND), "frame_id": ""}}
    told["peak_timestamps"] = [stamp(START_NS + SECOND), stamp(START_NS + 2 * SECOND)]
    key = "p1/ecg/h10_1"
    study.add(f"/humans/physiological/{key}/features", "ECG", START_NS + 2 * SECOND, **told)
    told |= {"peak_timestamps": [stamp(START_NS + 3 * SECOND)], "rr_intervals_ms": np.array([1000.0])}
    study.add(f"/humans/physiological/{key}/features", "ECG", START_NS + 3 * SECOND, **told)
    found = sense4hri_session.open(study.write()).events(key)
    assert found["event"].tolist() == ["r_peak"] * 3
    np.testing.assert_array_equal(found["rr_intervals_ms"], [np.nan, np.nan, 1000.0])


def test_a_device_value_that_could_not_be_computed_has_a_row(study):
    """A feature without values, as the message has it, is NaN under its name and unit."""
    raw(study, "p1/ecg/h10_1", 1, 0)
    features = [{"name": "heart_rate", "unit": "1/min", "values": []}]
    told = {"header": {"stamp": stamp(START_NS + SECOND), "frame_id": ""}, "features": features}
    study.add("/humans/physiological/p1/ecg/h10_1/device", "PhysioDeviceFeature", START_NS + SECOND, **told)
    (row,) = sense4hri_session.open(study.write()).device("p1/ecg/h10_1").to_dict("records")
    assert (row["name"], row["unit"]) == ("heart_rate", "1/min")
    assert np.isnan(row["value"])


def test_a_marker_that_a_sensor_told_lies_among_its_samples(study):
    """Told at once or 20 s late, before and after the device's clock was set; a time of another clock says nothing."""
    sensor = study.sensor("p1/ecg/h10_1", 100.0, "uV", ["c"], 16, transport_delay_s=0.01)
    study.add("/study/sensors", "SensorInfoArray", START_NS, sensors=[sensor])

    def tell(second, device_ns, late_s=0.0, source="h10_1"):
        at_ns = START_NS + second * SECOND + LINK_NS + round(late_s * SECOND)
        told = {"header": {"stamp": stamp(at_ns), "frame_id": ""}, "device_timestamp": stamp(device_ns)}
        study.add("/study/markers", "Marker", at_ns, **told, name="trigger", value=f"{second}", source=source)

    for second in range(1, 61):
        device_ns = (second + (7 if second <= 30 else 27)) * SECOND
        raw(study, "p1/ecg/h10_1", second, device_ns)
        tell(second, device_ns, late_s=20.0 if second in (15, 25) else 0.0)
    tell(70, 500_000 * SECOND)
    tell(71, 0)
    tell(72, 7 * SECOND, source="gui")
    session = sense4hri_session.open(study.write())
    samples_ns, _ = session["p1/ecg/h10_1"].arrays()
    found_ns = dict(zip(session.markers["value"].map(int), session.markers["time_ns"], strict=True))
    np.testing.assert_array_equal([found_ns[second] for second in range(1, 61)], samples_ns[99::100])
    late_s = [(found_ns[second] - START_NS - LINK_NS) / SECOND - second for second in (70, 71, 72)]
    np.testing.assert_allclose(late_s, [-0.01, -0.01, 0.0], atol=1e-6)


@pytest.mark.parametrize(("seconds", "told_late_s"), [(90, 0.0), (90, 0.7), (10, 0.7)])
def test_the_report_has_markers_that_a_sensor_told_where_the_export_has_them(study, seconds, told_late_s):
    """From the first second on, over a restart, also where told 20 s late; those without device time at their stamp."""

    def tell(second, device_ns, late_s, source="h10_1"):
        at_ns = START_NS + second * SECOND + LINK_NS + round(late_s * SECOND)
        told = {"header": {"stamp": stamp(at_ns), "frame_id": ""}, "device_timestamp": stamp(device_ns)}
        study.add("/study/markers", "Marker", at_ns, **told, name="trigger", value=f"{second}", source=source)

    for second in range(1, seconds + 1):
        device_ns = (second + (7 if second <= 45 else 27)) * SECOND
        raw(study, "p1/ecg/h10_1", second, device_ns)
        tell(second, device_ns, 20.0 if second in (15, 40) else told_late_s)
    tell(91, 500_000 * SECOND, 0.0)
    tell(92, 0, 0.0)
    tell(93, 60 * SECOND, 0.0, source="gui")
    study.messages.sort()
    folder = study.write()
    exported = sense4hri_session.open(folder).markers.sort_values("value")
    shown = sorted(make_report(folder)["markers"], key=lambda marker: marker["value"])
    apart_ns = np.array([marker["ros_ns"] for marker in shown]) - exported["time_ns"].to_numpy()
    assert np.abs(apart_ns).max() < 1_000_000

"""A recording of drivers on two hosts is on one timeline: that of the reference host."""

import numpy as np
import pytest
import sense4hri_session

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
AHEAD_NS, STEP_NS = 250_000_000, 2 * SECOND  # of the clock of lab_b; then it is set forward


def stamp(at_ns):
    return {"sec": at_ns // SECOND, "nanosec": at_ns % SECOND}


def stream(study, key, host, host_ns, seconds=60):
    """One sample at every 1/10 s of true time; device and host clock of each."""
    for i in range(seconds * 10):
        true_ns = START_NS + i * SECOND // 10
        study.raw(key, host_ns(true_ns), 7 * SECOND + i * SECOND // 10, {"x": np.array([float(i)])})
        if i % 10 == 0:
            values = {"host": host, "realtime_minus_monotonic_ns": host_ns(true_ns) - true_ns + SECOND}
            topic = f"/humans/physiological/{key}/health"
            study.add(
                topic, "StreamHealth", true_ns, header={"stamp": stamp(host_ns(true_ns)), "frame_id": ""}, **values
            )


def entries(study, host_ns, seconds=60):
    for second in range(seconds):
        true_ns = START_NS + second * SECOND
        clock = {"host": "lab_b", "reference": "lab_a", "measured_at": stamp(host_ns(true_ns)), "state": 1}
        clock |= {"offset_ns": true_ns - host_ns(true_ns), "skew_ppm": 0.0, "uncertainty_s": 1e-4}
        study.add("/study/host_clocks", "HostClockArray", true_ns, clocks=[clock])


def stepped(true_ns):
    return true_ns + AHEAD_NS + (STEP_NS if true_ns >= START_NS + 30 * SECOND else 0)


def test_streams_of_two_hosts_lie_side_by_side_through_a_step(study):
    """One host 250 ms ahead, and 2 s more from the middle on: every sample is where it was taken, within 5 ms."""
    stream(study, "p1/ecg/a", "lab-a", lambda true_ns: true_ns)
    stream(study, "p1/ecg/b", "Lab-B", stepped)
    entries(study, stepped)
    session = sense4hri_session.open(study.write())
    for key in ("p1/ecg/a", "p1/ecg/b"):
        times_ns, _ = session[key].arrays()
        true_ns = START_NS + np.arange(600) * SECOND // 10
        assert np.abs(times_ns - true_ns).max() < 5_000_000, key
    assert not [note for note in session.notes if "nobody has measured" in note]


@pytest.mark.parametrize(("host", "said"), [("lab_c", True), ("lab_a", False)])
def test_a_host_that_nobody_measured_is_named_in_the_notes(study, host, said):
    """Its offset is 0, which may be wrong; the reference's is right."""
    stream(study, "p1/ecg/c", host, lambda true_ns: true_ns, seconds=10)
    entries(study, stepped, seconds=10)
    session = sense4hri_session.open(study.write())
    assert any("nobody has measured the clock of host lab_c" in note for note in session.notes) is said


def test_a_replay_recorded_beside_live_hosts_keeps_its_stamps_and_it_is_said(study):
    """Stamps of three weeks before: the line of now, 20 ppm of skew, would have moved them by 36 s."""
    now_ns = 21 * 86_400 * SECOND
    stream(study, "p1/ecg/b", "lab_b", lambda true_ns: true_ns, seconds=10)
    clock = {"host": "lab_b", "reference": "lab_a", "measured_at": stamp(START_NS + now_ns), "skew_ppm": 20.0}
    study.add("/study/host_clocks", "HostClockArray", START_NS, clocks=[clock])
    session = sense4hri_session.open(study.write())
    times_ns, _ = session["p1/ecg/b"].arrays()
    assert np.abs(times_ns - START_NS - np.arange(100) * SECOND // 10).max() < 5_000_000
    assert any("stamps of host lab_b were taken more than a day from" in note for note in session.notes)


def test_markers_of_a_driver_on_another_host_lie_among_its_samples(study):
    """With device time and without, before and after a step of the host's clock: within 5 ms of the truth."""
    stream(study, "p1/ecg/a", "lab-a", lambda true_ns: true_ns)
    stream(study, "p1/ecg/b", "Lab-B", stepped)
    entries(study, stepped)
    true_ns = START_NS + np.arange(1, 60) * SECOND
    for at_ns in true_ns.tolist():
        for source, device_ns in (("b", 7 * SECOND + at_ns - START_NS), ("b", 0), ("gui", 0)):
            stamped_ns = stepped(at_ns) if source == "b" else at_ns
            told = {"header": {"stamp": stamp(stamped_ns), "frame_id": ""}, "device_timestamp": stamp(device_ns)}
            study.add("/study/markers", "Marker", at_ns, **told, name="trigger", source=source)
    markers = sense4hri_session.open(study.write()).markers
    assert np.abs(markers["time_ns"].to_numpy() - np.repeat(true_ns, 3)).max() < 5_000_000

"""From a host's clock to the reference's: online, from a recording, and where nothing is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from sense4hri.clock_model import ros_ns
from sense4hri.host_clocks import FRESH_S, MOST_HOSTS, MOST_SENSORS, HostClocks, SensorHosts, sanitised, this_host
from sense4hri.stamps import SECOND_NS

T0_NS = 1_700_000_000 * SECOND_NS


def array(host, offset_ns, skew_ppm, measured_at_ns, reference="lab_a"):
    seconds, nanoseconds = divmod(measured_at_ns, SECOND_NS)
    measured_at = SimpleNamespace(sec=seconds, nanosec=nanoseconds)
    entry = SimpleNamespace(host=host, reference=reference, offset_ns=offset_ns, skew_ppm=skew_ppm, uncertainty_s=1e-4)
    entry.measured_at = measured_at
    return SimpleNamespace(clocks=[entry])


def test_device_to_host_to_reference():
    """The device's model first, then the host's line, as the contract writes them."""
    clocks = HostClocks()
    clocks.take(array("lab_b", 3_000_000, 50.0, T0_NS), 0.0)
    device_ns, reference_ns, offset_ns, skew_ppm = 20 * SECOND_NS, 10 * SECOND_NS, T0_NS - 10 * SECOND_NS, -20.0
    host_ns = T0_NS + 10 * SECOND_NS - 200_000
    expected = host_ns + 3_000_000 + round(50e-6 * (host_ns - T0_NS))
    assert ros_ns(device_ns, reference_ns, offset_ns, skew_ppm) == host_ns
    assert clocks.reference_ns("Lab-B", host_ns) == expected


def test_a_host_without_an_entry_has_offset_0_and_says_so():
    """The reference itself needs none, and in a study on one host there is nothing to say."""
    clocks = HostClocks()
    assert clocks.doubt("lab_c") == ""
    clocks.take(array("lab_b", 3_000_000, 0.0, T0_NS), 0.0)
    assert clocks.reference_ns("lab_c", T0_NS) == T0_NS
    assert "lab_c" in clocks.doubt("lab_c")
    assert clocks.doubt("lab_b") == clocks.doubt("LAB-A") == clocks.doubt("") == ""


def test_a_recording_knows_which_entry_held_when():
    """A step of the host's clock: what is stamped before it has the entries before, what comes later the new one."""
    clocks, live = HostClocks(history=True), HostClocks()
    for second in range(10):
        offset_ns = 1_000_000 if second < 5 else -4 * SECOND_NS
        ahead_ns = 0 if second < 5 else 4 * SECOND_NS
        for each in (clocks, live):
            each.take(array("lab_b", offset_ns, 10.0, T0_NS + second * SECOND_NS + ahead_ns), 0.0)
    stamps = T0_NS + np.array([-1, 0, 4, 9, 12, 60], np.int64) * SECOND_NS
    expected = stamps + np.array([990_000, 1_000_000, 1_000_000, *[-4 * SECOND_NS] * 2, -4 * SECOND_NS + 470_000])
    assert clocks.reference_ns("lab_b", stamps).tolist() == expected.tolist()
    assert [clocks.reference_ns("lab_b", int(stamp)) for stamp in stamps] == expected.tolist()
    assert live.reference_ns("lab_b", T0_NS) < T0_NS - 3 * SECOND_NS


@pytest.mark.parametrize(("offset_ns", "skew_ppm"), [(0, np.nan), (0, np.inf), (0, 2e6), (1 << 62, 0.0)])
def test_an_entry_that_no_clock_can_have_tells_nothing(offset_ns, skew_ppm):
    """As a damaged recording may hold it: the times stay as they are, the entry before it holds."""
    clocks = HostClocks(history=True)
    clocks.take(array("lab_b", offset_ns, skew_ppm, T0_NS), 0.0)
    assert clocks.reference_ns("lab_b", T0_NS) == T0_NS
    clocks.take(array("lab_b", 5, 0.0, T0_NS), 0.0)
    clocks.take(array("lab_b", offset_ns, skew_ppm, T0_NS + SECOND_NS), 0.0)
    assert clocks.reference_ns("lab_b", T0_NS + 2 * SECOND_NS) == T0_NS + 2 * SECOND_NS + 5


def test_a_clock_that_was_set_back_has_the_newer_word():
    """What it shows twice belongs to the entry that came later."""
    clocks = HostClocks(history=True)
    for at_s, offset_s in ((0, 0), (1, 0), (2, 0), (-7, 10), (-6, 10)):
        clocks.take(array("lab_b", offset_s * SECOND_NS, 0.0, T0_NS + at_s * SECOND_NS), 0.0)
    assert clocks.reference_ns("lab_b", T0_NS - 6 * SECOND_NS) == T0_NS + 4 * SECOND_NS


@pytest.mark.parametrize("history", [False, True], ids=["live", "of a recording"])
def test_a_flood_of_hosts_keeps_none_out_and_pushes_none_out(history):
    """A host that is told each second stays, one that comes later is known a while after the flood, with its offset."""
    clocks = HostClocks(history)
    for second in range(60):
        clocks.take(array("lab_b", 5, 0.0, T0_NS + second * SECOND_NS), float(second))
        for number in range(MOST_HOSTS) if second < 30 else ():
            clocks.take(array(f"x_{second}_{number}", 7, 0.0, T0_NS), second + number / MOST_HOSTS)
        if second >= 20:
            clocks.take(array("lab_c", 9, 0.0, T0_NS + second * SECOND_NS), float(second))
        assert clocks.reference_ns("lab_b", T0_NS) == T0_NS + 5
        assert len(clocks._entries) <= MOST_HOSTS
    assert clocks.reference_ns("lab_c", T0_NS + 59 * SECOND_NS) == T0_NS + 59 * SECOND_NS + 9


def test_what_a_recording_has_of_a_host_that_left_stays():
    """Whatever names a flood uses afterwards."""
    clocks = HostClocks(history=True)
    for second in range(100):
        clocks.take(array("lab_b", 5, 0.0, T0_NS + second * SECOND_NS), float(second))
    for number in range(5 * MOST_HOSTS):
        clocks.take(array(f"x_{number}", 7, 0.0, T0_NS), 200.0 + number // MOST_HOSTS * 2 * FRESH_S)
    assert clocks.reference_ns("lab_b", T0_NS) == T0_NS + 5


@pytest.mark.parametrize(
    ("name", "known"), [("Lab-A.local", "lab_a_local"), ("lab_b", "lab_b"), ("__", "host"), ("a--b", "a_b")]
)
def test_names_of_hosts_may_stand_in_a_nodes_name(name, known):
    """Small letters, digits and single `_`."""
    assert sanitised(name) == known


def test_a_study_file_names_the_host(monkeypatch):
    """SENSE4HRI_HOST before the machine's own name, which in a container is but an id."""
    monkeypatch.setenv("SENSE4HRI_HOST", "lab-b")
    assert this_host() == "lab-b"
    monkeypatch.delenv("SENSE4HRI_HOST")
    assert this_host()


def test_a_stamp_is_of_the_host_on_which_the_sensors_driver_runs():
    """Also that of a derived stream; of a sensor nobody has told of it stays, also where a host is called `host`."""
    sensors = SensorHosts(HostClocks())
    sensors.clocks.take(array("lab_b", 5, 0.0, T0_NS), 0.0)
    sensors.clocks.take(array("host", 7, 0.0, T0_NS), 0.0)
    sensors.told("h10_1", "Lab-B")
    sensors.told("h10_2", "")
    assert [sensors.reference_ns(name, T0_NS) - T0_NS for name in ("h10_1", "h10_1_ecg", "h10_2", "x")] == [5, 5, 0, 0]
    sensors.registered("h10_1", "lab_c")
    assert sensors.host("h10_1") == "lab_b"
    sensors.registered("h10_2", "lab_c")
    assert sensors.host("h10_2") == "lab_c"
    sensors.told("h10_1", "lab_a")
    assert sensors.reference_ns("h10_1", T0_NS) == T0_NS


def test_a_flood_of_sensors_pushes_out_the_silent_ones():
    """What is heard of again and again stays known; memory is bounded."""
    sensors = SensorHosts(HostClocks())
    for number in range(3 * MOST_SENSORS):
        if number % (MOST_SENSORS - 1) == 0:
            sensors.told("h10_1", "lab_b")
        sensors.told(f"made_up_{number}", "nowhere")
        assert sensors.host("h10_1") == "lab_b"
    assert len(sensors) == MOST_SENSORS


@pytest.mark.parametrize("history", [False, True], ids=["live", "of a recording"])
@pytest.mark.parametrize("weeks", [-3, 3])
def test_a_line_says_nothing_of_weeks_before_and_after(history, weeks):
    """A replay of old stamps beside a live clock-sync: 20 ppm of three weeks were 36 s; they stay, and it is said."""
    clocks, far_ns = HostClocks(history), T0_NS + weeks * 7 * 86_400 * SECOND_NS
    clocks.take(array("lab_b", 3_000_000, 20.0, T0_NS), 0.0)
    assert clocks.reference_ns("Lab-B", far_ns) == far_ns
    assert clocks.reference_ns("lab_b", np.array([far_ns, T0_NS])).tolist() == [far_ns, T0_NS + 3_000_000]
    assert "lab_b were taken more than a day from" in clocks.doubt("lab_b", [T0_NS, far_ns])
    assert clocks.doubt("lab_b", [T0_NS]) == clocks.doubt("lab_a", [far_ns]) == clocks.doubt("lab_b") == ""


@pytest.mark.parametrize("hours", [-23, 23])
def test_a_host_that_is_silent_for_hours_goes_on_as_it_did(hours):
    """Within the longest session a jump back to what its clock shows would be worse than 1 ppm that nobody measured."""
    clocks, far_ns = HostClocks(), T0_NS + hours * 3600 * SECOND_NS
    clocks.take(array("lab_b", 1_500_000_000, 20.0, T0_NS), 0.0)
    assert clocks.reference_ns("lab_b", far_ns) == far_ns + 1_500_000_000 + round(20e-6 * (far_ns - T0_NS))
    assert clocks.doubt("lab_b", [far_ns]) == ""

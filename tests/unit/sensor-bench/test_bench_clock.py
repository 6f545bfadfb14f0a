"""The drifting device clock."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_bench.clock import POLAR_EPOCH_UNIX_NS, UNSET_CLOCK_NS, DeviceClock, HostClock
from sensor_bench.polar.peripheral import polar_ns
from sensor_bench.room import seed_of

START_NS = 1_800_000_000_000_000_000


def test_an_hour_at_sixty_ppm_gains_216_milliseconds():
    """Skew is the gain of the device on the host."""
    clock = DeviceClock(START_NS, skew_ppm=60.0)
    hour_ns = 3_600_000_000_000
    assert clock.read_ns(START_NS + hour_ns) - UNSET_CLOCK_NS - hour_ns == 216_000_000


@given(st.floats(-1000, 1000), st.floats(-1000, 1000), st.integers(0, 10**15))
def test_a_change_of_skew_makes_no_jump(before_ppm, after_ppm, at_ns):
    """The reading just before and at the change is the same, and the new rate holds from then on."""
    clock = DeviceClock(START_NS, skew_ppm=before_ppm)
    before = clock.read_ns(START_NS + at_ns)
    clock.set_skew(START_NS + at_ns, after_ppm)
    assert clock.read_ns(START_NS + at_ns) == before
    second_ns = 1_000_000_000
    assert clock.read_ns(START_NS + at_ns + second_ns) - before == second_ns + round(after_ppm * 1000)


def test_a_reset_jumps_and_the_past_keeps_its_own_time():
    """After a reset the clock counts from 2019 again; what was sampled before still has the old stamps."""
    clock = DeviceClock(START_NS, polar_ns("2026-01-01T00:00:00"), 10.0)
    old = clock.read_ns(START_NS + 5)
    clock.reset(START_NS + 10_000_000_000)
    assert clock.read_ns(START_NS + 10_000_000_000) == UNSET_CLOCK_NS
    assert clock.read_ns(START_NS + 5) == old
    assert clock.resets == 1


def test_epochs():
    """2019-01-01 is where an unset H10 starts; the Polar epoch is 2000-01-01."""
    assert polar_ns("2019-01-01T00:00:00") == UNSET_CLOCK_NS
    assert polar_ns("2000-01-01") == 0
    assert POLAR_EPOCH_UNIX_NS == 946_684_800 * 10**9


def test_host_clock_is_the_wall_clock_at_its_start():
    """The host clock agrees with the wall clock as long as nobody steps that one."""
    clock = HostClock()
    assert abs(clock.now_ns() - time.time_ns()) < 50_000_000
    assert clock.wall_offset_ns() == pytest.approx(0, abs=50_000_000)


def test_seeds_depend_on_their_parts_alone():
    """The same parts give the same seed in every process, other parts another one."""
    assert seed_of(1, "p1") == 1053710674
    assert seed_of(1, "p1") != seed_of(1, "p2")

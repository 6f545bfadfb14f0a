"""The offline clock fit on simulated links with known truth."""

import numpy as np
import pytest
from clock_sync import links
from clock_sync.estimator import ClockEstimator
from sense4hri.host_account import HostAccount
from sense4hri_session.clock_curve import Measurement
from sense4hri_session.clock_fit import Packets, fit_clock

SECOND = 1_000_000_000
PUBLISH_NS = 500_000_000


def offline(link: links.Link) -> np.ndarray:
    """Error in ms at every packet."""
    fit = fit_clock({"ecg": Packets(link.device_ns, link.received_ns)})
    assert len(fit.segments) == 1
    return link.error_ms(fit.segments[0].ros_ns(link.device_ns))


def online(link: links.Link) -> np.ndarray:
    """Error in ms of the newest published model at every packet."""
    estimator, published = ClockEstimator(), 0
    ros = np.empty(len(link.true_s), np.int64)
    for i, (device, received) in enumerate(zip(link.device_ns.tolist(), link.received_ns.tolist(), strict=True)):
        if estimator.packet("ecg", device, received) or received - published >= PUBLISH_NS:
            model, published = estimator.model(), received
        ros[i] = model.ros_ns(device)
    return link.error_ms(ros)


def alignment_p95_ms(one: links.Link, a: np.ndarray, other: links.Link, b: np.ndarray) -> float:
    """95th percentile of the difference of two devices' errors, over true time."""
    return float(np.percentile(np.abs(a - np.interp(one.true_s, other.true_s, b)), 95))


@pytest.mark.parametrize("profile", ["strap", "bad", "congestion", "serial", "eeg"])
def test_two_devices_lie_within_a_millisecond_and_no_worse_than_live(profile):
    """Relative alignment of two devices is at most 1 ms (p95) and not above that of the live models."""
    one, other = links.simulate(profile, 71, 600.0), links.simulate(profile, 72, 600.0)
    after = alignment_p95_ms(one, offline(one), other, offline(other))
    live = alignment_p95_ms(one, online(one), other, online(other))
    assert after <= 1.0
    assert after <= live + 0.01


def test_both_directions_reach_the_first_minute():
    """In the first 30 s, where a live model has seen little, the offline fit is as good as later."""
    link = links.simulate("strap", 73, 600.0)
    error = np.abs(offline(link))
    assert error[link.true_s < 30].max() < error.max() + 0.1 < 1.1


@pytest.mark.parametrize(("back_ms", "epochs"), [(0, 1), (150, 2), (5000, 2)])
def test_a_message_after_a_newer_one_begins_no_epoch_and_a_clock_set_back_does(back_ms, epochs):
    """Also where the clock goes back by less than two messages, so that the next one but one is ahead again."""
    taken_ns = np.arange(1, 301) * SECOND // 10
    device_ns = taken_ns - np.where(taken_ns > 20 * SECOND, back_ms * 1_000_000, 0) + 100 * SECOND
    received_ns = taken_ns + np.random.default_rng(1).exponential(3e6, len(taken_ns)).astype(np.int64)
    received_ns[[50, 120]] += 150_000_000
    order = np.argsort(received_ns)
    fit = fit_clock({"ecg": Packets(device_ns[order], received_ns[order])})
    assert len(fit.segments) == epochs
    segment = fit.segment_of["ecg"].tolist()
    found_ns = [fit.segments[s].ros_ns(np.array([d]))[0] for d, s in zip(device_ns[order], segment, strict=True)]
    assert np.abs(found_ns - taken_ns[order]).max() < 5_000_000


@pytest.mark.parametrize("late", [[298], [297, 298], [298, 297], [280], [100, 101], [101, 100], []])
@pytest.mark.parametrize("link_ms", [3, 1200])
def test_messages_that_come_last_or_together_after_newer_ones_begin_no_epoch(late, link_ms):
    """At the end, where nothing tells what comes next, and several in a row: each lies where it was taken."""
    taken_ns = np.arange(1, 301) * SECOND // 10
    device_ns = taken_ns + 100 * SECOND
    received_ns = taken_ns + np.random.default_rng(1).exponential(3e6, len(taken_ns)).astype(np.int64)
    last = 105 if 100 in late else 299
    received_ns[late] = received_ns[last] + link_ms * 1_000_000 + np.arange(len(late)) * 1_000_000
    order = np.argsort(received_ns, kind="stable")
    fit = fit_clock({"ecg": Packets(device_ns[order], received_ns[order])})
    assert len(fit.segments) == 1
    assert np.abs(fit.segments[0].ros_ns(device_ns) - taken_ns).max() < 5_000_000


@pytest.mark.parametrize("left", [1, 2, 9, 40])
@pytest.mark.parametrize("back_ms", [150, 5000, 1_000_000])
def test_a_clock_set_back_at_the_end_begins_an_epoch(left, back_ms):
    """Where its stamps fill no hole, however few packets are left; where many are left, also into a hole."""
    taken_ns = np.delete(np.arange(1, 301), range(205, 215) if left == 40 else ()) * SECOND // 10
    set_back = np.arange(len(taken_ns))[::-1] < left
    device_ns = taken_ns + 2000 * SECOND - set_back * back_ms * 1_000_000
    received_ns = taken_ns + np.random.default_rng(1).exponential(3e6, len(taken_ns)).astype(np.int64)
    segment = fit_clock({"ecg": Packets(device_ns, received_ns)}).segment_of["ecg"]
    np.testing.assert_array_equal(segment, set_back)


def test_a_known_delay_is_subtracted():
    """transport_delay_s moves every time by exactly that much."""
    link = links.simulate("serial", 74, 120.0)
    packets = {"ecg": Packets(link.device_ns, link.received_ns)}
    plain, moved = fit_clock(packets), fit_clock(packets, transport_delay_s=0.020)
    difference = plain.segments[0].ros_ns(link.device_ns) - moved.segments[0].ros_ns(link.device_ns)
    assert np.abs(difference - 20_000_000).max() <= 1


def test_a_reboot_begins_a_segment_for_every_stream():
    """Device time that goes back in one stream opens a segment for the device; its late packets stay in the old one."""
    link = links.simulate("strap", 75, 600.0)
    half = len(link.true_s) // 2
    device = link.device_ns.copy()
    device[half:] -= 1000 * SECOND
    streams = {"ecg": Packets(device[::2], link.received_ns[::2]), "acc": Packets(device[1::2], link.received_ns[1::2])}
    fit = fit_clock(streams)
    assert len(fit.segments) == 2
    ros = np.empty_like(device)
    for name, start in (("ecg", 0), ("acc", 1)):
        own, segment = device[start::2], fit.segment_of[name]
        ros[start::2] = [fit.segments[s].ros_ns(np.array([d]))[0] for d, s in zip(own.tolist(), segment, strict=True)]
    assert np.percentile(np.abs(link.error_ms(ros)), 95) < 1.5


def test_a_sensor_handed_over_and_restarted_begins_a_segment():
    """A sensor that p1 wore and p2 wears next, its clock begun anew meanwhile, has two epochs in each stream."""
    link = links.simulate("strap", 79, 600.0)
    worn, again = link.true_s < 240.0, link.true_s > 360.0
    device = np.where(again, link.device_ns - 1000 * SECOND, link.device_ns)
    whose = {"p1": worn, "unassigned": ~worn & ~again, "p2": again}
    streams = {
        f"{human}/{kind}/h10_1": Packets(device[own][start::2], link.received_ns[own][start::2])
        for human, own in whose.items()
        for start, kind in enumerate(("accelerometer", "ecg"))
        if human != "unassigned" or kind == "ecg"
    }
    fit = fit_clock(streams)
    assert len(fit.segments) == 2
    for key, packets in streams.items():
        own = fit.segment_of[key]
        ros = np.select([own == 0, own == 1], [segment.ros_ns(packets.device_ns) for segment in fit.segments])
        assert np.abs(ros - packets.received_ns).max() < SECOND


def test_two_devices_of_one_name_are_no_sensor_that_changes_hands():
    """Against the contract, each on a person of its own: their packets by turns begin no epochs without end."""
    one, other = links.simulate("strap", 81, 60.0), links.simulate("strap", 82, 60.0)
    streams = {"p1/ecg/h10_1": one, "p2/ecg/h10_1": other}
    device = {"p1/ecg/h10_1": one.device_ns, "p2/ecg/h10_1": other.device_ns - 1000 * SECOND}
    fit = fit_clock({key: Packets(device[key], link.received_ns) for key, link in streams.items()})
    assert len(fit.segments) == 1


@pytest.mark.parametrize("ahead_s", [0.1, 0.7, 0.95, 3.0, 1e6, -3.0, -1e6])
def test_one_wrong_stamp_moves_no_other_packet(ahead_s):
    """A single wrong stamp among thousands is placed by its receipt, and every other packet as without it."""
    link = links.simulate("strap", 75, 600.0)
    i = len(link.device_ns) // 2
    device_ns = link.device_ns.copy()
    device_ns[i] += round(ahead_s * SECOND)
    fit = fit_clock({"ecg": Packets(device_ns, link.received_ns)})
    numbers = fit.segment_of["ecg"]
    assert np.flatnonzero(numbers).tolist() == [i]
    whole = fit_clock({"ecg": Packets(link.device_ns, link.received_ns)})
    others = np.arange(len(device_ns)) != i
    difference = (fit.segments[0].ros_ns(device_ns) - whole.segments[0].ros_ns(device_ns))[others]
    assert np.abs(difference).max() < 100_000
    assert fit.segments[1].ros_ns(device_ns[i : i + 1])[0] == link.received_ns[i]


def test_a_stall_is_no_segment():
    """A link that stalls for 20 s and drains is one clock, and the fit is not moved by it."""
    link = links.simulate("strap", 76, 600.0, queue=((300.0, 300.1, 320.0), (0.0, 20.0, 0.0)))
    assert np.abs(offline(link)).max() < 1.5


@pytest.mark.parametrize("step_s", [-3600.0, -0.3, 0.05, 3600.0])
def test_a_step_of_the_hosts_clock_begins_a_segment(step_s):
    """What the host says of its clock cuts between packets stamped before and after the step, also a small one."""
    link = links.simulate("serial", 77, 300.0)
    step_ns = round(step_s * SECOND)
    at = link.true_s >= 150.0
    received = link.received_ns + at * step_ns
    accounts = []
    for second in range(300):
        stepped = second >= 150
        stamp = links.EPOCH_NS + second * SECOND + SECOND // 2 + stepped * step_ns
        accounts.append(HostAccount(stamp, 10**18 + stepped * step_ns))
    fit = fit_clock({"ecg": Packets(link.device_ns, received)}, host_clock=accounts)
    assert len(fit.segments) == 2
    ros = [
        fit.segments[s].ros_ns(np.array([d]))[0]
        for d, s in zip(link.device_ns.tolist(), fit.segment_of["ecg"], strict=True)
    ]
    error = link.error_ms(np.array(ros) - at * step_ns)
    assert np.percentile(np.abs(error), 95) < 0.2


def test_a_host_that_was_started_anew_begins_no_segment():
    """A device that runs on while its host starts again has one clock; the host's monotonic clock is a new one."""
    link = links.simulate("serial", 80, 300.0)
    there = (link.true_s < 120.0) | (link.true_s > 180.0)
    seconds = [second for second in range(300) if not 120 <= second <= 180]
    begun_ns = [links.EPOCH_NS + (-9000 if second < 150 else 170) * SECOND for second in seconds]
    stamps_ns = [links.EPOCH_NS + second * SECOND + SECOND // 2 for second in seconds]
    accounts = [HostAccount(*account) for account in zip(stamps_ns, begun_ns, strict=True)]
    fit = fit_clock({"ecg": Packets(link.device_ns[there], link.received_ns[there])}, host_clock=accounts)
    assert len(fit.segments) == 1


def test_two_way_measurements_win():
    """Where the driver measured the offset in both directions, even the constant part of the delay is gone."""
    link = links.simulate("wifi", 78, 300.0)
    random = np.random.default_rng(1)
    measured = [
        Measurement(int(d), int(links.EPOCH_NS + t * SECOND - d + random.normal(0, 2e-4) * SECOND), 4e-4)
        for t, d in zip(link.true_s[::50].tolist(), link.device_ns[::50].tolist(), strict=True)
    ]
    fit = fit_clock({"eeg": Packets(link.device_ns, link.received_ns)}, measurements=measured)
    error_ms = (fit.segments[0].ros_ns(link.device_ns) - links.EPOCH_NS) * 1e-6 - link.true_s * 1e3
    assert fit.segments[0].measured
    assert np.abs(error_ms).max() < 0.3


def test_few_packets_are_enough():
    """One packet and two packets give a clock, none is a ValueError."""
    for n in (1, 2, 3):
        stamps = np.arange(n, dtype=np.int64) * SECOND
        fit = fit_clock({"ecg": Packets(stamps + 5 * SECOND, stamps + 1000 * SECOND)})
        assert np.abs(fit.segments[0].ros_ns(stamps + 5 * SECOND) - stamps - 1000 * SECOND).max() < 2_000_000
    with pytest.raises(ValueError, match="no packet"):
        fit_clock({"ecg": Packets(np.array([], np.int64), np.array([], np.int64))})


def test_the_cost_of_a_fit_follows_the_packets_and_not_the_years_between_them():
    """300 packets of one epoch that span sixty years have no more knots than twice as many."""
    device = np.arange(300, dtype=np.int64) * SECOND // 10
    device[200:] += 60 * 365 * 86_400 * SECOND
    fit = fit_clock({"ecg": Packets(device, device + 1_700_000_000 * SECOND)})
    assert len(fit.segments) == 1
    assert len(fit.segments[0].knots_s) <= 601

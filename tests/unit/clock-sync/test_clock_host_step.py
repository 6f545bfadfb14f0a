"""Steps of the host's clock, true and false: what the packets show has the last word, within a stated time."""

from collections.abc import Callable

import numpy as np
import pytest
from clock_sync import links
from clock_sync.estimator import ClockEstimator
from clock_sync.host_steps import MOST_HIGH
from clock_sync.model import State

SECOND = 1_000_000_000
AT_S = 150.0
QUICK_S, SMALL_S = 22.0, 63.0  # as the README states, and a packet or two
STEPS_S = (0.02, -0.02, 0.3, -0.3, 3600.0, -3600.0)
Clock = Callable[[float], float]


def steady(_: float) -> float:
    return 0.0


def stepped(by_s: float, begin_s: float = AT_S, end_s: float = 1e9) -> Clock:
    return lambda now_s: by_s if begin_s <= now_s < end_s else 0.0


def follow(link: links.Link, true: Clock, told: Clock, silent_s: float = 1e9):
    """Error and uncertainty in ms after every packet, of a host that is at true(t) s and says told(t) each second."""
    estimator, second, found = ClockEstimator(), 0, []
    for i, now_s in enumerate(link.received_s.tolist()):
        while second < min(now_s, silent_s):
            account_ns = 5 * SECOND + round(told(second) * SECOND)
            if estimator.host_clock(account_ns):
                estimator.host_step(account_ns)
            second += 1
        host_ns, device_ns = round(true(now_s) * SECOND), int(link.device_ns[i])
        estimator.packet("ecg", device_ns, int(link.received_ns[i]) + host_ns)
        model = estimator.model()
        found.append((model.ros_ns(device_ns) - host_ns, model.uncertainty_s * 1e3))
    ros_ns, uncertainty_ms = zip(*found, strict=True)
    return np.abs(link.error_ms(np.array(ros_ns))), np.array(uncertainty_ms), estimator


def calm(link: links.Link) -> tuple[links.Link, float]:
    return link, AT_S


def in_a_stall(link: links.Link) -> tuple[links.Link, float]:
    received_s = link.received_s.copy()
    received_s[(received_s > AT_S - 4) & (received_s < AT_S + 6)] = AT_S + 6
    received_ns = links.EPOCH_NS + np.rint(received_s * 1e9).astype(np.int64)
    return link._replace(received_s=received_s, received_ns=received_ns), AT_S + 6


def in_a_reconnect(link: links.Link) -> tuple[links.Link, float]:
    there = (link.true_s < AT_S - 3) | (link.true_s > AT_S + 30)
    return links.Link(*(column[there] for column in link)), AT_S + 30


def in_a_queue(_: links.Link) -> tuple[links.Link, float]:
    queue = ((AT_S - 10, AT_S - 5, AT_S + 5, AT_S + 25), (0.0, 2.0, 2.0, 0.0))
    return links.simulate("strap", 1, 260.0, queue=queue), AT_S + 25


@pytest.mark.parametrize("circumstance", [calm, in_a_stall, in_a_reconnect, in_a_queue])
@pytest.mark.parametrize("step_s", STEPS_S)
@pytest.mark.parametrize("lasts_s", [1, 5, 1e9], ids=["once", "burst", "for ever"])
def test_a_false_step_is_undone_by_the_packets(circumstance, step_s, lasts_s):
    """However long a host tells of a step that was none, the line is back where it was, and in the meantime unsure."""
    link, over_s = circumstance(links.simulate("strap", 1, 260.0))
    error_ms, uncertainty_ms, estimator = follow(link, steady, stepped(step_s, AT_S, AT_S + lasts_s))
    wait_s = QUICK_S if abs(step_s) >= 0.3 else SMALL_S
    after = link.received_s > over_s + wait_s
    assert error_ms[after].max() < 3.0
    assert uncertainty_ms[after].max() < 10.0
    told = link.received_s > AT_S
    assert np.mean(error_ms[told] <= uncertainty_ms[told]) >= 0.95
    assert estimator.segment == (1 if lasts_s == 1 and abs(step_s) < 0.05 else 3)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_false_step_that_nobody_takes_back_is_undone(step_s):
    """The host tells of a step and then no more: the packets alone decide."""
    link = links.simulate("strap", 2, 260.0)
    error_ms, _, _ = follow(link, steady, stepped(step_s), silent_s=AT_S + 2.5)
    assert error_ms[link.received_s > AT_S + SMALL_S].max() < 3.0


def test_a_step_beside_a_clock_that_stands_costs_no_more_than_any():
    """A stranger whose device time goes on by a nanosecond a packet shows nothing for ever: so many are looked at."""
    link = links.simulate("strap", 2, 60.0)
    *_, estimator = follow(link, steady, stepped(-1.0, 59.0))
    device_ns, received_ns = int(link.device_ns[-1]), int(link.received_ns[-1])
    for number in range(MOST_HIGH + 10):
        estimator.packet("ecg", device_ns + number, received_ns + number)
    assert len(estimator._step._high) == MOST_HIGH


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_false_step_right_at_the_start_is_undone(step_s):
    """Three seconds after the first packet nothing is known of the link: a minute later nothing of it is left."""
    link = links.simulate("strap", 3, 150.0)
    error_ms, uncertainty_ms, _ = follow(link, steady, stepped(step_s, 3.0))
    after = link.received_s > 3.0 + SMALL_S
    assert error_ms[after].max() < 5.0
    assert np.all(error_ms[after] <= uncertainty_ms[after])


@pytest.mark.parametrize("circumstance", [calm, in_a_stall, in_a_reconnect, in_a_queue])
@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_true_step_is_followed(circumstance, step_s):
    """Told by the next account, the step is in the model within two accounts, and stays."""
    link, _ = circumstance(links.simulate("strap", 1, 260.0))
    true = stepped(step_s, AT_S + 0.4)
    error_ms, _, estimator = follow(link, true, true)
    assert error_ms[link.received_s > AT_S + 3].max() < 3.0
    assert estimator.segment == 2


@pytest.mark.parametrize("profile", ["bad", "serial", "slow"])
@pytest.mark.parametrize("step_s", [0.06, -0.06])
def test_false_and_true_steps_on_other_links(profile, step_s):
    """Also where delays are larger than the step, or hardly any, a false one is undone and a true one kept."""
    link = links.simulate(profile, 4, 290.0)
    for true in (steady, stepped(step_s)):
        error_ms, uncertainty_ms, _ = follow(link, true, stepped(step_s))
        after = link.received_s > AT_S + 70
        assert np.percentile(error_ms[after], 95) < 4.0
        assert np.mean(error_ms[after] <= uncertainty_ms[after]) >= 0.95


@pytest.mark.parametrize("seed", [10, 21, 24])
def test_a_small_step_back_is_followed_from_where_the_line_was(seed):
    """What comes between the two accounts that a small step needs does not bend the line."""
    link, true = links.simulate("strap", seed, 250.0), stepped(-0.02, AT_S + 0.4)
    error_ms, _, estimator = follow(link, true, true)
    assert error_ms[link.received_s > AT_S + 3].max() < 3.0
    assert estimator.segment == 2


def test_a_host_that_slept_is_stepped_truly_afterwards():
    """Two accounts that mean the same after a false step are neither taken for a step again; a third one is."""
    link = links.simulate("strap", 5, 360.0)

    def told(now_s: float) -> float:
        return 0.0 if now_s < 60 else 600.0 if now_s < 150 else 0.0 if now_s < 200 else 5.0

    error_ms, _, estimator = follow(link, stepped(5.0, 199.5), told)
    assert estimator.segment == 4
    assert error_ms[(link.received_s > 90) & (link.received_s < 199)].max() < 5.0
    assert error_ms[link.received_s > 203].max() < 3.0


def test_a_reset_of_the_device_in_a_disputed_step_is_a_reset():
    """A device that starts anew while the packets dispute a step gets a clock of its own at once."""
    link = links.simulate("strap", 6, 200.0)
    cut = int(np.searchsorted(link.received_s, AT_S + 8))
    device_ns = link.device_ns.copy()
    device_ns[cut:] -= 1000 * SECOND
    reset = link._replace(device_ns=device_ns)
    error_ms, _, estimator = follow(reset, steady, stepped(60.0))
    assert error_ms[cut:].max() < 100.0
    assert estimator.strays <= 20


def started_anew(link: links.Link, off_s: float, account_s: float):
    """Error and uncertainty in ms, and segment, after every packet, of a host that was away from AT_S to 30 s later."""
    there = (link.true_s < AT_S) | (link.true_s > AT_S + 30)
    link = links.Link(*(column[there] for column in link))
    estimator, second, found = ClockEstimator(), 0, []
    stamped = (column.tolist() for column in (link.device_ns, link.received_ns, link.received_s))
    for device_ns, received_ns, now_s in zip(*stamped, strict=True):
        anew = now_s > AT_S + 30
        account_ns, off_ns = (round(of_s * SECOND) if anew else 0 for of_s in (account_s, off_s))
        while second < now_s:
            begins = anew and second <= AT_S + 30
            if begins:
                estimator.host_started(account_ns)
            if estimator.host_clock(account_ns):
                estimator.host_step(account_ns)
            second = int(now_s) + 1 if begins else second + 1
        estimator.packet("ecg", device_ns, received_ns + off_ns)
        model = estimator.model()
        found.append((model.ros_ns(device_ns) - off_ns, model.uncertainty_s * 1e3, model.segment, model.state))
    ros_ns, uncertainty_ms, segments, states = zip(*found, strict=True)
    since = link.true_s > AT_S
    return np.abs(link.error_ms(np.array(ros_ns)))[since], np.array(uncertainty_ms)[since], segments[-1], states


@pytest.mark.parametrize("off_s", [0.0, 0.2, -45.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_host_that_was_started_anew_has_a_clock_of_its_own(off_s, seed):
    """Three days of running that are gone are no step of its wall clock, and that may be anything afterwards."""
    error_ms, uncertainty_ms, segment, states = started_anew(links.simulate("strap", seed, 300.0), off_s, 3 * 86400.0)
    assert error_ms.max() < 250.0
    assert np.mean(error_ms <= uncertainty_ms) >= 0.95
    assert error_ms[-60:].max() < 5.0
    assert segment == 2
    assert State.HOLDOVER not in states


def test_a_clock_that_was_set_is_no_new_start():
    """Where the packets have moved as far as the account it is a step, whatever the stamps of the host's health say."""
    error_ms, _, segment, _ = started_anew(links.simulate("strap", 1, 300.0), 3600.0, 3600.0)
    assert error_ms.max() < 5.0
    assert segment == 2

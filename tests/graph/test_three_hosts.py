"""Three hosts on a bad network: nothing is lost without being told, and their clocks are known.

They find each other by static peers (docs/decisions/static-peers.md): there is no discovery server to kill.
"""

import statistics
import time
from pathlib import Path

import pytest
from hosts_study import HostsStudy, surroundings
from processes import Process
from slow_network import SlowNetwork, why_not

LOSS, DELAY_S = 0.05, 0.1
RECOVERY_S = 5.0
NEAR_S = 5e-3  # the network is a thread of this process, which others keep waiting; the number is bench_hosts.py's
WHY_NOT = why_not()
CROWD = Path(__file__).parents[1] / "crowd.py"

pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)


@pytest.mark.parametrize("cuts_s", [(1, 10), pytest.param((60,), marks=pytest.mark.slow)])
def test_what_arrives_and_what_is_told_lost_is_all_through_partitions_and_steps(cuts_s, ros_domain, tmp_path):
    """5 % loss, 100 ms, drivers' clock 250 ms off with 50 ppm, cut for 1 and 10 or 60 s, then stepped by 2 s."""
    study = HostsStudy(tmp_path, ros_domain)
    healed_s = []
    try:
        study.network.loss, study.network.delay_s = LOSS, DELAY_S
        study.begin()
        time.sleep(15)
        for cut_s in cuts_s:
            study.network.cut("drive")
            time.sleep(cut_s)
            study.network.heal("drive")
            healed_s.append(time.time())
            time.sleep(RECOVERY_S + 1)
        study.step(2.0)
        time.sleep(8)
    finally:
        study.end()
    for sensor, account in study.accounts().items():
        assert account.arrived + account.told_lost == account.span, (sensor, account[:3])
        assert account.span > 3000, sensor
        assert account.last_s <= account.received_s[-1], f"{sensor} taken after it came: by a clock 2.25 s ahead"
        for moment_s in healed_s:
            came_s = min(at_s for at_s in account.received_s if at_s > moment_s)
            assert came_s - moment_s <= RECOVERY_S, f"{sensor} came {came_s - moment_s:.1f} s after healing"
    for host in ("drive", "other"):
        errors = study.host_errors(host)
        assert len(errors) > 10
        assert all(abs(error_s) <= uncertainty_s for error_s, uncertainty_s in errors), (host, errors)
        assert statistics.median(abs(error_s) for error_s, _ in errors) < NEAR_S, (host, errors)


@pytest.mark.parametrize("added", [False, True], ids=["from the start", "one was added"])
def test_each_hears_each_however_many_there_are(added, ros_domain, tmp_path):
    """Six processes on each of two hosts: without multicast, those beyond the fourth of both find each other too.

    Also where only those of a host that came later know the other's address: nobody has to be started anew for it.
    """
    network = SlowNetwork("drive", "keep")
    crowds: list[Process] = []
    try:
        for host, other in (("drive", "keep"), ("keep", "drive")):
            env, before = surroundings(network, host, ros_domain), network.inside(host)
            if added and host == "drive":
                env["ROS_STATIC_PEERS"] = ""
            crowds.append(Process(tmp_path / f"{host}.log", CROWD, host, other, env=env, before=before))
        for crowd in crowds:
            crowd.until("all heard")
    finally:
        for crowd in crowds:
            crowd.end()
        network.close()

"""The law of replay: at any speed, and live, the same numbers. Runs alone (see tests/run.py)."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from processes import claimed_domain

sys.path.insert(0, str(Path(__file__).parent))
from replay_law import between, chosen, computed, differences, opened_inside, recompute, stamp_ns
from replay_live import Study, study

SECOND_NS = 1_000_000_000
LATE_S = 1.0
"""A state of fusion waits about so long for features (fusion_affect.align)."""


def unhurried_study(work: Path) -> Study:
    """A session in which every service kept up, or the third: an overloaded machine cannot be asked for one."""
    for attempt in range(3):
        session = study(work / str(attempt), 11.0)
        if not hurried(session):
            break
    return session


def hurried(session: Study) -> str:
    """What kept a session from being what a machine with time would have made of it; empty where nothing did."""
    if late := session.heard_late():
        return "; ".join(late)
    return f"features came {session.lateness_s():.1f} s late" if session.lateness_s() >= LATE_S else ""


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_law(ros_domain, tmp_path):
    """Recomputed at 1x and 20x everything is equal; from start_at, and the first clock segment inside, also to live."""
    session = unhurried_study(tmp_path / "live")
    with claimed_domain() as other_domain, ThreadPoolExecutor(2) as pool:
        plays = [
            pool.submit(recompute, session.folder, rate, tmp_path / f"at_{rate:g}", domain)
            for rate, domain in ((1.0, ros_domain), (20.0, other_domain))
        ]
        once, fast = (play.result() for play in plays)
    assert {topic.rsplit("/", 1)[1] for topic in once} == {"features", "clock", "state"}
    assert differences(once, fast) == []
    if why := hurried(session):
        pytest.skip(f"1x is 20x; this machine is too busy to compare it to live: {why}")
    said, live = ("/features", "/state"), computed(session.folder)
    begun = between(live, session.start_ns, session.stop_ns)
    until_ns = min(stamp_ns(messages[-1]) for messages in chosen(begun, *said).values())
    assert until_ns > session.stop_ns - 4 * SECOND_NS
    of_session = (chosen(between(them, session.start_ns, until_ns + 1), *said) for them in (live, once))
    assert differences(*of_session) == []
    (states,) = chosen(begun, "/state").values()
    assert len({(state.state, state.expression) for state in states}) >= 3
    assert opened_inside(live)
    assert all(len(models) >= 5 for models in opened_inside(live).values())
    assert differences(opened_inside(live), opened_inside(once)) == []

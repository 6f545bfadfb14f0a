"""What a stranger does to a study with 10 000 messages, answers and requests that nobody can use."""

import os
import sys
import tempfile
import time
from contextlib import ExitStack, closing
from pathlib import Path
from unittest import mock

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

THINGS = 10_000
MOST_GROWN = 0.1
"""Of what a service had after the first quarter of it all."""
TARGET = "nobody ends, 0 lost, all counted, named, memory flat"


def rows() -> list[dict]:
    """Everything measured here, for `make bench`."""
    from fuzzed_study import fuzz
    from processes import Processes, claimed_domain
    from sense4hri.memory import TRIM_EVERY_S

    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        domain = stack.enter_context(claimed_domain())
        stack.enter_context(mock.patch.dict(os.environ, {"ROS_DOMAIN_ID": str(domain)}))
        processes = Processes(Path(folder), Path(folder))
        stack.callback(processes.close)
        outcome = fuzz(
            processes.start,
            lambda driver: stack.enter_context(closing(driver)),
            Path(folder),
            THINGS,
            1.5 * TRIM_EVERY_S,
        )
    lost = outcome.lost_samples + outcome.lost_features
    ended = (
        f"{len(outcome.dead)} services ended, {len(outcome.tracebacks)} tracebacks, {lost} messages or features lost"
    )
    ended += f", {outcome.silent} neither recorded nor told"
    counted = f"{outcome.uncounted} not counted, {len(outcome.unnamed)} services that do not name it"
    grown, name, before_mib = max(
        ((after / before - 1, name, before) for name, (before, after) in outcome.resident_mib.items()),
        default=(0.0, "none is left", 0.0),
    )
    counted += f"; memory {grown:+.0%} of {before_mib:.0f} MiB at the most, {name}"
    measured = f"{outcome.sent} sent: {ended}, {counted}; {time.monotonic() - begun_s:.0f} s"
    ok = not (
        outcome.dead
        or outcome.tracebacks
        or outcome.amiss
        or lost
        or outcome.silent
        or outcome.uncounted
        or outcome.unnamed
        or grown > MOST_GROWN
    )
    what = f"{THINGS} things of a stranger on the graph, 17 services, one healthy stream"
    return [{"what": what, "target": TARGET, "measured": measured, "ok": ok}]

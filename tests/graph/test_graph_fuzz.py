"""A stranger on the graph who sends what nobody can use. In full: tests/bench/bench_graph_fuzz.py."""

import pytest
from fuzzed_study import fuzz

THINGS = 3000


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_nothing_that_a_stranger_sends_ends_a_service_or_costs_the_healthy_stream_anything(start, opened, tmp_path):
    """Every service of a study outlives it, no sample and no feature is lost, what was refused is counted and named."""
    outcome = fuzz(start, opened, tmp_path, THINGS)
    assert outcome.dead == []
    assert outcome.tracebacks == []
    assert outcome.amiss == []
    assert outcome.silent == 0, outcome
    assert (outcome.lost_samples, outcome.lost_features) == (0, 0), outcome
    assert outcome.sent >= THINGS * 0.9
    assert outcome.uncounted == 0
    assert outcome.unnamed == []

"""The estimator on any sequence of packets, accounts and measurements."""

import math

from clock_sync.estimator import ClockEstimator
from hypothesis import given, settings
from hypothesis import strategies as st

MS = 1_000_000
steps = st.one_of(st.integers(0, 100), st.integers(-3000, 20_000), st.sampled_from([0, 500, 10**7, -(10**7)]))
packets = st.tuples(st.just("packet"), st.sampled_from(["ecg", "accelerometer"]), steps, steps)
accounts = st.tuples(st.just("account"), st.sampled_from([0, 1, 30, 3000, -3000]))
measurements = st.tuples(st.just("measurement"), steps, steps, st.sampled_from([0.0, 1e-3, -1.0, math.nan, math.inf]))


@settings(max_examples=150)
@given(st.lists(st.one_of(packets, packets, packets, accounts, measurements), min_size=1, max_size=120))
def test_whatever_comes_the_model_is_finite_and_the_segment_never_falls(events):
    """Any order of packets, steps and measurements leaves finite numbers; only the uncertainty may be huge."""
    estimator = ClockEstimator()
    device, received, host, segment = 10**12, 1_700_000_000 * 10**9, 0, 0
    for event in events:
        if event[0] == "packet":
            device, received = max(device + event[2] * MS, 1), received + event[3] * MS
            estimator.packet(event[1], device, received)
        elif event[0] == "account":
            host += event[1] * MS
            received += event[1] * MS
            if estimator.host_clock(host):
                estimator.host_step(host)
        else:
            estimator.measurement(received + event[1] * MS, device + event[2] * MS, received - device, event[3])
        if estimator.known:
            model = estimator.model()
            assert all(map(math.isfinite, (model.skew_ppm, model.latency_s)))
            assert model.uncertainty_s >= 0
            assert abs(model.skew_ppm) <= 10_000
            assert model.segment >= segment
            segment = model.segment

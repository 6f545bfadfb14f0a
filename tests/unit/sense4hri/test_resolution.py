"""What a channel resolves."""

import numpy as np
from sense4hri.resolution import least_step


def test_the_step_is_that_of_the_converter():
    """Channels in steps of 0.02 and of 5, one that never changes, one without a number: 0.02, 5, NaN, NaN."""
    walk = np.cumsum(np.random.default_rng(1).normal(0, 3, 500))
    values = np.column_stack([np.round(walk / 0.02) * 0.02, np.round(walk / 5) * 5, np.ones(500), np.full(500, np.nan)])
    np.testing.assert_allclose(least_step(values), [0.02, 5.0, np.nan, np.nan], rtol=1e-6)
    assert np.isnan(least_step(values[:1])).all()

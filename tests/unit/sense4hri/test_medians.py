import numpy as np
import pytest
from sense4hri.medians import median


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101])
def test_it_is_numpy_s_median_to_the_bit(n):
    """Of odd and even numbers of values, in any order, infinite ones among them."""
    values = np.random.default_rng(n).normal(size=n)
    assert median(values) == np.median(values)
    assert median(np.append(values, np.inf)) == np.median(np.append(values, np.inf))

import numpy as np
import pytest
from sense4hri.medians import median, medians, quantile


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101])
def test_it_is_numpy_s_median_to_the_bit(n):
    """Of odd and even numbers of values, in any order, infinite ones among them."""
    values = np.random.default_rng(n).normal(size=n)
    assert median(values) == np.median(values)
    assert median(np.append(values, np.inf)) == np.median(np.append(values, np.inf))


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101])
def test_rows_have_numpy_s_medians_to_the_bit(n):
    """Each row of a matrix has its own; the matrix stays as it is."""
    rows = np.random.default_rng(n).normal(size=(4, n))
    before = rows.copy()
    assert (medians(rows) == np.median(rows, axis=1)).all()
    assert (rows == before).all()


@pytest.mark.parametrize("n", [1, 2, 3, 10, 101])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 0.95, 1.0])
def test_it_is_numpy_s_quantile_to_the_bit(n, share):
    """Of any share, on a value or between two."""
    values = np.random.default_rng(n).normal(size=n)
    assert quantile(values, share) == np.quantile(values, share)

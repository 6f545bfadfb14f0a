"""Windows that move along values."""

import numpy as np
import pytest
from sense4hri.windows import windows


@pytest.mark.parametrize("width", [1, 3, 7])
def test_they_are_those_of_numpy(width):
    """Row by row the same as numpy's own, of a part of an array too."""
    values = np.random.default_rng(1).normal(size=20)[3:10]
    assert np.array_equal(windows(values, width), np.lib.stride_tricks.sliding_window_view(values, width))


@pytest.mark.parametrize("width", [0, 8])
def test_a_window_that_does_not_fit_is_refused(width):
    """Neither of no values nor of more than there are."""
    with pytest.raises(ValueError, match=f"a window of {width} values does not fit into 7"):
        windows(np.zeros(7), width)


def test_values_with_others_between_them_are_refused():
    """Of every second value of an array it would show the wrong ones."""
    with pytest.raises(ValueError, match="contiguous"):
        windows(np.zeros(10)[::2], 3)

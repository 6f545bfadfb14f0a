"""At which rate samples really come, and where that cannot be known."""

from types import SimpleNamespace

import numpy as np
import pytest
from sense4hri.rate import TrueRate, UsualStep, usual_step_s

SECOND_NS = 10**9


def rate_of(samples_per_s: int, device: bool) -> float:
    """What is taken for the rate of a stream declared with 1000 Hz after 30 s."""
    rate = TrueRate(1000.0)
    for second in range(30):
        end_ns = second * SECOND_NS
        rate.take(
            SimpleNamespace(
                begins=second == 0,
                hole=None,
                end_ns=end_ns,
                times_ns=range(samples_per_s),
                device_ns=end_ns if device else None,
            )
        )
    return rate.hz


@pytest.mark.parametrize(
    ("samples_per_s", "device", "told_hz"),
    [(950, True, 950), (1050, True, 1050), (950, False, 1000), (1050, False, 1050), (850, False, 850)],
)
def test_what_may_be_lost_is_no_slower_rate(samples_per_s: int, device: bool, told_hz: float) -> None:
    """With device time lost samples are known; by arrival alone a twentieth less is a loss, nearly a sixth is not."""
    assert rate_of(samples_per_s, device) == pytest.approx(told_hz)


def test_the_usual_step_of_an_irregular_stream():
    """Samples of one time count for nothing, be they most of all; of nothing it is a second."""
    assert usual_step_s(np.array([0, 0, 0, 0, 20, 20, 40]) * 10**6) == 0.02
    assert usual_step_s(np.array([5, 5])) == usual_step_s(np.array([5])) == 1.0


def test_the_usual_step_is_another_once_five_blocks_agree_on_it():
    """Of a device that begins slowly the first second does not stay; blocks that differ tell nothing."""
    step = UsualStep()
    changed = [step.take(np.arange(10) * ms * 10**6) for ms in (100, 17, 16, 17, 17, 16, 17)]
    assert changed == [False] * 5 + [True, False]
    assert step.seconds == pytest.approx(0.017)
    assert not any(step.take(np.arange(10) * ms * 10**6) for ms in (2, 31) * 5)
    assert step.seconds == pytest.approx(0.017)

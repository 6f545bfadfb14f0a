"""What is missing by a board's own count, to the sample, through wraps, long silences and any polling."""

import numpy as np
import pytest
from driver_brainflow.counts import NUMBERINGS, Missing, Numbering

U8 = Numbering(256)
CASES = {name: (NUMBERINGS[name]["default"], rate_hz) for name, rate_hz in (("CYTON", 250.0), ("CYTON_DAISY", 125.0))}
CASES |= {"MUSE_2": (NUMBERINGS["MUSE_2"]["default"], 256.0)}


def missing(numbering: Numbering, rate_hz: float, numbers, stamps_s, polls=(), polled_s=None) -> list[int]:
    """Return what is missing before each sample, the samples fetched in parts."""
    counter, parts = Missing(numbering, rate_hz), np.split(np.arange(len(numbers)), polls)
    numbers, stamps_s = np.asarray(numbers, float), np.asarray(stamps_s, float)
    polled_s = stamps_s if polled_s is None else polled_s
    return [
        int(n)
        for part in parts
        if len(part)
        for n in counter.before(numbers[part], stamps_s[part], float(polled_s[part[-1]]))
    ]


@pytest.mark.parametrize("board", CASES)
@pytest.mark.parametrize("seed", range(4))
def test_one_percent_is_counted_exactly_through_all_wraps(board, seed):
    """Ten minutes with 1 % of the packets lost, polled at random: each loss is found, where it is, and no other."""
    (period, samples, step, _), rate_hz = CASES[board]
    rng = np.random.default_rng(seed)
    packets = np.flatnonzero(rng.random(round(600 * rate_hz / samples)) >= 0.01)
    numbers = np.repeat(packets * step % period, samples)
    came_s = np.repeat(packets * samples / rate_hz, samples) + rng.exponential(0.005, len(numbers))
    polls = np.unique(rng.integers(1, len(numbers), 15_000))
    found = missing(NUMBERINGS[board]["default"], rate_hz, numbers, came_s, polls)
    expected = np.zeros(len(numbers), int)
    expected[samples::samples] = (np.diff(packets) - 1) * samples
    assert found == expected.tolist()


@pytest.mark.parametrize("away_s", [1.0, 1.02, 1.024, 1.5, 2.044, 7.3, 60.0])
def test_rounds_that_went_by_unseen_are_counted(away_s):
    """A silence longer than a round of the counter costs all its samples, also where the rate is 0.2 % off.

    And where the number is the same before it and after, as if a sample had come twice.
    """
    lost = round(away_s * 250)
    numbers = np.r_[np.arange(300), np.arange(300 + lost, 600 + lost)]
    assert sum(missing(U8, 250.0, numbers % 256, numbers / 250.5, range(25, 600, 25))) == lost


def test_nothing_is_lost_where_a_poll_comes_late():
    """Samples fetched in one burst after a stall of the driver have BrainFlow's stamps and are all there."""
    numbers = np.arange(2000)
    assert sum(missing(U8, 250.0, numbers % 256, numbers / 250, [1, 1900])) == 0


def test_a_stall_of_the_host_has_lost_nothing():
    """0.6 s of silence, then all of it at once, none missing: whole rounds are not made up."""
    numbers = np.arange(1000)
    came_s = numbers / 250
    came_s[(numbers >= 500) & (numbers < 650)] = 650 / 250
    assert sum(missing(U8, 250.0, numbers % 256, came_s, range(10, 1000, 10))) == 0


def test_a_clock_that_is_set_has_lost_nothing():
    """The stamps are the wall clock's; how long it took is the monotonic clock's."""
    numbers, stamps_s = np.arange(1000), np.arange(1000) / 250
    stamps_s[500:] += 3600
    assert sum(missing(U8, 250.0, numbers % 256, stamps_s, range(10, 1000, 10), numbers / 250)) == 0


def test_a_generator_that_falls_behind_has_lost_nothing():
    """The SYNTHETIC board's numbers go on where they were after its thread was kept waiting for seconds."""
    numbers, stamps_s = np.arange(500), np.arange(500) / 250
    stamps_s[250:] += 3
    assert sum(missing(NUMBERINGS["SYNTHETIC"]["default"], 250.0, numbers % 256, stamps_s)) == 0


def test_a_recording_that_begins_again_has_lost_nothing():
    """Where the stamps go back the count may go anywhere."""
    assert sum(missing(U8, 250.0, [7, 8, 9, 0, 1], [9.0, 9.004, 9.008, 0.0, 0.004])) == 0


def test_the_first_sample_tells_of_nothing():
    """A board that is joined at any number has lost nothing yet."""
    assert missing(U8, 250.0, [200, 201], [5.0, 5.004]) == [0, 0]


def test_a_board_that_begins_to_count_anew_has_lost_nothing():
    """A number back at 0 a second later is no loss of 50 minutes, as when the sender of a STREAMING board restarts."""
    numbers = np.repeat([500, 501, 0, 1], 12)
    stamps_s = np.r_[np.arange(24), np.arange(280, 304)] / 256
    assert sum(missing(NUMBERINGS["MUSE_2"]["default"], 256.0, numbers, stamps_s, [24])) == 0

"""What is believed of receipt stamps beside the recorder's own time."""

import pytest
from sense4hri_recording.receipts import Receipts

HOUR, DAY = 3_600_000_000_000, 86_400_000_000_000
BEGUN = 1_700_000_000_000_000_000


def believed(*aheads: int) -> tuple[list[int], int]:
    """How far ahead of the recorder's time what is believed lies, and how many stamps were odd."""
    receipts = Receipts()
    logs = [BEGUN + i * 1_000_000_000 for i in range(len(aheads))]
    found = [receipts.believed_ns(log + ahead, log) - log for log, ahead in zip(logs, aheads, strict=True)]
    return found, receipts.odd


@pytest.mark.parametrize(
    ("aheads", "found", "odd"),
    [
        ((5, 6, 7), [5, 6, 7], 0),
        ((5, DAY, 6), [5, 5, 6], 1),
        ((DAY, 6, 7), [DAY, 6, 7], 1),
        ((-DAY, 6, 7), [-DAY, 6, 7], 1),
        ((-DAY, -DAY + 5, -DAY + 6), [-DAY, -DAY + 5, -DAY + 6], 0),
        ((DAY, 6, DAY, 7), [DAY, 6, 6, 7], 2),
        ((5, DAY, 2 * DAY, 6), [5, 5, 5, 6], 2),
        ((5, 6, DAY, DAY + 1), [5, 6, 6, DAY + 1], 1),
        ((5, HOUR // 2, 0), [5, HOUR // 2, 0], 0),
    ],
    ids=["steady", "one", "first", "first back", "far host", "first and third", "two", "set", "within an hour"],
)
def test_one_stamp_alone_that_leaps_is_no_time(aheads, found, odd):
    """A stamp that leaps is counted and the recorder's time stands in; a second one like it is the clock's."""
    assert believed(*aheads) == (found, odd)

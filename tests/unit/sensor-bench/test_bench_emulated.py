"""A driver's own emulator on the bench: what its file must have, and that no sample of it comes twice or never."""

import numpy as np
import pytest
from sense4hri.errors import ConfigError
from sensor_bench.emulated.file import loaded
from sensor_bench.emulated.lsl import EmulatedFeed, EmulatedLslKeys

SENDER = """
CONTENT_TYPE, SENSOR_TYPE, RATE_HZ, CHANNELS = "EDA", "eda", 25.0, (("skin", "nS", "EDA"),)
class VirtualDevice:
    def rows(self, first, count):
        return [[float(index)] for index in range(first, first + count)]
"""


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "no such file"),
        ("SERVICE = ", "invalid syntax"),
        ("import nowhere_at_all", "nowhere_at_all"),
        ("SERVICE = ''", "has no VirtualDevice"),
    ],
)
def test_a_file_that_cannot_be_played_is_named(tmp_path, text, reason):
    """Missing, no Python, or without what is asked for: one sentence with its path."""
    path = tmp_path / "emulator.py"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigError, match=rf"emulator.py.*{reason}|{reason}.*emulator.py"):
        loaded(str(path), "SERVICE", "VirtualDevice")


@pytest.mark.parametrize("step_s", [0.02, 0.033, 1.0])
def test_a_sender_gives_each_sample_once(tmp_path, step_s):
    """However its time is cut, the rows go on where they ended, at the file's rate."""
    path = tmp_path / "emulator.py"
    path.write_text(SENDER)
    feed = EmulatedFeed(
        EmulatedLslKeys(sensor="it", model="EmulatedLsl", participant="p1", name="it", emulator=str(path))
    )
    edges_s = np.arange(0.0, 10.0 + step_s / 2, step_s)
    taken = [each for edge_s in edges_s for each in feed.taken(edge_s, edge_s + step_s)]
    numbers = np.concatenate([each.rows[:, 0] for each in taken])
    assert numbers.tolist() == list(range(len(numbers)))
    assert np.concatenate([each.times_s for each in taken]) == pytest.approx(numbers / 25.0)

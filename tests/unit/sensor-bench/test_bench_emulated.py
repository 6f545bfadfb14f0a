"""A driver's own emulator on the bench: what its file must have, and that no sample of it comes twice or never."""

import numpy as np
import pytest
from sense4hri.errors import ConfigError
from sensor_bench.emulated.file import loaded
from sensor_bench.emulated.lsl import EmulatedFeed, EmulatedLslKeys

SENDER = """
OUTLETS = {
    "": ("Accelerometer", "accelerometer", 128.0, (("x", "milli-g", ""),)),
    "Events": ("Skin", "temperature", 0.0, (("skin", "C", ""), ("number", "", ""))),
}
class VirtualDevice:
    def __init__(self):
        self.taken = {name: 0 for name in OUTLETS}
    def at(self, name, number):
        return number / 128.0 if not name else number * 0.3 + 0.1 * (number % 3)
    def send(self, time_s):
        sampled = []
        for name in OUTLETS:
            while (at_s := self.at(name, self.taken[name])) < time_s:
                sampled.append((name, at_s, [float(self.taken[name])] * (2 if name else 1)))
                self.taken[name] += 1
        return sampled
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


def sender(tmp_path):
    """What the bench makes of a file with two outlets, the second one irregular."""
    path = tmp_path / "emulator.py"
    path.write_text(SENDER)
    return EmulatedFeed(
        EmulatedLslKeys(sensor="it", model="EmulatedLsl", participant="p1", name="It", emulator=str(path))
    )


def test_each_outlet_is_offered_under_a_name_and_source_id_of_its_own(tmp_path):
    """The first as the study calls the stream, the others with what the file calls them behind it."""
    feed = sender(tmp_path)
    assert [(each.name, each.source_id, each.rate_hz) for each in feed.outlets] == [
        ("It", "bench-it", 128.0),
        ("It Events", "bench-it-Events", 0.0),
    ]
    assert feed.types == (("accelerometer",), ("temperature",))


@pytest.mark.parametrize("step_s", [0.02, 0.033, 1.0])
def test_a_sender_gives_each_sample_once(tmp_path, step_s):
    """However its time is cut, the rows of each outlet go on where they ended, each with its time."""
    feed = sender(tmp_path)
    edges_s = np.arange(0.0, 10.0 + step_s / 2, step_s)
    taken = [each for edge_s in edges_s for each in feed.taken(edge_s, edge_s + step_s)]
    for outlet, time_of in enumerate((lambda number: number / 128.0, lambda number: number * 0.3 + 0.1 * (number % 3))):
        mine = [each for each in taken if each.outlet == outlet]
        numbers = np.concatenate([each.rows[:, 0] for each in mine])
        assert numbers.tolist() == list(range(len(numbers)))
        assert np.concatenate([each.times_s for each in mine]) == pytest.approx(time_of(numbers))


def test_what_is_sampled_while_the_machine_is_off_is_never_taken(tmp_path):
    """Nobody has sent it: it counts neither as sent nor as lost."""
    feed = sender(tmp_path)
    feed.taken(0.0, 1.0)
    (first, *_) = feed.taken(5.0, 6.0)
    assert (first.times_s[0], len(first.times_s)) == (5.0, 128)

"""A real recording; what is seen in it is in ../shared/data/REFERENCE.md, section 9."""

import numpy as np
from interpreter_emg.config import Config
from interpreter_emg.stream import EmgStream
from slow_signals import event_times_s, play


def test_two_episodes_and_nothing_elsewhere(shared_data):
    """BioSPPy's recording: active from 35 to 41 s and from 50 to 58 s, though only 1.5 and 2 times as loud as rest."""
    samples = np.loadtxt(shared_data / "emg" / "biosppy" / "emg.txt")
    updates = play(lambda info: EmgStream(Config(), info), samples, 1000.0, "emg", "counts")
    np.testing.assert_allclose(event_times_s(updates, "onset_timestamps"), [35.0, 50.0], atol=1.6)
    np.testing.assert_allclose(event_times_s(updates, "offset_timestamps"), [41.0, 58.0], atol=0.6)

"""A file as the sensor: what is missing in it is told by its own times."""

import tempfile
import time
from pathlib import Path

import numpy as np
from sense4hri.device import Samples
from sense4hri.stamps import SECOND_NS

from devices.played import LOSS, SIGNAL_S, Played, Tally


def columns_of_text() -> Played:
    """ECG at 250 Hz with a column of times in ms, some rows missing; five minutes, which begin again in the middle.

    The driver reads the file once, before it plays it: the codec's time holds both. Its times are compared with no
    clock: when a sample of a file is taken is what the driver decides by playing it.
    """
    from driver_file.config import FileConfig
    from driver_file.device import Tape
    from driver_file.transport import read

    fs_hz, random, tally = 250, np.random.default_rng(17), Tally(250.0)
    numbers = np.arange(int(SIGNAL_S / 2 * fs_hz))
    kept = random.random(len(numbers)) >= LOSS
    kept[[0, 1, -2, -1]] = True  # what is lost at an end nobody can count
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "ecg.csv"
        lines = [f"{1_700_000_000_000 + 4 * number},{number % 2000}" for number in numbers[kept].tolist()]
        file.write_text("\n".join(["time_ms,ECG (uV)", *lines, ""]))
        config = FileConfig(sensor_id="file_1", file=str(file), time_column="time_ms", time_unit="ms")
        begun_s = time.process_time()
        recorded, content = read(config)
        tape = Tape(recorded, content.events, config)
        codec_s = time.process_time() - begun_s
    for frame in range(2 * tape.frames):
        received_ns = round((1_700_000_000 + frame * config.frame_s) * SECOND_NS)
        begun_s = time.process_time()
        items = list(tape.items(frame, received_ns))
        codec_s += time.process_time() - begun_s
        for item in items:
            if isinstance(item, Samples):
                tally.take(item)
    sent, lost = 2 * len(numbers), 2 * int(np.sum(~kept))
    return Played("driver-file, columns of text at 250 Hz", sent, lost, tally.came, tally.lost, codec_s)

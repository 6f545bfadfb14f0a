"""The beats in a recording, by neurokit2.

`python -m sensor_bench.signals.detection PLAYBACK STREAM` prints them as JSON.

The bench runs it as a child process, which gives the 240 MB back that neurokit2 takes.
"""

import dataclasses
import json
import sys
from collections.abc import Iterator

import numpy as np
from sense4hri.signal_files.content import UnreadableFileError

from sensor_bench.signals import child
from sensor_bench.signals.playback import resampled
from sensor_bench.signals.recordings import Playback, Recording, load
from sensor_bench.signals.waveforms import FloatArray

DETECTORS = ("neurokit", "pantompkins1985")
"""Of neurokit2, in this order; the second is tried where the first finds no plausible rhythm."""
LOWEST_FS_HZ = 100.0
"""neurokit2's filters want at least this."""


async def detect_beats(playback: Playback, stream: str) -> FloatArray:
    """Beat times (s) in a recording, from a child process."""
    try:
        found = await child.result_of(
            "sensor_bench.signals.detection", json.dumps(dataclasses.asdict(playback)), stream
        )
    except child.ChildError as error:
        raise UnreadableFileError(f"{playback.file}: no beats found in it: {error}") from error
    return np.array(found)


def is_plausible(beats_s: FloatArray, duration_s: float) -> bool:
    """Whether the beats are a heart's: 25 to 240 per minute, through at least half of the recording."""
    if beats_s.size < 3:
        return False
    median_s = float(np.median(np.diff(beats_s)))
    return 0.25 <= median_s <= 2.4 and beats_s.size * median_s > duration_s / 2


def candidates(signal: FloatArray, fs_hz: float, stream: str) -> Iterator[FloatArray]:
    """Beat times (s) as one detector after the other finds them."""
    import neurokit2 as nk

    rate = round(fs_hz)
    if stream == "ppg":
        # counts fall with a pulse
        yield nk.ppg_findpeaks(nk.ppg_clean(-signal, sampling_rate=rate), sampling_rate=rate)["PPG_Peaks"] / fs_hz
        return
    for method in DETECTORS:
        cleaned = nk.ecg_clean(signal, sampling_rate=rate, method=method)
        _, found = nk.ecg_peaks(cleaned, sampling_rate=rate, method=method)
        yield np.asarray(found["ECG_R_Peaks"]) / fs_hz


def main() -> None:
    """Detect, and print; exit with a sentence where there is no rhythm."""
    playback, stream = Playback(**json.loads(sys.argv[1])), sys.argv[2]
    recording: Recording = load(playback, stream)
    fs_hz = recording.fs_hz * (1 if recording.fs_hz >= LOWEST_FS_HZ else 4)
    signal = resampled(recording, fs_hz)[:, 0]
    for beats_s in candidates(signal, fs_hz, stream):
        if is_plausible(beats_s, signal.size / fs_hz):
            json.dump(beats_s.tolist(), sys.stdout)
            return
    sys.exit("no regular heartbeat in it")


if __name__ == "__main__":
    main()

"""R peaks, heart rate, variability and quality of every ECG stream on the graph."""

import sys

from sense4hri import stamps, wire
from sense4hri.interpreter import run_interpreter
from sense4hri.stream_info import StreamInfo
from sense4hri_msgs.msg import ECG, HRV

from interpreter_ecg.config import Config
from interpreter_ecg.stream import EcgStream, EcgUpdate


def make_stream(config: Config, info: StreamInfo) -> EcgStream:
    """The state for one raw stream."""
    return EcgStream(config, info.sampling_frequency_hz, info.channel_names, info.unit)


def fill(message: ECG, update: EcgUpdate) -> None:
    """Write an update into a message; the kit has stamped it."""
    message.window_s = update.window_s
    message.peak_count = update.peak_count
    message.peak_timestamps = [stamps.from_ns(time_ns) for time_ns in update.peak_times_ns]
    message.rr_intervals_ms = wire.doubles(update.rr_intervals_ms)
    message.rr_interval_ms = update.rr_interval_ms
    message.heart_rate_bpm = update.heart_rate_bpm
    message.hrv = HRV(**update.hrv._asdict())
    message.device_heart_rate_difference_bpm = update.device_heart_rate_difference_bpm
    message.signal_quality = update.signal_quality
    message.extra = [wire.feature("r_amplitude", "uV", update.r_amplitude_uv)]
    message.reasons = list(update.reasons)


def main() -> int:
    """Run until stopped."""
    return run_interpreter("interpreter_ecg", Config, "ecg", make_stream, ECG, fill)


if __name__ == "__main__":
    sys.exit(main())

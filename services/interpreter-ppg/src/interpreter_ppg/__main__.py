"""Wires the pulse interpreter to ROS."""

import sys

from sense4hri import stamps, wire
from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import HRV, PPG

from interpreter_ppg.config import Config
from interpreter_ppg.stream import PpgStep, PpgUpdate


def fill(message: PPG, update: PpgUpdate) -> None:
    """Write an update into a message, but for its two stamps."""
    message.window_s = update.window_s
    message.peak_count = update.peak_count
    message.peak_timestamps = [stamps.from_ns(time_ns) for time_ns in update.peak_times_ns]
    message.rr_intervals_ms = wire.doubles(update.rr_intervals_ms)
    message.rr_interval_ms = update.rr_interval_ms
    message.heart_rate_bpm = update.heart_rate_bpm
    message.hrv = HRV(**update.hrv._asdict())
    message.device_heart_rate_difference_bpm = update.device_heart_rate_difference_bpm
    message.pulse_amplitude = update.pulse_amplitude
    message.channel_name = update.channel_name
    message.signal_quality = update.signal_quality
    message.reasons = list(update.reasons)


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter("interpreter_ppg", Config, "ppg", PpgStep, PPG, fill)


if __name__ == "__main__":
    sys.exit(main())

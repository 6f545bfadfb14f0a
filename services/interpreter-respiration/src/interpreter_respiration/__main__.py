"""Breaths, rate and quality of every belt, ECG and accelerometer on the graph."""

import sys

from sense4hri import motion
from sense4hri.interpreter import run_interpreter
from sense4hri.stream_info import StreamInfo
from sense4hri_msgs.msg import Respiration

from interpreter_respiration.config import Config
from interpreter_respiration.heart import HeartStream
from interpreter_respiration.stream import RespirationStream
from interpreter_respiration.update import RespirationUpdate

SOURCES = ("respiration", "ecg", "accelerometer")


def step(config: Config, info: StreamInfo) -> RespirationStream | HeartStream:
    """Return the state for one stream. Raises ValueError where it cannot show breathing."""
    return HeartStream(config, info) if info.name.sensor_type == "ecg" else RespirationStream(config, info)


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_respiration",
        Config,
        step,
        RespirationUpdate,
        Respiration,
        sources=SOURCES,
        publishes="respiration",
        beside=(motion.SENSOR_TYPE,),
    )


if __name__ == "__main__":
    sys.exit(main())

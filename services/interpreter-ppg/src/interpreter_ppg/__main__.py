"""Pulses, heart rate, variability and quality of every PPG stream on the graph."""

import sys

from sense4hri import motion
from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import PPG

from interpreter_ppg.config import Config
from interpreter_ppg.stream import PpgStream, PpgUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_ppg", Config, PpgStream, PpgUpdate, PPG, sources=("ppg",), beside=(motion.SENSOR_TYPE,)
    )


if __name__ == "__main__":
    sys.exit(main())

"""R peaks, heart rate, variability and quality of every ECG stream on the graph."""

import sys

from sense4hri import motion
from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import ECG

from interpreter_ecg.config import Config
from interpreter_ecg.stream import EcgStream, EcgUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_ecg", Config, EcgStream, EcgUpdate, ECG, sources=("ecg",), beside=(motion.SENSOR_TYPE,)
    )


if __name__ == "__main__":
    sys.exit(main())

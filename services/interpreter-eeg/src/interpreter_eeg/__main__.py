"""Band powers, indices and quality of every EEG stream on the graph."""

import sys

from sense4hri import motion
from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import EEG

from interpreter_eeg.config import Config
from interpreter_eeg.stream import EegStream, EegUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_eeg", Config, EegStream, EegUpdate, EEG, sources=("eeg",), beside=(motion.SENSOR_TYPE,)
    )


if __name__ == "__main__":
    sys.exit(main())

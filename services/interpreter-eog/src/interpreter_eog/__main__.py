"""Blinks, saccades, deflections and quality of every EOG stream on the graph."""

import sys

from sense4hri import motion
from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import EOG

from interpreter_eog.config import Config
from interpreter_eog.stream import EogStream, EogUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_eog", Config, EogStream, EogUpdate, EOG, sources=("eog",), beside=(motion.SENSOR_TYPE,)
    )


if __name__ == "__main__":
    sys.exit(main())

"""Tonic level, skin conductance responses and quality of every EDA stream on the graph."""

import sys

from sense4hri import motion
from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import EDA

from interpreter_eda.config import Config
from interpreter_eda.stream import EdaStream, EdaUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_eda", Config, EdaStream, EdaUpdate, EDA, sources=("eda",), beside=(motion.SENSOR_TYPE,)
    )


if __name__ == "__main__":
    sys.exit(main())

"""Cleaned size, baseline and change of the pupils of every stream on the graph."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import Pupillometry

from interpreter_pupillometry.config import Config
from interpreter_pupillometry.stream import PupilStream, PupilUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_pupillometry", Config, PupilStream, PupilUpdate, Pupillometry, sources=("pupillometry",)
    )


if __name__ == "__main__":
    sys.exit(main())

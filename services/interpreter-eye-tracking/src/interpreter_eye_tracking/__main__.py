"""Fixations, saccades, blinks and where gaze is, of every eye tracking stream on the graph."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import EyeTracking

from interpreter_eye_tracking.config import Config
from interpreter_eye_tracking.stream import EyeStream
from interpreter_eye_tracking.update import EyeUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_eye_tracking", Config, EyeStream, EyeUpdate, EyeTracking, sources=("eye_tracking",)
    )


if __name__ == "__main__":
    sys.exit(main())

"""Intensity, steps and posture of every accelerometer on the graph."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import Motion

from interpreter_motion.config import Config
from interpreter_motion.stream import MotionStream, MotionUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter("interpreter_motion", Config, MotionStream, MotionUpdate, Motion, sources=("accelerometer",))


if __name__ == "__main__":
    sys.exit(main())

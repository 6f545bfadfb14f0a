"""An interpreter of two streams of one device: ppg, and the accelerometer beside it."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import PPG
from toy_steps import Config, Moved, Pulse

if __name__ == "__main__":
    sys.exit(run_interpreter("toy_motion", Config, Moved, Pulse, PPG, sources=("ppg",), beside=("accelerometer",)))

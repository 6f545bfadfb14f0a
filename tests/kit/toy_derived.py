"""An interpreter of several sources that publishes another type: respiration from ECG or acceleration."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import Respiration
from toy_steps import Breaths, Config, DerivedBreathing

if __name__ == "__main__":
    sources = ("respiration", "ecg", "accelerometer")
    status = run_interpreter(
        "toy_derived", Config, DerivedBreathing, Breaths, Respiration, sources=sources, publishes="respiration"
    )
    sys.exit(status)

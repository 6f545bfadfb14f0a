"""An interpreter that counts samples: one update a second with the number of samples since the last one."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import ECG
from toy_steps import Config, Count, Counter

if __name__ == "__main__":
    sys.exit(run_interpreter("toy_interpreter", Config, Counter, Count, ECG, sources=("ecg",)))

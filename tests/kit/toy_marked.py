"""An interpreter that takes markers: the level of an EDA above that of the baseline."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import EDA
from toy_steps import Baseline, Config, Level

if __name__ == "__main__":
    sys.exit(run_interpreter("toy_marked", Config, Baseline, Level, EDA, sources=("eda",)))

"""Amplitude, frequency, activity and effort of every EMG stream on the graph."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import EMG

from interpreter_emg.config import Config
from interpreter_emg.stream import EmgStream, EmgUpdate


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter("interpreter_emg", Config, EmgStream, EmgUpdate, EMG, sources=("emg",))


if __name__ == "__main__":
    sys.exit(main())

"""Breaths, rate, variability and quality of every respiration stream on the graph."""

import sys

from sense4hri.interpreter import run_interpreter
from sense4hri_msgs.msg import Respiration

from interpreter_respiration.config import Config
from interpreter_respiration.stream import RespirationStream, RespirationUpdate

SOURCES = ("respiration",)


def main() -> int:
    """Run until stopped; return the exit status."""
    return run_interpreter(
        "interpreter_respiration", Config, RespirationStream, RespirationUpdate, Respiration, sources=SOURCES
    )


if __name__ == "__main__":
    sys.exit(main())

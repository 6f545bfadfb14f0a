"""Types of arguments that several commands here take."""

import argparse
import math


def positive(text: str) -> float:
    """Return a finite number above 0; else argparse names the argument and this text."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"is {text!r}, must be a number above 0")
    return number

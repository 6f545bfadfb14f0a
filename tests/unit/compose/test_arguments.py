"""What is wrong with an argument is said in words, before anything starts."""

import subprocess
import sys
from pathlib import Path

import pytest

COMPOSE = Path(__file__).resolve().parents[3] / "compose"


@pytest.mark.parametrize("given", ["-2", "0", "nan", "inf", "two"])
@pytest.mark.parametrize(("script", "option"), [("check_study.py", "--hours"), ("demo.py", "--duration")])
def test_a_length_that_is_none_is_refused(script: str, option: str, given: str) -> None:
    """Not above 0, not finite, no number: the option and what was given are named."""
    command = [sys.executable, str(COMPOSE / script), f"{option}={given}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert f"{option}: is '{given}', must be a number above 0" in done.stderr

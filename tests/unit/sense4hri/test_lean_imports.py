"""What no service needs is not loaded: each process is a container with its own memory."""

import os
import subprocess
import sys

PROBE = """
import sys
import sense4hri.driver
from sense4hri_msgs.msg import PhysioRaw
PhysioRaw()
names = "rosidl_parser.parser", "rosidl_generator_py.generate_py_impl", "lark", "em"
print([name for name in names if sys.modules.get(name)])
"""


def test_messages_come_without_rosidls_code_generator() -> None:
    """A driver imports the kit and a message, and neither brings the generator or its parsers."""
    done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_arithmetic_starts_no_threads() -> None:
    """A service computes on vectors too short to share among cores: numpy brings it no thread."""
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    program = "import sense4hri, numpy, os; print(len(os.listdir('/proc/self/task')))"
    assert subprocess.check_output([sys.executable, "-c", program], text=True, env=environment).strip() == "1"

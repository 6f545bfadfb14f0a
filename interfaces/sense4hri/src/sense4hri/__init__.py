"""The kit: names, stamps, sample times, parameters, health, and how to run a service.

The pure half (`errors schema names chunk sample_clock grid clock_model stamps hrv`) imports no ROS and works in a
notebook.
"""

import importlib.util
import os
import sys

if importlib.util.find_spec("rclpy"):  # a service's process, not an analyst's notebook
    # Vectors are short here: more threads only spin.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Message classes load rosidl's code generator with its parsers, 15 MB of them, and do without where there is none.
sys.modules.setdefault("rosidl_generator_py.generate_py_impl", None)  # type: ignore[arg-type]

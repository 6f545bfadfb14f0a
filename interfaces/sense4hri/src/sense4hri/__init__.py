"""The kit: names, stamps, sample times, parameters, health, and how to run a service.

The pure half (`errors schema names chunk sample_clock grid clock_model stamps hrv`) imports no ROS and works in a
notebook.
"""

import sys

# Message classes load rosidl's code generator with its parsers, 15 MB of them, and do without where there is none.
sys.modules.setdefault("rosidl_generator_py.generate_py_impl", None)  # type: ignore[arg-type]

"""The LSL session of this test process: other programs on the machine neither hear it nor are heard."""

import os

from pylsl.lib import lib
from sense4hri import lsl

SESSION = f"test-{os.getpid()}"
lib.lsl_set_config_content(lsl.settings((), SESSION).encode())  # liblsl reads it once, before anything else

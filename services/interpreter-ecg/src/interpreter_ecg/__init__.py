"""R peaks, heart rate, heart-rate variability and signal quality from raw ECG."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # vectors are short here: more threads only spin

"""R peaks, heart rate, heart-rate variability and signal quality from raw ECG."""

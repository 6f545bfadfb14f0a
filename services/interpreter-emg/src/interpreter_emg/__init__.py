"""Amplitude, frequency, activity, effort and quality from raw EMG."""

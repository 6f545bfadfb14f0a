"""Pulses, pulse-rate variability, amplitude and quality from raw PPG."""

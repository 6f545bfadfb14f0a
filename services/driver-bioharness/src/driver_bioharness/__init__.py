"""Zephyr BioHarness 3 over Bluetooth Classic: ECG, breathing, acceleration, R-R."""

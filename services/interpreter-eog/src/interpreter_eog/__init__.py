"""Blinks, saccades, deflections and quality from raw EOG."""

"""Breaths, rate, variability and quality from belts, ECGs and accelerometers."""

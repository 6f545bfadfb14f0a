"""Breaths, rate, variability and quality from belts."""

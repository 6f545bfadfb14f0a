"""Intensity, steps and posture from any accelerometer."""

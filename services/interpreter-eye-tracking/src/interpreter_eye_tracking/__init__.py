"""Fixations, saccades, blinks and spread of gaze from raw eye tracking."""

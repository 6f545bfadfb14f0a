"""Starts and stops sessions: all ready, one common start, one common end, all written."""

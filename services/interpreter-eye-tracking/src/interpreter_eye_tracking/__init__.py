"""Interpreter eye tracking."""

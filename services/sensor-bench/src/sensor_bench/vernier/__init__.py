"""Vernier Go Direct sensors: the respiration belt."""

"""Vernier Go Direct respiration belts over Bluetooth Low Energy."""

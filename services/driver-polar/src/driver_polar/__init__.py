"""Polar H10, Verity Sense and OH1 over Bluetooth Low Energy."""

"""Polar sensors as their firmware behaves: bytes, control point, models, GATT services."""

"""Any recording as a sensor, with its own times and units."""

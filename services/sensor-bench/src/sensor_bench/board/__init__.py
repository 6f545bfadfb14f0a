"""A virtual microcontroller that sends what its maker thought of."""

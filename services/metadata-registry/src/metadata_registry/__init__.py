"""Which sensors there are, their parameters, and who wears what."""

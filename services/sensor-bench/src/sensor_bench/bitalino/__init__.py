"""A virtual BITalino (r)evolution."""

"""A virtual Shimmer3."""

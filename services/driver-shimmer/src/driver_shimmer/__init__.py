"""Driver shimmer."""

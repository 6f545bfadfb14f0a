"""Driver bioharness."""

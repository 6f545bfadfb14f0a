"""Driver file."""
